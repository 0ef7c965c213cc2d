"""Where a step's time goes: steps a second on one core, and the shares of sensing, network, wheels, noise.

    python benchmarks/kernels.py

A part's share is what it costs to do it twice: the same compiled loop runs with and without a
second sensing, network, wheels or noise, in turn, in one process, and the ratios are compared.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from steps import random_networks

from realitygap.compiled import kernel
from realitygap.kernels.brain import decide
from realitygap.kernels.network import load_network
from realitygap.kernels.params import Networks, Path
from realitygap.kernels.trial import (
    draw_noise,
    draw_start,
    move,
    sense,
    start,
    store,
    to_inputs,
    turn_wheels,
)
from realitygap.kernels.work import new_work
from realitygap.simulation.simulation import Simulation, batch_streams
from realitygap.tasks import TASKS, load_task
from realitygap.world.arena import Arena
from realitygap.world.robot import Profile, load_profile

PARTS = ("nothing", "sensing", "network", "wheels", "noise")
NOTHING, SENSING, NETWORK, WHEELS, NOISE = range(5)
TRIALS, ROUNDS = 1024, 9


@kernel
def run_with_twice(part, world, nets, which, streams, paths, work, twin):
    """run_trials with one part of each step done a second time, on `twin` where it has a memory."""
    robot, arena, task, level = world.robot, world.arena, world.task, world.level
    for t in range(which.shape[0]):
        stream, n = streams[t], which[t]
        p = paths[t % paths.shape[0]]
        path = Path(p[0], p[1], p[2], p[3], p[4], p[5])
        draw_start(task, stream, work.start)
        start(work.start, work)
        load_network(nets, n, work)
        start(work.start, twin)
        load_network(nets, n, twin)
        for k in range(task.steps):
            draw_noise(level, stream, k, work)
            if part == NOISE:
                draw_noise(level, stream, k, work)
            sense(world, stream, k, work)
            if part == SENSING:
                sense(world, stream, k, work)
            to_inputs(robot, task, work)
            commands = decide(nets, n, work)
            if part == NETWORK:
                for i in range(work.inputs.shape[0]):
                    twin.inputs[i] = work.inputs[i]
                    twin.change[i] = work.change[i]
                decide(nets, n, twin)
            if part == WHEELS:
                for w in range(2):
                    for i in range(work.wheel.shape[1]):
                        twin.wheel[w, i] = work.wheel[w, i]
                for i in range(work.pose.shape[0]):
                    twin.pose[i] = work.pose[i]
                for i in range(work.noise.shape[0]):
                    twin.noise[i] = work.noise[i]
                turn_wheels(robot, commands, level, twin)
                move(robot, arena, twin)
            turn_wheels(robot, commands, level, work)
            move(robot, arena, work)
            store(path, k, work)


def seconds_for(simulation: Simulation, nets: Networks) -> Callable[[int], float]:
    """A function that runs all trials with a part done twice and says how long it took."""
    which = np.arange(TRIALS) % len(nets.neurons)
    work, twin = (new_work(simulation.robot, simulation.trial, nets) for _ in range(2))
    paths = np.zeros((1, 6, simulation.trial.steps))
    streams = batch_streams(7, TRIALS)

    def seconds(part: int) -> float:
        start = time.perf_counter()
        run_with_twice(
            part, simulation.world, nets, which, streams, paths, work, twin,
        )  # fmt: skip
        return time.perf_counter() - start

    return seconds


def as_measured(printed: Profile) -> Profile:
    """A robot whose sensors read by curves about what they read by the printed law before a wall."""
    law, share = printed.infrared, np.arange(41) / 40
    far = 4.0 * (1.0 / np.maximum(share, 1e-9) - 1.0)

    def curve(a: float, b: float) -> tuple[float, ...]:
        return tuple(np.clip(6.3 * (a / np.maximum(far, 0.1) ** 2 + b), 0.0, law.top).tolist())

    noise = (3.0, *(21.0,) * 8)
    sensors = tuple(replace(s, a=1.0, b=0.0, curve=curve(s.a, s.b), noise=noise) for s in law.sensors)
    optics = {"lobe": (0.3, 0.28, 0.22, 0.14, 0.06), "aperture_deg": 60.0, "width_cm": 0.5, "curve_cm": 4.0}
    return replace(printed, infrared=replace(law, sensors=sensors, **optics))


def compare_laws() -> None:
    """How long steps with sensors by curves take, over those by a printed law, in turn in one run.

    Straight lines between a curve's values see a little farther than the printed law; so also with a range
    that ends where the law's does: then as many sensors have anything to read.
    """
    for name in ("paper", "khepera"):
        printed = load_profile(name)
        by_curves = as_measured(printed)
        ends = float(np.median([printed.infrared.reach_cm(s) for s in printed.infrared.sensors]))
        near = replace(by_curves, infrared=replace(by_curves.infrared, range_cm=ends))
        timed = []
        for profile in (printed, by_curves, near):
            simulation = Simulation(load_task("avoidance"), profile, 1.0)
            timed.append(seconds_for(simulation, random_networks(simulation, stream=1995)))
            timed[-1](NOTHING)
        rounds = np.array([[seconds(NOTHING) for seconds in timed] for _ in range(ROUNDS)])
        ratios = np.median(rounds[:, 1:] / rounds[:, :1], axis=0)
        print(f"sensors by curves, over the law of {name}: {ratios[0]:.3f}; of its reach: {ratios[1]:.3f}")


def as_calibrated(printed: Profile) -> Profile:
    """A robot whose sensors take in light as those of a calibrated unit of the twin do."""
    law = printed.ambient
    sensors = tuple(replace(sensor, gain=3.3e6) for sensor in law.sensors)
    beyond = replace(
        law, sensors=sensors, floor=60.0, dark=480.8, bands=(480.8, 60.0), response="linear", rays=45.0,
        reflectance=0.14, exponent=1.41, facing=1.41, matt=1.0, falloff=1.0, near_cm=1.8,
        lamp_height_cm=3.6, lamp_narrow=1.0, lamp_proud_cm=0.6, sensor_height_cm=1.2,
    )  # fmt: skip
    return replace(printed, ambient=beyond)


def compare_light() -> None:
    """How long steps of light seeking by a calibrated unit take, over those by the printed law, in turn."""
    printed, timed = load_profile("paper"), []
    for profile in (printed, as_calibrated(printed)):
        simulation = Simulation(load_task("light"), profile, 1.0)
        timed.append(seconds_for(simulation, random_networks(simulation, stream=1995)))
        timed[-1](NOTHING)
    rounds = np.array([[seconds(NOTHING) for seconds in timed] for _ in range(ROUNDS)])
    print(f"light of a calibrated unit, over the printed law: {np.median(rounds[:, 1] / rounds[:, 0]):.2f}")


def walled(count: int, side: float) -> Arena:
    """A room with so many walls of 10 cm, anywhere but in its middle, where trials start."""
    random, walls = np.random.default_rng(3), []
    while len(walls) < count:
        x, y, angle = *random.uniform(0, side, 2), random.uniform(0, np.pi)
        ends = (x, y, x + 10 * np.cos(angle), y + 10 * np.sin(angle))
        middle = np.linspace(ends[:2], ends[2:], 20) - side / 2
        if min(ends) >= 0 and max(ends) <= side and np.hypot(*middle.T).min() > 7:
            walls.append(tuple(map(float, ends)))
    return Arena(name="walled", size_cm=(side, side), walls=tuple(walls))


def compare_rooms() -> None:
    """How long steps among inner walls take, over those in the paper's arena, in turn in one run."""
    task, sides = load_task("avoidance"), {1: 60, 4: 60, 20: 120, 200: 400}
    rooms = [task.arena, *(walled(count, side) for count, side in sides.items())]
    timed = []
    for room in rooms:
        start = replace(task.start, x_cm=room.size_cm[0] / 2, y_cm=room.size_cm[1] / 2)
        simulation = Simulation(replace(task, arena=room, start=start), load_profile("paper"), 1.0)
        timed.append(seconds_for(simulation, random_networks(simulation, stream=1995)))
        timed[-1](NOTHING)
    rounds = np.array([[seconds(NOTHING) for seconds in timed] for _ in range(ROUNDS)])
    for walls, ratio in zip(sides, np.median(rounds[:, 1:] / rounds[:, :1], axis=0), strict=True):
        print(f"a room with {walls} inner walls, over the paper's arena: {ratio:.2f}")


def main() -> None:
    compare_rooms()
    compare_laws()
    compare_light()
    for name in TASKS:
        simulation = Simulation(load_task(name), load_profile("paper"), 1.0)
        seconds = seconds_for(simulation, random_networks(simulation, stream=1995))
        seconds(NOTHING)  # warm-up: compiles
        rounds = np.array([[seconds(part) for part in range(len(PARTS))] for _ in range(ROUNDS)])
        speed = TRIALS * simulation.trial.steps / rounds[:, 0] / 1e6
        extra = np.median(rounds[:, 1:] / rounds[:, :1] - 1.0, axis=0)
        print(f"{name}: {np.median(speed):.2f} million steps/s (best {speed.max():.2f})")
        for part, share in zip(PARTS[1:], extra, strict=True):
            print(f"  {part:8s} {100 * share:5.1f} %")
        print(f"  the rest {100 * (1 - extra.sum()):5.1f} %")


if __name__ == "__main__":
    main()
