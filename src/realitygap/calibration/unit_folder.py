"""The folder of a calibrated unit: its owner, its recordings and their parts."""

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from realitygap.calibration.recorder.journal import STUDY
from realitygap.calibration.recordings import FACTS
from realitygap.errors import CalibrationError
from realitygap.files import atomic_write, read_toml, refuse_unknown, to_toml

__all__ = [
    "MEASURING", "PARTS", "PROFILE", "RECORDINGS", "SETTINGS", "claim", "form_of", "is_recorded",
    "kind_of", "parts_in", "parts_of", "recordings_of", "settings_of",
]  # fmt: skip

PROFILE, SETTINGS, RECORDINGS = "robot.toml", "unit.toml", "recordings"
PARTS = ("ambient", "wheels", "infrared-wall", "infrared-cylinder")
"""The recordings, the longest kind first, so that two workers finish at about the same time."""
MEASURING = ("auto", "measured")
"""Forms whose fit of the proximity sensors takes so long that all workers share it."""
CURE = "Choose another folder, or remove this one."


def recordings_of(folder: Path) -> Path:
    """Where its recordings are; a share's are the whole unit's."""
    return folder / str(settings_of(folder).get("of", "")) / RECORDINGS


def kind_of(part: str) -> str:
    """The plan of a part, without its object."""
    return part.partition("-")[0]


def is_recorded(folder: Path, part: str) -> bool:
    """Whether a part is complete."""
    return (recordings_of(folder) / part / FACTS).is_file()


def parts_of(folder: Path) -> list[str]:
    """The recordings that the folder's robot is fitted to."""
    return list(settings_of(folder).get("parts", PARTS))


def form_of(folder: Path) -> str:
    """The form that its robot's sensors are fitted by."""
    known = settings_of(folder)
    # On the twin the printed form has the smallest error, which "auto" finds in three times the time.
    return str(known.get("form", "extended" if "unit" in known else "auto"))


def settings_of(folder: Path) -> dict[str, Any]:
    """The settings that the folder was made with."""
    return read_toml(folder / SETTINGS, CalibrationError, CURE)


def parts_in(given: Sequence[str]) -> list[str]:
    """Some of PARTS.

    Raises:
        CalibrationError: none, one twice, or something else.
    """
    listed = list(given) if isinstance(given, Iterable) and not isinstance(given, str) else []
    if not listed or len(set(map(str, listed))) < len(listed) or any(one not in PARTS for one in listed):
        raise CalibrationError(f"parts: expected a list of some of {', '.join(PARTS)}, got {given!r}.")
    return listed


def claim(folder: Path, settings: dict[str, Any]) -> None:
    """Mark the folder as this robot's, or check that it is."""
    path = folder / SETTINGS
    if not path.is_file():
        if any((folder / name).exists() for name in (PROFILE, RECORDINGS, STUDY)):
            raise CalibrationError(
                f"{folder}: expected a new folder, or one with {SETTINGS}; it holds something else. "
                "Choose another folder."
            )
        folder.mkdir(parents=True, exist_ok=True)
        atomic_write(path, to_toml(settings))
        return
    there = read_toml(path, CalibrationError, CURE, broken=CURE)
    refuse_unknown(there, settings, CalibrationError, where=str(path))
    for key, value in settings.items():
        if there.get(key) != value:
            raise CalibrationError(
                f"{path}: {key}: expected {value!r}, got {there.get(key)!r}: another calibration is there. "
                f"{CURE}"
            )
