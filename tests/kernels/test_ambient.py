"""Ambient light (§3.3), judged by the slow reference and by hand."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from realitygap.world.arena import Cylinder, Lamp
from realitygap.world.robot import Body
from tests.kernels.reference import sensors as reference
from tests.kernels.reference.rays import overlap, place_and_direction
from tests.kernels.scenes import EMPTY, PAPER, RADIUS, SEEKING, agree, random_scenes, readings
from tests.kernels.test_outline import OUTLINES, free_pose

FULL = 4.19 + 4.24 + 8.24 + 4.24 + 4.19 - 4.15
LAMP = Lamp(x_cm=50, y_cm=50)
LIT = replace(EMPTY, lamps=(LAMP,))
MATT = replace(PAPER, ambient=replace(PAPER.ambient, reflectance=0.0))
"""Nothing is reflected: what is left is the direct light."""


def direct(arena, pose, profile=MATT) -> np.ndarray:
    """What each sensor's reading says of its direct light: A = 1/(V − 55)², 0 where it is dark."""
    _, ambient = readings(profile, arena, pose)
    return np.where(ambient < 484, 1 / (ambient - 55) ** 2, 0.0)


def mean_distance(lamp, place) -> float:
    return float(np.mean([math.dist(place, point) for point in lamp.points()]))


def test_agrees_with_the_reference():
    """Every sensor of every robot reads what the slow reference reads, with up to three lamps."""
    shades = jumps = 0
    for profile, arena, pose in random_scenes(seed=3, count=150):
        _, got = readings(profile, arena, pose)
        jumps += agree(got, reference.ambient, profile, arena, pose)
        shades += int(((got > 60) & (got < 484)).sum())
    assert shades > 200, "the scenes are too dark to judge anything"
    assert jumps < 0.02 * shades


def test_agrees_over_a_lamp():
    """A body that stands over points of a lamp shades whatever they would light."""
    random = np.random.default_rng(5)
    judged = 0
    for profile, arena, pose in random_scenes(seed=6, count=200):
        if not arena.lamps:
            continue
        lamp = arena.lamps[random.integers(len(arena.lamps))]
        x, y = np.add(lamp.points()[random.integers(5)], random.uniform(-2, 2, 2)).tolist()
        if overlap(arena, x, y, RADIUS) <= 0:
            over = (x, y, pose[2])
            _, got = readings(profile, arena, over)
            agree(got, reference.ambient, profile, arena, over)
            judged += 1
    assert judged > 50


@pytest.mark.parametrize("outline", OUTLINES)
def test_a_polygons_shadow_is_its_outlines(outline):
    """Light that passes a polygon's edges is not shaded by the circle about it, by whichever law."""
    random = np.random.default_rng(8)
    body = Body(outline_cm=outline)
    lit = differ = 0
    for profile, arena, _ in random_scenes(seed=9, count=40):
        eyes = [replace(s, x_cm=0.0, y_cm=0.0) for s in profile.ambient.sensors]
        if not arena.lamps or (pose := free_pose(random, arena, outline)) is None:
            continue
        unseen = replace(profile.infrared, sensors=())
        polygon = replace(
            profile, infrared=unseen, body=replace(body, height_cm=profile.body.height_cm),
            ambient=replace(profile.ambient, sensors=tuple(eyes)),
        )  # fmt: skip
        _, got = readings(polygon, arena, pose)
        agree(got, reference.ambient, polygon, arena, pose)
        disc = replace(PAPER.body, radius_cm=body.radius_cm, height_cm=polygon.body.height_cm)
        lit += 1
        differ += bool((readings(replace(polygon, body=disc), arena, pose)[1] != got).any())
    assert lit > 15 and differ > 5, "no shadow tells a polygon from its circle"


def test_against_the_wall_beneath_the_lamp():
    """A body over the whole lamp keeps its light from every wall, in whatever direction it falls."""
    lamp = {"lamp_narrow": 1.0, "lamp_proud_cm": 0.6}
    robot = replace(PAPER, ambient=replace(PAPER.ambient, **lamp))
    _, got = readings(robot, SEEKING, (107.0, 35.0, 0.0))
    assert (got == 484).all()


def test_full_light_is_20_95():
    """Σ k − 4.15 = 20.95: a sensor that sees all five points has D = 20.95 / d²."""
    assert pytest.approx(20.95) == FULL
    pose = (30, 50, 0.0)
    for k in (2, 3):
        place, _ = place_and_direction(PAPER.ambient.sensors[k], pose)
        d = mean_distance(LAMP, place)
        assert direct(LIT, pose)[k] == pytest.approx(FULL / d**2, rel=1e-5)


def test_own_body_hides_the_lamp_from_sensors_that_look_away():
    """A point of the lamp more than 90° off a sensor's direction gives it no direct light."""
    facing = direct(LIT, (30, 50, 0.0))
    away = direct(LIT, (30, 50, math.pi))
    assert (facing[[1, 2, 3, 4]] > 0).all() and (facing[[6, 7]] == 0).all()
    assert (away[[1, 2, 3, 4]] == 0).all() and (away[[6, 7]] > 0).all()


@pytest.mark.parametrize("visible", [(1, 1, 1, 1, 0), (0, 0, 1, 1, 1), (0, 0, 0, 1, 1), (0, 0, 0, 0, 1)])
def test_occlusion_by_a_wall(visible):
    """An inner wall takes away exactly the points of the lamp that it hides."""
    lamp = replace(LAMP, line_deg=90.0)
    pose = (30, 50 + 0.55, 0.0)
    px, py = 32.45, 50.0  # sensor 3
    # A wall halfway, which covers the lines to the hidden points and no others.
    middle = (px + 50) / 2
    ys = [(py + y) / 2 for _, y in lamp.points()]
    hidden = [y for y, seen in zip(ys, visible, strict=True) if not seen]
    wall = (middle, min(hidden) - 0.3, middle, max(hidden) + 0.3)
    arena = replace(LIT, lamps=(lamp,), walls=(wall,))
    light = sum(k for k, seen in zip(lamp.weights, visible, strict=True) if seen) - 4.15
    d = mean_distance(lamp, (px, py))
    assert direct(arena, pose)[3] == pytest.approx(max(light, 0) / d**2, rel=1e-5)


def test_direct_light_is_never_negative():
    """With every point hidden D would be −4.15 / d²; it is 0, and so the sensor reads dark."""
    cylinder = Cylinder(x_cm=40, y_cm=50, radius_cm=6)
    _, got = readings(MATT, replace(LIT, cylinders=(cylinder,)), (25, 50, 0.0))
    assert (got == 484).all()
    # Reflected light is not eaten up by a negative direct light either.
    _, with_reflection = readings(PAPER, replace(LIT, cylinders=(cylinder,)), (25, 50, 0.0))
    assert (with_reflection < 484).any()


def test_darkness():
    """Without a lamp, or with one of no brightness, all sensors read the dark value."""
    for arena in (EMPTY, replace(LIT, lamps=(replace(LAMP, brightness=0.0),))):
        _, got = readings(PAPER, arena, (30, 50, 0.0))
        assert (got == 484).all()


def test_brightness_scales_the_illumination():
    """Twice the brightness is twice the illumination, so is twice a sensor's gain, so are two lamps."""
    pose = (30, 40, 0.4)
    once = direct(LIT, pose, PAPER)
    bright = direct(replace(LIT, lamps=(replace(LAMP, brightness=2.0),)), pose, PAPER)
    two = direct(replace(LIT, lamps=(LAMP, LAMP)), pose, PAPER)
    sensors = tuple(replace(sensor, gain=2.0) for sensor in PAPER.ambient.sensors)
    gained = direct(LIT, pose, replace(PAPER, ambient=replace(PAPER.ambient, sensors=sensors)))
    clear = once > 2e-5
    assert clear.sum() >= 4
    for other in (bright, two, gained):
        np.testing.assert_allclose(other[clear], 2 * once[clear], rtol=1e-4)


def test_mirror_sensors_read_alike():
    """On the arena's middle line, facing the lamp, mirror-image sensors agree."""
    for x in np.linspace(3, 107, 60):
        _, got = readings(PAPER, SEEKING, (x, 35, 0.0))
        np.testing.assert_allclose(got[[0, 1, 2, 6]], got[[5, 4, 3, 7]], rtol=1e-6)
