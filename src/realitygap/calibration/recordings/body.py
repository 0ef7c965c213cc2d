"""The body of a recorded robot, as one recording or several together state it."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from realitygap.calibration.recordings.recording import (
    BODY_RADIUS_CM,
    HEIGHTS_CM,
    Recording,
    SensorRecording,
)
from realitygap.errors import CalibrationError, ConfigError
from realitygap.robots.body import Channel
from realitygap.world.robot import Body, Profile, load_profile

__all__ = ["as_recorded", "stated_heights", "stated_shape", "tells_heights"]

USUAL = "paper"
"""The profile whose converter's highest count is the default of a recording."""


def stated_shape(base: Profile | None, one: Channel) -> dict[str, Any]:
    """The body's outline and the kind of its sensors as facts; without a base the Khepera's."""
    body = base.body if base else Body(radius_cm=BODY_RADIUS_CM)
    shape: dict[str, Any] = {"body_radius_cm": body.radius_cm}
    if body.outline_cm:
        shape["body_outline_cm"] = [list(corner) for corner in body.outline_cm]
    shape["sensors"] = one.sensors
    if one.high != load_profile(USUAL).channel(one.name).top:
        shape["full_scale"] = one.high
    return shape


def stated_heights(base: Profile | None) -> dict[str, float]:
    """Heights of body and sensors as facts, cm, if the base has both; without a base the Khepera's."""
    if base is None:
        return HEIGHTS_CM
    heights = dict(zip(HEIGHTS_CM, (base.body.height_cm, base.ambient.sensor_height_cm), strict=True))
    return heights if all(heights.values()) else {}


def as_recorded(recordings: Sequence[Recording], base: Profile) -> Profile:
    """The base with the body that its recordings state.

    Raises:
        CalibrationError: recordings state different bodies.
    """
    return _of_its_height(recordings, _of_its_size(recordings, base))


def _of_its_size(recordings: Sequence[Recording], base: Profile) -> Profile:
    """The base with the body whose edge the recordings' distances are measured from.

    A .sam table states no body: it is the manufacturer's, and readings depend on it.
    """
    seen = [r for r in recordings if isinstance(r, SensorRecording) and r.from_sensor is None]
    said = [r for r in seen if "body_radius_cm" in r.facts or not r.body_said] or seen
    radii = {r.body_radius_cm: r.source for r in said}
    outlines = {r.body_outline_cm: r.source for r in said if r.body_outline_cm}
    if len(outlines) > 1:
        here, there = list(outlines.values())[:2]
        raise CalibrationError(
            f"body_outline_cm: expected one robot; {here} and {there} have different ones. Correct them."
        )
    if len(radii) > 1:
        (one, here), (two, there) = list(radii.items())[:2]
        raise CalibrationError(
            f"body_radius_cm: expected one robot, got {one:g} cm in {here} and {two:g} cm in {there}. "
            "Correct them; a recording that does not say it has that of --base."
        )
    if not radii:
        return base
    outline = next(iter(outlines), base.body.outline_cm)
    ((radius_cm, source),) = radii.items()
    try:
        return replace(base, body=replace(base.body, radius_cm=radius_cm, outline_cm=outline))
    except ConfigError as error:
        raise CalibrationError(
            f"{source}: body_radius_cm: {radius_cm:g} cm does not fit profile {base.name!r}: {error} Correct "
            "it (cm), or give the profile of the robot that was recorded."
        ) from None


def _of_its_height(recordings: Sequence[Recording], base: Profile) -> Profile:
    """The base with the heights that its recordings state, which decide where light passes over the body."""
    said = {tuple(r.facts[key] for key in HEIGHTS_CM): r.source for r in recordings if tells_heights(r)}
    if len(said) > 1:
        (one, here), (two, there) = list(said.items())[:2]
        raise CalibrationError(
            f"{' and '.join(HEIGHTS_CM)}: expected one robot, got {one} in {here} and {two} in {there}. "
            "Correct them."
        )
    for top, eyes in said:
        lower = replace(base.ambient, sensor_height_cm=eyes)
        base = replace(base, body=replace(base.body, height_cm=top), ambient=lower)
    return base


def tells_heights(recording: Recording) -> bool:
    """Whether it states the heights of body and sensors."""
    return HEIGHTS_CM.keys() <= recording.facts.keys()
