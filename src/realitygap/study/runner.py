"""Carry out a study: make or resume its folder, give its runs to workers, write what they find."""

from __future__ import annotations

from collections.abc import Generator, Iterator
from contextlib import closing, contextmanager
from pathlib import Path

from realitygap.errors import RealityGapError, StudyInterruptedError
from realitygap.study.config import StudyConfig
from realitygap.study.folder import exists, lock, open_folder, take_back, versions
from realitygap.study.jobs import Advanced, Job, Message, Workshop
from realitygap.study.load import Study, load_study
from realitygap.study.materials import Materials, gather
from realitygap.study.progress import OnProgress, Progress, Reporter
from realitygap.study.reader import DATABASE
from realitygap.study.settings import whole
from realitygap.study.store import Store
from realitygap.study.workers import Pool, cores, refuse_unguarded_script
from realitygap.text import as_path, must_be

__all__ = ["Progress", "run_study"]


def run_study(
    folder: str | Path,
    config: StudyConfig | None = None,
    *,
    workers: int | None = None,
    resume: bool = False,
    on_progress: OnProgress | None = None,
) -> Study:
    """Carry out a study in a folder, or go on with the one that is there.

    Neither `workers` nor an interruption at any moment changes a bit of the result.

    Args:
        folder: made if it does not exist.
        config: what to do; None to resume a study as it was made.
        workers: processes that carry out runs, one a core if None; 1 stays in this process.
        resume: go on with the study that is in the folder; without one, make it from `config`.
        on_progress: called a few times a second.

    Returns:
        The finished study. A study that is finished already is left as it is.

    Raises:
        UsageError: a wrong configuration, or a folder that cannot be used.
        StudyInterruptedError: Ctrl-C; what was saved is kept.
    """
    folder = as_path(folder, "folder")
    if config is not None:
        must_be(config, StudyConfig, "config", "StudyConfig.single(task) makes one.")
    size = cores() if workers is None else workers
    whole("workers", size, 1, 1024)
    refuse_unguarded_script()
    try:
        requested = None if config is None else gather(config)
        with lock(folder), _taken_back(folder, requested):
            workshop = Workshop(open_folder(folder, requested, resume=resume))
            with Store(folder / DATABASE) as store:
                _carry_out(folder, workshop, store, size, on_progress)
    except KeyboardInterrupt:
        kept = f"What was saved in {folder} is kept: resume it (--resume)."
        raise StudyInterruptedError(f"stopped. {kept}") from None
    return load_study(folder)


@contextmanager
def _taken_back(folder: Path, requested: Materials | None) -> Iterator[None]:
    """A start that fails leaves nothing behind, so that what was wrong can be mended."""
    new = not exists(folder)
    try:
        yield
    except RealityGapError:
        if new and requested is not None:
            take_back(folder, requested)
        raise


def _carry_out(
    folder: Path, workshop: Workshop, store: Store, workers: int, on_progress: OnProgress | None
) -> None:
    """All runs that are not finished."""
    config = workshop.config
    unfinished = store.unfinished()
    total = config.runs * len(config.conditions)
    left = {run: config.evaluations - done for run, done in unfinished}
    costs = {run: workshop.cost(run, n) + workshop.tests_cost(run) for run, n in left.items()}
    reporter = Reporter(on_progress, runs=total, evaluations=config.evaluations)
    done = total * config.evaluations - sum(left.values())
    reporter.start(done=done, runs_done=total - len(left), work=sum(costs.values()))
    if not unfinished:
        return
    store.begin_session(versions())
    workshop.compile()
    reporter.begin()
    longest_first = sorted(costs, key=lambda run: (-costs[run], run))
    jobs = (Job(run, store.checkpoint(run, workshop.read)) for run in longest_first)
    with closing(_messages(folder, workshop, jobs, min(workers, len(left)))) as messages:
        for message in messages:
            _keep(workshop, store, reporter, message)


def _messages(folder: Path, workshop: Workshop, jobs: Iterator[Job], workers: int) -> Generator[Message]:
    """What comes of the jobs, here or from processes."""
    if workers == 1:
        for job in jobs:
            yield from workshop.carry_out(job)
    else:
        with Pool(folder, workers) as pool:
            yield from pool.work(jobs)


def _keep(workshop: Workshop, store: Store, reporter: Reporter, message: Message) -> None:
    """Write a message to the store, then count it."""
    run = message.run
    if isinstance(message, Advanced):
        store.advance(run, message.records, message.kept)
        count = len(message.records.number)
        reporter.add(evaluations=count, work=workshop.cost(run, count))
    else:
        store.finish(run, message.results)
        reporter.add(runs=1, work=workshop.tests_cost(run))
