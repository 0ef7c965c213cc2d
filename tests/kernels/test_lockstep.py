"""Trials in lockstep: the bits of one by one, and only where that is known to hold."""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from benchmarks.steps import random_networks

from realitygap.kernels import batch
from realitygap.kernels.geometry import added
from realitygap.kernels.infrared import fan_of, follow, reflected
from realitygap.kernels.jit import kernel
from realitygap.kernels.lane_noise import SINGLE, log_share, normal_single
from realitygap.kernels.lane_sensors import COUNTS, PART, follow_all, take_in
from realitygap.kernels.lanes import COS, LIGHT, SIN, WIDE, X, Y, fit_lanes, new_lanes
from realitygap.kernels.lockstep import run_lockstep
from realitygap.kernels.params import LANES
from realitygap.kernels.rng import bits, normal_pair
from realitygap.kernels.trial import scale_input
from realitygap.kernels.work import quiet
from realitygap.simulation import engine
from realitygap.simulation.simulation import Simulation, batch_streams
from realitygap.tasks import load_task
from realitygap.world.arena import Arena, Cylinder
from realitygap.world.profile import load_profile
from tests.kernels.scenes import PAPER, random_profile

AVOIDANCE = load_task("obstacle-avoidance")


def other_robot(random: np.random.Generator):
    """Any eight sensors at most, with reaches that end; wheels with play and lag."""
    drawn = random_profile(random).infrared
    sensors = tuple(
        replace(s, b=min(s.b, -40.0), offset_cm=abs(s.offset_cm))
        for s in drawn.sensors[: random.integers(1, 9)]
    )
    wheels = replace(PAPER.wheels, lag=random.choice([0.0, 0.3]), play_cm=random.choice([0.0, 0.05]))
    return replace(PAPER, infrared=replace(drawn, sensors=sensors), wheels=wheels)


def other_room(random: np.random.Generator) -> Arena:
    """A room of any size with up to four cylinders that are apart from each other and the middle."""
    width, depth = random.uniform(40, 110, 2)
    poles: list[Cylinder] = [Cylinder(x_cm=width / 2, y_cm=depth / 2, radius_cm=7)]
    for _ in range(random.integers(0, 30)):
        r = random.uniform(0.6, 6)
        x, y = random.uniform(r, width - r), random.uniform(r, depth - r)
        apart = all(np.hypot(x - p.x_cm, y - p.y_cm) > r + p.radius_cm + 0.02 for p in poles)
        poles += [Cylinder(x_cm=x, y_cm=y, radius_cm=r)] if apart and len(poles) < 5 else []
    return Arena(name="other", size_cm=(width, depth), cylinders=tuple(poles[1:]))


def both_ways(simulation: Simulation, networks: int, trials: int) -> tuple[np.ndarray, np.ndarray]:
    """The paths of trials in lockstep and one by one."""
    cores = simulation._cores
    assert fit_lanes(cores.world)
    nets = random_networks(simulation, stream=7, count=networks)
    work = cores.scratch(nets)
    lanes = new_lanes(cores.world, nets)
    paths = np.zeros((2, networks, trials, 6, cores.trial.steps))
    for w in range(networks):
        streams = batch_streams(100 + w, trials)
        run_lockstep(cores.world, nets, w, streams, paths[0, w], lanes)
        batch.run_trials(cores.world, nets, np.full(trials, w), streams, paths[1, w], work)
    return paths.view(np.int64)


@pytest.mark.parametrize("level", [0.0, 1.0, 2.0])
@pytest.mark.parametrize("name", ["paper", "khepera", "e-puck"])
def test_the_same_bits_in_thousands_of_trials(name, level):
    """24 networks in 64 trials of 20 s each, by the printed law and by its extended form."""
    lockstep, alone = both_ways(Simulation(AVOIDANCE, name, level), 24, WIDE)
    assert np.array_equal(lockstep, alone)


@pytest.mark.parametrize("trials", [1, 5, 8, 33])
def test_any_number_of_trials(trials):
    """Lanes that no trial has change nothing."""
    lockstep, alone = both_ways(Simulation(AVOIDANCE, PAPER, 1.0), 3, trials)
    assert np.array_equal(lockstep, alone)


@pytest.mark.parametrize("steps", [1, 7, 9, 31])
def test_any_number_of_steps(steps):
    """Paths are written eight steps at a time, and what is left of them at the end."""
    lockstep, alone = both_ways(Simulation(replace(AVOIDANCE, seconds=steps / 10), PAPER, 1.0), 2, 16)
    assert np.array_equal(lockstep, alone)


def test_the_same_bits_of_other_robots_in_other_rooms():
    """60 robots with sensors of their own, each in a room of its own."""
    random, touched = np.random.default_rng(44), 0
    for _ in range(60):
        room = other_room(random)
        start = replace(AVOIDANCE.start, x_cm=room.size_cm[0] / 2, y_cm=room.size_cm[1] / 2)
        task = replace(AVOIDANCE, arena=room, start=start)
        lockstep, alone = both_ways(Simulation(task, other_robot(random), 1.0), 2, 24)
        assert np.array_equal(lockstep, alone)
        touched += alone.view(np.float64)[:, :, 5].any(axis=-1).sum()
    assert touched > 100


@kernel
def _both_lights(world, n, lanes, exact):
    """What comes back to each sensor: in single precision into lanes, in double into `exact`, less b."""
    robot, d, work = world.robot, lanes.double, lanes.work
    rays = fan_of(robot, work)
    follow_all(np.uint64(n), robot, world.arena, lanes)
    for t in range(n):
        at = np.uint64(t)
        work.pose[0], work.pose[1], work.pose[3], work.pose[4] = (
            d[X + at],
            d[Y + at],
            d[COS + at],
            d[SIN + at],
        )
        for k in range(robot.proximity_a.shape[0]):
            follow(robot, world.arena, k, rays, work)
            exact[k, t] = reflected(robot, world.arena, k, rays, work.terms)
            for i in range(LANES):
                work.terms[i] = robot.proximity_weight[k, i] * robot.proximity_b[k]
            exact[k, t] -= added(work.terms)


@pytest.mark.parametrize("name", ["paper", "khepera"])
def test_single_precision_errs_by_a_fraction_of_its_margin(name):
    """A third at most, at 64 000 places that the body can be at; and what is not noticed reads 0."""
    random, cores = np.random.default_rng(45), Simulation(AVOIDANCE, name, 1.0)._cores
    nets = random_networks(Simulation(AVOIDANCE, name), stream=1, count=1)
    lanes, worst, seen = new_lanes(cores.world, nets), 0.0, 0
    robot, radius, poles = cores.robot, cores.robot.radius, cores.arena.cylinders
    exact, sums = np.zeros((8, WIDE)), robot.proximity_b * robot.proximity_weight.sum(axis=1)
    for _ in range(1000):
        places = random.uniform(radius, 50 - radius, (1000, 2))
        gap = np.hypot(*(places[:, None] - poles[:, :2]).T) - poles[:, 2:] - radius
        lanes.double[X : X + WIDE], lanes.double[Y : Y + WIDE] = places[(gap > 0).all(axis=0)][:WIDE].T
        angle = random.uniform(0, 7, WIDE)
        lanes.double[COS : COS + WIDE], lanes.double[SIN : SIN + WIDE] = np.cos(angle), np.sin(angle)
        _both_lights(cores.world, WIDE, lanes, exact)
        light = (
            lanes.single[LIGHT : LIGHT + 8 * WIDE].astype(float).reshape(8, WIDE) * robot.proximity_a[:, None]
        )
        known, unseen = light > 0, light == 0
        assert (exact[unseen] + np.broadcast_to(sums[:, None], exact.shape)[unseen] <= 0).all()
        share = abs(light - exact) / (float(COUNTS) + float(PART) * exact)
        worst, seen = max(worst, share[known].max()), seen + known.sum()
    assert seen > 100_000 and 0.001 < worst < 1 / 3, worst


@kernel
def _take_in(n, world, lanes):
    take_in(np.uint64(n), world.robot, world.task, lanes)


@pytest.mark.parametrize(("margins", "apart"), [(-1.5, 0), (-0.8, 1), (0.8, 1), (1.5, 0)])
def test_a_reading_within_its_margin_senses_apart(margins, apart):
    """Where a reading is so near the count at which an input changes, and only there."""
    cores = Simulation(AVOIDANCE, PAPER, 0.0)._cores
    robot, lanes = cores.robot, new_lanes(cores.world, quiet())
    ends = [scale_input(robot.proximity_low, robot.proximity_high, float(c)) for c in range(200)]
    edge = ends.index(ends[0] + 1) - 0.5  # readings are rounded to the least that gives another input
    returned = edge - robot.proximity_b[0] * robot.proximity_weight[0].sum()
    returned += margins * (float(COUNTS) + float(PART) * returned)
    lanes.single[LIGHT : LIGHT + 8 * WIDE] = returned / robot.proximity_a[0]
    _take_in(WIDE, cores.world, lanes)
    assert (lanes.apart == apart).all()


@kernel
def _both_normals(streams, exact, single):
    """The first normal number of each stream's first draw, in double and in single precision."""
    for i in range(streams.shape[0]):
        b = bits(streams[i], 0)
        exact[i], _ = normal_pair(streams[i], 0)
        single[i] = normal_single(np.uint32(b >> np.uint64(32)), np.uint32(b))


def test_sensors_noise_in_single_precision_is_known_well_enough():
    """To what its margin has, in two million draws."""
    streams = np.arange(2_000_000).astype(np.uint64) * np.uint64(0x9E3779B97F4A7C15)
    exact, single = np.zeros(len(streams)), np.zeros(len(streams), np.float32)
    _both_normals(streams, exact, single)
    assert np.abs(exact).max() > 4.5 and np.abs(exact).min() < 1e-4
    assert np.abs(single - exact).max() < SINGLE


@kernel
def _logarithms(high, out):
    for i in range(high.shape[0]):
        out[i] = log_share(high[i])


def test_the_logarithm_of_a_draw_holds_at_its_ends():
    """Where single precision does not tell a share from 1, and next to 0."""
    high = np.array([0, 1, 2, 3037000498, 3037000499, 2**31, 2**32 - 300, 2**32 - 2, 2**32 - 1], np.uint32)
    out = np.zeros(len(high), np.float32)
    _logarithms(high, out)
    share = (high.astype(float) + 0.5) / 2.0**32
    exact = np.where(share > 0.5, np.log1p(-(2.0**32 - high - 0.5) / 2.0**32), np.log(share))
    assert np.allclose(out, exact, rtol=3e-7, atol=0)


def test_what_does_not_fit_goes_one_by_one():
    """Light, inner walls, many or overlapping cylinders, measured curves, reflectances, nine sensors."""
    room = AVOIDANCE.arena
    poles = (*room.cylinders, Cylinder(x_cm=25, y_cm=44, radius_cm=2))
    two = (Cylinder(x_cm=10, y_cm=10, radius_cm=3), Cylinder(x_cm=12, y_cm=10, radius_cm=3))
    tinted = (replace(room.cylinders[0], reflectance=0.5), *room.cylinders[1:])
    rooms = [
        replace(room, walls=((1.0, 1.0, 5.0, 1.0),)), replace(room, cylinders=poles),
        replace(room, cylinders=two), replace(room, cylinders=tinted),
    ]  # fmt: skip
    nine = replace(PAPER.infrared, sensors=(*PAPER.infrared.sensors, PAPER.infrared.sensors[0]))
    unfit = [Simulation(replace(AVOIDANCE, arena=one), PAPER) for one in rooms]
    unfit += [Simulation("light-seeking", PAPER), Simulation(AVOIDANCE, replace(PAPER, infrared=nine))]
    assert not any(fit_lanes(one._cores.world) for one in unfit)
    assert Simulation(replace(AVOIDANCE, spread=0.1), PAPER)._cores._lockstep is False


def test_nobody_waits_for_a_compilation_that_is_not_repaid(monkeypatch):
    """Trials go one by one until compiling for lockstep would have been worth it; the same scores."""
    monkeypatch.setattr(engine, "_asked", [0])
    monkeypatch.setattr(engine.SHELF, "holds", lambda name: False)
    simulation = Simulation(replace(AVOIDANCE, seconds=2), PAPER)
    nets, streams = (
        random_networks(simulation, stream=3, count=2),
        np.arange(140, dtype=np.uint64).reshape(2, 70),
    )
    went, run = [], engine.run_lockstep
    monkeypatch.setattr(engine, "run_lockstep", lambda *given: went.append(len(given[3])) or run(*given))
    alone = simulation.scores(nets, streams)
    assert not went and engine._asked[0] == 140 * 20
    simulation.scores(nets, streams[:, :2])
    assert engine._asked[0] == 140 * 20, "few trials of a network do not count"
    monkeypatch.setattr(engine, "REPAID", 140 * 20)
    assert np.array_equal(simulation.scores(nets, streams), alone)
    assert sum(went) == 140 and max(went) <= WIDE


def test_python_gives_the_same_bits():
    """With the compiler off, some steps in lockstep and one by one."""
    words = "from tests.kernels.test_lockstep import python_agrees; python_agrees()"
    environment = {**os.environ, "NUMBA_DISABLE_JIT": "1"}
    done = subprocess.run([sys.executable, "-c", words], env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def python_agrees() -> None:
    """Two robots, each with a few trials of 0.6 s that begin anywhere."""
    start = replace(AVOIDANCE.start, x_cm=25, y_cm=8, radius_cm=3)
    task = replace(AVOIDANCE, seconds=0.6, start=start)
    for name in ("paper", "khepera"):
        lockstep, alone = both_ways(Simulation(task, load_profile(name), 1.0), 1, 5)
        assert np.array_equal(lockstep, alone)
