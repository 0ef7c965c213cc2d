"""Reads a recording's files; errors name file and line."""

import hashlib
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from realitygap.calibration.recordings import checks
from realitygap.calibration.recordings.checks import FACTS, FARTHEST_CM
from realitygap.calibration.recordings.facts import (
    body_of,
    check_heights,
    number_of,
    read_facts,
    reflectance_of,
)
from realitygap.calibration.recordings.objects import KINDS, check_object
from realitygap.calibration.recordings.recording import (
    HEIGHTS_CM,
    PULSES_PER_MM,
    STEP_KINDS,
    Recording,
    SensorRecording,
    WheelRecording,
)
from realitygap.calibration.recordings.sam import read_sam
from realitygap.calibration.recordings.thymio import LIKE, read_thymio, sensor_of
from realitygap.errors import RecordingError
from realitygap.files import Table, as_path, refuse_unknown
from realitygap.values import Floats
from realitygap.world.arena import Arena, load_arena

__all__ = [
    "EDGES", "READINGS", "STEPS", "STEP_COLUMNS", "UNFINISHED", "UNITS", "WHEEL_COUNTS",
    "find_recordings", "load_recording", "read_folder",
]  # fmt: skip

READINGS, EDGES, STEPS = "readings.csv", "edges.csv", "steps.csv"
POLAR = ("distance_cm", "bearing_deg")
POSE = ("x_cm", "y_cm", "heading_deg")
STEP_COLUMNS = (
    "t_s", "command_left", "command_right", "counter_left", "counter_right",
    "speed_left", "speed_right", "trial", "kind",
)  # fmt: skip
UNITS = "cm, degrees, s, counts, {}, pulses"
"""Units of the numbers; commands and speeds are in the robot's own units, named in the braces."""
SPEEDS = ("speed_left", "speed_right")
WHEEL_COUNTS = ("counter_left", "counter_right", *SPEEDS)
"""Columns that only wheels with counters have; no fit needs their speeds."""
KNOWN = (
    "kind", "object", "reflectance", "sensors", "full_scale", "body_radius_cm", "body_outline_cm",
    *HEIGHTS_CM, "arena", "units", "notes", "robot", "unit", "twin_noise", "port", "bios", "protocol",
    "firmware", "plan", "seed", "repeats", "bearings", "distances_cm", "places", "between", "date",
    "base", "pulses_per_mm", "marker", "id", "productId", "fwversion", "prox.comm.tx",
)  # fmt: skip
"""Keys of recording.toml: a calibration reads those about the body, surfaces and units, the others are for
the record; the last ones come from a Thymio."""
UNFINISHED = "unfinished"
"""How many places there are between the bearings, while they are looked for."""
DRIVE = "end"
"""A key of a drive's recording.toml, which is another format of the same name."""


def load_recording(path: str | Path, *, object: str | None = None, kind: str | None = None) -> Recording:
    """A recording's folder, a `.sam` table, or a Thymio's series (`sensor02_light.csv`).

    Args:
        path: the folder, its recording.toml, or the table.
        object: the object of a table, or one that replaces a recording's.
        kind: of a table's sensors.

    Raises:
        RecordingError: what is missing or wrong, with file and line.
    """
    path = as_path(path, "recording")
    if path.suffix.lower() == ".sam":
        return read_sam(path, object=object, kind=kind)
    if path.suffix.lower() == ".csv":
        return read_thymio(path)
    return read_folder(path.parent if path.name == FACTS else path, object=object)


def find_recordings(path: str | Path) -> Sequence[Path]:
    """The recordings at a path: itself, or all recordings in a folder.

    Raises:
        RecordingError: there is none.
    """
    path = Path(path)
    if path.suffix.lower() in (".sam", ".csv") or path.name == FACTS or (path / FACTS).is_file():
        return (path,)
    inside = sorted(found.parent for found in path.glob(f"*/{FACTS}"))
    if inside:
        return tuple(inside)
    if series := _series(path):
        return series
    below = sorted(found.parent for found in path.glob(f"*/*/{FACTS}"))
    if below:
        groups = list(dict.fromkeys(str(found.parent) for found in below))
        more = f" and {len(groups) - 3} more" if len(groups) > 3 else ""
        raise RecordingError(
            f"{path}: holds no recording, but folders in it do: give {' or '.join(groups[:3])}{more}."
        )
    what = "holds no recording" if path.is_dir() else "there is no such recording"
    raise RecordingError(f"{path}: {what}. Make one with `realitygap record`, or give a .sam table.")


def _series(folder: Path) -> tuple[Path, ...]:
    """A Thymio's series in a folder, whatever their names."""
    there = sorted(found for found in folder.glob("*") if LIKE.fullmatch(found.name))
    for found in there:
        sensor_of(found, "Rename it, or move it elsewhere.")
    return tuple(there)


def read_folder(folder: Path, *, object: str | None = None) -> Recording:
    """The recording of a folder; `object` replaces the one in its facts.

    Raises:
        RecordingError: what is missing or wrong, with file and line.
    """
    facts = read_facts(folder)
    where = folder / FACTS
    kind = facts.get("kind")
    if "kind" in facts or DRIVE not in facts:
        refuse_unknown(facts, KNOWN, RecordingError, where=str(where), cure="Anything else goes into notes.")
    if kind not in KINDS:
        cure = " This is a drive's recording, no calibration's." if DRIVE in facts else ""
        raise RecordingError(f"{where}: kind: expected {', '.join(KINDS)}, got {kind!r}.{cure}")
    before, after = UNITS.split("{}")
    units = str(facts.get("units", UNITS))
    if not (units.startswith(before) and units.endswith(after)):
        expected = UNITS.format("the units of its commands")
        raise RecordingError(
            f"{where}: units: expected {expected!r}, got {units!r}. Convert the table first."
        )
    if kind == "wheels":
        return _wheels(folder, facts)
    name = object or facts.get("object", "lamp" if kind == "ambient" else None)
    check_object(kind, str(name), str(where))
    return _readings(folder, facts, kind, str(name))


def _readings(folder: Path, facts: Mapping[str, Any], kind: str, name: str) -> SensorRecording:
    """The readings at the places of a grid, and between them, where there are any."""
    made, path = _read(folder / READINGS, facts, kind, name), folder / EDGES
    if not path.exists():
        return made
    edges = replace(_read(path, facts, kind, name), source=str(path))
    digest = hashlib.sha256((made.hash + edges.hash).encode()).hexdigest()
    return replace(made, edges=edges, hash=digest)


def _read(path: Path, facts: Mapping[str, Any], kind: str, name: str) -> SensorRecording:
    folder, table = path.parent, checks.read_rows(path, ends="places" in facts)
    sensors = _sensor_columns(table, facts)
    check_heights(folder, facts)
    pose, arena, body = None, None, body_of(folder, facts)
    if "arena" in facts and "x_cm" in table.columns:
        table.need((*POSE, "repeat"))
        arena = load_arena(folder / str(facts["arena"]))
        pose = _pose(table, empty=False)
        distance, bearing = _from_lamp(pose, arena, body.radius_cm)
    else:
        distance, bearing = _from_object(table)
    # A column without any reading is a sensor that was not recorded.
    counts = np.stack([table.numbers(s, empty=not any(table.texts(s))) for s in sensors], 1)
    full_scale = number_of(folder, facts, "full_scale", "the highest count")
    warned = checks.check_readings(
        table, kind=kind, distance_cm=distance, bearing_deg=bearing, counts=counts, full_scale=full_scale
    )
    return SensorRecording(
        kind=kind,
        object=name,
        distance_cm=distance,
        bearing_deg=180.0 - (180.0 - bearing) % 360.0,
        repeat=table.whole("repeat"),
        counts=counts,
        pose=pose,
        arena=arena,
        body_radius_cm=body.radius_cm,
        body_outline_cm=body.outline_cm,
        reflectance=reflectance_of(folder, facts, pose is None and kind == "infrared"),
        body_said="body_radius_cm" in facts or "body_outline_cm" in facts,
        full_scale=full_scale,
        lines=[table.at(k) for k in range(len(table.rows))],
        speed_cm_s=np.abs(table.numbers("speed_cm_s")) if "speed_cm_s" in table.columns else None,
        warnings=(*checks.doubt_object(name, folder), *warned, *_unfinished(table, facts)),
        **_common(folder, table, facts),
    )


def _wheels(folder: Path, facts: Mapping[str, Any]) -> WheelRecording:
    table = checks.read_rows(folder / STEPS, ends="places" in facts)
    counting = any(name in table.columns for name in WHEEL_COUNTS)
    table.need([name for name in STEP_COLUMNS if name not in (SPEEDS if counting else WHEEL_COUNTS)])
    kind = np.array(table.texts("kind"), str)
    table.refuse(~np.isin(kind, STEP_KINDS), "kind", f"one of {', '.join(STEP_KINDS)}", kind)
    t, trial = table.numbers("t_s"), table.whole("trial")
    back = np.concatenate([[False], (np.diff(t) <= 0) & (np.diff(trial) == 0)])
    table.refuse(back, "t_s", "a time after the row's before", t, "A trial's rows follow each other.")
    _, first = np.unique(trial, return_index=True)
    again = (np.diff(trial, prepend=-1) != 0) & ~np.isin(np.arange(len(t)), first)
    table.refuse(again, "trial", "a new number", trial.astype(float), "A trial's rows follow each other.")

    def pair(name: str) -> Floats:
        empty = name == "speed"
        return np.stack([table.numbers(f"{name}_{side}", empty=empty) for side in ("left", "right")], 1)

    pulses = number_of(folder, facts, "pulses_per_mm", "pulses of a counter in a millimetre of way")
    return WheelRecording(
        t_s=t,
        commands=pair("command"),
        counters=pair("counter") if counting else np.full((len(t), 2), math.nan),
        speeds=pair("speed") if set(SPEEDS) <= set(table.columns) else np.full((len(t), 2), math.nan),
        trial=trial,
        kind=kind,
        pulses_per_mm=pulses or PULSES_PER_MM,
        pulses_said=pulses is not None,
        pose=_pose(table, empty=True) if set(POSE) <= set(table.columns) else None,
        warnings=(
            *(checks.check_steps(pair("command"), pair("counter")) if counting else ()),
            *_unfinished(table, facts),
        ),
        **_common(folder, table, facts),
    )


def _common(folder: Path, table: Table, facts: Mapping[str, Any]) -> dict[str, Any]:
    # Without the date: the same readings have the same hash.
    lines = (folder / FACTS).read_bytes().splitlines(keepends=True)
    told = b"".join(line for line in lines if not line.startswith((b"date =", b'"date" =')))
    digest = hashlib.sha256(told + table.path.read_bytes()).hexdigest()
    return {"source": str(folder), "hash": digest, "notes": str(facts.get("notes", "")), "facts": facts}


def _sensor_columns(table: Table, facts: Mapping[str, Any]) -> list[str]:
    """s0, s1, … without a gap, as many as the facts state, if they do."""
    found = [name for name in table.columns if name[:1] == "s" and name[1:].isdecimal()]
    expected = facts.get("sensors", max(len(found), 1))
    if isinstance(expected, bool) or not isinstance(expected, int) or expected < 1:
        where = table.path.with_name(FACTS)
        raise RecordingError(f"{where}: sensors: expected a whole number from 1 on, got {expected!r}.")
    if sorted(found) != sorted(f"s{i}" for i in range(expected)):
        raise RecordingError(
            f"{table.head}: expected the sensors' columns s0 to s{expected - 1}, got "
            f"{', '.join(found or table.columns)}. "
            f"Another number of sensors is said with `sensors` in {FACTS}."
        )
    return [f"s{i}" for i in range(expected)]


def _pose(table: Table, *, empty: bool) -> Floats:
    """[n, 3] x, y (cm), heading (rad)."""
    pose = np.stack([table.numbers(name, empty=empty) for name in POSE], 1)
    pose[:, 2] = np.radians(pose[:, 2])
    return pose


def _from_object(table: Table) -> tuple[Floats, Floats]:
    """Distance of the object from the body's edge (cm) and its bearing (degrees)."""
    if "x_cm" in table.columns and "distance_cm" not in table.columns:
        where = table.path.with_name(FACTS)
        raise RecordingError(f'{where}: arena: missing; poses need the room: add arena = "file.toml".')
    table.need((*POLAR, "repeat"))
    distance, bearing = table.numbers("distance_cm"), table.numbers("bearing_deg")
    table.refuse(distance < 0, "distance_cm", "0 or more", distance, "It counts from the body's edge.")
    cure = "Are these millimetres? Where nothing was near, leave the row out."
    table.refuse(distance > FARTHEST_CM, "distance_cm", f"at most {FARTHEST_CM:g}", distance, cure)
    table.refuse(np.abs(bearing) > 360, "bearing_deg", "degrees from −360 to 360", bearing)
    return distance, bearing


def _from_lamp(pose: Floats, arena: Arena, body_radius_cm: float) -> tuple[Floats, Floats]:
    """Distance of the arena's first lamp from the body's edge (cm) and its bearing (degrees)."""
    if not arena.lamps:
        return np.full(len(pose), math.nan), np.full(len(pose), math.nan)
    dx, dy = arena.lamps[0].x_cm - pose[:, 0], arena.lamps[0].y_cm - pose[:, 1]
    return np.hypot(dx, dy) - body_radius_cm, np.degrees(np.arctan2(dy, dx) - pose[:, 2])


def _unfinished(table: Table, facts: Mapping[str, Any]) -> tuple[str, ...]:
    """A warning if there are fewer places than planned, or not all that were looked for between them."""
    planned = facts.get("places")
    if not isinstance(planned, int):
        return ()
    key = ("trial",) if "trial" in table.columns else POSE if "x_cm" in table.columns else POLAR
    done = len(set(zip(*(table.texts(name) for name in key), strict=True)))
    if done < planned:
        what = f"{table.path}: unfinished: {done} of {planned} places"
    elif facts.get("between") == UNFINISHED:
        what = f"{table.path.parent}: unfinished: places between the bearings, which tell where rays end"
    else:
        return ()
    return (f"{what}; `realitygap record … --resume` goes on",)
