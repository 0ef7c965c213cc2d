"""Recordings made by tests, written as folders that the project reads."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np

from realitygap.calibration.load import (
    FACTS,
    POLAR,
    POSE,
    READINGS,
    STEP_COLUMNS,
    STEPS,
    UNITS,
    UNKNOWN,
    WHEEL_COUNTS,
)
from realitygap.calibration.recordings import Recording, SensorRecording, WheelRecording
from realitygap.files import to_toml

__all__ = ["save_recording"]


def save_recording(folder: str | Path, recording: Recording) -> None:
    """Write a recording into a folder; `load_recording` reads it back, equal."""
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    facts: dict[str, Any] = {"units": UNITS, "notes": recording.notes, **recording.facts}
    if isinstance(recording, SensorRecording):
        facts |= {"kind": recording.kind, "object": recording.object, "sensors": recording.sensors}
        if recording.reflectance != 1.0:
            known = math.isfinite(recording.reflectance)
            facts["reflectance"] = recording.reflectance if known else UNKNOWN
        if recording.body_said:
            facts["body_radius_cm"] = recording.body_radius_cm
        if recording.body_outline_cm:
            facts["body_outline_cm"] = [list(corner) for corner in recording.body_outline_cm]
        if recording.pose is not None and recording.arena is not None:
            facts["arena"] = "arena.toml"
            (folder / "arena.toml").write_text(recording.arena.to_toml(), "utf-8")
        columns, rows = _reading_rows(recording)
    else:
        facts["kind"] = "wheels"
        columns, rows = _step_rows(recording)
    (folder / FACTS).write_text(to_toml(facts), "utf-8")
    name = READINGS if isinstance(recording, SensorRecording) else STEPS
    lines = [",".join(columns), *(",".join(row) for row in rows)]
    (folder / name).write_text("\n".join(lines) + "\n", "utf-8")


def _reading_rows(recording: SensorRecording) -> tuple[list[str], list[list[str]]]:
    names = POSE if recording.pose is not None else POLAR
    if recording.pose is None:
        where = np.stack([recording.distance_cm, recording.bearing_deg], 1)
    else:
        where = np.column_stack([recording.pose[:, :2], np.degrees(recording.pose[:, 2])])
    rows = [
        [*(f"{v:.10g}" for v in at), str(int(repeat)), *(f"{v:g}" for v in counts)]
        for at, repeat, counts in zip(where, recording.repeat, recording.counts, strict=True)
    ]
    return [*names, "repeat", *(f"s{i}" for i in range(recording.sensors))], rows


def _step_rows(recording: WheelRecording) -> tuple[list[str], list[list[str]]]:
    pairs = [recording.commands, *([recording.counters, recording.speeds] if recording.counted else [])]
    columns = [name for name in STEP_COLUMNS if recording.counted or name not in WHEEL_COUNTS]
    numbers = np.column_stack([recording.t_s, *pairs])
    named = zip(numbers, recording.trial, recording.kind, strict=True)
    rows = [[*(f"{v:.10g}" for v in row), str(int(trial)), str(kind)] for row, trial, kind in named]
    if recording.pose is None:
        return columns, rows
    for row, (x, y, heading) in zip(rows, recording.pose, strict=True):
        row += ["", "", ""] if math.isnan(x) else [f"{x:.10g}", f"{y:.10g}", f"{math.degrees(heading):.10g}"]
    return [*columns, *POSE], rows
