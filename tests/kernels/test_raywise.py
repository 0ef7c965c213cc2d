"""Sensors ray by ray have the bits of those by rows of rays."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from realitygap.kernels.ambient import illuminate
from realitygap.kernels.infrared import by_rays
from realitygap.kernels.jit import kernel
from realitygap.kernels.light_beyond import goes_beyond
from realitygap.kernels.params import RAYS
from realitygap.kernels.raywise import follow_ray, illuminate_alone, look_out, take_up
from realitygap.kernels.together import Own, common_room, lanes_of_rays, mine_of, part_of
from realitygap.kernels.trial import stand
from realitygap.world.profile import load_profile
from tests.kernels.scenes import PAPER, full_room, random_pose, random_scenes, work_for


@kernel
def near_ways(robot, arena, pose, work, common, rows, alone):
    stand(pose, work)
    by_rays(robot, arena, work, rows)
    for k in range(rows.shape[0]):
        look_out(robot, arena, k, work, common)
        for i in range(RAYS * common.noticed[k]):
            follow_ray(robot, arena, k, i, work, common)
        alone[k] = take_up(robot, k, common)


@kernel
def light_ways(robot, arena, pose, work, own, rays, rows, alone):
    stand(pose, work)
    illuminate(robot, arena, False, work, rows)
    for k in range(rows.shape[0]):
        part, mine = part_of(robot, k, 1), mine_of(work, own, k, rays)
        illuminate_alone(part, arena, False, mine, alone[k : k + 1])


def scenes(measured: bool):
    """Printed laws, or a measured robot, in rooms with cylinders, inner walls and lamps; and in full ones."""
    robot = load_profile("thymio")
    robot = replace(robot, infrared=replace(robot.infrared, matt=0.0, overlap=0.2))
    for profile, arena, pose in random_scenes(31, 150):
        given = profile.ambient
        lit = replace(
            PAPER.ambient, sensors=given.sensors, exponent=given.exponent, reflectance=given.reflectance
        )
        printed = replace(profile, ambient=lit, infrared=replace(profile.infrared, matt=0.0))
        yield robot if measured else printed, arena, pose
    random = np.random.default_rng(32)
    for arena in [full_room(random) for _ in range(20)]:
        pose = random_pose(random, arena)
        if pose is not None:
            yield robot if measured else PAPER, arena, pose


@pytest.mark.parametrize("measured", [False, True])
def test_proximity_sensors_read_the_same(measured):
    """In random poses; most of them notice something."""
    some = 0
    for profile, arena, pose in scenes(measured):
        robot, work = profile.to_kernel(), work_for(profile)
        assert (robot.proximity_curve.shape[1] > 0) is measured
        rows, alone = np.zeros((2, len(robot.proximity_place)))
        near_ways(robot, arena.to_kernel(), np.array(pose), work, common_room(len(rows)), rows, alone)
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
        light, wide = lanes_of_rays(work, robot)
        rooms = {name: np.full(light if name == "light" else wide, np.nan) for name in Own._fields[:-2]}
        own = Own(**rooms, noticed=np.zeros(1, np.int64), listed=np.zeros(1, np.uint64))
        rows, alone = np.zeros((2, sensors))
        each = (work.all_fans.shape[1] - 16) // sensors
        light_ways(robot, arena.to_kernel(), np.array(pose), work, own, each, rows, alone)
        assert np.array_equal(rows, alone)
        some += rows.any()
    assert some > 40
