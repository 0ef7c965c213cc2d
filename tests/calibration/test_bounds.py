"""Whatever a fit's constants come to within their bounds, the profile that they make can be loaded."""

from __future__ import annotations

import tomllib
from dataclasses import replace
from functools import cache, partial

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from realitygap.calibration import forms as printed
from realitygap.calibration.forms import INFRARED_FORMS, LIGHT_FORMS, with_infrared, with_light
from realitygap.calibration.model import Scene
from realitygap.calibration.wheels import _with
from realitygap.world.arena import load_arena
from realitygap.world.robot import Profile, load_profile
from realitygap.world.toml import build

PAPER = load_profile("paper")
TIGHT = replace(PAPER, body=replace(PAPER.body, radius_cm=2.6))
"""A body whose sensors sit at its edge."""
ROOM = load_arena("light-seeking").to_kernel()
SCENE = Scene(arena=ROOM, poses=np.full((4, 3), 30.0), row=np.arange(4, dtype=np.int64))


@cache
def forms(tight: bool):
    """What each form leaves free, and what makes a profile of it."""
    base = TIGHT if tight else PAPER
    made = [
        (printed.infrared_parameters(form, base, ["turn"]), partial(with_infrared, base))
        for form in INFRARED_FORMS
    ]
    counts = np.random.default_rng(0).uniform(0, 1023, (4, 8))
    for form in LIGHT_FORMS:
        for falloff in (1.0, 2.0):
            lit = replace(base, ambient=replace(base.ambient, falloff=falloff))
            frees = printed.light_parameters(form, lit, [("turn", SCENE)], counts, room=True)
            made.append((frees, partial(with_light, lit, form=form)))
    return made


def drawn(frees, draw):
    """Constants within their bounds, often at them."""
    ends = lambda f: draw.choice([f.low, f.high, draw.uniform(f.low, f.high)], len(f.start))  # noqa: E731
    return {f.key: np.array(ends(f), float) for f in frees}


def comes_back(made: Profile) -> bool:
    return build(Profile, tomllib.loads(made.to_toml())) == made


@pytest.mark.parametrize("tight", [False, True])
@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=15)
def test_no_fit_leaves_what_the_loader_takes(tight, seed):
    """Infrared, light and wheels, each in every form."""
    draw = np.random.default_rng(seed)
    for frees, make in forms(tight):
        assert comes_back(make(drawn(frees, draw)))
    speeds = dict(zip(("speed_left", "speed_right"), draw.uniform(0.05, 20.0, 2), strict=True))
    assert comes_back(_with(TIGHT if tight else PAPER, speeds))
