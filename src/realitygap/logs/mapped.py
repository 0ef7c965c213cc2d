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
from realitygap.logs.cuts import many
from realitygap.logs.table import Log, read_log
from realitygap.track import Track
from realitygap.values import Floats

__all__ = ["ASKED", "KINDS", "SIDES", "UNITS", "Mapped", "cumulative", "filled", "quaternion_yaw", "read_map"]

KINDS = ("wheels", "infrared", "ambient", "track")
ASKED = "?"
SIDES = ("left", "right")
TIME = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
LENGTH = {"cm": 1.0, "mm": 0.1, "m": 100.0}
ANGLE = {"rad": 1.0, "deg": math.pi / 180, "quaternion": 1.0}
SPEED = {"cm/s": 1.0, "mm/s": 0.1, "m/s": 100.0}
OWN = {"own": 1.0}
"""A robot's own unit of commands or speeds."""
PLAIN = {"": 1.0}
UNITS: dict[str, Mapping[str, float]] = {
    "t_s": TIME, "x_cm": LENGTH, "y_cm": LENGTH, "heading_deg": ANGLE, "distance_cm": LENGTH,
    "bearing_deg": ANGLE, "v": SPEED, "w": {"rad/s": 1.0, "deg/s": math.pi / 180},
    "command_v": SPEED, "command_w": {"rad/s": 1.0, "deg/s": math.pi / 180},
    **{f"counter_{side}": {"pulses": 1.0} for side in SIDES},
    **{f"speed_{side}": SPEED | OWN for side in SIDES}, **{f"command_{side}": OWN for side in SIDES},
    "speed_cm_s": SPEED, "run": PLAIN, "sensor": PLAIN, "reading": PLAIN,
}  # fmt: skip
"""What a column may be, and in which units: factors to s, cm, rad, cm/s, rad/s."""
KEYS = ("column", "unit", "sign", "offset_deg", "per_row")
WRAP = 2.0**16
"""Counters of 16 bits begin anew there."""
ANEW = 10
"""Usual steps by which a clock goes back that begins anew."""
MOST_SENSORS = 1000
AGAIN_S = 0.5
"""A pose that is the same for less was not measured anew."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Mapped:
    """The columns of logs in s, cm, rad and pulses, runs one after the other; what is asked is refused when
    it is needed.

    Attributes:
        path, hash: the MAP.toml, and the SHA-256 of it and its logs.
        columns: [n] by name as in UNITS; counters are cumulative, times grow within a run.
        units: of each, as the map says.
        sensors: [n, S] readings s0, s1, …; None without.
        run: [n] from 0 on; names: of the runs.
        lines: [n] where each row is.
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
    names: tuple[str, ...]
    lines: Sequence[str] = field(repr=False)
    notes: tuple[str, ...]

    def need(self, *names: str) -> None:
        """Refuse a map without these columns."""
        missing = [name for name in names if name not in self.columns]
        if missing:
            raise RecordingError(
                f"{self.path}: expected columns {', '.join(names)}, got {', '.join(self.columns)}. Name "
                f"the log's column: {missing[0]} = {{ column = … }}."
            )

    def tracks(self) -> dict[tuple[str, str], Track]:
        """The path of each run, by its name and no unit; a pose repeated within half a second is none."""
        self.need("t_s", "x_cm", "y_cm", "heading_deg")
        t, x, y, heading = (self.columns[name] for name in ("t_s", "x_cm", "y_cm", "heading_deg"))
        out = {}
        for k, name in enumerate(self.names):
            rows = np.flatnonzero(self.run == k)
            new = np.concatenate([[True], (np.diff([x[rows], y[rows], heading[rows]]) != 0).any(axis=0)])
            last = np.maximum.accumulate(np.where(new, np.arange(len(rows)), 0))
            rows = rows[new | (t[rows] - t[rows][last] > AGAIN_S)]
            out[name, ""] = Track(t=t[rows], x=x[rows], y=y[rows], heading=heading[rows], seen_by="log")
        return out


def read_map(path: str | Path) -> Mapped:
    """The logs of a MAP.toml, as it says.

    Raises:
        RecordingError: what is missing, wrong or still asked for; names file and key.
    """
    path = Path(path)
    facts = read_toml(path, RecordingError, "Make one with `realitygap look LOG`.")
    logs, kind, columns = (facts.pop(key, None) for key in ("logs", "kind", "columns"))
    if not isinstance(logs, list) or not logs or not all(isinstance(one, str) for one in logs):
        raise RecordingError(
            f'{path}: logs: expected a list of files, as in logs = ["run.txt"], got {logs!r}.'
        )
    if kind not in KINDS:
        raise RecordingError(f"{path}: kind: expected {', '.join(KINDS)}, got {kind!r}.")
    if not isinstance(columns, Mapping) or not columns:
        raise RecordingError(f"{path}: columns: expected a table [columns] of what each column is.")
    known = [name for name in columns if _sensor(name) is None]
    refuse_unknown(known, UNITS, RecordingError, where=f"{path}: columns", cure="And sensors: s0, s1 …")
    said = {name: _entry(path, name, entry) for name, entry in columns.items()}
    if "unit" in said.get("x_cm", {}) and "y_cm" in said:
        said["y_cm"].setdefault("unit", said["x_cm"]["unit"])
    read = [read_log(os.path.normpath(path.parent / one)) for one in logs]
    parts = [{name: _converted(path, log, name, entry) for name, entry in said.items()} for log in read]
    notes = [note for log in read for note in log.notes]
    made = {name: np.concatenate([part[name] for part in parts]) for name in said}
    lines = [f"{log.path}, line {k}" for log in read for k in log.lines.tolist()]
    of_file = np.repeat(np.arange(len(read)), [len(log.lines) for log in read])
    run, names = _runs(made.pop("run", None), of_file, [Path(one).stem for one in logs])
    kept = np.argsort(run, kind="stable")
    made, run = {name: column[kept] for name, column in made.items()}, run[kept]
    for name in (f"counter_{side}" for side in SIDES):
        if name in made:
            made[name], wraps = cumulative(made[name], run, per_row=bool(said[name].get("per_row")))
            notes += [f"{name} wraps round after 16 bits ({many(wraps, 'time')})"] if wraps else []
    if "t_s" in made:
        run, names, good = _in_time(made["t_s"], run, names, notes)
        made, run, kept = {name: column[good] for name, column in made.items()}, run[good], kept[good]
        first = np.unique(run, return_index=True)[1]
        made["t_s"] = made["t_s"] - made["t_s"][first][run]
        for name in (name for name in made if re.match("counter|speed_[lr]|command|v$|w$", name)):
            empty, held = np.isnan(made[name]).sum(), name.startswith("command")
            made[name] = filled(made[name], made["t_s"], run, held=held)
            notes += [f"{name}: {many(empty, 'empty cell')} filled from its neighbours"] if empty else []
    lines = [lines[k] for k in kept.tolist()]
    digest = hashlib.sha256(path.read_bytes())
    for log in read:
        digest.update(log.path.read_bytes())
    return Mapped(
        path=path, hash=digest.hexdigest(), kind=kind, facts=facts, run=run, names=tuple(names), lines=lines,
        columns={name: column for name, column in made.items() if _sensor(name) is None},
        units={name: str(entry.get("unit", "")) for name, entry in said.items()},
        sensors=_sensors(path, made), notes=tuple(dict.fromkeys(notes)),
    )  # fmt: skip


def quaternion_yaw(parts: Floats) -> Floats:
    """[n] rad, of quaternions x, y, z, w [n, 4], or z, w [n, 2] of turns about the vertical."""
    if parts.shape[1] == 2:
        return np.asarray(2 * np.arctan2(parts[:, 0], parts[:, 1]))
    x, y, z, w = parts.T
    return np.asarray(np.arctan2(2 * (w * z + x * y), 1 - 2 * (y**2 + z**2)))


def _sensor(name: str) -> int | None:
    """The number of a sensor's column."""
    return int(name[1:]) if name[:1] == "s" and name[1:].isdecimal() else None


def _entry(path: Path, name: str, entry: Any) -> dict[str, Any]:
    """A column's entry as a table; its unit is known."""
    made = dict(entry) if isinstance(entry, Mapping) else {"column": entry}
    where = f"{path}: {name}"
    refuse_unknown(made, KEYS, RecordingError, where=where)
    asked = [key for key in made if made[key] == ASKED]
    units = UNITS.get(name, PLAIN)
    if asked:
        what = f"one of {', '.join(units)}" if asked[0] == "unit" else "the log's own"
        raise RecordingError(
            f'{where}: {asked[0]}: expected {what}, got "?": `realitygap look` could not tell it. Write it.'
        )
    if "column" not in made:
        raise RecordingError(f"{where}: expected {{ column = … }}, got {entry!r}.")
    for key, good, expected in (
        ("unit", str(made.get("unit", next(iter(units)))) in units, ", ".join(units)),
        ("sign", made.get("sign", 1) in (1, -1), "1 or -1"),
        ("offset_deg", isinstance(made.get("offset_deg", 0), int | float), "degrees"),
        ("per_row", isinstance(made.get("per_row", False), bool), "true or false"),
    ):
        if not good:
            raise RecordingError(f"{where}: {key}: expected {expected}, got {made[key]!r}.")
    return made


def _converted(path: Path, log: Log, name: str, entry: Mapping[str, Any]) -> Floats:
    column, unit = entry["column"], entry.get("unit", next(iter(UNITS.get(name, PLAIN))))
    if unit == "quaternion":
        if not isinstance(column, list) or len(column) not in (2, 4):
            raise RecordingError(f"{path}: {name}: a quaternion has 4 columns: x, y, z, w; got {column!r}.")
        values = quaternion_yaw(np.stack([log.values[:, _at(path, log, name, one)] for one in column], 1))
    else:
        at = _at(path, log, name, column)
        values = log.values[:, at]
        if name == "run" and np.isnan(values).any():
            values = np.unique([row[at] for row in log.cells], return_inverse=True)[1].astype(float)
    factor = entry.get("sign", 1) * UNITS.get(name, PLAIN)[unit]
    return np.asarray(values * factor + math.radians(entry.get("offset_deg", 0.0)))


def _at(path: Path, log: Log, name: str, column: Any) -> int:
    """A column's place in a log."""
    if isinstance(column, str) and column in log.names:
        return log.names.index(column)
    if isinstance(column, int) and not isinstance(column, bool) and 1 <= column <= len(log.names):
        return column - 1
    raise RecordingError(
        f"{path}: {name}: column: expected one of {log.path.name}'s, {', '.join(log.names)}, or its number "
        f"from 1 to {len(log.names)}, got {column!r}."
    )


def _runs(
    told: Floats | None, of_file: NDArray[np.int64], stems: Sequence[str]
) -> tuple[NDArray[np.int64], list[str]]:
    """[n] the run of each row, in order, and the runs' names: a file is one, or several by its column."""
    if told is None:
        return of_file, list(stems)
    numbers: dict[tuple[int, float], int] = {}
    pairs = zip(of_file.tolist(), told.tolist(), strict=True)
    run = np.array([numbers.setdefault(pair, len(numbers)) for pair in pairs], np.int64)
    single = len(stems) == 1
    return run, [f"{value:g}" if single else f"{stems[file]}:{value:g}" for file, value in numbers]


def _in_time(
    t: Floats, run: NDArray[np.int64], names: Sequence[str], notes: list[str]
) -> tuple[NDArray[np.int64], list[str], NDArray[np.bool_]]:
    """Runs, their names, and the rows [n] whose time comes before all later ones of their run: of rows of one
    time the last. A clock that begins anew begins a run."""
    step, within = np.diff(t), np.diff(run) == 0
    forth = step[within & (step > 0)]
    usual = float(np.median(forth)) if len(forth) else 1.0
    anew = within & (step < -ANEW * usual)
    number = np.concatenate([[0], np.cumsum(anew | ~within)])
    whose = run[np.unique(number, return_index=True)[1]].tolist()
    if anew.any():
        notes.append(f"the clock begins anew ({many(anew.sum(), 'time')}): a run each")
    again = [whose[:k].count(one) for k, one in enumerate(whose)]
    named = [f"{names[one]}.{k + 1}" if k else names[one] for one, k in zip(whose, again, strict=True)]
    good = np.full(len(t), True)
    for k in range(len(whose)):
        rows = np.flatnonzero(number == k)
        later = np.fmin.accumulate(np.append(t[rows], math.inf)[:0:-1])[::-1]
        good[rows] = t[rows] < later
    if not good.all():
        notes.append(f"{many((~good).sum(), 'row')} left out: not before all later ones")
    return number, named, good


def filled(column: Floats, t: Floats, run: NDArray[np.int64], *, held: bool = False) -> Floats:
    """[n] a column with its empty cells filled, as in rows of which only a pose was logged: evenly in time or
    with the value before (`held`)."""
    out = column.copy()
    for rows in (np.flatnonzero(run == k) for k in np.unique(run)) if np.isnan(column).any() else ():
        known = rows[np.isfinite(column[rows])]
        if len(known):
            before = np.maximum(np.searchsorted(t[known], t[rows], side="right") - 1, 0)
            out[rows] = column[known[before]] if held else np.interp(t[rows], t[known], column[known])
    return out


def cumulative(pulses: Floats, run: NDArray[np.int64], *, per_row: bool) -> tuple[Floats, int]:
    """[n] pulses from the begin, of a counter that may be one of 16 bits, and how often it began anew."""
    if per_row:
        return np.asarray(np.cumsum(np.nan_to_num(pulses))), 0
    step = np.diff(pulses, prepend=pulses[:1])
    step[np.diff(run, prepend=run[:1]) != 0] = 0.0
    wraps = (np.abs(step) > 0.75 * WRAP) & (np.ptp(pulses) <= WRAP)
    if not wraps.any():
        return np.asarray(pulses - np.nan_to_num(pulses[:1])), 0
    return np.asarray(np.cumsum(step - WRAP * np.sign(step) * wraps)), int(wraps.sum())


def _sensors(path: Path, made: Mapping[str, Floats]) -> Floats | None:
    """[n, S] readings, from a column for each sensor, or from columns sensor and reading."""
    if "reading" in made:
        if "sensor" not in made:
            raise RecordingError(f"{path}: reading: expected a column sensor beside it, or s0, s1 …")
        known = np.isin(made["sensor"], range(MOST_SENSORS))
        if not known.all():
            got = made["sensor"][int((~known).argmax())]
            raise RecordingError(f"{path}: sensor: expected its number, from 0 on, in each row, got {got:g}.")
        number = made["sensor"].astype(np.int64)
        out = np.full((len(number), int(number.max()) + 1), math.nan)
        out[np.arange(len(number)), number] = made["reading"]
        return out
    found = {k: made[name] for name in made if (k := _sensor(name)) is not None}
    if found and sorted(found) != list(range(len(found))):
        raise RecordingError(f"{path}: expected sensors s0 to s{len(found) - 1}, got {', '.join(made)}.")
    return np.stack([found[k] for k in sorted(found)], 1) if found else None
