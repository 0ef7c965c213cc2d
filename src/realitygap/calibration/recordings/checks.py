"""Checks of a recording's numbers: mixed-up units, dead counters. Names file and line."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from realitygap.calibration.recordings.objects import cylinder_radius
from realitygap.calibration.recordings.recording import count_unit
from realitygap.errors import RecordingError
from realitygap.files import Table, read_table
from realitygap.values import Floats

__all__ = ["FACTS", "FARTHEST_CM", "check_readings", "check_steps", "copies", "doubt_object", "read_rows"]

FACTS = "recording.toml"
"""The file of facts about a recording's robot and how it was made."""

REACH_CM = 20.0
"""Twice the range of a Khepera's infrared: nothing beyond reads like a near object."""
FARTHEST_CM = 300.0
"""No object was recorded beyond this: a larger number means something else."""
WIDEST_CM = 20.0
"""A larger radius is hardly a cylinder to a robot of this size."""
VOLTS = 5.0
"""No converter's counts end so low; volts and shares of the full scale do."""
BRIGHT = 300.0
"""Counts of the paper's robot."""
COPIES = "leave them out, or give each reading of a place a repeat of its own"
ENOUGH = 4
"""Number of bearings from which on their unit is checked."""


def read_rows(path: Path, *, ends: bool) -> Table:
    """The table of a recording; with `ends` its last line must be complete, as a recorder writes it.

    Raises:
        RecordingError: no table, no rows, a truncated row, a duplicate column.
    """
    table = read_table(path, RecordingError)
    if not table.rows:
        raise RecordingError(f"{path}: empty: expected a line of column names and a row for each reading.")
    if ends and not path.read_bytes().endswith(b"\n"):
        raise RecordingError(f"{table.at(-1)}: cut short. Go on with `realitygap record … --resume`.")
    twice = [name for name in table.columns if name and table.columns.count(name) > 1]
    if twice:
        raise RecordingError(f"{table.head}: the column {twice[0]!r} stands there twice.")
    return table


def check_readings(
    table: Table,
    *,
    kind: str,
    distance_cm: Floats,
    bearing_deg: Floats,
    counts: Floats,
    full_scale: float | None,
) -> tuple[str, ...]:
    """Warnings about sensor readings [n, S] at [n] distances and bearings in a table's rows.

    Args:
        table: for file and line in messages.
        kind: "infrared" or "ambient".
        distance_cm, bearing_deg: [n].
        counts: [n, S].
        full_scale: the converter's highest count; None: unknown.

    Raises:
        RecordingError: readings that are impossible in centimetres and degrees.
    """
    top = math.inf if full_scale is None else full_scale
    expected = "counts from 0 on" if full_scale is None else f"counts from 0 to {top:g}"
    cure = "" if full_scale is None else f"The converter's highest count is said with full_scale in {FACTS}."
    for k, values in enumerate(counts.T):
        table.refuse(values < 0, f"s{k}", expected, values)
        table.refuse(values > top, f"s{k}", expected, values, cure)
    brightest = np.nan_to_num(counts).max(axis=1)  # a sensor may be unrecorded
    most = float(brightest.max())
    if most <= VOLTS and (counts % 1 > 0).any():
        raise RecordingError(
            f"{table.path}: expected raw counts, got readings up to {most:.3g} that are no whole numbers: "
            "are these volts, or shares of the full scale? Write what the converter gives."
        )
    bright = BRIGHT * max(1.0, count_unit(full_scale or most))
    far = (distance_cm > REACH_CM) & (brightest > bright)
    if kind == "infrared" and far.any():
        k = int(np.flatnonzero(far)[0])
        raise RecordingError(
            f"{table.at(k)}: distance_cm: {int(brightest[k])} counts at {distance_cm[k]:g} cm, "
            "where infrared sees nothing. Are these millimetres? Divide them by 10."
        )
    warned = copies(table.path, dict(zip(table.lines, table.rows, strict=True)), COPIES)
    turned = np.unique(np.abs(bearing_deg[np.isfinite(bearing_deg)]))
    if len(turned) >= ENOUGH and turned[-1] < 6.4 and (turned != np.rint(turned)).any():
        warned.append(f"{table.path}: bearing_deg never passes {turned[-1]:.2f}: are these radians?")
    return tuple(warned)


def copies(path: Path, rows: Mapping[int, Sequence[str]], cure: str) -> list[str]:
    """A warning about rows of a file, by line, that equal an earlier one in every column: copies are no
    further evidence."""
    seen: dict[tuple[str, ...], int] = {}
    copied = [line for line, row in rows.items() if seen.setdefault(tuple(row), line) != line]
    if not copied:
        return []
    first = seen[tuple(rows[copied[0]])]
    return [
        f"{path}, line {copied[0]}: a copy of line {first} (such rows: {len(copied)}): copies make the noise "
        f"look smaller than it is; {cure}"
    ]


def doubt_object(name: str, where: str | Path) -> tuple[str, ...]:
    """A warning about an implausibly large cylinder."""
    radius = cylinder_radius(name)
    if radius is None or radius <= WIDEST_CM:
        return ()
    return (f"{where}: object: a cylinder of {radius:g} cm radius, nearly a wall: are these millimetres?",)


def check_steps(commands: Floats, counters: Floats) -> tuple[str, ...]:
    """Warnings about wheels [n, 2] that were driven while their counter stood still."""
    out = []
    for side, name in enumerate(("left", "right")):
        driven = np.abs(commands[:, side]).max(initial=0.0) > 0
        if driven and np.ptp(counters[:, side]) == 0:
            out.append(f"counter_{name} never changes although the wheel was driven: it looks dead")
    return tuple(out)
