"""Sensors ray by ray have the bits of those by rows of rays."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from realitygap.kernels.ambient import illuminate
from realitygap.kernels.geometry import added, walls_round
from realitygap.kernels.infrared import by_rays
from realitygap.kernels.jit import kernel
from realitygap.kernels.light import look
from realitygap.kernels.light_beyond import goes_beyond
from realitygap.kernels.params import RAYS
from realitygap.kernels.raywise import answer_near, light_by, look_along
from realitygap.kernels.trial import stand
from realitygap.world.robot import load_profile
from tests.kernels.scenes import PAPER, full_room, random_pose, random_scenes, work_for


@kernel
def near_ways(robot, arena, pose, work, rows, alone):
    stand(pose, work)
    by_rays(robot, arena, work, rows)
    at = work.pose[0], work.pose[1], work.pose[3], work.pose[4]
    for k in range(rows.shape[0]):
        light = look_along(robot, arena, k, at, work.inverse, work.incidence) if work.noticed[k] == 1 else 0.0
        alone[k] = answer_near(robot, k, light)


@kernel
def light_ways(robot, arena, pose, work, rows, alone):
    stand(pose, work)
    illuminate(robot, arena, False, work, rows)
    for k in range(rows.shape[0]):
        view, terms = look(robot, k, work), work.terms
        walls = walls_round(arena, view)
        alone[k] = 0.0
        for lamp in range(arena.lamp_points.shape[0]):
            for i in range(RAYS + 1):
                terms[i] = light_by(robot, arena, lamp, k, i, view, walls, work)
            alone[k] += terms[RAYS] + added(terms)


def scenes(measured: bool):
    """Robots by printed laws, or measured ones, in rooms with cylinders, inner walls and lamps; and in full
    ones. Some see matt surfaces."""
    thymio = load_profile("thymio")
    by_curves = [
        replace(thymio, infrared=replace(thymio.infrared, matt=matt, overlap=0.2)) for matt in (0.0, 1.0)
    ]
    for i, (profile, arena, pose) in enumerate(random_scenes(31, 150)):
        given = profile.ambient
        lit = replace(
            PAPER.ambient, sensors=given.sensors, exponent=given.exponent, reflectance=given.reflectance
        )
        yield by_curves[i % 2] if measured else replace(profile, ambient=lit), arena, pose
    random = np.random.default_rng(32)
    for arena in [full_room(random) for _ in range(20)]:
        pose = random_pose(random, arena)
        if pose is not None:
            yield by_curves[0] if measured else PAPER, arena, pose


@pytest.mark.parametrize("measured", [False, True])
def test_proximity_sensors_read_the_same(measured):
    """In random poses; most of them notice something."""
    some = 0
    for profile, arena, pose in scenes(measured):
        robot, work = profile.to_kernel(), work_for(profile)
        assert (robot.proximity_curve.shape[1] > 0) is measured
        rows, alone = np.zeros((2, len(robot.proximity_place)))
        near_ways(robot, arena.to_kernel(), np.array(pose), work, rows, alone)
        assert np.array_equal(rows, alone)
        some += rows.any()
    assert some > 80


def test_ambient_sensors_read_the_same():
    """By the printed law, in random poses in rooms with lamps."""
    some = 0
    for profile, arena, pose in scenes(measured=False):
        robot, work = profile.to_kernel(), work_for(profile)
        sensors = len(robot.ambient_place)
        assert not goes_beyond.py_func(robot)
        rows, alone = np.zeros((2, sensors))
        light_ways(robot, arena.to_kernel(), np.array(pose), work, rows, alone)
        assert np.array_equal(rows, alone)
        some += rows.any()
    assert some > 40
