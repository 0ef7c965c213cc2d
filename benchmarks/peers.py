"""Steps a second on one core beside other simulators of a Khepera, in the arena of obstacle avoidance.

    python benchmarks/peers.py [--rounds 5] [--seconds 2] [--kheperax PYTHON] [--json]

Each goes its own way at its own step: what that has in it stands beside its figure. All take turns, round by
round, each by the processor time of its own process. A peer that is not here is left out, with the line that
installs it. Kheperax brings JAX: give it an environment of its own and name that one's Python here, as
`python -m venv kp && kp/bin/pip install kheperax==0.2.0`, then `--kheperax kp/bin/python`.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

STEP_S, TRIALS, SIDES = 0.1, 64, 8
BATCHES = (16, 64, 256)
"""Of Kheperax, whose best one counts."""
KHEPERAX = "kheperax==0.2.0"
Timed = Callable[[float], tuple[float, float]]
"""At least so many seconds of work → steps, processor seconds."""

WHAT = {
    "realitygap, 64 networks": "80 rays; network of a random start, 10 updates; noise; PID; contact; score",
    "realitygap, 64 trials": "the same, 64 trials of each network",
    "Enki": "24 rays; a weighted sum, no network; noise; contact; no score",
    "Kheperax": "8 rays, 2 bumpers; perceptron of 8; noise; whoever touches sticks; octagons; a score",
}
"""A step of each is of 100 ms."""


def main() -> None:
    """Print a line for each."""
    words = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    words.add_argument("--rounds", type=int, default=5)
    words.add_argument("--seconds", type=float, default=2.0)
    words.add_argument("--kheperax", default=sys.executable, metavar="PYTHON", help="of its environment")
    words.add_argument("--json", action="store_true")
    words.add_argument("--arena", help=argparse.SUPPRESS)
    given = words.parse_args()
    if hasattr(os, "sched_setaffinity"):  # threads of a library would work on other cores
        os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
    if given.arena:
        serve_kheperax(json.loads(given.arena))
        return
    timed = contestants(given.kheperax)
    rounds: dict[str, list[float]] = {name: [] for name in timed}
    for _ in range(given.rounds):
        for name, run in timed.items():
            steps, seconds = run(given.seconds)
            rounds[name].append(steps / seconds)
    figures = {name: sorted(rates)[len(rates) // 2] for name, rates in rounds.items()}
    if given.json:
        print(json.dumps({"steps_per_second": figures, "rounds": rounds, "a_step_has": WHAT}))
        return
    for name, rate in figures.items():
        span = f"({min(rounds[name]) / 1e6:.2f} to {max(rounds[name]) / 1e6:.2f})"
        print(f"{name:24} {rate / 1e6:5.2f} million steps/s {span}: {WHAT[name]}")


def contestants(kheperax: str) -> dict[str, Timed]:
    """All that are here, warmed up; says which are not."""
    from realitygap.errors import UsageError
    from realitygap.tasks import load_task

    task = load_task("obstacle-avoidance")
    pillars = [(c.x_cm, c.y_cm, c.radius_cm) for c in task.arena.cylinders]
    timed = {"realitygap, 64 networks": ours(64, 4), "realitygap, 64 trials": ours(16, TRIALS)}
    try:
        from realitygap.robots.enki import program

        room = [STEP_S, *task.arena.size_cm, task.start.x_cm, task.start.y_cm]
        numbers = [*room, len(pillars), *(v for pillar in pillars for v in pillar)]
        text = Path(__file__).with_suffix(".cpp").read_bytes()
        timed["Enki"] = asked([str(program(text)), *map(str, numbers)])
    except UsageError as error:
        print(f"left out: {error}", file=sys.stderr)
    found = subprocess.run([kheperax, "-c", "import kheperax.tasks.main"], capture_output=True)
    if found.returncode:
        print(f"left out: Kheperax. pip install {KHEPERAX} (see --help)", file=sys.stderr)
        return timed
    room = {"side": task.arena.size_cm[0], "pillars": pillars, "steps": task.steps}
    timed["Kheperax"] = asked([kheperax, __file__, "--arena", json.dumps(room)])
    return timed


def ours(count: int, trials: int) -> Timed:
    """Trials of random networks, as evolution evaluates them."""
    import numpy as np
    from steps import random_networks

    from realitygap.simulation.simulation import Simulation, batch_streams

    simulation = Simulation("obstacle-avoidance", "paper", 1.0)
    networks = random_networks(simulation, stream=1995, count=count)
    streams = batch_streams(7, count * trials).reshape(count, trials)

    def run(seconds: float) -> tuple[float, float]:
        begun, made = time.process_time(), 0
        while time.process_time() - begun < seconds:
            simulation.scores(networks, np.ascontiguousarray(streams))
            made += streams.size * simulation.task.steps
        return made, time.process_time() - begun

    run(0.1)
    return run


def asked(order: list[str]) -> Timed:
    """A process that answers each line of seconds with one of steps and processor seconds."""
    process = subprocess.Popen(order, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, bufsize=1)
    told, heard = process.stdin, process.stdout
    assert told is not None and heard is not None

    def run(seconds: float) -> tuple[float, float]:
        told.write(f"{seconds}\n")
        answer = heard.readline().split()
        if len(answer) != 2:
            raise SystemExit(f"{order[0]} ended with {process.wait()}")
        return float(answer[0]), float(answer[1])

    run(0.1)
    return run


def serve_kheperax(arena: dict) -> None:
    """Answer as `asked` expects it; the arena becomes Kheperax's unit square."""
    import math

    import jax
    import jax.numpy as jnp

    jax.tree_leaves = jax.tree_util.tree_leaves  # which version 0.2.0 asks for and JAX dropped
    from kheperax.simu.geoms import Pos, Segment
    from kheperax.simu.maze import Maze
    from kheperax.simu.robot import Robot
    from kheperax.tasks.config import KheperaxConfig
    from kheperax.tasks.main import KheperaxTask

    side = arena["side"]
    corners = [
        [Pos(x=(x + r * math.cos(a)) / side, y=(y + r * math.sin(a)) / side)
         for a in (2 * math.pi * k / SIDES for k in range(SIDES))]
        for x, y, r in arena["pillars"]
    ]  # fmt: skip
    walls = [Segment(p1=ring[k - 1], p2=ring[k]) for ring in corners for k in range(SIDES)]
    robot = Robot.create_default_robot()
    robot = robot.replace(
        posture=robot.posture.replace(x=0.5, y=0.5), radius=2.75 / side, laser_ranges=5.0 / side,
        laser_angles=jnp.linspace(-jnp.pi, jnp.pi, 8, endpoint=False), std_noise_sensor_measures=0.1 / side,
    )  # fmt: skip
    config = KheperaxConfig.get_default()
    config.maze, config.robot, config.episode_length = Maze.create(segments_list=walls), robot, arena["steps"]
    config.action_scale, config.std_noise_wheel_velocities = 0.8 / side, 0.04 / side
    key = jax.random.PRNGKey(1995)
    _, policy, scoring = KheperaxTask.create_default_task(config, key)
    score = jax.jit(scoring)
    start = jax.vmap(policy.init, in_axes=(0, None))

    def rate(batch: int, seconds: float) -> tuple[float, float]:
        networks = start(jax.random.split(key, batch), jnp.zeros(10))
        jax.block_until_ready(score(networks, key))
        begun, made = time.process_time(), 0
        while time.process_time() - begun < seconds:
            jax.block_until_ready(score(networks, key))
            made += batch * arena["steps"]
        return made, time.process_time() - begun

    tried = {batch: rate(batch, 0.5) for batch in BATCHES}
    best = max(tried, key=lambda batch: tried[batch][0] / tried[batch][1])
    for line in sys.stdin:
        print(*rate(best, float(line)), flush=True)


if __name__ == "__main__":
    main()
