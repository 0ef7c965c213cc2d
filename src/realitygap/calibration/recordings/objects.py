"""What a recording's sensors saw: a wall, a cylinder or a lamp."""

import math

from realitygap.errors import RecordingError

__all__ = ["KINDS", "check_object", "cylinder_radius"]

KINDS = ("infrared", "ambient", "wheels")


def cylinder_radius(name: str) -> float | None:
    """The radius (cm) of "cylinder:RADIUS_CM"; None for any other object."""
    word, _, rest = name.partition(":")
    try:
        radius = float(rest) if word == "cylinder" else math.nan
    except ValueError:
        return None
    return radius if math.isfinite(radius) and radius > 0 else None


def check_object(kind: str, name: str, where: str) -> None:
    """Refuse an object that sensors of this kind cannot be recorded with.

    Raises:
        RecordingError: names the known ones.
    """
    if kind not in KINDS[:2]:
        raise RecordingError(f'{where}: kind: expected "infrared" or "ambient", got {kind!r}.')
    if kind == "ambient" and name != "lamp":
        raise RecordingError(f'{where}: object: ambient light is recorded with a "lamp", got {name!r}.')
    if kind == "infrared" and name != "wall" and cylinder_radius(name) is None:
        raise RecordingError(
            f'{where}: object: expected "wall" or "cylinder:RADIUS_CM" with a radius above 0, got {name!r}. '
            "Say what the sensors saw."
        )
