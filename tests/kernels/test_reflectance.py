"""Surfaces that throw back more or less than those a robot's constants hold for, judged by the reference."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from realitygap.world.arena import Arena
from tests.kernels.reference import sensors as reference
from tests.kernels.scenes import EMPTY, PAPER, agree, random_scenes, readings
from tests.kernels.test_infrared import BETAS, REACH, A, B
from tests.kernels.test_measured import measured


def tinted(arena: Arena, random: np.random.Generator) -> Arena:
    """The arena with walls and cylinders of any reflectance, some black; in half of all none is above 1."""
    count = 1 + len(arena.cylinders)
    white = random.uniform(0, random.choice([1, 4]), count) * (random.random(count) < 0.9)
    cylinders = zip(arena.cylinders, white[1:], strict=True)
    return replace(
        arena, reflectance=white[0], cylinders=tuple(replace(c, reflectance=r) for c, r in cylinders)
    )


def test_agrees_with_the_reference():
    """Proximity by the printed law and as measured, and light: each sensor reads what the reference reads."""
    random, changed = np.random.default_rng(1), 0
    for profile, bare, pose in random_scenes(seed=2, count=60):
        arena = tinted(bare, random)
        got, light = readings(profile, arena, pose)
        agree(got, reference.proximity, profile, arena, pose)
        agree(light, reference.ambient, profile, arena, pose)
        robot = measured(profile, random)
        got, _ = readings(robot, arena, pose)
        agree(got, reference.proximity, robot, arena, pose)
        changed += int((abs(got - readings(robot, bare, pose)[0]) > 1).sum())
    assert changed > 60, "the scenes are too empty to judge anything"


def test_surfaces_of_reflectance_one_are_those_of_the_constants():
    """An arena that says 1 of all its surfaces reads as one that says nothing: no short cut errs."""
    for profile, arena, pose in random_scenes(seed=3, count=30):
        said = replace(arena, reflectance=1.0)
        kernel = said.to_kernel()
        assert kernel.reflectance.size == 0 and said.to_dict() == arena.to_dict()
        ones = kernel._replace(reflectance=np.ones(1 + len(arena.cylinders)))
        for one, other in zip(readings(profile, arena, pose), readings(profile, ones, pose), strict=True):
            np.testing.assert_allclose(one, other, rtol=1e-5, atol=1e-3)


@pytest.mark.parametrize("white", [0.3, 2.0])
def test_a_wall_throws_back_by_its_reflectance(white):
    """Sensor 2 reads a wall ahead as if its a were so many times larger, beyond its usual reach too."""
    for gap in (2.0, REACH * 1.05):
        got, _ = readings(PAPER, replace(EMPTY, reflectance=white), (100 - 2.45 - gap, 50, 0.0))
        terms = np.cos(BETAS) * (white * A / (gap / np.cos(BETAS)) ** 2 + B)
        assert got[2] == pytest.approx(float(np.clip(terms.sum(), 0, 1023)), rel=1e-5)
        assert got[2] > 0 or gap > 2.0 > white
