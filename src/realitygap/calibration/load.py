"""Reads recordings: a folder (recording.toml and a table), a `.sam` table of the Khepera community, a
Thymio's series before a wall, or anybody's logs by a MAP.toml (`realitygap look`)."""

import hashlib
import math
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from realitygap.calibration.cleaning import cleaned, first_pulses
from realitygap.calibration.recordings import (
    BODY_RADIUS_CM,
    EXCEEDED,
    HEIGHTS_CM,
    PULSES_PER_MM,
    Recording,
    SensorRecording,
    WheelRecording,
    check_object,
    count_unit,
)
from realitygap.errors import ConfigError, RecordingError
from realitygap.files import (
    LARGEST_TABLE,
    Table,
    as_path,
    read_table,
    read_text,
    read_toml,
    refuse_separator,
    refuse_unknown,
)
from realitygap.logs.mapped import ASKED, SIDES, Mapped, read_map
from realitygap.values import Floats
from realitygap.world.arena import WHITEST, Arena, load_arena
from realitygap.world.robot import Body
from realitygap.world.toml import build

__all__ = ["find_recordings", "load_recording"]

FACTS, READINGS, STEPS = "recording.toml", "readings.csv", "steps.csv"
MAP = "MAP.toml"
DRIVE = "drive.toml"
"""The facts of a drive (`realitygap.robots`), which is no recording for a calibration."""

POLAR = ("distance_cm", "bearing_deg")
POSE = ("x_cm", "y_cm", "heading_deg")
STEP_COLUMNS = (
    "t_s", "command_left", "command_right", "counter_left", "counter_right",
    "speed_left", "speed_right", "trial", "kind",
)  # fmt: skip
COMMANDS, COUNTERS, SPEEDS = ((f"{what}_left", f"{what}_right") for what in ("command", "counter", "speed"))
"""Of which one is needed."""
WHEEL_COUNTS = (*COUNTERS, *SPEEDS)
"""Columns that only wheels with counters have; no fit needs their speeds."""
STEP_KINDS = ("step", "start", "straight", "turn")
UNITS = "cm, degrees, s, counts, {}, pulses"
"""Units of the numbers; commands and speeds are in the robot's own units, named in the braces."""
KNOWN = (
    "kind", "object", "reflectance", "gain", "start_cm", "sensors", "full_scale", "body_radius_cm",
    "body_outline_cm", *HEIGHTS_CM, "arena", "units", "placed_by", "notes", "robot", "unit",
    "twin_noise", "port", "bios", "protocol", "firmware", "plan", "seed", "repeats", "bearings",
    "distances_cm", "places", "between", "date", "base", "pulses_per_mm", "marker", "id", "productId",
    "fwversion", "prox.comm.tx",
)  # fmt: skip
"""Keys of recording.toml: a calibration reads those about the body, surfaces, places and units; the others
are for the record, the last ones from a Thymio."""
UNKNOWN = "unknown"
"""A reflectance, a gain or a start that is to be fitted."""

KINDS = ("infrared", "ambient", "wheels")
FARTHEST_CM, REACH_CM = 300.0, 20.0
"""No object was recorded beyond the first; infrared sees nothing beyond the second, twice a Khepera's range.
Else they are mm."""
BRIGHT = 300.0
"""Counts of the paper's robot."""

SAM_SENSORS, SAM_TOP = 8, 1023
"""`.sam` tables are a Khepera's: eight sensors and a 10-bit converter."""
LIGHT_SCALE, LIGHT_STEP = 500.0, 10.24
"""A light table is inverted and scaled: V = 500·(1 − x/1024), x in steps of 10.24. The 500 is an
assumption of the tables' keepers."""

SERIES = re.compile(r"sensor.*\.csv", re.IGNORECASE)
SERIES_NAME = re.compile(r"sensor0*([0-6])_.*\.csv", re.IGNORECASE)
SERIES_CM = re.compile(r"([0-9]+(?:\.[0-9]*)?|\.[0-9]+)\s*(cm|mm)", re.IGNORECASE)
SERIES_SENSORS, STALE = 7, 2
"""A Thymio's horizontal sensors; the first readings of a row may still belong to the distance before."""


def find_recordings(path: str | Path) -> Sequence[Path]:
    """The recordings at a path: itself, or all recordings in a folder.

    Raises:
        RecordingError: there is none.
    """
    path = Path(path)
    alone = path.suffix.lower() in (".sam", ".csv", ".toml")
    if alone or any((path / name).is_file() for name in (FACTS, DRIVE)):
        return (path,)
    if (path / MAP).is_file():
        return (path / MAP,)
    inside = sorted(found.parent for found in path.glob(f"*/{FACTS}"))
    inside = inside or sorted(found for found in path.glob("*") if SERIES.fullmatch(found.name))
    if inside:
        return tuple(inside)
    if path.is_file():
        raise RecordingError(
            f"{path}: a log of some robot, whose columns nobody has named yet. Run `realitygap look {path}` "
            "first: it writes a MAP.toml, which is given in its place."
        )
    what = "holds no recording" if path.is_dir() else "there is no such recording"
    raise RecordingError(f"{path}: {what}. Make one with `realitygap record`, or give a .sam table.")


def load_recording(path: str | Path, *, object: str | None = None) -> Recording:
    """A recording's folder, a `.sam` table, a Thymio's series (`sensor02_light.csv`), or logs by a MAP.toml.

    Args:
        path: the folder, its recording.toml, the table, or the MAP.toml.
        object: the object of a table, or one that replaces a recording's.

    Raises:
        RecordingError: what is missing or wrong, with file and line.
    """
    path = as_path(path, "recording")
    if path.suffix.lower() == ".sam":
        return _read_sam(path, object)
    if path.suffix.lower() == ".csv":
        return _read_series(path)
    if path.suffix.lower() == ".toml" and path.name not in (FACTS, DRIVE):
        return _read_map(path, object)
    return _read_folder(path.parent if path.name in (FACTS, DRIVE) else path, object)


def _read_folder(folder: Path, object: str | None) -> Recording:
    where, make = folder / FACTS, "Make one with `realitygap record`."
    if (folder / DRIVE).is_file():
        raise _drive(folder, read_toml(folder / DRIVE, RecordingError, make))
    if not where.exists():
        what = f"there is no {FACTS} in it" if folder.is_dir() else "there is no such folder"
        raise RecordingError(f"{folder}: no recording: {what}. {make}")
    facts = read_toml(where, RecordingError, make)
    steps = folder / STEPS  # earlier versions called a drive's facts recording.toml, too
    if "kind" not in facts and steps.is_file() and b"late_s" in steps.read_bytes()[:99]:
        raise _drive(folder, facts)
    kind, units = facts.get("kind"), str(facts.get("units", UNITS))
    _check_facts(where, facts)
    if kind not in KINDS:
        raise RecordingError(f"{where}: kind: expected {', '.join(KINDS)}, got {kind!r}.")
    if not re.fullmatch(UNITS.format(".*"), units, re.DOTALL):
        expected = UNITS.format("the units of its commands")
        raise RecordingError(
            f"{where}: units: expected {expected!r}, got {units!r}. Convert the table first."
        )
    table = _read_rows(folder / (STEPS if kind == "wheels" else READINGS), facts)
    origin = _origin(table, facts)
    if kind == "wheels":
        return _read_wheels(table, where, facts, origin)
    return _read_sensors(table, where, facts, str(kind), object, origin)


def _check_facts(where: Path, facts: Mapping[str, Any]) -> None:
    """Refuse keys that nothing reads, and what says wrongly who placed the robot."""
    refuse_unknown(facts, KNOWN, RecordingError, where=str(where), cure="Anything else goes into notes.")
    if facts.get("placed_by", "person") not in ("person", "program"):
        expected = '"person" or "program"'
        raise RecordingError(f"{where}: placed_by: expected {expected}, got {facts['placed_by']!r}.")


def _drive(folder: Path, facts: Mapping[str, Any]) -> RecordingError:
    how = "" if "end" in facts else " that was killed before its end"
    return RecordingError(
        f"{folder}: expected a recording for a calibration, got a drive's{how}. Make one with "
        "`realitygap record`."
    )


def _digest(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()


def _origin(table: Table, facts: Mapping[str, Any]) -> dict[str, Any]:
    """What `Recorded` holds of a folder."""
    folder = table.path.parent
    # Without the date: the same readings have the same hash.
    lines = (folder / FACTS).read_bytes().splitlines(keepends=True)
    kept = b"".join(line for line in lines if not line.startswith((b"date =", b'"date" =')))
    digest = _digest(kept + table.path.read_bytes())
    return {"source": str(folder), "hash": digest, "notes": str(facts.get("notes", "")), "facts": facts}


def _read_rows(path: Path, facts: Mapping[str, Any]) -> Table:
    """A recording's table; one that a recorder writes is complete to the end of its last line."""
    table = read_table(path, RecordingError)
    if not table.rows:
        raise RecordingError(f"{path}: empty: expected a line of column names and a row for each reading.")
    if "places" in facts and not path.read_bytes().endswith(b"\n"):
        raise RecordingError(f"{table.at(-1)}: cut short. Go on with `realitygap record … --resume`.")
    twice = [name for name in table.columns if name and table.columns.count(name) > 1]
    if twice:
        raise RecordingError(f"{table.head}: the column {twice[0]!r} stands there twice.")
    return table


def _unfinished(table: Table, facts: Mapping[str, Any]) -> list[str]:
    """A warning if there are fewer places than planned."""
    planned = facts.get("places")
    key = ("trial",) if "trial" in table.columns else POSE if "x_cm" in table.columns else POLAR
    done = len(set(zip(*(table.texts(name) for name in key), strict=True)))
    if not isinstance(planned, int) or done >= planned:
        return []
    return [f"{table.path}: unfinished: {done} of {planned} places; `realitygap record … --resume` goes on"]


def _number(
    where: Path, facts: Mapping[str, Any], key: str, what: str, most: float = LARGEST_TABLE
) -> float | None:
    """A positive number among the facts; None if it is missing. `what`: the fact and its unit, in words."""
    value = facts.get(key)
    if value is None:
        return None
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0 < value <= most:
        raise RecordingError(f"{where}: {key}: expected {what}, got {value!r}.")
    return float(value)


# Sensors


def _read_sensors(
    table: Table, where: Path, facts: Mapping[str, Any], kind: str, object: str | None, origin: dict[str, Any]
) -> SensorRecording:
    name = str(object or facts.get("object", "lamp" if kind == "ambient" else None))
    check_object(kind, name, str(where))
    body, full_scale = _body(where, facts), _number(where, facts, "full_scale", "the highest count")
    sensors = _sensor_columns(table, facts)
    posed = "arena" in facts and "x_cm" in table.columns
    pose = arena = None
    if posed:
        table.need((*POSE, "repeat"))
        arena, pose = load_arena(where.with_name(str(facts["arena"]))), _poses(table, empty=False)
        distance, bearing = _from_lamp(pose, arena, body.radius_cm)
    elif "x_cm" in table.columns and "distance_cm" not in table.columns:
        raise RecordingError(f'{where}: arena: missing; poses need the room: add arena = "file.toml".')
    else:
        table.need((*POLAR, "repeat"))
        distance, bearing = (table.numbers(column) for column in POLAR)
    gain, start_cm = (
        _own(where, facts, key, kind == "infrared" and not posed) for key in ("gain", "start_cm")
    )
    distance = distance + np.nan_to_num(start_cm)
    # An empty cell is a reading that was not taken, an empty column a sensor that was not recorded.
    counts = np.stack([table.numbers(s, empty=True) for s in sensors], 1)
    _check_readings(table, kind, distance, bearing, counts, full_scale)
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
        body_said="body_radius_cm" in facts or "body_outline_cm" in facts,
        full_scale=full_scale,
        gain=gain,
        start_cm=start_cm if math.isnan(start_cm) else 0.0,
        reflectance=_reflectance(where, facts, kind == "infrared" and not posed),
        speed_cm_s=np.abs(table.numbers("speed_cm_s")) if "speed_cm_s" in table.columns else None,
        lines=[table.at(k) for k in range(len(table.rows))],
        warnings=tuple(_unfinished(table, facts)),
        **origin,
    )


def _check_readings(
    table: Table, kind: str, distance: Floats, bearing: Floats, counts: Floats, full_scale: float | None
) -> None:
    """Refuse readings that are impossible in counts, centimetres and degrees, by line, column and unit."""
    mm = "Are these millimetres? Where nothing was near, leave the row out."
    if "distance_cm" in table.columns:
        off = (distance < 0) | (distance > FARTHEST_CM)
        table.refuse(off, "distance_cm", f"0 to {FARTHEST_CM:g} cm from the body's edge", distance, mm)
        table.refuse(np.abs(bearing) > 360, "bearing_deg", "degrees from −360 to 360", bearing)
    top = math.inf if full_scale is None else full_scale
    expected = f"counts from 0 to {top:g} (full_scale)"
    for k, values in enumerate(counts.T):
        table.refuse((values < 0) | (values > EXCEEDED * top), f"s{k}", expected, values)
    brightest = np.nan_to_num(counts).max(axis=1)
    bright = BRIGHT * max(1.0, count_unit(full_scale or float(brightest.max())))
    if kind == "infrared":
        far = (distance > REACH_CM) & (brightest > bright)
        expected = f"at most {REACH_CM:g} cm where a sensor reads {bright:g} counts or more"
        table.refuse(far, "distance_cm", expected, distance, mm)


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
            f"{', '.join(found or table.columns)}. Another number is said with `sensors` in {FACTS}."
        )
    return [f"s{i}" for i in range(expected)]


def _body(where: Path, facts: Mapping[str, Any]) -> Body:
    """The body whose edge distances are measured from, a disc or a polygon; its heights are checked, too."""
    outline = facts.get("body_outline_cm", ())
    radius = facts.get("body_radius_cm", 0.0 if outline else BODY_RADIUS_CM)
    heights = [_number(where, facts, key, "cm above the floor") for key in HEIGHTS_CM]
    top, eyes = (0.0 if height is None else height for height in heights)
    if (top, eyes) != (0.0, 0.0) and not 0 < eyes < top:
        raise RecordingError(
            f"{where}: {' and '.join(HEIGHTS_CM)}: expected both, in cm above the floor, the sensors below "
            "the body's top. Correct them, or leave both out: those of --base are used then."
        )
    try:
        return build(Body, {"radius_cm": radius, "outline_cm": outline})
    except ConfigError as error:
        raise RecordingError(f"{where}: body_{error}") from None


def _reflectance(where: Path, facts: Mapping[str, Any], allowed: bool) -> float:
    """Reflectance of the object's surface, NaN if it is to be fitted; `allowed`: whether it may be stated."""
    if "reflectance" in facts and not allowed:
        raise RecordingError(
            f"{where}: reflectance: expected in an infrared recording of a wall or a cylinder; of an arena's "
            "surfaces it stands in the arena's file."
        )
    if facts.get("reflectance") == UNKNOWN:
        return math.nan
    what = f'a number above 0, at most {WHITEST:g}, or "{UNKNOWN}"'
    return _number(where, facts, "reflectance", what, WHITEST) or 1.0


def _own(where: Path, facts: Mapping[str, Any], key: str, allowed: bool) -> float:
    """A constant of the recording's own, `gain` or `start_cm`, NaN if it is to be fitted."""
    usual, least, most, unit = (1.0, 0.01, 100.0, "times") if key == "gain" else (0.0, -10.0, 10.0, "cm")
    value = facts.get(key, usual)
    if value == UNKNOWN and allowed:
        return math.nan
    known = isinstance(value, int | float) and not isinstance(value, bool) and least <= value <= most
    if not known or (key in facts and not allowed):
        expected = f'a number from {least:g} to {most:g} ({unit}), or "{UNKNOWN}", of infrared without poses'
        raise RecordingError(f"{where}: {key}: expected {expected}, got {value!r}.")
    return float(value)


def _poses(table: Table, *, empty: bool) -> Floats:
    """[n, 3] x, y (cm), heading (rad)."""
    pose = np.stack([table.numbers(name, empty=empty) for name in POSE], 1)
    pose[:, 2] = np.radians(pose[:, 2])
    return pose


def _from_lamp(pose: Floats, arena: Arena, body_radius_cm: float) -> tuple[Floats, Floats]:
    """Distance of the arena's first lamp from the body's edge (cm) and its bearing (degrees)."""
    if not arena.lamps:
        return np.full(len(pose), math.nan), np.full(len(pose), math.nan)
    dx, dy = arena.lamps[0].x_cm - pose[:, 0], arena.lamps[0].y_cm - pose[:, 1]
    return np.hypot(dx, dy) - body_radius_cm, np.degrees(np.arctan2(dy, dx) - pose[:, 2])


# Wheels


def _read_wheels(
    table: Table, where: Path, facts: Mapping[str, Any], origin: dict[str, Any]
) -> WheelRecording:
    """Drives; what is known of the wheels is one of commands, counters and speeds at least."""
    have = {name for name in table.columns if any(table.texts(name))}
    some = next((pair for pair in (COUNTERS, SPEEDS, COMMANDS) if set(pair) <= have), None)
    if some is None:
        raise RecordingError(
            f"{table.head}: expected columns {', '.join(COUNTERS)}, or those of speeds or commands, got "
            f"{', '.join(table.columns)}. Add those that were recorded."
        )
    table.need(("t_s", "trial"))
    kind = np.array(table.texts("kind") if "kind" in have else ["step"] * len(table.rows), str)
    table.refuse(~np.isin(kind, STEP_KINDS), "kind", f"one of {', '.join(STEP_KINDS)}", kind)
    t, trial = table.numbers("t_s"), table.whole("trial")
    follow = "A trial's rows follow each other."
    back = np.concatenate([[False], (np.diff(t) <= 0) & (np.diff(trial) == 0)])
    table.refuse(back, "t_s", "a time (s) after the row's before", t, follow)
    _, first = np.unique(trial, return_index=True)
    again = (np.diff(trial, prepend=-1) != 0) & ~np.isin(np.arange(len(t)), first)
    table.refuse(again, "trial", "a new number", trial.astype(float), follow)

    def pair(names: Sequence[str]) -> Floats:
        if not set(names) <= have:
            return np.full((len(t), 2), math.nan)
        return np.stack([table.numbers(name, empty=names == SPEEDS and some != SPEEDS) for name in names], 1)

    commands, counters, speeds = map(pair, (COMMANDS, COUNTERS, SPEEDS))
    if some == SPEEDS:  # by trapezia: where they were read is not known better
        step = np.diff(t, prepend=t[:1]) * (np.diff(trial, prepend=trial[:1]) == 0)
        counters = np.cumsum((speeds + np.roll(speeds, 1, axis=0)) / 2 * step[:, None], axis=0)
    pose = None
    if {"x_cm", "y_cm"} <= have:
        names = [name if name in have else "" for name in POSE]
        pose = np.stack([table.numbers(n, empty=True) if n else np.full(len(t), math.nan) for n in names], 1)
        pose[:, 2] = np.radians(pose[:, 2])
    pulses = _number(where, facts, "pulses_per_mm", "pulses of a counter in a millimetre of way")
    made = WheelRecording(
        t_s=t, commands=commands, counters=counters, speeds=speeds, trial=trial, kind=kind, pose=pose,
        pulses_per_mm=pulses or PULSES_PER_MM, pulses_said=pulses is not None, from_speeds=some == SPEEDS,
        warnings=tuple(_unfinished(table, facts)), **origin,
    )  # fmt: skip
    return cleaned(made, table.at)


# Logs of others, by a MAP.toml


def _read_map(path: Path, object: str | None) -> Recording:
    """The recording that a MAP.toml makes of its logs: the same table as that of a folder."""
    mapped = read_map(path)
    facts, columns = dict(mapped.facts), dict(mapped.columns)
    if mapped.kind not in KINDS:
        raise RecordingError(f"{path}: kind: expected {', '.join(KINDS)}, got {mapped.kind!r}: only a path.")
    for key in (key for key, value in facts.items() if value == ASKED and not (object and key == "object")):
        raise RecordingError(f'{path}: {key}: expected its value, got "?": `realitygap look` asks you.')
    origin = {"source": str(path), "hash": mapped.hash, "notes": str(facts.get("notes", "")), "facts": facts}
    for name in columns.keys() & {"heading_deg", "bearing_deg"}:
        columns[name] = np.degrees(columns[name])
    made: dict[str, Any]
    if mapped.kind == "wheels":
        mapped.need("t_s")
        made = {**_of_both_wheels(mapped, facts), **columns, "trial": mapped.run}
    else:
        made = _of_sensors(mapped, columns, facts)
    _check_facts(path, facts)
    rows = [["" if v != v else f"{v:.12g}" for v in row] for row in zip(*made.values(), strict=True)]
    table = Table(path, tuple(made), rows, 0, mapped.lines, RecordingError, f"Correct {path} or its log.")
    recording: Recording = (
        _read_wheels(table, path, facts, origin)
        if mapped.kind == "wheels"
        else _read_sensors(table, path, facts, mapped.kind, object, origin)
    )
    said = [*mapped.notes, *(warning.removeprefix(f"{path}: ") for warning in recording.warnings)]
    recording = replace(recording, warnings=(f"{path}: {'; '.join(said)}",) if said else ())
    if isinstance(recording, SensorRecording) or recording.pulses_said:
        return recording
    found = first_pulses(recording)
    return replace(recording, pulses_per_mm=found, pulses_said=True) if math.isfinite(found) else recording


def _of_sensors(mapped: Mapped, columns: dict[str, Floats], facts: dict[str, Any]) -> dict[str, Floats]:
    """The columns of readings, with bearings from `bearing_deg` (one, or one for each sensor) if it is said,
    and which of the readings at its place each is."""
    readings, bearing = mapped.sensors, facts.pop("bearing_deg", None)
    if readings is None:
        raise RecordingError(f"{mapped.path}: expected readings: columns s0, s1 …, or sensor and reading.")
    read = np.isfinite(readings).argmax(axis=1)
    if bearing is not None:
        try:
            columns["bearing_deg"] = np.broadcast_to(np.array(bearing, float), readings.shape[1:])[read]
        except ValueError:
            expected = f"bearing_deg: expected degrees: a number, or a list of {readings.shape[1]}"
            raise RecordingError(f"{mapped.path}: {expected}, got {bearing!r}.") from None
    made, seen = columns | {f"s{k}": column for k, column in enumerate(readings.T)}, Counter[Any]()
    made["repeat"] = np.zeros(len(read))
    for k, place in enumerate(zip(*(made[n] for n in (*POLAR, *POSE) if n in made), read, strict=True)):
        made["repeat"][k] = seen[place]
        seen[place] += 1
    return made


def _of_both_wheels(mapped: Mapped, facts: dict[str, Any]) -> dict[str, Floats]:
    """Speeds and commands of each wheel in cm/s from those of the robot; for speeds of a known unit
    `pulses_per_mm` is that of their integral."""
    columns, track, out = mapped.columns, facts.pop("track_cm", None), dict[str, Floats]()
    for ahead, turn, name in (("v", "w", "speed"), ("command_v", "command_w", "command")):
        if ahead in columns or turn in columns:
            mapped.need(ahead, turn)
            if not isinstance(track, int | float) or track <= 0:
                raise RecordingError(
                    f"{mapped.path}: track_cm: expected the cm between the wheels with which the robot makes "
                    f"{ahead} and {turn} from their speeds, got {track!r}."
                )
            for side, sign in zip(SIDES, (-1, 1), strict=True):
                out[f"{name}_{side}"] = columns[ahead] + sign * columns[turn] * track / 2
    speeds = "v" in columns or mapped.units.get("speed_left", "own") != "own"
    if speeds and "counter_left" not in columns:
        facts.setdefault("pulses_per_mm", 0.1)
    return out


# Tables of others


def _read_sam(path: Path, object: str | None) -> SensorRecording:
    """A table of the Khepera community: a line `sensors bearings distances first_mm step_mm`; for each
    distance a line `TURN k` and a line of readings for each bearing, clockwise from the front; then `END`."""
    text = read_text(path, RecordingError, "Give the path of a .sam table.").strip().upper()
    lines = text.splitlines() or [""]
    try:
        words = lines[0].split()
        (sensors, bearings, distances), (first, step) = map(int, words[:3]), map(float, words[3:])
        far = first + step * (distances - 1)
        likely = sensors == SAM_SENSORS and bearings > 0 and 0 <= first < far <= 10 * FARTHEST_CM
    except ValueError:
        likely = False
    if not likely:
        raise RecordingError(
            f"{path}, line 1: expected `sensors bearings distances first_mm step_mm`, as in `8 180 20 5 2`, "
            f"of 8 sensors and up to {10 * FARTHEST_CM:g} mm, got {lines[0][:40]!r}."
        )
    try:
        counts = np.array([line.split() for line in lines[1:-1] if "TURN" not in line], float)
        whole = counts.shape == (distances * bearings, SAM_SENSORS) and lines[-1].strip() == "END"
        whole &= bool(((counts >= 0) & (counts <= SAM_TOP) & (counts % 1 == 0)).all())
    except ValueError:
        whole = False
    if not whole:
        raise RecordingError(
            f"{path}: expected {distances * bearings} rows of {SAM_SENSORS} whole numbers from 0 to "
            f"{SAM_TOP}, as its first line says, TURN before each distance, and END. Fetch it again."
        )
    distance = (first + step * np.arange(distances)) / 10.0
    # Light tables were truncated to integers.
    off = np.abs(counts - np.rint(counts / LIGHT_STEP) * LIGHT_STEP)
    light = bool((off < 1.0).all() and len(np.unique(counts)) > 3)
    said = object or ("lamp" if light else "wall")
    kind = "ambient" if said == "lamp" else "infrared"
    check_object(kind, said, str(path))
    ends = float(((counts >= SAM_TOP) | (counts < LIGHT_STEP)).mean())
    if (kind == "infrared" and light) or (kind == "ambient" and not light and ends > 0.5):
        here = f"every reading lies on a step of {LIGHT_STEP}, as of ambient light. Give --object lamp."
        near = f"{ends:.0%} are 0 or {SAM_TOP}, as of proximity. Give --object wall or cylinder:RADIUS_CM."
        raise RecordingError(f"{path}: {here if light else near}")
    bearing = 180.0 - (180.0 + 360.0 / bearings * np.arange(bearings)) % 360.0
    guessed = () if object else (f"{path}: its object is not said; taken for a {said} (--object says it)",)
    return SensorRecording(
        kind=kind, object=said, full_scale=SAM_TOP, repeat=np.zeros(len(counts), np.int64),
        distance_cm=np.repeat(distance, bearings), bearing_deg=np.tile(bearing, distances),
        counts=LIGHT_SCALE * (1.0 - counts / 1024.0) if kind == "ambient" else counts,
        reflectance=math.nan if said.startswith("cylinder") else 1.0,  # the table says nothing of its surface
        source=str(path), hash=_digest(path.read_bytes()), warnings=guessed,
        notes=f"a .sam table, {distances} distances and {bearings} bearings, one reading each",
    )  # fmt: skip


def _read_series(path: Path) -> SensorRecording:
    """Readings of one Thymio II sensor before a wall (`resilient-swarms/thymio`, MIT licence): a row has one
    distance ("9cm") and the readings there, in time order; an empty cell is a missing reading."""
    named = SERIES_NAME.fullmatch(path.name)
    if named is None:
        raise RecordingError(
            f"{path}: expected the name of a Thymio's series, as sensor02_light.csv, with the sensor's "
            f"number 0 to 6. Other tables are folders with a {FACTS}, or run "
            f"`realitygap look {path}` first."
        )
    lines = read_text(path, RecordingError, "Give the path of a Thymio's series.").splitlines()
    refuse_separator(path, lines, RecordingError)
    distance, values, at = [], [], []
    for number, line in enumerate(lines, 1):
        cells = [cell.strip(' \t"') for cell in line.split(",")]
        if not any(cells):
            continue
        away = SERIES_CM.fullmatch(cells[0])
        away_cm = float(away[1]) / (10.0 if away[2].lower() == "mm" else 1.0) if away else math.inf
        try:
            counts = [float(cell) for cell in cells[1 + STALE :] if cell]
        except ValueError:
            counts = []
        if away_cm > FARTHEST_CM or not counts or not all(0 <= count < math.inf for count in counts):
            raise RecordingError(
                f"{path}, line {number}: expected a distance as in 9cm or 87.5mm, at most {FARTHEST_CM:g} "
                f"cm, and more than {STALE} readings, counts from 0 on, got {line[:40]!r}."
            )
        at += [f"{path}, line {number}"] * len(counts)
        distance += [away_cm] * len(counts)
        values += counts
    if not values:
        raise RecordingError(f"{path}: empty: expected a line for each distance.")
    sensor, table = int(named[1]), np.full((len(values), SERIES_SENSORS), np.nan)
    table[:, sensor] = values
    return SensorRecording(
        kind="infrared", object="wall", distance_cm=np.array(distance), bearing_deg=np.zeros(len(values)),
        repeat=np.arange(len(values)), counts=table, from_sensor=sensor, body_said=False, lines=at,
        source=str(path), hash=_digest(path.read_bytes()),
        notes=f"sensor {sensor} of a Thymio II before a wall, the first {STALE} readings of a row left out",
    )  # fmt: skip
