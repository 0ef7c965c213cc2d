"""What seems odd in a recording: units mixed up, counters that look dead. Names file and line."""

import math
from pathlib import Path

import numpy as np

from realitygap.calibration.recordings.recording import count_unit, cylinder_radius
from realitygap.errors import RecordingError
from realitygap.table import Table, read_table
from realitygap.values import Floats

__all__ = ["FACTS", "FARTHEST_CM", "check_readings", "check_steps", "doubt_object", "read_rows"]

FACTS = "recording.toml"
"""What is known of a recording's robot, and how it was made."""

REACH_CM = 20.0
"""Twice the way that a Khepera's infrared goes: beyond it nothing reads as on a near object."""
FARTHEST_CM = 300.0
"""Beyond it no object was recorded: a larger number stands for something else."""
WIDEST_CM = 20.0
"""Of a cylinder, beyond which it is hardly one to a robot of this size."""
BRIGHT = 300.0
"""Counts of the paper's robot."""
ENOUGH = 4
"""Bearings from which on their unit is doubted."""


def read_rows(path: Path, *, ends: bool) -> Table:
    """The table of a recording; with `ends` its last line must have an end, as a recorder's has.

    Raises:
        RecordingError: no table, no rows, one that is cut short, a column that is there twice.
    """
    table = read_table(path, RecordingError)
    if not table.rows:
        raise RecordingError(f"{path}: empty: expected a line of column names and a row for each reading.")
    if ends and not path.read_bytes().endswith(b"\n"):
        raise RecordingError(f"{table.at(-1)}: cut short. Go on with `realitygap record … --resume`.")
    twice = [name for name in table.columns if name and table.columns.count(name) > 1]
    if twice:
        raise RecordingError(f"{path}, line 1: the column {twice[0]!r} stands there twice.")
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
        table: names file and line.
        kind: "infrared" or "ambient".
        distance_cm, bearing_deg: [n].
        counts: [n, S].
        full_scale: the converter's highest count; None: not said.

    Raises:
        RecordingError: readings that no robot in centimetres and degrees can have had.
    """
    top = math.inf if full_scale is None else full_scale
    expected = "counts from 0 on" if full_scale is None else f"counts from 0 to {top:g}"
    cure = "" if full_scale is None else f"The converter's highest count is said with full_scale in {FACTS}."
    for k, values in enumerate(counts.T):
        table.refuse(values < 0, f"s{k}", expected, values)
        table.refuse(values > top, f"s{k}", expected, values, cure)
    bright = BRIGHT * max(1.0, count_unit(full_scale or float(counts.max())))
    far = (distance_cm > REACH_CM) & (counts.max(axis=1) > bright)
    if kind == "infrared" and far.any():
        k = int(np.flatnonzero(far)[0])
        raise RecordingError(
            f"{table.at(k)}: distance_cm: {int(counts[k].max())} counts at {distance_cm[k]:g} cm, "
            "where infrared sees nothing. Are these millimetres? Divide them by 10."
        )
    warned = []
    turned = np.unique(np.abs(bearing_deg[np.isfinite(bearing_deg)]))
    if len(turned) >= ENOUGH and turned[-1] < 6.4 and (turned != np.rint(turned)).any():
        warned.append(f"{table.path}: bearing_deg never passes {turned[-1]:.2f}: are these radians?")
    return tuple(warned)


def doubt_object(name: str, where: str | Path) -> tuple[str, ...]:
    """A warning about a cylinder that is as wide as a barrel."""
    radius = cylinder_radius(name)
    if radius is None or radius <= WIDEST_CM:
        return ()
    return (f"{where}: object: a cylinder of {radius:g} cm radius, nearly a wall: are these millimetres?",)


def check_steps(commands: Floats, counters: Floats) -> tuple[str, ...]:
    """Warnings about wheels [n, 2]: a counter that stands although its wheel was driven."""
    out = []
    for side, name in enumerate(("left", "right")):
        driven = np.abs(commands[:, side]).max(initial=0.0) > 0
        if driven and np.ptp(counters[:, side]) == 0:
            out.append(f"counter_{name} never changes although the wheel was driven: it looks dead")
    return tuple(out)
