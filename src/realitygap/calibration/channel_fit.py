"""One kind of sensor, fitted: its constants, how it was judged, and what is to be said of it."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from realitygap.calibration.misfit import LIMITS, Misfit, lit_ratio
from realitygap.calibration.noise import NoiseEstimate
from realitygap.calibration.solve import Fit
from realitygap.values import Floats
from realitygap.world.profile import Profile

__all__ = ["LOOKUP", "MEASURED", "UNLIT", "ChannelFit", "doubts", "unmeasured"]

MEASURED = "measured"
"""The form of curves: measured.py, LightCurves."""
LOOKUP = "lookup"
"""The form without a law: lookup.py."""
UNLIT = "no reading held out is neither dark nor saturated: model error over noise is that of all readings"
OVERFITTED = 1.3
"""Held-out RMSE over the fitted one, from which on a form is said to fit more than the robot."""
FAR_OFF, NARROW = 10.0, 4.0
"""Model error over noise, and an angular exponent, from which on a light's distances are doubted."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ChannelFit:
    """One kind of sensor, fitted.

    Attributes:
        kind: "infrared" or "ambient".
        form: the form that was asked for.
        profile: the base with this form's constants in place.
        fit: constants, intervals, what cannot be told apart.
        by_form: RMSE of every form, counts; held_out: of those that were tried on places held out.
        judged: each sensor's misfit on places held out: limits go by its lit_ratio.
        misplaced: by how many deviations the model's lit readings change where places set by hand are a
            millimetre off; NaN where a program set them.
        noise: what could be measured of it.
        deviation, measured: the noise's where sensors see something, counts, and whether it was measured
            or is the base profile's.
        sensors: each sensor's misfit.
        dead: sensors that told nothing, and why.
        warnings: in words.
        distance_cm, bearing_deg: [n] of all rows; NaN where poses are all that is known.
        name: [n] of each row's recording: its object, or its file where two have the same.
        counts, model: [n, S]; counts are NaN where a sensor told nothing.
        span: [S, 2] what each sensor's readings really span; NaN of none.
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
        """Of the form that was asked for, all sensors that live, counts."""
        return self.by_form[self.form]

    @property
    def ratio(self) -> float:
        """Model error over noise of all sensors on places held out, where readings are neither dark nor
        saturated: the figure that reports and limits go by; NaN where there are none."""
        return lit_ratio(self.judged)

    @property
    def ratio_placed(self) -> float:
        """The ratio without what places that are a millimetre off explain of it; NaN as `misplaced`."""
        return float(np.sqrt(max(self.ratio**2 - self.misplaced**2, 0.0)))


def doubts(made: ChannelFit) -> list[str]:
    """What a person should know of a fit, in words."""
    kind, limit, out = made.kind, LIMITS[made.kind], []
    over = [m for m in made.judged if m.lit_ratio > limit]
    if over:
        which = ", ".join(f"{m.sensor} ({m.lit_ratio:.1f})" for m in over)
        out.append(
            f"{kind}: model error is more than {limit:g} noise deviations ({made.deviation:.3g} counts) for "
            f"sensors {which}: model error exceeds noise there"
        )
    if not np.isfinite(made.ratio):
        out.append(f"{kind}: {UNLIT}")
    held_out = made.held_out[made.form]
    if held_out > OVERFITTED * made.rmse and made.form != LOOKUP:  # which holds what it was made of
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
    """A warning where a linear law of light is far off, or its lobe odd: as with distances in another unit.

    The paper's law is far off on any sensor that reads light linearly: that says nothing of distances.
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
    """What a noise that was not measured means, in words."""
    return (
        f"too little to measure noise by where sensors see something: {deviation:.3g} counts are assumed, "
        "and model error over noise, out of which none is taken, rests on them"
    )
