"""Sensors by the threads of a group that share their rays, since few sensors notice anything.

Where all surfaces have the usual reflectance and light follows the printed law; after each stage the threads
meet (together.py).
"""

from collections import namedtuple

import numpy as np

from realitygap.kernels.ambient import answer
from realitygap.kernels.jit import step
from realitygap.kernels.light import rays_of_fan
from realitygap.kernels.params import RAYS, Robot
from realitygap.kernels.raywise import follow_light, follow_ray, look_out, stand_about, take_in, take_up
from realitygap.kernels.together import meet, part_of
from realitygap.kernels.trial import AMBIENT, PROXIMITY, near_fed, read, wheels_speed

Common = namedtuple("Common", "places noticed listed terms")
"""What threads share of so many sensors of a kind, S: places [S, 6] between the outer walls; marks [S] and
numbers [S + 1] of those that notice anything; what their rays return or bring, and last the overlap of beams
or the direct light [S, RAYS + 1]."""


def most_of_a_kind(robot: Robot) -> int:
    """S: the proximity sensors or the ambient ones, whichever are more."""
    return max(len(robot.proximity_place), len(robot.ambient_place), 1)


def common_room(sensors: int) -> Common:
    """Room for what threads share of so many sensors of a kind."""
    marks, numbers = np.zeros(sensors, np.int32), np.zeros(sensors + 1, np.int32)
    return Common(np.zeros((sensors, 6)), marks, numbers, np.zeros((sensors, RAYS + 1)))


@step
def look_share(world, lane, group, work, common):
    """This thread's share of the proximity sensors that look whether they notice anything."""
    for k in range(lane, near_fed(world.robot, world.task.feed), group):
        look_out(world.robot, world.arena, k, work, common)


@step
def list_shared(near, lane, common):
    """List those of so many sensors that do, and their number in the last place: one thread alone."""
    if lane == 0:
        count = 0
        for k in range(near):
            if common.noticed[k] == 1:
                common.listed[count] = k
                count += 1
        common.listed[common.noticed.shape[0]] = count


@step
def follow_share(world, lane, group, work, common):
    """This thread's share of their rays."""
    for n in range(lane, common.listed[common.noticed.shape[0]] * RAYS, group):
        follow_ray(world.robot, world.arena, common.listed[n // RAYS], n % RAYS, work, common)


@step
def read_share(world, lane, group, work, common):
    """This thread's share of the proximity sensors that read what their rays return."""
    robot, speed = world.robot, wheels_speed(work)
    for k in range(lane, near_fed(robot, world.task.feed), group):
        work.readings[k] = take_up(robot, k, common)
        part, out = part_of(robot, k, 0), work.readings[k : k + 1]
        read(part, PROXIMITY, world.level, speed, work.noise[k:], out)


@step
def stand_share(world, lane, group, work, common):
    """This thread's share of the ambient sensors that find where they are."""
    near = near_fed(world.robot, world.task.feed)
    for k in range(lane, work.readings.shape[0] - near, group):
        stand_about(world.robot, world.arena, k, work, common)
        work.readings[near + k] = 0.0


@step
def light_share(world, lamp, lane, group, work, common):
    """This thread's share of the ways in which a lamp's light reaches them."""
    ways = rays_of_fan(world.robot, work) + 1
    sensors = work.readings.shape[0] - near_fed(world.robot, world.task.feed)
    for n in range(lane, ways * sensors, group):
        follow_light(world.robot, world.arena, lamp, n // ways, n % ways, work, common)


@step
def take_share(world, lane, group, work, common):
    """This thread's share of the ambient sensors that take in a lamp's light."""
    near = near_fed(world.robot, world.task.feed)
    for k in range(lane, work.readings.shape[0] - near, group):
        work.readings[near + k] += take_in(k, common)


@step
def answer_share(world, lane, group, work):
    """This thread's share of the ambient sensors that read what light they have."""
    robot, speed = world.robot, wheels_speed(work)
    near, sensors = near_fed(robot, world.task.feed), max(robot.ambient_place.shape[0], 1)
    for k in range(lane, work.readings.shape[0] - near, group):
        part, out = part_of(robot, k, robot.ambient_ray.shape[0] // sensors), work.readings[near + k :][:1]
        answer(part, out)
        read(part, AMBIENT, world.level, speed, work.noise[near + k :], out)


@step
def sense_near(world, lane, group, work, common):
    """As `sense`, the proximity sensors, where all surfaces have the usual reflectance: ray by ray."""
    look_share(world, lane, group, work, common)
    meet(lane, group)
    list_shared(near_fed(world.robot, world.task.feed), lane, common)
    meet(lane, group)
    follow_share(world, lane, group, work, common)
    meet(lane, group)
    read_share(world, lane, group, work, common)


@step
def sense_light(world, lane, group, work, common):
    """As `sense`, the ambient sensors, by the printed law: ray by ray."""
    meet(lane, group)
    stand_share(world, lane, group, work, common)
    meet(lane, group)
    for lamp in range(world.arena.lamp_points.shape[0]):
        light_share(world, lamp, lane, group, work, common)
        meet(lane, group)
        take_share(world, lane, group, work, common)
        meet(lane, group)
    answer_share(world, lane, group, work)


@step
def sense_by_rays(world, lane, group, work, own, common):
    """As `sense_together`, ray by ray."""
    sense_near(world, lane, group, work, common)
    sense_light(world, lane, group, work, common)
