"""MAP.toml: which column of a log is what, in which unit and with which sign.

    logs = ["run-1.txt", "run-2.txt"]
    kind = "wheels"
    [columns]
    t_s = { column = "time", unit = "ms" }
    heading_deg = { column = "yaw", unit = "rad", sign = -1 }

A column is named by its name, or by its number from 1 on. Beside `logs`, `kind` and `columns` stand the keys
of a recording.toml. A "?" is what `realitygap look` could not tell.
"""

import hashlib
import math
import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from realitygap.errors import RecordingError
from realitygap.files import read_toml, refuse_unknown
from realitygap.logs.cuts import many, repeats
from realitygap.logs.table import Log, read_log
from realitygap.track import Track
from realitygap.values import Floats

__all__ = [
    "ASKED", "SENSOR", "SIDES", "UNITS", "Mapped", "converted", "cumulative", "filled", "read_map",
]  # fmt: skip

KINDS = ("wheels", "infrared", "ambient", "track")
ASKED = "?"
SIDES = ("left", "right")
SENSOR = re.compile(r"s(\d+)")
LENGTH = {"cm": 1.0, "mm": 0.1, "m": 100.0}
ANGLE = {"deg": math.pi / 180, "rad": 1.0, "quaternion": 1.0}
SPEED = {"cm/s": 1.0, "mm/s": 0.1, "m/s": 100.0}
TURN = {"rad/s": 1.0, "deg/s": math.pi / 180}
OWN, PLAIN = {"own": 1.0}, {"": 1.0}
"""A robot's own unit of commands or speeds; none."""
UNITS: dict[str, Mapping[str, float]] = {
    "t_s": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}, "x_cm": LENGTH, "y_cm": LENGTH,
    "heading_deg": ANGLE, "distance_cm": LENGTH, "bearing_deg": ANGLE,
    "v": SPEED, "w": TURN, "command_v": SPEED, "command_w": TURN,
    **{f"counter_{side}": {"pulses": 1.0} for side in SIDES},
    **{f"speed_{side}": SPEED | OWN for side in SIDES}, **{f"command_{side}": OWN for side in SIDES},
    "speed_cm_s": SPEED, "run": PLAIN, "sensor": PLAIN, "reading": PLAIN,
}  # fmt: skip
"""What a column may be, and in which units: factors to s, cm, rad, cm/s, rad/s."""
KEYS = ("column", "unit", "sign", "per_row")
WRAP = 2.0**16
"""Counters of 16 bits begin anew there."""
MOST_SENSORS = 1000
AGAIN_S = 0.5
"""A pose that is the same for less was not measured anew."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Mapped:
    """The columns of logs in s, cm, rad and pulses, runs one after the other.

    Attributes:
        path, hash: the MAP.toml, and the SHA-256 of it and its logs.
        facts: what stands beside its columns; an asked one is still "?".
        columns: [n] by name as in UNITS; counters are cumulative, times grow within a run.
        units: of each, as the map says.
        sensors: [n, S] readings s0, s1, …; None without.
        run: [n] from 0 on; names: of the runs; lines: [n] where each row is.
        notes: what was left out, in words.
    """

    path: Path
    hash: str
    kind: str
    facts: Mapping[str, Any]
    columns: Mapping[str, Floats] = field(repr=False)
    units: Mapping[str, str]
    sensors: Floats | None = field(repr=False)
    run: NDArray[np.int64] = field(repr=False)
    names: Sequence[str]
    lines: Sequence[str] = field(repr=False)
    notes: Sequence[str]

    def need(self, *names: str) -> None:
        """Refuse a map without these columns."""
        for missing in (name for name in names if name not in self.columns):
            raise RecordingError(
                f"{self.path}: expected columns {', '.join(names)}, got {', '.join(self.columns)}. Name "
                f"the log's column: {missing} = {{ column = … }}."
            )

    def tracks(self) -> dict[tuple[str, str], Track]:
        """The path of each run, by its name and no unit; a pose repeated within half a second is none."""
        self.need("t_s", "x_cm", "y_cm", "heading_deg")
        t, *pose = (self.columns[name] for name in ("t_s", "x_cm", "y_cm", "heading_deg"))
        back = np.isnan(t) | np.append(False, (np.diff(self.run) == 0) & ~(np.diff(t) > 0))
        if back.any():
            k = int(back.argmax())
            raise RecordingError(
                f"{self.lines[k]}: t_s: expected a time after the row's before, got {t[k]:g} s of its run. "
                f"Cut the log there, or name a column of its runs in {self.path}: run."
            )
        new = ~repeats(np.stack(pose, 1), np.diff(self.run, prepend=-1) == 0)
        last = np.maximum.accumulate(np.where(new, np.arange(len(t)), 0))
        new |= t - t[last] > AGAIN_S
        out = {}
        for k, name in enumerate(self.names):
            rows = new & (self.run == k)
            x, y, heading = (one[rows] for one in pose)
            out[name, ""] = Track(t=t[rows], x=x, y=y, heading=heading, seen_by="log")
        return out


def read_map(path: str | Path) -> Mapped:
    """The logs of a MAP.toml, as it says.

    Raises:
        RecordingError: what is missing, wrong or still asked for; names file and key.
    """
    path = Path(path)
    facts = read_toml(path, RecordingError, "Make one with `realitygap look LOG`.")
    logs, kind, columns = (facts.pop(key, None) for key in ("logs", "kind", "columns"))
    for key, got, good, expected in (
        ("logs", logs, isinstance(logs, list) and logs, 'a list of files, as in logs = ["run.txt"]'),
        ("kind", kind, kind in KINDS, ", ".join(KINDS)),
        ("columns", columns, isinstance(columns, Mapping) and columns, "what each column is: [columns]"),
    ):
        if not good:
            raise RecordingError(f"{path}: {key}: expected {expected}, got {got!r}.")
    known = [name for name in columns if not SENSOR.fullmatch(name)]
    refuse_unknown(known, UNITS, RecordingError, where=f"{path}: columns", cure="And sensors: s0, s1 …")
    said = {name: _entry(f"{path}: {name}", name, entry, columns) for name, entry in columns.items()}
    read = [read_log(os.path.normpath(path.parent / str(one))) for one in logs]
    parts = [{name: _column(path, log, name, entry) for name, entry in said.items()} for log in read]
    notes = [note for log in read for note in log.notes]
    made = {name: np.concatenate([part[name] for part in parts]) for name in said}
    lines = np.array([f"{log.path}, line {k}" for log in read for k in log.lines.tolist()])

    # A file is a run, or several by its column.
    stems = [Path(one).stem for one in logs]
    stems = stems if len({*stems}) == len(stems) else [Path(one).as_posix() for one in logs]
    file = np.repeat(np.arange(len(read)), [len(log.lines) for log in read])
    told = made.pop("run", np.zeros(len(file)))
    runs, run = np.unique(np.stack([file, told], 1), axis=0, return_inverse=True)
    names = [f"{stems[int(one)]}:" * (len(stems) > 1) + f"{value:.12g}" for one, value in runs]
    names = names if "run" in said else stems
    kept = np.argsort(run, kind="stable")
    made, run, lines = {name: column[kept] for name, column in made.items()}, run[kept], lines[kept]
    for name in (name for name in made if name.startswith("counter")):
        lost = said[name]["per_row"] and np.isnan(made[name]).sum()
        made[name], wraps = cumulative(made[name], run, per_row=said[name]["per_row"])
        notes += [f"{name}: {many(lost, 'empty cell')} taken as no pulse"] if lost else []
        notes += [f"{name} wraps round after 16 bits ({many(wraps, 'time')})"] if wraps else []
    if "t_s" in made and kind in ("wheels", "track"):
        last = np.append((np.diff(made["t_s"]) != 0) | (np.diff(run) != 0), True)
        notes += [] if last.all() else [f"{many((~last).sum(), 'row')} of the same time as the next left out"]
        made, run, lines = {name: column[last] for name, column in made.items()}, run[last], lines[last]
        made["t_s"] = made["t_s"] - made["t_s"][np.unique(run, return_index=True)[1]][run]
        for name in (name for name in made if re.match("counter|speed_[lr]|command|v$|w$", name)):
            empty = np.isnan(made[name]).sum()
            made[name] = filled(made[name], made["t_s"], run, held=name.startswith("command"))
            notes += [f"{name}: {many(empty, 'empty cell')} filled from its neighbours"] if empty else []
    digest = hashlib.sha256(b"".join(one.read_bytes() for one in (path, *(log.path for log in read))))
    return Mapped(
        path=path, hash=digest.hexdigest(), kind=kind, facts=facts, run=run, names=names,
        lines=lines.tolist(), columns={name: made[name] for name in made if name in UNITS},
        units={name: entry["unit"] for name, entry in said.items()}, sensors=_sensors(path, made),
        notes=tuple(dict.fromkeys(notes)),
    )  # fmt: skip


def _entry(where: str, name: str, entry: Any, columns: Mapping[str, Any]) -> dict[str, Any]:
    """A column's entry with every key; the unit of y is that of x if it is not said."""
    entry = dict(entry) if isinstance(entry, Mapping) else {"column": entry}
    refuse_unknown(entry, KEYS, RecordingError, where=where)
    units, beside = UNITS.get(name, PLAIN), columns.get("x_cm") if name == "y_cm" else None
    unit = beside.get("unit") if isinstance(beside, Mapping) else None
    made: dict[str, Any] = {"column": ASKED, "unit": unit or next(iter(units)), "sign": 1, "per_row": False}
    made |= entry
    for key, good, expected in (
        ("unit", str(made["unit"]) in units, f"one of {', '.join(units)}"),
        ("sign", made["sign"] in (1, -1), "1 or -1"),
        ("per_row", isinstance(made["per_row"], bool), "true or false"),
    ):
        if not good:
            raise RecordingError(f"{where}: {key}: expected {expected}, got {made[key]!r}.")
    return made


def _column(path: Path, log: Log, name: str, entry: Mapping[str, Any]) -> Floats:
    """A column of a log as its entry says; words are numbered."""
    at = []
    for column in entry["column"] if isinstance(entry["column"], list) else [entry["column"]]:
        if column not in log.names and column not in range(1, len(log.names) + 1):
            raise RecordingError(
                f"{path}: {name}: column: expected one of {log.path.name}'s, {', '.join(log.names)}, or its "
                f"number from 1 to {len(log.names)}, got {column!r}."
            )
        at.append(log.names.index(column) if column in log.names else int(column) - 1)
    if len(at) not in ((2, 4) if entry["unit"] == "quaternion" else (1,)):
        raise RecordingError(
            f"{path}: {name}: column: expected one, or x, y, z, w of a quaternion, got {entry['column']!r}."
        )
    values = log.values[:, at]
    if name == "run" and np.isnan(values).any():
        return np.unique([row[at[0]] for row in log.cells], return_inverse=True)[1].astype(float)
    return converted(name, values, entry["unit"], entry["sign"])


def converted(name: str, parts: Floats, unit: str, sign: int) -> Floats:
    """[n] in s, cm, rad and so on, or as they stand in an unknown unit, of one column [n, 1]; or yaw of
    quaternions x, y, z, w [n, 4], or z, w [n, 2] of turns about the vertical."""
    values = parts[:, 0]
    if unit == "quaternion":
        x, y, z, w = np.pad(parts, ((0, 0), (4 - parts.shape[1], 0))).T
        values = np.arctan2(2 * (w * z + x * y), 1 - 2 * (y**2 + z**2))
    return np.asarray(values * sign * UNITS.get(name, PLAIN).get(unit, 1.0))


def filled(column: Floats, t: Floats, run: NDArray[np.int64], *, held: bool = False) -> Floats:
    """[n] a column whose empty cells have values evenly in between, or the one before (`held`), of a run."""
    out = column.copy()
    for rows in (np.flatnonzero(run == k) for k in np.unique(run[~np.isfinite(column)])):
        known = rows[np.isfinite(column[rows])]
        if len(known) and held:
            out[rows] = column[known[np.maximum(np.searchsorted(known, rows, side="right") - 1, 0)]]
        elif len(known):
            out[rows] = np.interp(t[rows], t[known], column[known])
    return out


def cumulative(pulses: Floats, run: NDArray[np.int64], *, per_row: bool) -> tuple[Floats, int]:
    """[n] pulses from the begin, of a counter that may be one of 16 bits, and how often it began anew."""
    if per_row:
        return np.asarray(np.cumsum(np.nan_to_num(pulses))), 0
    known, out = np.isfinite(pulses), pulses.copy()
    some, run = pulses[known], run[known]
    step = np.diff(some, prepend=some[:1])
    step[np.diff(run, prepend=run[:1]) != 0] = 0.0
    wraps = np.abs(step) > 0.75 * WRAP
    wraps &= bool(wraps.any()) and np.ptp(some) <= WRAP
    out[known] = np.cumsum(step - WRAP * np.sign(step) * wraps) if wraps.any() else some - some[:1]
    return out, int(wraps.sum())


def _sensors(path: Path, made: Mapping[str, Floats]) -> Floats | None:
    """[n, S] readings, from a column for each sensor, or from columns sensor and reading."""
    if {"reading", "sensor"} <= made.keys():
        number = np.nan_to_num(made["sensor"], nan=-1)
        if not np.isin(number, range(MOST_SENSORS)).all():
            raise RecordingError(f"{path}: sensor: expected its number, from 0 on, in each row.")
        return np.where(number[:, None] == np.arange(number.max() + 1), made["reading"][:, None], math.nan)
    found = {int(told[1]): column for name, column in made.items() if (told := SENSOR.fullmatch(name))}
    if sorted(found) != list(range(len(found))):
        raise RecordingError(f"{path}: expected sensors s0 to s{len(found) - 1}, got {', '.join(made)}.")
    return np.stack([found[k] for k in sorted(found)], 1) if found else None
