"""The score rows of a study: tables 1 and 2, a row for each run that is finished.

    from realitygap.study.load import load_study
    from realitygap.transfer.score_rows import marks_of

    for one in marks_of(load_study("out/reproduce")):
        print(one.name, one.type, one.behaviour, one.differences, one.correspondence)

A score row follows from the study and its transfers alone; what is in `marks.json` is not computed again,
for as long as it holds.
"""

import contextlib
import json
from collections import Counter
from collections.abc import Callable, Collection
from os import PathLike
from pathlib import Path
from typing import Any

from realitygap import whole
from realitygap.robots.address import ROBOT, StandIn
from realitygap.study.digest import check_of
from realitygap.study.load import Study, as_study
from realitygap.transfer.load import Transferred, load_transfers
from realitygap.transfer.score_row import Bench, Job, ScoreRow
from realitygap.work.pool import Setup, Tell
from realitygap.work.workers import Workers, near, opened

__all__ = ["MARKS", "ScoreRow", "jobs_of", "kind_of", "marks_of"]

MARKS = "marks.json"

OnProgress = Callable[[int, int], None]

FEW = 4
"""So many rows are made sooner than other processes have loaded what they need."""


def marks_of(
    study: Study | str | PathLike[str], *, workers: Workers = 1, on_progress: OnProgress | None = None
) -> list[ScoreRow]:
    """A score row for each finished run, individual and kind of robot; the champion's where none drove one.

    Args:
        study: with its transfers, as far as there are any; or its folder.
        workers: who makes them: processes (None: one a core), or a pool; changes no bit.
        on_progress: called with score rows done and in all.
    """
    study = as_study(study)
    kept = _Kept(study.folder)
    jobs = [job for task in dict.fromkeys(run.task for run in study.runs) for job in jobs_of(study, task)]
    keys = [job.key for job in jobs]
    left = [k for k, key in enumerate(keys) if kept.get(key) is None]
    tell, made = on_progress or (lambda done, total: None), dict[int, ScoreRow]()

    def heard(message: tuple[int, ScoreRow]) -> None:
        made[message[0]] = message[1]
        tell(len(jobs) - len(left) + len(made), len(jobs))

    tell(len(jobs) - len(left), len(jobs))
    with opened(1 if len(left) <= FEW else near(workers)) as pool:
        pool.work(Setup(_Scorer), [(k, jobs[k]) for k in left], heard)
    for k in left:
        kept.put(keys[k], made[k].to_dict())
    kept.save(set(keys))
    return [ScoreRow(**row) for row in map(kept.get, keys) if row is not None]


class _Kept:
    """The score rows in a folder's file, each with a checksum.

    What is broken or was edited is computed anew; a file that cannot be written is done without.
    """

    def __init__(self, folder: Path) -> None:
        self._file = folder / MARKS
        self._marks: dict[str, dict[str, Any]] = {}
        with contextlib.suppress(OSError, ValueError, RecursionError):
            there = json.loads(self._file.read_text("utf-8"))
            if isinstance(there, dict):
                self._marks = {key: kept["mark"] for key, kept in there.items() if _is_sound(kept)}
        self._changed = False

    def get(self, key: str) -> dict[str, Any] | None:
        """The score row that was made of just this."""
        return self._marks.get(key)

    def put(self, key: str, mark: dict[str, Any]) -> None:
        """Keep a score row."""
        self._marks[key] = mark
        self._changed = True

    def save(self, wanted: Collection[str]) -> None:
        """Write the file, without what nobody asks for any more; not through a link."""
        if not self._changed or self._file.is_symlink():
            return
        kept = {k: {"mark": mark, "check": check_of(mark)} for k, mark in self._marks.items() if k in wanted}
        with contextlib.suppress(OSError):
            whole.write(self._file, json.dumps(kept, indent=1))


def _is_sound(kept: object) -> bool:
    """Whether this is a score row as it was kept."""
    return isinstance(kept, dict) and "mark" in kept and kept.get("check") == check_of(kept["mark"])


class _Scorer:
    """Makes score rows; a job takes along all that its row follows from but the trials' files."""

    def carry_out(self, job: tuple[int, Job], tell: Tell) -> None:
        """One row, with its number."""
        tell((job[0], job[1].mark()))

    def close(self) -> None:
        """Nothing is held."""


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
