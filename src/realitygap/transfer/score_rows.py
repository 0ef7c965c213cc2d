"""The score rows of a study: tables 1 and 2, a row for each run that is finished.

    from realitygap.study.load import load_study
    from realitygap.transfer.score_rows import marks_of

    for one in marks_of(load_study("out/reproduce")):
        print(one.name, one.type, one.behaviour, one.differences, one.correspondence)

A score row follows from the study and its transfers alone; what is in `marks.json` is not computed again.
"""

from collections import Counter
from collections.abc import Callable
from os import PathLike

from realitygap.robots.address import ROBOT, StandIn
from realitygap.study.load import Study, as_study
from realitygap.transfer.kept_rows import Kept
from realitygap.transfer.load import Transferred, load_transfers
from realitygap.transfer.score_row import Bench, Job, ScoreRow

__all__ = ["ScoreRow", "jobs_of", "kind_of", "marks_of"]

OnProgress = Callable[[int, int], None]


def marks_of(study: Study | str | PathLike[str], *, on_progress: OnProgress | None = None) -> list[ScoreRow]:
    """A score row for each finished run, individual and kind of robot; the champion's where none drove one.

    Args:
        study: with its transfers, as far as there are any; or its folder.
        on_progress: called with score rows done and in all.
    """
    study = as_study(study)
    kept = Kept(study.folder)
    jobs = [job for task in dict.fromkeys(run.task for run in study.runs) for job in jobs_of(study, task)]
    marks = []
    for k, job in enumerate(jobs):
        if on_progress:
            on_progress(k, len(jobs))
        made = kept.get(job.key)
        if made is None:
            made = job.mark().to_dict()
            kept.put(job.key, made)
        marks.append(ScoreRow(**made))
    kept.save({job.key for job in jobs})
    if on_progress:
        on_progress(len(jobs), len(jobs))
    return marks


def kind_of(one: Transferred) -> str:
    """The kind of robot: what may be judged together."""
    stand_in = StandIn.of_folder(one.robot)
    return ROBOT if stand_in is None else stand_in.kind


def jobs_of(study: Study, task: str) -> list[Job]:
    """The score rows to be made of a task, in the order of its runs; robots before twins."""
    runs = [run for run in study.runs if run.task == task and run.finished]
    found: dict[tuple[int, str, str], list[Transferred]] = {}
    for one in load_transfers(study.folder):
        if one.task == task:
            found.setdefault((one.run, kind_of(one), one.individual), []).append(one)
    counts: dict[tuple[str, str], Counter[int]] = {}
    for (_, kind, individual), several in found.items():
        counts.setdefault((kind, individual), Counter())[len({one.start for one in several})] += 1
    usual = {key: min(count, key=lambda starts: (-count[starts], starts)) for key, count in counts.items()}
    bench = Bench(study=study, task=study.task(task), scales=usual)
    order = sorted(usual, key=lambda key: (key[0] != ROBOT, len(key[0]), key)) or [("", "champion")]
    return [
        Job(bench=bench, run=run, individual=individual, kind=kind,
             transfers=tuple(found.get((run.id, kind, individual), ())))
        for kind, individual in order
        for run in runs
    ]  # fmt: skip
