"""Carries out a study: creates or resumes its folder, gives its runs to workers, writes their results.

Shards, which were carried out apart, are merged to the same bits as in one piece.
"""

import shlex
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, closing, contextmanager
from pathlib import Path

from realitygap.errors import StudyError, StudyInterruptedError
from realitygap.files import as_path, must_be
from realitygap.study.config import StudyConfig
from realitygap.study.folder import (
    Inputs,
    Materials,
    exists,
    gather,
    home_of,
    input_files,
    inputs_for,
    open_folder,
    own_config,
    read_materials,
    refuse_other,
    take_back,
    write_files,
)
from realitygap.study.jobs import Finished, Job, Message, Rehearsal, StudyExecutor
from realitygap.study.load import Study, load_study
from realitygap.study.provenance import versions
from realitygap.study.store import DATABASE, LOST, Reader, Store
from realitygap.work.folder import file_errors, lock, new_folder
from realitygap.work.pool import Pool, Processes, Setup, Workers, opened
from realitygap.work.progress import OnProgress, Progress, Reporter
from realitygap.work.shard import Mark, Shard, marked

__all__ = ["COMPILING", "EVOLVING", "FINISHED", "WORK", "Progress", "merge_runs", "run_study"]

COMPILING = "compiling (once)"
EVOLVING = "evolving"
TESTING = "testing"
"""The phase of tests after all evaluations."""
WORK = "evolve"
"""The kind of work that a shard divides."""
FINISHED = "finished already"
"""The phase of a study that has nothing left to do."""


def run_study(
    folder: str | Path,
    config: StudyConfig | None = None,
    *,
    workers: Workers = None,
    resume: bool = False,
    shard: Shard | str | None = None,
    engine: str = "cores",
    on_progress: OnProgress | None = None,
) -> Study:
    """Carry out a study in a folder, or continue the one that is there.

    Neither `workers` nor interruptions change a bit of the result.

    Args:
        folder: created if it does not exist.
        config: the study's configuration; None to resume a study with its own.
        workers: processes that carry out runs, one a core if None, 1 stays in this process; or a pool.
        resume: continue the study in the folder; without one, create it from `config`.
        shard: the share of the runs to carry out, such as "1/2"; a started one keeps its share. `merge` makes
            the study from all shards' folders.
        engine: "cores", or "cuda": an NVIDIA GPU runs the trials of all runs side by side, without workers.
        on_progress: called a few times a second.

    Returns:
        The study, finished (for a shard its runs). A finished study is returned unchanged.

    Raises:
        UsageError: a wrong configuration, or a folder that cannot be used.
        StudyInterruptedError: Ctrl-C; what was saved is kept.
    """
    folder = as_path(folder, "folder")
    shard = None if shard is None else Shard.parse(shard)
    if config is not None:
        must_be(config, StudyConfig, "config", "StudyConfig.single(task) makes one.")
    try:
        with opened(workers) as pool:
            requested = None if config is None else gather(config)
            with lock(folder), _taken_back(folder, requested):
                mark = marked(folder, shard, WORK, begun=exists(folder))
                if mark is not None and not exists(folder):
                    with file_errors(folder):
                        mark.write(folder, finished=False)
                executor = StudyExecutor(open_folder(folder, requested, resume=resume), engine)
                _carry_out(folder, executor, pool, mark, on_progress)
                if mark is not None:
                    with file_errors(folder):
                        mark.write(folder, finished=True)
    except KeyboardInterrupt:
        kept = f"What was saved in {folder} is kept: resume it (--resume)."
        raise StudyInterruptedError(f"stopped. {kept}") from None
    return load_study(folder)


@contextmanager
def _taken_back(folder: Path, requested: Materials | None) -> Iterator[None]:
    """Leave nothing behind if the start fails, so that the cause can be fixed."""
    new = not exists(folder)
    try:
        yield
    except Exception:
        if new and requested is not None:
            take_back(folder, requested)
        raise


def _carry_out(
    folder: Path, executor: StudyExecutor, pool: Pool, mark: Mark | None, on_progress: OnProgress | None
) -> None:
    """Carry out all unfinished runs (for a shard its own), and count what is stored."""
    with Store(folder / DATABASE) as store:
        runs = executor.runs if mark is None else mark.shard.own(executor.runs)
        left = {run: executor.config.evaluations - done for run, done in store.unfinished() if run in runs}
        total = len(runs) * executor.config.evaluations
        count = {"done": total - sum(left.values()), "runs_done": len(runs) - len(left), "new": 0}
        tests = {run: executor.tests_cost(run) for run in left}
        costs = {run: executor.cost(run, n) + tests[run] for run, n in left.items()}
        testing = sum(tests.values())
        reporter = Reporter(on_progress, {EVOLVING: sum(costs.values()) - testing, TESTING: testing})

        def phase(name: str) -> None:
            counts = {"runs_done": count["runs_done"], "runs_total": len(runs)}
            reporter.phase(name, done=count["done"], total=total, what="evaluations", **counts)

        def keep(*messages: Message) -> None:
            store.keep(messages)
            for message in messages:
                if isinstance(message, Finished):
                    count["runs_done"] += 1
                    reporter.add(tests[message.run], of=TESTING, runs_done=count["runs_done"])
                    continue
                n = len(message.records.number)
                count["done"], count["new"] = count["done"] + n, count["new"] + n
                pace = count["new"] / max(reporter.spent, 1e-9) if reporter.spent else 0.0
                cost = executor.cost(message.run, n)
                reporter.add(cost, done=n, of=EVOLVING, evaluations_per_second=pace)
                if count["done"] == total:
                    phase(TESTING)

        phase(COMPILING if left else FINISHED)
        if not left:
            return
        store.begin_session({**versions(), "engine": executor.engine})
        setup = Setup(executor_for, (inputs_for(folder, pool),), here=executor)
        if isinstance(pool, Processes) and min(pool.size, len(left)) > 1 and executor.engine == "cores":
            pool.work(setup, (Rehearsal(False), Rehearsal(True)), lambda message: None)
        executor.compile()
        phase(EVOLVING)
        longest_first = sorted(costs, key=lambda run: (-costs[run], run))
        jobs = (Job(run, store.checkpoint(run, executor.read)) for run in longest_first)
        if executor.engine == "cores":
            pool.work(setup, jobs, keep)
            if any(run in left for run, _ in store.unfinished()):
                raise StudyError(LOST)
            return
        with closing(executor.messages(jobs)) as bundles:
            for messages in bundles:
                keep(*messages)


def executor_for(inputs: Inputs) -> StudyExecutor:
    """A study's executor, in any worker."""
    held = ExitStack()  # Numba looks for its tasks in the folder
    return StudyExecutor(read_materials(home_of(inputs, held)), held=held)


def merge_runs(shards: Mapping[Shard, Path], out: Path) -> Study:
    """The study of all shards' runs, in a new folder, complete or not at all.

    Args:
        shards: their folders, as from `work.shard.all_shards`.
        out: the new folder.

    Raises:
        StudyError: shards of different studies, a damaged or unfinished one, or `out` exists.
    """
    first, *others = shards.values()
    for folder in shards.values():
        own_config(folder)  # its files are as they were
    for folder in others:
        refuse_other(first, folder)
    with new_folder(out, f"realitygap report {shlex.quote(str(out))}") as half:
        runs = {folder: _finished(folder, shard) for shard, folder in shards.items()}
        write_files(half, input_files(first))
        Reader(first / DATABASE).copy(half / DATABASE)
        with Store(half / DATABASE) as store:
            for folder in others:
                store.take(folder / DATABASE, runs[folder])
    return load_study(out)


def _finished(folder: Path, shard: Shard) -> Sequence[int]:
    """A shard's runs.

    Raises:
        StudyError: it is damaged, or one is not finished, although the shard is marked as finished.
    """
    reader = Reader(folder / DATABASE)
    reader.check()
    own = shard.own(reader.runs())
    for run in own:
        if not run["finished"]:
            raise StudyError(
                f"{folder}: run {run['id']} of shard {shard} is not finished, though the shard is marked so: "
                "it was copied while it was worked on. Copy it once more, or finish the copy (--resume)."
            )
    return [run["id"] for run in own]
