"""Tables 1 and 2: types, behaviour scores, differences, correspondence scores, beside the paper's."""

import csv
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from itertools import zip_longest
from pathlib import Path
from typing import NamedTuple

from realitygap.files import to_csv
from realitygap.report.evolution import PER_CONDITION, Mean, mean_of
from realitygap.study.load import Study
from realitygap.tasks.task import Task
from realitygap.transfer.scores import ScoreRow, marks_of
from realitygap.world.robot import noise_level, noise_name

__all__ = [
    "PAPER_ROWS", "ScoreTable", "score_tables", "scores_csv", "study_tables",
]  # fmt: skip


class PaperRow(NamedTuple):
    """A controller of the paper, with its judges' scores out of 10."""

    type: str
    behaviour: int
    differences: str
    correspondence: int


def _paper_rows() -> dict[str, dict[float, tuple[PaperRow, ...]]]:
    found: dict[str, dict[float, tuple[PaperRow, ...]]] = {}
    lines = Path(__file__).with_name("paper_tables.csv").read_text("utf-8").splitlines()
    for task, noise, kind, behaviour, differences, correspondence in list(csv.reader(lines))[1:]:
        rows = found.setdefault(task, {})
        row = PaperRow(kind, int(behaviour), differences, int(correspondence))
        rows[float(noise)] = (*rows.get(float(noise), ()), row)
    return found


PAPER_ROWS: Mapping[str, Mapping[float, tuple[PaperRow, ...]]] = _paper_rows()
"""By task and noise level."""

SCORES = ("behaviour", "correspondence")


@dataclass(frozen=True, kw_only=True)
class ScoreClass:
    """The score rows of the runs evolved at one noise level, and the paper's of that level, if any."""

    level: float
    name: str
    marks: tuple[ScoreRow, ...]
    paper: tuple[PaperRow, ...]

    @property
    def paper_average(self) -> tuple[float, ...] | None:
        """The mean behaviour and correspondence score of the paper's rows, as it prints them."""
        rows = self.paper
        return (
            tuple(round(sum(getattr(row, of) for row in rows) / len(rows), 1) for of in SCORES)
            if rows
            else None
        )

    def mean(self, of: str) -> Mean | None:
        """The mean "behaviour" or "correspondence" score over the runs that have one."""
        return mean_of(self.values(of))

    def values(self, of: str) -> list[float]:
        """Each run's score, if it has one."""
        return [value for mark in self.marks if (value := getattr(mark, of)) is not None]

    @property
    def averages(self) -> dict[str, float]:
        """The means that there are."""
        return {of: mean.value for of in SCORES if (mean := self.mean(of)) is not None}

    def rows(self) -> list[tuple[ScoreRow | None, PaperRow | None]]:
        """Our rows and the paper's, side by side."""
        return list(zip_longest(self.marks[: 2 * PER_CONDITION], self.paper))


@dataclass(frozen=True, kw_only=True)
class ScoreTable:
    """Table 1 or 2: one task's individuals and their scores on one kind of robot ("": on none yet)."""

    task: str
    kind: str
    individual: str
    classes: tuple[ScoreClass, ...]

    @property
    def id(self) -> str:
        """Id for links and files."""
        words = [self.kind, "" if self.individual == "champion" else self.individual]
        return "-".join([self.task, "scores", *(w.replace(" ", "-") for w in words if w not in ("", "twin"))])

    @property
    def marks(self) -> list[ScoreRow]:
        """The score rows of all levels."""
        return [mark for one in self.classes for mark in one.marks]

    @property
    def missing(self) -> list[str]:
        """What is missing in which runs, and why, each reason once."""
        found: dict[str, list[str]] = {}
        for one in self.classes:
            for mark in one.marks:
                if mark.why:
                    found.setdefault(mark.why, []).append(f"{one.name} #{mark.index}")
        return [
            f"{'All runs' if len(runs) == len(self.marks) else ', '.join(runs)}: {why.rstrip('.')}."
            for why, runs in found.items()
        ]

    def to_dict(self) -> dict[str, object]:
        """Ready for JSON."""
        return {
            "task": self.task,
            "robot": self.kind or None,
            "individual": self.individual,
            "rows": [mark.to_dict() for mark in self.marks],
            "averages": [
                {"noise": one.level, "runs": len(one.marks), **dict.fromkeys(SCORES), **one.averages}
                for one in self.classes
            ],
            "paper": [
                {"noise": one.level, "rows": [row._asdict() for row in one.paper]}
                | dict(zip(SCORES, one.paper_average or (), strict=True))
                for one in self.classes
                if one.paper
            ],
        }


def score_tables(task: Task, levels: Iterable[float], marks: Sequence[ScoreRow]) -> list[ScoreTable]:
    """A task's tables, one for each kind of robot and individual, in the order of the score rows."""
    own = [mark for mark in marks if mark.task == task.name]
    if task.source is not None:  # the paper's names are of the paper's tasks
        own = [replace(mark, type=None, share=None, situated_type=None) for mark in own]
    paper = PAPER_ROWS.get(task.name, {}) if task.source is None else {}
    return [
        ScoreTable(
            task=task.name,
            kind=kind,
            individual=individual,
            classes=tuple(
                ScoreClass(
                    level=level,
                    name=noise_name(level),
                    marks=tuple(
                        mark
                        for mark in own
                        if (mark.kind, mark.individual, noise_level(mark.noise)) == (kind, individual, level)
                    ),
                    paper=paper.get(level, ()),
                )
                for level in levels
            ),
        )
        for kind, individual in dict.fromkeys((mark.kind, mark.individual) for mark in own)
    ]


def study_tables(study: Study, marks: Sequence[ScoreRow] | None = None) -> list[ScoreTable]:
    """All tables of a study, in the order of its tasks; `marks` are its score rows, if they are there."""
    marks, found = marks_of(study) if marks is None else marks, list[ScoreTable]()
    for name in dict.fromkeys(run.task for run in study.runs):
        levels = sorted({noise_level(run.noise) for run in study.runs if run.task == name})
        found += score_tables(study.task(name), levels, marks)
    return found


def scores_csv(tables: Sequence[ScoreTable]) -> str:
    """All of a task's tables as CSV: a row a run, averages, and the paper's own rows (source: paper)."""
    names = [field.name for field in fields(ScoreRow) if field.name not in ("task", "noise")]
    head = ["task", "noise", "source", "row", *names]
    rows = [row for table in tables for one in table.classes for row in _class_rows(table, one)]
    for one in tables[0].classes if tables else ():
        facts = {"task": tables[0].task, "noise": one.name, "source": "paper"}
        rows += [{**facts, "row": k, **row._asdict()} for k, row in enumerate(one.paper, 1)]
        if one.paper:
            rows.append(
                {**facts, "row": "average", **dict(zip(SCORES, one.paper_average or (), strict=True))}
            )
    return to_csv([head, *([row.get(key, "") for key in head] for row in rows)], end="\r\n")


def _class_rows(table: ScoreTable, one: ScoreClass) -> Iterator[dict[str, object]]:
    facts = {"task": table.task, "noise": one.name, "source": "here"}
    for mark in one.marks:
        own = {key: value for key, value in mark.to_dict().items() if value is not None}
        yield {**own, **facts, "row": mark.index}
    if one.marks:
        mean = one.mean("correspondence")
        ends = {"low": mean.value - mean.half, "high": mean.value + mean.half} if mean else {}
        known = {key: min(max(value, 0.0), 10.0) for key, value in ends.items() if math.isfinite(value)}
        whose = {"row": "average", "kind": table.kind, "individual": table.individual}
        yield {**facts, **whose, **one.averages, **known}
