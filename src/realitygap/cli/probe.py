"""`realitygap probe`: what the sensors read at one place."""

from typing import Any

import click

from realitygap.cli import option
from realitygap.cli.kinds import Whole
from realitygap.cli.output import print_json, table
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
    if json_output:
        print_json({**facts(simulation, seed), "proximity": proximity, "ambient": ambient})
        return
    for title, readings in (("proximity", proximity), ("ambient", ambient)):
        if not readings.shape[1]:
            continue
        click.echo(f"{title}, counts")
        rows = [[k, *(_count(reading) for reading in row)] for k, row in enumerate(readings.tolist())]
        click.echo(table(["reading", *(f"s{i}" for i in range(readings.shape[1]))], rows))


def _count(reading: float) -> float | int:
    """A reading with at most two digits after the point."""
    return int(reading) if reading == int(reading) else round(reading, 2)
