"""Where the paper's own forms begin: its laws, whatever a base profile has been fitted to."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from realitygap.world.profile import Profile, load_profile
from realitygap.world.sensors import Ambient, AmbientSensor, ProximitySensor

__all__ = ["neutral_infrared", "neutral_light"]

Sensors = Sequence[ProximitySensor] | Sequence[AmbientSensor]

SAME_CM = 0.2
"""Sensors that sit within this are the paper's: a fit moves them by less."""
BEYOND = (
    "response", "facing", "lamp_height_cm", "lamp_narrow", "lamp_proud_cm", "falloff", "near_cm",
    "matt", "rays",
)  # fmt: skip
"""Keys of [ambient] that the paper does not have: their defaults change nothing."""


def neutral_infrared(base: Profile) -> Profile:
    """The base with §3.2.3 as printed: cos β, distances as they are, sensors looking where they should."""
    law, paper = base.infrared, load_profile("paper").infrared
    # Another robot's sensors look where its base has it: there is nothing else to go by.
    nominal = paper.sensors if _same(law.sensors, paper.sensors) else law.sensors
    sensors = tuple(replace(s, offset_cm=0.0) for s in nominal)
    return replace(base, infrared=replace(law, exponent=paper.exponent, matt=0.0, sensors=sensors))


def neutral_light(base: Profile) -> Profile:
    """The base with §3.3 as printed: 1.5 · cos² β of what is reflected, and nothing beyond the paper."""
    law, paper = base.ambient, load_profile("paper").ambient
    nominal = paper.sensors if _same(law.sensors, paper.sensors) else law.sensors
    sensors = tuple(replace(s, floor_shift=0.0, dark_shift=0.0) for s in nominal)
    beyond = {key: Ambient.__dataclass_fields__[key].default for key in BEYOND}
    printed = {"reflectance": paper.reflectance, "exponent": paper.exponent}
    return replace(base, ambient=replace(law, sensors=sensors, **printed, **beyond))  # type: ignore[arg-type]


def _same(sensors: Sensors, paper: Sensors) -> bool:
    """Whether a robot's sensors sit where the paper's do."""
    here, there = ([(s.x_cm, s.y_cm) for s in some] for some in (sensors, paper))
    return len(here) == len(there) and bool(np.allclose(here, there, rtol=0, atol=SAME_CM))
