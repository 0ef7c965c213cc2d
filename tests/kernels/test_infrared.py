"""Infrared proximity (§3.2.3), judged by the slow reference and by hand."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from realitygap.world.arena import Cylinder
from tests.kernels.reference import sensors as reference
from tests.kernels.scenes import (
    AVOIDANCE,
    EMPTY,
    PAPER,
    agree,
    full_room,
    random_pose,
    random_profile,
    random_scenes,
    readings,
)

A, B = 3515.0, -91.4
BETAS = np.radians([-81, -63, -45, -27, -9, 9, 27, 45, 63, 81])
REACH = math.sqrt(A / -B)


def law(distances) -> float:
    """The paper's sum over ten rays of given lengths, clipped."""
    terms = np.cos(BETAS) * (A / np.asarray(distances) ** 2 + B)
    return float(np.clip(terms.sum(), 0, 1023))


def test_agrees_with_the_reference():
    """Every sensor of every robot reads what the slow reference reads, whatever stands around."""
    lit = jumps = 0
    for profile, arena, pose in random_scenes(seed=1, count=500):
        got, _ = readings(profile, arena, pose)
        jumps += agree(got, reference.proximity, profile, arena, pose)
        lit += int(((got > 0) & (got < 1023)).sum())
    assert lit > 500, "the scenes are too empty to judge anything"
    assert jumps < 0.01 * lit


def test_agrees_in_rooms_full_of_things():
    """Between forty walls and poles the early exits never change a reading either."""
    random = np.random.default_rng(3)
    read = lit = jumps = 0
    for k in range(60):
        arena, profile = full_room(random), random_profile(random) if k % 2 else PAPER
        pose = random_pose(random, arena)
        if pose is not None:
            got, _ = readings(profile, arena, pose)
            jumps += agree(got, reference.proximity, profile, arena, pose)
            read += len(got)
            lit += int(((got > 0) & (got < 1023)).sum())
    assert jumps < 0.02 * lit and 50 < lit < 0.7 * read, (
        "the rooms are too empty or too full to judge anything"
    )


def test_agrees_where_evolution_happens():
    """The paper's robot in the paper's arena: its early exits never change a reading."""
    random = np.random.default_rng(2)
    for _ in range(300):
        pose = random_pose(random, AVOIDANCE)
        got, _ = readings(PAPER, AVOIDANCE, pose)
        agree(got, reference.proximity, PAPER, AVOIDANCE, pose)


@pytest.mark.parametrize("gap", [1.0, 2.0, 3.0, 4.5])
def test_flat_wall(gap):
    """Sensor 2 sees a flat wall ahead along every ray at gap / cos β."""
    # At 50 cm to both sides the outermost rays still end on this wall.
    got, _ = readings(PAPER, EMPTY, (100 - 2.45 - gap, 50, 0.0))
    assert got[2] == pytest.approx(law(gap / np.cos(BETAS)), rel=1e-5)


@pytest.mark.parametrize("shape", ["wall", "pole"])
def test_matt_surfaces_reflect_by_the_cosine(shape):
    """A matt wall throws back by cos β, a matt pole by half the chord that a ray cuts, over the radius."""
    matt = replace(PAPER, infrared=replace(PAPER.infrared, matt=1.0))
    gap, radius = (4.0 if shape == "wall" else 3.0), 4.0
    d, cosine = gap / np.cos(BETAS), np.cos(BETAS)
    arena, pose = EMPTY, (100 - 2.45 - gap, 50.55, 0.0)
    if shape == "pole":
        centre = gap + radius
        arena = replace(EMPTY, cylinders=(Cylinder(x_cm=50 + centre, y_cm=50, radius_cm=radius),))
        pose = (50 - 2.45, 50 - 0.55, 0.0)
        half = np.sqrt(np.maximum(radius**2 - (centre * np.sin(BETAS)) ** 2, 0.0))
        hit = half > 0
        d = np.minimum(50 / np.cos(BETAS), 50 / np.abs(np.sin(BETAS)))
        cosine = np.maximum(np.cos(BETAS), np.abs(np.sin(BETAS)))
        d[hit], cosine[hit] = (centre * np.cos(BETAS) - half)[hit], half[hit] / radius
    got, _ = readings(matt, arena, pose)
    expected = (np.cos(BETAS) * (A * cosine / d**2 + B)).sum()
    assert 0 < expected < 1023
    assert got[2] == pytest.approx(expected, rel=1e-5)
    assert readings(PAPER, arena, pose)[0][2] > expected + 20, "it would show if incidence did not count"


@pytest.mark.parametrize("beyond", [1e-9, 0.01, 1.0])
def test_exactly_zero_beyond_reach(beyond):
    """A wall just beyond √(a/−b) before the sensor gives exactly 0."""
    got, _ = readings(PAPER, EMPTY, (100 - 2.45 - REACH - beyond, 50, 0.0))
    assert (got == 0).all()


@pytest.mark.parametrize("share", [0.92, 0.98])
def test_cylinders_all_round_within_reach_are_seen(share):
    """One cylinder that far off is outweighed by the rays that miss it; one on every ray is not."""
    radius = 0.9
    turned = BETAS + 0.4
    sensor = np.array([50.0, 50.0]) + 2.45 * np.array([math.cos(0.4), math.sin(0.4)])
    sensor += 0.55 * np.array([-math.sin(0.4), math.cos(0.4)])
    centres = sensor + (share * REACH + radius) * np.stack([np.cos(turned), np.sin(turned)], 1)
    ring = tuple(Cylinder(x_cm=float(x), y_cm=float(y), radius_cm=radius) for x, y in centres)
    got, _ = readings(PAPER, replace(EMPTY, cylinders=ring), (50, 50, 0.4))
    assert got[2] == pytest.approx(law(np.full(10, share * REACH)), rel=1e-5) and got[2] > 10


def test_rays_that_miss_count():
    """The sum is literal: rays that meet nothing take b·cos β each from a thin pole's reading."""
    arena = replace(EMPTY, cylinders=(Cylinder(x_cm=50 + 4 + 0.7, y_cm=50, radius_cm=0.7),))
    got, _ = readings(PAPER, arena, (50 - 2.45, 50 - 0.55, 0.0))
    middle, others = np.cos(BETAS[[4, 5]]), np.cos(np.delete(BETAS, [4, 5]))
    least, most = ((A / d**2 + B) * middle.sum() + B * others.sum() for d in (4.7, 4.0))
    assert middle.sum() * (A / 4.7**2 + B) > 100 and most < 0, "it would show if they did not count"
    assert least < most and got[2] == 0


def test_mirror_sensors_read_alike():
    """On the arena's middle line, facing along it, mirror-image sensors agree to the last bit."""
    for matt in (0.0, 1.0):
        robot = replace(PAPER, infrared=replace(PAPER.infrared, matt=matt))
        for x in np.linspace(3, 47, 60):
            got, _ = readings(robot, AVOIDANCE, (x, 25, 0.0))
            assert got[:6].tolist() == got[5::-1].tolist() and got[6] == got[7]
