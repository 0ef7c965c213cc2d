"""`realitygap probe`: what the sensors read at one place."""

from typing import Any

import click

from realitygap.cli import option
from realitygap.cli.kinds import Whole
from realitygap.cli.output import table, tell
from realitygap.cli.scene import facts, placed

__all__ = ["probe"]


@click.command()
@click.argument("task")
@option.pose()
@option.profile()
@option.arena
@option.noise()
@option.seed()
@click.option("--repeat", type=Whole(1, 10**6), default=1, help="Read N times.")
@option.as_json
def probe(seed: int, repeat: int, json_output: bool, **where: Any) -> None:
    """Read a robot's sensors at a place in TASK's arena.

    Readings are whole counts, as the robot's converter gives them; at noise zero they are shown
    before rounding.

    \b
    Example: what the paper's model reads facing a cylinder, without noise
        realitygap probe avoidance --pose 25 15 180 --noise zero
    """
    simulation, pose = placed(**where)
    proximity, ambient = simulation.probe(pose, stream=seed, repeat=repeat)
    found, lines = {"proximity": proximity, "ambient": ambient}, []
    for title, readings in found.items():
        if readings.shape[1]:
            rows = [[k, *map(_count, row)] for k, row in enumerate(readings.tolist())]
            head = ["reading", *(f"s{i}" for i in range(readings.shape[1]))]
            lines += [f"{title}, counts", table(head, rows)]
    tell(json_output, {**facts(simulation, seed), **found}, *lines)


def _count(reading: float) -> float | int:
    """A reading with at most two digits after the point."""
    return int(reading) if reading == int(reading) else round(reading, 2)
