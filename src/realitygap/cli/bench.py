"""`realitygap bench`: how many simulation steps a second this machine makes.

The measuring is here as plain functions, for scripts to use.
"""

from __future__ import annotations

import time
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING, Any

import click

from realitygap.cli import option
from realitygap.cli.kinds import Finite
from realitygap.cli.output import Figure, table, tell

if TYPE_CHECKING:
    from realitygap.kernels.params import Networks
    from realitygap.simulation.simulation import Simulation

__all__ = ["bench", "measure", "random_networks", "steps_per_second"]

NETWORKS = 64
TRIALS = 4


@click.command()
@option.profile()
@option.noise()
@click.option(
    "--seconds", type=Finite(0.01, 3600), default=3.0, metavar="S", help="Measuring time for each figure."
)
@option.as_json
def bench(profile: str, noise: float, seconds: float, json_output: bool) -> None:
    """Measure simulation steps per second.

    Measures both tasks, on one core and on all. The networks are random, as at the start of a run, and as
    large as evolved ones. Each figure is measured after a warm-up.

    \b
    Example:
        realitygap bench --json
    """
    from realitygap.tasks import TASKS
    from realitygap.work.workers import cores

    figures = {task: measure(task, profile=profile, noise=noise, seconds=seconds) for task in TASKS}
    facts = {**figures, "cores": cores(), "profile": profile, "noise": noise}
    head = ("task", "steps/s, one core", f"steps/s, {cores()} cores")
    rows = [[task, *(Figure(rate, ",.0f") for rate in rates.values())] for task, rates in figures.items()]
    tell(json_output, facts, table(head, rows))


def measure(
    task: str, *, profile: str = "paper", noise: float = 1.0, seconds: float = 3.0
) -> dict[str, float]:
    """Steps per second of `task` on one core and on all, for `seconds` each.

    Args:
        task: its name or file.
        profile: the robot's.
        noise: a scale.
        seconds: of either measurement.
    """
    from realitygap.work.workers import cores

    settings: dict[str, Any] = {"profile": profile, "noise": noise, "seconds": seconds}
    return {
        "steps_per_second_one_core": steps_per_second(task, threads=1, **settings),
        "steps_per_second_all_cores": steps_per_second(task, threads=cores(), **settings),
    }


def steps_per_second(
    task: str, *, profile: str = "paper", noise: float, threads: int, seconds: float
) -> float:
    """Steps a second that `threads` threads make together; kernels release the interpreter's lock.

    Each thread has its own simulation and random networks, and evaluates them batch after batch
    until the time is up.

    Args:
        task: its name or file.
        profile: the robot's.
        noise: a scale.
        threads: how many.
        seconds: how long.
    """
    from realitygap.simulation.simulation import Simulation
    from realitygap.tasks import load_task
    from realitygap.world.profile import load_profile

    simulations = [Simulation(load_task(task), load_profile(profile), noise) for _ in range(threads)]
    simulations[0].compile()
    shares = [
        (simulation, random_networks(simulation, stream=k), k) for k, simulation in enumerate(simulations)
    ]
    for share in shares:
        _batch(*share)  # warm-up
    with ThreadPoolExecutor(threads) as pool:
        start = time.perf_counter()
        made = sum(pool.map(lambda share: _until(start + seconds, *share), shares))
        return made / (time.perf_counter() - start)


def random_networks(simulation: Simulation, *, stream: int, count: int = NETWORKS) -> Networks:
    """`count` networks of a run's random start: 11 to 12 slots, about ten live links."""
    import numpy as np

    from realitygap.controller.network import decode
    from realitygap.controller.operators import Variation

    layout = simulation.layout
    variation = Variation(layout=layout)
    genes = [variation.random(np.uint64(stream * count + i)) for i in range(count)]
    return decode(np.stack(genes), layout)


def _until(end: float, simulation: Simulation, networks: Networks, key: int) -> int:
    made, batch = 0, 0
    while time.perf_counter() < end:
        batch += 1
        made += _batch(simulation, networks, key * 1_000_003 + batch)
    return made


def _batch(simulation: Simulation, networks: Networks, key: int) -> int:
    """Evaluate all networks once; the number of steps that took."""
    import numpy as np

    streams = np.random.default_rng(key).integers(
        0, 2**63, size=(len(networks.neurons), TRIALS), dtype=np.uint64
    )
    simulation.scores(networks, streams)
    return int(streams.size) * round(simulation.task.seconds * 10)
