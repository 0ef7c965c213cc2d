"""Bounds of light in single precision: the double-precision law within them, and the same bits of trials."""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from benchmarks.steps import random_networks

from realitygap.kernels import batch
from realitygap.kernels.ambient import illuminate
from realitygap.kernels.bounded_rays import PART, total
from realitygap.kernels.jit import kernel
from realitygap.kernels.light_bounds import about_power, bound_light, fit_bounds
from realitygap.kernels.params import LANES
from realitygap.kernels.trial import bound_readings, draw_noise, set_pose
from realitygap.kernels.work import NO_RECORD, new_work
from realitygap.simulation.simulation import Simulation, batch_streams
from realitygap.tasks import load_task
from realitygap.world.arena import Arena, Cylinder
from realitygap.world.robot import Profile, load_profile
from tests.kernels.scenes import PAPER, random_lamp, random_profile

SEEKING = load_task("light-seeking")


def as_calibrated() -> Profile:
    """A robot whose sensors take in light as those of a calibrated unit of the twin do."""
    law = PAPER.ambient
    sensors = tuple(replace(s, gain=3.3e6, floor_shift=k % 3 - 1.0) for k, s in enumerate(law.sensors))
    beyond = replace(
        law, sensors=sensors, floor=60.0, dark=480.8, bands=(480.8, 60.0), response="linear", rays=45.0,
        reflectance=0.14, exponent=1.41, facing=1.41, matt=1.0, falloff=1.0, near_cm=1.8,
        lamp_height_cm=3.6, lamp_narrow=1.0, lamp_proud_cm=0.6, sensor_height_cm=1.2,
    )  # fmt: skip
    return replace(PAPER, ambient=beyond)


ROBOTS = {"paper": PAPER, "khepera": load_profile("khepera"), "calibrated": as_calibrated()}


def any_robot(random: np.random.Generator) -> Profile:
    """Any sensors, under printed and extended laws."""
    drawn = random_profile(random)
    one = random.random() < 0.6
    beyond = {
        "lamp_narrow": 1.0 if one else random.choice([0.0, 0.5]),
        "lamp_height_cm": random.choice([1.6, 4.0, 9.0] if one else [0.0, 4.0]),
        "facing": random.choice([0.0, 0.7, 1.4, 3.0]),
        "matt": random.choice([0.0, 1.0]) if one else 0.0,
    }
    return replace(drawn, ambient=replace(drawn.ambient, **beyond))


def any_room(random: np.random.Generator, lamps: int) -> Arena:
    """A bare room of any size with so many lamps."""
    width, depth = random.uniform(30, 119, 2)
    lit = tuple(random_lamp(random, width, depth) for _ in range(lamps))
    return Arena(name="other", size_cm=(width, depth), lamps=lit)


def any_simulations(seed: int, count: int, most_lamps: int = 3):
    """Robots of their own in rooms of their own, whose light can be bounded."""
    random = np.random.default_rng(seed)
    while count:
        room = any_room(random, random.integers(1, most_lamps + 1))
        start = replace(SEEKING.start, x_cm=room.size_cm[0] / 2, y_cm=room.size_cm[1] / 2, radius_cm=5)
        profile = any_robot(random)
        task = replace(SEEKING, arena=room, start=start, seconds=10)
        simulation = Simulation(task, profile, random.choice([0.0, 1.0, 2.0]))
        if fit_bounds(simulation.world):
            count -= 1
            yield simulation


def both_ways(simulation: Simulation, networks: int, trials: int) -> np.ndarray:
    """The paths of trials by bounds and without."""
    cores = simulation
    assert fit_bounds(cores.world)
    nets = random_networks(simulation, stream=7, count=networks)
    which, streams = np.repeat(np.arange(networks), trials), batch_streams(100, networks * trials)
    paths = np.zeros((2, len(which), 6, cores.trial.steps))
    for bounded in (True, False):
        work = new_work(cores.robot, cores.trial, nets, bounded=bounded)
        batch.run_trials(cores.world, nets, which, streams, paths[int(bounded)], NO_RECORD, work)
    return paths.view(np.int64)


@pytest.mark.parametrize("level", [0.0, 1.0, 2.0])
@pytest.mark.parametrize("name", list(ROBOTS))
def test_the_same_bits_in_thousands_of_trials(name, level):
    """40 networks in 25 trials of 20 s each."""
    bounded, plain = both_ways(Simulation(SEEKING, ROBOTS[name], level), 40, 25)
    assert np.array_equal(bounded, plain)


def test_the_same_bits_of_other_robots_in_other_rooms():
    """60 robots with sensors of their own, each in a room of its own with up to three lamps."""
    for simulation in any_simulations(seed=51, count=60):
        bounded, plain = both_ways(simulation, 4, 5)
        assert np.array_equal(bounded, plain)


@kernel
def _both_lights(world, poses, work, found, certain):
    """Of each pose: the bounds, the law's illumination, and what part of the reflected light is doubtful."""
    robot, rows = world.robot, work.bounds.rows
    for t in range(poses.shape[0]):
        set_pose(poses[t], work)
        bound_light(robot, world.arena, work, found[t, 0], found[t, 1])
        each = (work.all_fans.shape[1] - LANES) // found.shape[2]
        for k in range(found.shape[2]):
            found[t, 3, k] = 0.0
            if work.listed[k] == 1:
                whole = max(total(rows[0], k * each, (k + 1) * each), np.float32(1e-30))
                found[t, 3, k] = total(rows[1], k * each, (k + 1) * each) / whole
        illuminate(robot, world.arena, True, work, found[t, 2])
        draw_noise(world.level, np.uint64(t), 0, work)
        certain[t] = bound_readings(world, work)


def anywhere(cores: Simulation, places: int, seed: int) -> np.ndarray:
    """[places, 3] poses in the room, a third of which touch a wall."""
    random, r, size = np.random.default_rng(seed), cores.robot.radius, cores.arena.size
    poses = np.column_stack([random.uniform(r, size - r, (places, 2)), random.uniform(-7, 7, places)])
    touches = random.random((places, 2)) < 0.18
    poses[:, :2] = np.where(touches, np.where(random.random((places, 2)) < 0.5, r, size - r), poses[:, :2])
    return poses


def looked_at(simulation: Simulation, places: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """[places, 4, A] lower and upper bound, the light itself, all up to where a reading is constant, and what
    share of a lamp's is doubtful; and whether the inputs are certain."""
    cores = simulation
    work = new_work(cores.robot, cores.trial, random_networks(simulation, stream=1, count=1), bounded=True)
    poses = anywhere(cores, places, seed)
    found, certain = np.zeros((places, 4, len(cores.robot.ambient_gain))), np.zeros(places, np.bool_)
    _both_lights(cores.world, poses, work, found, certain)
    found[:, :3] = np.minimum(found[:, :3], cores.robot.ambient_full / cores.robot.ambient_gain)
    return found, certain


@pytest.mark.parametrize("name", list(ROBOTS))
def test_single_precision_errs_by_a_fraction_of_its_margin(name):
    """At 64 000 places the light lies within the bounds; where nothing is doubtful it is off their middle by
    a third of their width at most. At most places all inputs are certain."""
    found, certain = looked_at(Simulation(SEEKING, ROBOTS[name], 1.0), 64_000, seed=52)
    lower, upper, light, doubt = found.transpose(1, 0, 2)
    assert ((lower <= light) & (light <= upper)).all()
    clear = (doubt < 1e-6) & (upper > lower * (1 + 1e-9)) & (upper < upper.max(axis=0))
    share = np.abs(light - (lower + upper) / 2)[clear] / ((upper - lower) / 2)[clear]
    assert clear.sum() > 20_000 and 0.0001 < share.max() < 1 / 3, (clear.sum(), share.max())
    assert certain.mean() > 0.85, certain.mean()


def test_bounds_hold_for_any_robot():
    """At 64 000 places of 160 robots; shadows, corners and rays along walls decide thousands of them."""
    doubted = 0
    for k, simulation in enumerate(any_simulations(seed=53, count=160)):
        found, _ = looked_at(simulation, 400, seed=k)
        lower, upper, light, doubt = found.transpose(1, 0, 2)
        assert ((lower <= light) & (light <= upper)).all()
        doubted += (doubt > 1e-6).sum()
    assert doubted > 5000, doubted


@kernel
def _both_rays(world, poses, work, found):
    """Of each pose and ray: the bounds of what it brings, and what the law has of it."""
    robot, rows = world.robot, work.bounds.rows
    for t in range(poses.shape[0]):
        set_pose(poses[t], work)
        bound_light(robot, world.arena, work, work.bounds.ends[0], work.bounds.ends[1])
        illuminate(robot, world.arena, False, work, work.readings)
        for i in range(found.shape[2]):
            found[t, 0, i] = rows[0, i] * (1 - PART) - rows[1, i]
            found[t, 1, i] = rows[0, i] * (1 + PART)
            found[t, 2, i] = work.light[i] * work.terms[i]


def test_each_ray_has_bounds():
    """Of thirty robots at 1500 places each, with one lamp and sensors whose rays always matter."""
    doubted = 0
    for k, simulation in enumerate(any_simulations(seed=55, count=60, most_lamps=1)):
        cores = simulation
        if not np.isinf(cores.robot.ambient_full).all():
            continue
        work = new_work(cores.robot, cores.trial, bounded=True)
        poses = anywhere(cores, 1500, k)
        found = np.zeros((1500, 3, work.all_fans.shape[1] - LANES))
        _both_rays(cores.world, poses, work, found)
        lower, upper, exact = found.transpose(1, 0, 2)
        lamp = 1.0
        if cores.robot.light_narrow == 1.0:
            lamp = max(cores.arena.lamp_weights.sum() + cores.arena.lamp_offset[0], 0.0)
        assert ((lower * lamp <= exact) & (exact <= upper * lamp)).all()
        doubted += (lower < 0.99 * upper).sum()
    assert doubted > 5000, doubted


def test_powers_are_near():
    """To less than half of their margin, and next to nothing below e⁻⁴⁰."""
    random = np.random.default_rng(54)
    for _ in range(4000):
        x, p = random.random() ** random.integers(1, 9), random.uniform(0, 20)
        exact = x**p
        assert abs(about_power(x, p) - exact) <= 5e-6 * exact + 1e-17
    assert about_power(1.0, 1.4) == 1.0 and about_power(0.0, 1.4) < 1e-17


def test_what_does_not_fit_is_not_bounded():
    """Proximity, obstacles, reflectances, an outline, sensors on the body's edge, lamps close to surfaces."""
    room, law = SEEKING.arena, PAPER.ambient
    pole = Cylinder(x_cm=60, y_cm=35, radius_cm=3)
    edge = replace(law.sensors[0], x_cm=PAPER.body.radius_cm - 0.1, y_cm=0.0)
    low = replace(as_calibrated(), ambient=replace(as_calibrated().ambient, lamp_height_cm=1.0))
    matt = replace(PAPER, ambient=replace(law, matt=1.0))
    rooms = [
        replace(room, cylinders=(pole,)), replace(room, walls=((50.0, 1.0, 50.0, 9.0),)),
        replace(room, reflectance=0.5), replace(room, size_cm=(125.0, 70.0)),
        replace(room, lamps=(replace(room.lamps[0], offset=-4.19),)),
        replace(room, lamps=(replace(room.lamps[0], spacing_cm=0.5),)),
    ]  # fmt: skip
    unfit = [Simulation(replace(SEEKING, arena=one), PAPER) for one in rooms]
    unfit += [Simulation(SEEKING, one) for one in (low, matt)]
    unfit += [Simulation(SEEKING, replace(PAPER, ambient=replace(law, sensors=(edge, *law.sensors[1:]))))]
    unfit += [Simulation("obstacle-avoidance", PAPER)]
    assert [fit_bounds(one.world) for one in unfit] == [False] * len(unfit)


def test_python_gives_the_same_bits():
    """With the compiler off, some steps by bounds and without."""
    words = "from tests.kernels.test_light_bounds import python_agrees; python_agrees()"
    environment = {**os.environ, "NUMBA_DISABLE_JIT": "1"}
    done = subprocess.run([sys.executable, "-c", words], env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def python_agrees() -> None:
    """Two robots, each with a trial of half a second."""
    for name in ("paper", "calibrated"):
        bounded, plain = both_ways(Simulation(replace(SEEKING, seconds=0.5), ROBOTS[name], 1.0), 1, 1)
        assert np.array_equal(bounded, plain)
