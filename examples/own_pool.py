"""A pool of your own: threads make a study's runs, and its digest is that of any other pool.

python examples/own_pool.py                                     # makes the study twice and compares
realitygap evolve avoidance --workers examples/own_pool.py:Threads
"""

import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor, as_completed
from hashlib import sha256
from pathlib import Path

from realitygap import StudyConfig, run_study
from realitygap.work.pool import messages_of


class Threads:
    """Two threads; a job's messages come all together when it is done."""

    def __init__(self, size=2):
        self.executor = ThreadPoolExecutor(size)

    def work(self, setup, jobs, tell):
        """Carry out all jobs; pass every message to `tell`, here in the thread that asked."""
        futures = [self.executor.submit(messages_of, setup, job) for job in jobs]
        try:
            for done in as_completed(futures):
                for message in done.result():  # raises what the job raised
                    tell(message)
        finally:
            for one in futures:
                one.cancel()

    def close(self):
        """Let the threads end."""
        self.executor.shutdown()


def digest(study):
    """One number of every evaluation and test of the study."""
    tables = (*study.evaluations().values(), *study.tests().values(), *study.retests().values())
    genes = [study.genotypes(run.id) for run in study.runs]
    return sha256(b"".join(table.tobytes() for table in (*tables, *genes))).hexdigest()


def main(folder):
    config = StudyConfig.single("avoidance", runs=2, evaluations=70, retest_trials=2, fresh_trials=2)
    config = config.with_settings(["task.seconds=2"])
    threads = Threads()
    mine = run_study(folder / "threads", config, workers=threads)
    threads.close()
    usual = run_study(folder / "usual", config, workers=1)
    print(digest(mine), digest(usual), sep="\n")


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as place:
        main(Path(sys.argv[1] if len(sys.argv) > 1 else place))
