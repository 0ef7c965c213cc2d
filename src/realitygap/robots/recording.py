"""Recordings: what a robot read, decided and did, a row a step, written while it drives.

A folder: `drive.toml` with the facts and, once the drive is over, how it ended; `steps.csv`.
Each row is handed to the system before the next step, so that a killed process loses none.
"""

import csv
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from realitygap.errors import UsageError
from realitygap.files import atomic_write, naming_errors, read_text, read_toml, to_toml
from realitygap.robots.body import Odometry
from realitygap.values import Command, Readings

__all__ = ["KILLED", "LATE_S", "Recorder", "Recording", "Step"]

KILLED = "killed"
"""How a recording ended if it does not say."""

LATE_S = 0.01
"""A step that begins later than this after its time is late."""

LONGEST_GAP_S, LATE_SHARE = 0.5, 0.2
"""A drive with a longer gap between two steps, or with a larger share of late ones, is no fair trial."""

FACTS, EARLIER = "drive.toml", "recording.toml"
"""The facts; earlier versions gave them the name of a calibration's, and such folders are still read."""
STEPS = "steps.csv"
LARGEST = 1e12
"""Largest number in a recording of a drive."""
_GROUPS = ("proximity", "ambient", "input")
_PAIRS = ("command", "counter", "speed")
ALWAYS = ["t_s", "late_s", *(f"{name}_{side}" for name in _PAIRS for side in ("left", "right"))]
"""The columns that every recording has."""


class Step(NamedTuple):
    """One step: when it began, how late, what was read, fed, decided; what the wheels said; when what
    was read arrived, of a body that tells it."""

    t_s: float
    late_s: float
    readings: Readings
    inputs: Sequence[int]
    command: Command
    odometry: Odometry
    read_s: float | None = None

    def row(self) -> list[float]:
        """As numbers, in the order of the file's columns."""
        nothing = (math.nan, math.nan)
        return [
            round(self.t_s, 6),
            round(self.late_s, 6),
            *self.readings.proximity.tolist(),
            *self.readings.ambient.tolist(),
            *self.inputs,
            self.command.left,
            self.command.right,
            *(self.odometry.counters or nothing),
            *(self.odometry.speeds or nothing),
            *([] if self.read_s is None else [round(self.read_s, 6)]),
        ]

    def columns(self) -> list[str]:
        """Names of the columns: units in the names, where there are any."""
        counts = (len(self.readings.proximity), len(self.readings.ambient), len(self.inputs))
        groups = [f"{name}_{i}" for name, n in zip(_GROUPS, counts, strict=True) for i in range(n)]
        return [*ALWAYS[:2], *groups, *ALWAYS[2:], *([] if self.read_s is None else ["read_s"])]


@dataclass(frozen=True, kw_only=True)
class Recording:
    """A recorded drive, [n] steps.

    t, late [n] s; proximity [n, P or 0], ambient [n, A or 0] counts; inputs [n, I]; commands [n, 2]
    and speeds [n, 2] in the robot's units; counters [n, 2] pulses. Counters and speeds are NaN where
    the robot has none, or its line had no room for them. `read` [n] s is when what was read arrived, NaN
    where the robot does not tell. `ended` is "finished", "killed", or what
    stopped the drive.
    """

    t: NDArray[np.float64]
    late: NDArray[np.float64]
    proximity: NDArray[np.float64]
    ambient: NDArray[np.float64]
    inputs: NDArray[np.int64]
    commands: NDArray[np.int64]
    counters: NDArray[np.float64]
    speeds: NDArray[np.float64]
    read: NDArray[np.float64]
    ended: str
    facts: Mapping[str, Any] = field(default_factory=dict)

    @property
    def late_steps(self) -> int:
        """How many steps began more than 10 ms after their time."""
        return int((self.late > LATE_S).sum())

    @property
    def timing(self) -> str | None:
        """Why its timing cannot be trusted: a gap, or too many late steps; None: it can."""
        gap = float(np.diff(self.t).max(initial=0.0))
        if gap > LONGEST_GAP_S:
            return f"a gap of {gap:.1f} s between two steps"
        if self.late_steps > LATE_SHARE * len(self.t):
            return f"{self.late_steps} of {len(self.t)} steps late"
        return None

    @property
    def missed_steps(self) -> int:
        """How many steps had no answer in time, so that older readings were used."""
        return int((self.read < self.t).sum())

    @classmethod
    def from_rows(
        cls, columns: Sequence[str], rows: Sequence[Sequence[float]], *, ended: str, facts: Mapping[str, Any]
    ) -> Self:
        """From the names of a file's columns and their rows [n, columns].

        Args:
            columns: their names.
            rows: [n, columns].
            ended: why.
            facts: of drive.toml.
        """
        table = np.array(rows, np.float64).reshape(len(rows), len(columns))
        names = np.array([name.rsplit("_", 1)[0] for name in columns], str)
        found = {
            name: np.ascontiguousarray(table[:, names == name])
            for name in ("t", "late", "read", *_GROUPS, *_PAIRS)
        }
        return cls(
            t=found["t"].reshape(len(rows)),
            late=found["late"].reshape(len(rows)),
            proximity=found["proximity"],
            ambient=found["ambient"],
            inputs=found["input"].astype(np.int64),
            commands=found["command"].reshape(len(rows), 2).astype(np.int64),
            counters=found["counter"].reshape(len(rows), 2),
            speeds=found["speed"].reshape(len(rows), 2),
            read=found["read"].reshape(len(rows)) if "read" in names else np.full(len(rows), np.nan),
            ended=ended,
            facts=facts,
        )

    @classmethod
    def from_folder(cls, folder: str | Path) -> Self:
        """Read a recording; a last line that a kill cut short is left out.

        Raises:
            UsageError: no recording there, or an invalid row: names the line.
        """
        facts_file, steps_file = Path(folder) / FACTS, Path(folder) / STEPS
        if not facts_file.is_file() and (Path(folder) / EARLIER).is_file():
            facts_file = Path(folder) / EARLIER
        if not facts_file.is_file():
            raise UsageError(f"{str(folder)!r} holds no recording: there is no {FACTS} in it")
        facts = read_toml(facts_file, UsageError, "It says what was recorded.")
        ended = str(facts.pop("end", {}).get("ended", KILLED))
        text = read_text(steps_file, UsageError, "It holds the steps.") if steps_file.is_file() else ""
        lines = text[: text.rfind("\n") + 1].splitlines()
        columns = next(csv.reader(lines[:1]), ALWAYS)
        if [columns.count(name) for name in ALWAYS] != [1] * len(ALWAYS):
            raise UsageError(f"{steps_file}, line 1: expected columns {', '.join(ALWAYS)} and others")
        _check_order(columns, f"{steps_file}, line 1")
        rows = [_row(line, columns, f"{steps_file}, line {k}") for k, line in enumerate(lines[1:], 2)]
        return cls.from_rows(columns, rows, ended=ended, facts=facts)


def _check_order(columns: Sequence[str], place: str) -> None:
    """Refuse columns of one kind that are too many or in another order: they would be taken for others."""
    for name in ("t", "late", "read", *_GROUPS, *_PAIRS):
        found = [column for column in columns if column.rsplit("_", 1)[0] == name]
        meant = [column for column in (*ALWAYS, "read_s") if column.rsplit("_", 1)[0] == name]
        meant = [f"{name}_{i}" for i in range(len(found))] if name in _GROUPS else meant
        if found and found != meant:
            raise UsageError(f"{place}: expected columns {', '.join(meant)}, got {', '.join(found)}")


class Recorder:
    """Keeps the steps of a drive, and writes each into `folder` if there is one.

    Raises:
        UsageError: the folder already holds a recording.
    """

    def __init__(self, folder: str | Path | None = None, *, facts: Mapping[str, Any] | None = None) -> None:
        self.facts = dict(facts or {})
        self.folder = Path(folder) if folder is not None else None
        self.ended = KILLED
        self._columns = ALWAYS
        self._rows: list[list[float]] = []
        self._file: IO[str] | None = None
        if self.folder is not None:
            self.folder.mkdir(parents=True, exist_ok=True)
            if any((self.folder / name).exists() for name in (FACTS, EARLIER)):
                raise UsageError(f"{str(self.folder)!r} already holds a recording; choose another folder")
            atomic_write(self.folder / FACTS, to_toml(self.facts))
            self._file = (self.folder / STEPS).open("w", encoding="utf-8")

    def __len__(self) -> int:
        return len(self._rows)

    def add(self, step: Step) -> None:
        row = step.row()
        if not self._rows:
            self._columns = step.columns()
            self._write(self._columns)
        self._rows.append(row)
        self._write(f"{value:.10g}" for value in row)

    def finish(self, ended: str) -> None:
        """Say how the drive ended, and close the files."""
        self.ended = ended
        if self._file is None or self.folder is None:
            return
        self._file.close()
        self._file = None
        kept = self.recording()
        end: dict[str, Any] = {"ended": ended, "steps": len(self._rows), "late_steps": kept.late_steps}
        if "read_s" in self._columns:
            end["missed_steps"] = kept.missed_steps
        with (self.folder / FACTS).open("a", encoding="utf-8") as file:
            file.write("\n" + to_toml({"end": end}))

    def recording(self) -> Recording:
        """All that was kept so far."""
        return Recording.from_rows(self._columns, self._rows, ended=self.ended, facts=self.facts)

    def _write(self, words: Iterable[str]) -> None:
        if self._file is not None:
            with naming_errors(self._file.name):
                self._file.write(",".join(words) + "\n")
                self._file.flush()


def _row(line: str, columns: Sequence[str], where: str) -> list[float]:
    words = line.split(",")
    try:
        row = [float(word) for word in words]
        if len(row) == len(columns) and not any(map(_is_odd, columns, row)):
            return row
    except ValueError:
        pass
    raise UsageError(f"{where}: expected {len(columns)} numbers, got {line!r}")


def _is_odd(name: str, value: float) -> bool:
    """A number that nothing can have been; counters and readings may be missing, commands not."""
    return abs(value) > LARGEST or (math.isnan(value) and name.startswith(("command", "input")))
