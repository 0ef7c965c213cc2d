"""The score rows of a study: tables 1 and 2, a row for each run that is finished.

    from realitygap.study.load import load_study
    from realitygap.transfer.score_rows import marks_of

    for one in marks_of(load_study("out/reproduce")):
        print(one.name, one.type, one.behaviour, one.differences, one.correspondence)

A score row follows from the study and its transfers alone; what is in `marks.json` is not computed again.
"""

import contextlib
import hashlib
import json
from collections import Counter
from collections.abc import Callable, Collection, Iterable
from functools import cache
from importlib.resources import files
from os import PathLike
from pathlib import Path
from typing import Any

from realitygap import whole
from realitygap.robots.address import ROBOT, StandIn
from realitygap.study.digest import check_of
from realitygap.study.load import Study, as_study
from realitygap.transfer.load import Transferred, load_transfers
from realitygap.transfer.packed import content
from realitygap.transfer.score_row import Bench, Job, ScoreRow

__all__ = ["MARKS", "Kept", "ScoreRow", "digest", "kind_of", "marks_of"]

MARKS = "marks.json"


class Kept:
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


def digest(words: Iterable[object], data: bytes, paths: Iterable[Path]) -> str:
    """A key for a score row: of all that it follows from, and of the rules that it is made by."""
    found = hashlib.blake2b(_rules(), digest_size=16)
    found.update(repr(list(words)).encode())
    found.update(data)
    for path in paths:
        found.update(content(path) or b"none")
    return found.hexdigest()


@cache
def _rules() -> bytes:
    """The text of the room that names and scores, its exemplars included."""
    found = hashlib.blake2b(digest_size=16)
    for room in ("realitygap.correspondence", "realitygap.correspondence.exemplars"):
        for entry in sorted(files(room).iterdir(), key=lambda entry: entry.name):
            if entry.name.endswith((".py", ".json", ".npz")):
                found.update(entry.read_bytes())
    return found.digest()


OnProgress = Callable[[int, int], None]


def marks_of(study: Study | str | PathLike[str], *, on_progress: OnProgress | None = None) -> list[ScoreRow]:
    """A score row for each finished run, individual and kind of robot; the champion's where none drove one.

    Args:
        study: with its transfers, as far as there are any; or its folder.
        on_progress: called with score rows done and in all.
    """
    study = as_study(study)
    kept = Kept(study.folder)
    jobs = [job for task in dict.fromkeys(run.task for run in study.runs) for job in _jobs(study, task)]
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


def _jobs(study: Study, task: str) -> list[Job]:
    """The score rows of a task, in the order of its runs; robots before twins."""
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
