"""A trial by the threads of a group has the bits of a trial by one: by a group of one, and by the shares of
several threads, taken in turn between any two meetings."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from realitygap.cli.bench import random_networks
from realitygap.kernels.batch import run_trials
from realitygap.kernels.jit import kernel, step
from realitygap.kernels.light_beyond import goes_beyond
from realitygap.kernels.network import PAST, ROWS, is_still, keep_past
from realitygap.kernels.params import MAX_DELAY, UPDATES, Path
from realitygap.kernels.shared_rays import (
    answer_share,
    common_room,
    follow_share,
    light_share,
    list_shared,
    look_share,
    read_share,
    stand_share,
    take_share,
)
from realitygap.kernels.together import (
    Own,
    act_share,
    arrive_share,
    draw_share,
    feed_share,
    keep_share,
    lanes_of_rays,
    run_together,
    sense_share,
    update_share,
)
from realitygap.kernels.trial import begin, draw_start, move, near_fed, note
from realitygap.kernels.work import new_work
from realitygap.simulation.simulation import Simulation, batch_streams
from realitygap.tasks import load_task
from realitygap.world.profile import load_profile
from tests.kernels.scenes import PAPER, work_for


@kernel
def alone(world, nets, n, stream, work, own, common, links, p):
    draw_start(world.task, stream, work.start)
    path = Path(p[0], p[1], p[2], p[3], p[4], p[5])
    run_together(world, nets, n, stream, 0, links.shape[0], work, own, common, path)


@step
def sense_in_turn(world, group, work, own):
    for lane in range(group):
        sense_share(world, lane, group, work, own)


@step
def follow_in_turn(world, group, work, common):
    near = near_fed(world.robot, world.task.feed)
    for lane in range(group):
        look_share(world, lane, group, work, common)
    for lane in range(group):
        list_shared(near, lane, common)
    for lane in range(group):
        follow_share(world, lane, group, work, common)
    for lane in range(group):
        read_share(world, lane, group, work, common)
    for lane in range(group):
        stand_share(world, lane, group, work, common)
    for lamp in range(world.arena.lamp_points.shape[0]):
        for lane in range(group):
            light_share(world, lamp, lane, group, work, common)
        for lane in range(group):
            take_share(world, lane, group, work, common)
    for lane in range(group):
        answer_share(world, lane, group, work)


@kernel
def in_turn(world, nets, n, stream, work, own, common, links, p):
    draw_start(world.task, stream, work.start)
    path, group = Path(p[0], p[1], p[2], p[3], p[4], p[5]), links.shape[0]
    begin(nets, n, work.start, work)
    neurons = nets.neurons[n]
    for k in range(world.task.steps):
        for lane in range(group):
            draw_share(world, stream, k, lane, group, work)
        if common.noticed.shape[0] > 0:
            follow_in_turn(world, group, work, common)
        else:
            sense_in_turn(world, group, work, own)
        for lane in range(group):
            feed_share(world, lane, group, work)
        if not is_still(work):
            links[:] = 0
            for update in range(UPDATES):
                for lane in range(group):
                    if update <= MAX_DELAY:
                        links[lane] = arrive_share(update, links[lane], lane, group, work)
                    update_share(neurons, (PAST + update) * neurons, lane, group, work)
            work.settled[0] = 1
            for lane in range(group):
                keep_share(neurons, lane, group, work)
        for lane in range(group):
            act_share(world, nets, n, lane, group, work)
        move(world.robot, world.arena, work)
        note(path, k, work)


@kernel
def keep_both_ways(neurons, group, work, other):
    keep_past(neurons, work)
    other.settled[0] = 1
    for lane in range(group):
        keep_share(neurons, lane, group, other)


@pytest.mark.parametrize("restless", [None, 0, 1, 2])
def test_a_group_sees_whether_the_network_has_settled(restless):
    """Three neurons, of which none or one still changes; two threads."""
    random, works = np.random.default_rng(6), []
    rows = np.repeat(random.integers(-10, 11, (1, 3)), ROWS, axis=0)
    if restless is not None:
        rows[-2, restless] += 1
    for _ in range(2):
        work = work_for(PAPER)
        work = work._replace(outputs=rows.reshape(-1).astype(np.int32))
        works.append(work)
    keep_both_ways(3, 2, *works)
    assert np.array_equal(works[0].outputs, works[1].outputs)
    assert works[0].settled[0] == works[1].settled[0] == (restless is None)


@pytest.mark.parametrize("profile", ["paper", "khepera", "enki-epuck"])
@pytest.mark.parametrize("feeds", ["proximity", "ambient", "proximity+ambient"])
@pytest.mark.parametrize("rays", [False, True])
@pytest.mark.parametrize(("way", "group"), [(alone, 1), (in_turn, 3), (in_turn, 8), (in_turn, 32)])
def test_a_group_has_the_bits_of_one(profile, feeds, rays, way, group):
    """Every step of the paths of two networks, with noise and, where there is light, two lamps."""
    robot = load_profile(profile)
    if feeds != "proximity" and not robot.ambient.sensors:
        pytest.skip("no ambient sensors")
    if rays and way is alone:
        pytest.skip("threads share rays where there are several")
    task = load_task("light-seeking" if feeds == "ambient" else "obstacle-avoidance")
    lamps = tuple(lamp for one in task.arena.lamps for lamp in (one, replace(one, x_cm=one.x_cm - 5.0)))
    room = replace(task.arena, lamps=lamps)
    simulation = Simulation(replace(task, arena=room, feeds=feeds, sensors=()).of(robot), robot, 1.0)
    if rays and feeds != "proximity" and goes_beyond.py_func(simulation._cores.robot):
        pytest.skip("light is followed ray by ray where it is the printed law's")
    cores, streams = simulation._cores, batch_streams(11, 2)
    nets = random_networks(simulation, stream=3, count=2)
    expected, found = (np.zeros((2, 6, cores.trial.steps)) for _ in range(2))
    run_trials(cores.world, nets, np.arange(2), streams, expected, cores.scratch(nets))
    work = new_work(cores.robot, cores.trial, nets)
    light, wide = lanes_of_rays(work, cores.robot)
    rooms = {name: np.full(light if name == "light" else wide, np.nan) for name in Own._fields[:-2]}
    own = Own(**rooms, noticed=np.zeros(1, np.int64), listed=np.zeros(1, np.uint64))
    common = common_room(8 if rays else 0)
    for n in range(2):
        way(cores.world, nets, n, streams[n], work, own, common, np.zeros(group, np.int64), found[n])
    assert np.array_equal(found, expected)
