"""The facts in recording.toml, each checked."""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from realitygap.calibration.recordings.checks import FACTS
from realitygap.calibration.recordings.recording import BODY_RADIUS_CM, HEIGHTS_CM
from realitygap.errors import ConfigError, RecordingError
from realitygap.files import LARGEST_TABLE as LARGEST
from realitygap.files import read_toml
from realitygap.world.arena import WHITEST
from realitygap.world.robot import Body
from realitygap.world.toml import build

__all__ = ["UNKNOWN", "body_of", "check_heights", "number_of", "read_facts", "reflectance_of"]

UNKNOWN = "unknown"
"""A reflectance that is to be fitted."""


def read_facts(folder: Path) -> dict[str, Any]:
    """The facts in recording.toml.

    Raises:
        RecordingError: no such file, or invalid TOML.
    """
    path = folder / FACTS
    make = "Make one with `realitygap record`."
    if not path.exists():
        what = f"there is no {FACTS} in it" if folder.is_dir() else "there is no such folder"
        raise RecordingError(f"{folder}: no recording: {what}. {make}")
    return read_toml(path, RecordingError, make)


def number_of(folder: Path, facts: Mapping[str, Any], key: str, what: str) -> float | None:
    """A positive number; None if it is missing.

    Args:
        folder: the recording's, for messages.
        facts: as read from its TOML.
        key: the fact's.
        what: the fact and its unit, in words, for messages.
    """
    if (value := facts.get(key)) is None:
        return None
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0 < value < LARGEST:
        raise RecordingError(f"{folder / FACTS}: {key}: expected {what}, got {value!r}.")
    return float(value)


def body_of(folder: Path, facts: Mapping[str, Any]) -> Body:
    """The body whose edge distances are measured from: a disc or a polygon."""
    outline = facts.get("body_outline_cm", ())
    value = facts.get("body_radius_cm", 0.0 if outline else BODY_RADIUS_CM)
    number = isinstance(value, int | float) and not isinstance(value, bool) and 0 <= value < 1e3
    if not number or not (value or outline):
        raise RecordingError(f"{folder / FACTS}: body_radius_cm: expected cm above 0, got {value!r}.")
    try:
        return build(Body, {"radius_cm": value, "outline_cm": outline})
    except ConfigError as error:
        raise RecordingError(f"{folder / FACTS}: body_{error}") from None


def reflectance_of(folder: Path, facts: Mapping[str, Any], told: bool) -> float:
    """Reflectance of the object's surface, NaN if it is to be fitted; `told`: whether the recording may state
    it."""
    value = facts.get("reflectance", 1.0)
    if "reflectance" in facts and not told:
        raise RecordingError(
            f"{folder / FACTS}: reflectance: expected in an infrared recording of a wall or a cylinder; of "
            "an arena's surfaces it stands in the arena's file."
        )
    if value == UNKNOWN:
        return math.nan
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0 < value <= WHITEST:
        what = f'a number above 0, at most {WHITEST:g}, or "{UNKNOWN}"'
        raise RecordingError(f"{folder / FACTS}: reflectance: expected {what}, got {value!r}.")
    return float(value)


def check_heights(folder: Path, facts: Mapping[str, Any]) -> None:
    """Refuse heights that are impossible, or one without the other."""
    said = [facts[key] for key in HEIGHTS_CM if key in facts]
    numbers = [v for v in said if isinstance(v, int | float) and not isinstance(v, bool) and v > 0]
    if said and (len(numbers) < len(HEIGHTS_CM) or not numbers[1] < numbers[0] < 1e3):
        raise RecordingError(
            f"{folder / FACTS}: {' and '.join(HEIGHTS_CM)}: expected both, in cm above the floor, the "
            f"sensors below the body's top, got {' and '.join(map(repr, said))}. Correct them, or leave both "
            "out: those of --base are used then."
        )
