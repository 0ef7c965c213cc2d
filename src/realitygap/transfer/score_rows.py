"""The score rows of a study: tables 1 and 2, a row for each finished run.

    from realitygap.study.load import load_study
    from realitygap.transfer.score_rows import marks_of

    for one in marks_of(load_study("out/reproduce")):
        print(one.name, one.type, one.behaviour, one.differences, one.correspondence)

A score row follows from the study and its transfers alone; valid rows in `marks.json` are not computed again.
"""

import contextlib
import json
from collections import Counter
from collections.abc import Callable, Mapping
from os import PathLike
from pathlib import Path
from typing import Any

from realitygap.files import atomic_write
from realitygap.robots.address import ROBOT, StandIn
from realitygap.study.load import Study, as_study
from realitygap.transfer.load import Transferred, load_transfers
from realitygap.transfer.score_row import Bench, Job, ScoreRow
from realitygap.values import Closing
from realitygap.work.pool import Setup, Tell, Workers, near, opened

__all__ = ["MARKS", "ScoreRow", "jobs_of", "kind_of", "marks_of"]

MARKS = "marks.json"

OnProgress = Callable[[int, int], None]

FEW = 4
"""Up to this number rows are computed before other processes could load what they need."""
TOGETHER = 5
"""Rows in a job: those of one task share their study and their namer, which arrive and are made once."""


def marks_of(
    study: Study | str | PathLike[str], *, workers: Workers = 1, on_progress: OnProgress | None = None
) -> list[ScoreRow]:
    """A score row for each finished run, individual and kind of robot; the champion's if none drove a robot.

    Args:
        study: with its transfers, if any; or its folder.
        workers: processes (None: one a core), or a pool; does not affect the results.
        on_progress: called with score rows done and in all.
    """
    study = as_study(study)
    kept = _read(study.folder / MARKS)
    jobs = jobs_of(study)
    keys = [job.key for job in jobs]
    left = [k for k, key in enumerate(keys) if key not in kept]
    tell, made = on_progress or (lambda done, total: None), dict[int, ScoreRow]()

    def heard(message: tuple[int, ScoreRow]) -> None:
        made[message[0]] = message[1]
        tell(len(jobs) - len(left) + len(made), len(jobs))

    tell(len(jobs) - len(left), len(jobs))
    with opened(1 if len(left) <= FEW else near(workers)) as pool:
        some = (left[first : first + TOGETHER] for first in range(0, len(left), TOGETHER))
        pool.work(Setup(_Scorer), [[(k, jobs[k]) for k in rows] for rows in some], heard)
    kept |= {keys[k]: made[k].to_dict() for k in left}
    if left:
        _write(study.folder / MARKS, {key: row for key, row in kept.items() if key in keys})
    return [ScoreRow(**kept[key]) for key in keys]


def _read(file: Path) -> dict[str, dict[str, Any]]:
    """Stored rows, by key; a broken file counts as empty."""
    with contextlib.suppress(OSError, ValueError, TypeError, AttributeError, RecursionError):
        return {key: ScoreRow(**row).to_dict() for key, row in json.loads(file.read_text("utf-8")).items()}
    return {}


def _write(file: Path, rows: Mapping[str, dict[str, Any]]) -> None:
    """Store rows, but not through a link; a file that cannot be written is ignored."""
    if not file.is_symlink():
        with contextlib.suppress(OSError):
            atomic_write(file, json.dumps(rows, indent=1))


class _Scorer(Closing):
    """Computes score rows; a job contains everything that its rows follow from except the trials' files."""

    def carry_out(self, job: list[tuple[int, Job]], tell: Tell) -> None:
        """Some rows, each with its number."""
        for k, row in job:
            tell((k, row.mark()))


def kind_of(one: Transferred) -> str:
    """The kind of robot: trials of one kind are judged together."""
    stand_in = StandIn.of_folder(one.robot)
    return ROBOT if stand_in is None else stand_in.kind


def jobs_of(study: Study) -> list[Job]:
    """The score rows to compute, task by task, in the order of its runs; robots before twins."""
    every, tasks = load_transfers(study.folder), dict.fromkeys(run.task for run in study.runs)
    return [job for task in tasks for job in _of_task(study, task, every)]


def _of_task(study: Study, task: str, every: list[Transferred]) -> list[Job]:
    runs = [run for run in study.runs if run.task == task and run.finished]
    found: dict[tuple[int, str, str], list[Transferred]] = {}
    for one in every:
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
