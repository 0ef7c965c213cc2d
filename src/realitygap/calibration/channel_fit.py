"""The fit of one kind of sensor: its constants, its errors and its warnings."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from realitygap.calibration.misfit import LIMITS, Misfit, lit_ratio, without
from realitygap.calibration.noise import NoiseEstimate
from realitygap.calibration.solve import Fit
from realitygap.values import Floats
from realitygap.world.robot import Profile

__all__ = ["LOOKUP", "MEASURED", "UNLIT", "ChannelFit", "doubts", "unmeasured"]

MEASURED = "measured"
"""The form with curves: measured.py, LightCurves."""
LOOKUP = "lookup"
"""The form without a model: lookup.py."""
UNLIT = "no reading held out is neither dark nor saturated: model error over noise is that of all readings"
OVERFITTED = 1.3
"""Held-out RMSE over fitted RMSE above which a form is reported as overfitted."""
FAR_OFF, NARROW = 10.0, 4.0
"""Model error over noise, and angular exponent, beyond which the distances of a light are doubted."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ChannelFit:
    """Fit of one kind of sensor.

    Attributes:
        kind: "infrared" or "ambient".
        form: the requested form.
        profile: the base with this form's constants in place.
        fit: constants, intervals, and which constants cannot be separated.
        by_form: RMSE of every form, counts; held_out: of those that were tried on held-out places.
        judged: each sensor's misfit on held-out places; limits apply to its lit_ratio.
        misplaced: change of the model's lit readings, in noise deviations, if places set by hand are a
            millimetre off; NaN where a program set them.
        noise: what could be measured of it.
        deviation, measured: the noise's deviation where sensors see something, counts; whether it was
            measured (else it is the base's).
        sensors: each sensor's misfit.
        dead: sensors that gave no information, and why.
        warnings: in words.
        distance_cm, bearing_deg: [n] of all rows; NaN where only poses are known.
        name: [n] each row's recording: its object, or its file where two have the same object.
        counts, model: [n, S]; counts are NaN for dead sensors.
        span: [S, 2] lowest and highest reading of each sensor; NaN without readings.
    """

    kind: str
    form: str
    profile: Profile
    fit: Fit
    by_form: dict[str, float]
    held_out: dict[str, float]
    noise: tuple[NoiseEstimate, ...]
    deviation: float
    measured: bool
    sensors: tuple[Misfit, ...]
    judged: tuple[Misfit, ...]
    misplaced: float
    dead: dict[int, str]
    warnings: tuple[str, ...]
    source: str
    distance_cm: Floats = field(repr=False)
    bearing_deg: Floats = field(repr=False)
    name: NDArray[np.str_] = field(repr=False)
    counts: Floats = field(repr=False)
    model: Floats = field(repr=False)
    span: Floats = field(repr=False)

    @property
    def rmse(self) -> float:
        """RMSE of the requested form over all live sensors, counts."""
        return self.by_form[self.form]

    @property
    def ratio(self) -> float:
        """Model error over noise of all sensors on held-out places whose readings are neither dark nor
        saturated; reports and limits use this figure. NaN without such places."""
        return lit_ratio(self.judged)

    @property
    def ratio_placed(self) -> float:
        """The ratio without the error that places a millimetre off would explain; NaN like `misplaced`."""
        return without(self.ratio, self.misplaced)


def doubts(made: ChannelFit) -> list[str]:
    """Warnings about a fit."""
    kind, limit, out = made.kind, LIMITS[made.kind], []
    over = [m for m in made.judged if m.lit_ratio > limit]
    if over:
        which = ", ".join(f"{m.sensor} ({m.lit_ratio:.1f})" for m in over)
        out.append(
            f"{kind}: model error is more than {limit:g} noise deviation{'s' * (limit != 1)} "
            f"({made.deviation:.3g} counts) for sensor{'s' * (len(over) > 1)} {which}: model error exceeds "
            "noise there"
        )
    if not np.isfinite(made.ratio):
        out.append(f"{kind}: {UNLIT}")
    held_out = made.held_out[made.form]
    if held_out > OVERFITTED * made.rmse and made.form != LOOKUP:  # which holds its input
        out.append(
            f"{kind}: RMSE {held_out:.3g} on places held out, {made.rmse:.3g} on those fitted: the form "
            "overfits"
        )
    free = {c.key for c in made.fit.constants}
    blind = {MEASURED: "aperture_deg", "extended": "direction_deg[0]"}.get(made.form)
    if kind == "infrared" and blind and blind not in free:
        out.append(
            f"{kind}: directions and lobes are not identifiable with every sensor straight before a wall: "
            "directions are the base profile's, the lobe is an assumption, as are matt surfaces"
        )
    dead = tuple(f"[{k}]" for k in made.dead)
    vague = [c.key for c in made.fit.constants if not c.told and not c.key.endswith(dead)]
    if vague:
        names = ", ".join(vague)
        out.append(f"{kind}: not identifiable from these recordings: {names} (bounds or a mild prior decide)")
    out += _doubtful_light(made)
    if not made.measured:
        out.append(
            f"{kind}: {unmeasured(made.deviation)}. Several readings at each place, or bearings close "
            "together, measure it"
        )
    return out


def _doubtful_light(made: ChannelFit) -> list[str]:
    """A warning where a linear light model is far off or its lobe implausible, as with distances in another
    unit.

    The paper's model is far off for any sensor that is linear in light, so it does not count as evidence
    here.
    """
    if made.kind != "ambient" or made.profile.ambient.response != "linear" or not made.sensors:
        return []
    error = float(np.sqrt(np.mean([m.ratio**2 for m in made.sensors])))
    facing = made.profile.ambient.facing
    if error < FAR_OFF and facing < NARROW:
        return []
    return [
        f"ambient: model error of {error:.1f} noise deviations, sensors with an angular exponent of "
        f"{facing:.1f} (a Khepera's is about 1.3): are distances in cm, from the body's edge to the lamp?"
    ]


def unmeasured(deviation: float) -> str:
    """What it means that the noise was not measured, in words."""
    return (
        f"too little to measure noise by where sensors see something: {deviation:.3g} counts are assumed, "
        "and model error over noise, out of which none is taken, rests on them"
    )
