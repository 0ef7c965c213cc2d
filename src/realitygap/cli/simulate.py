"""`realitygap simulate`: one trial, step by step."""

from pathlib import Path
from typing import Any

import click

from realitygap.cli import option
from realitygap.cli.output import tell
from realitygap.cli.scene import facts, path_table, placed

__all__ = ["simulate"]


@click.command()
@click.argument("task")
@option.controller()
@option.pose()
@option.profile()
@option.arena
@option.noise()
@option.seed()
@option.seconds
@option.picture
@option.as_json
def simulate(
    controller: str, seed: int, seconds: float | None, picture: Path | None, json_output: bool, **where: Any
) -> None:
    """Simulate one trial of TASK.

    TASK is obstacle-avoidance, light-seeking or a Python file of your own. With --json there is
    an entry for each step (0.1 s, or the profile's): the robot's readings, decision and pose then, what its
    wheels achieved in the following step, and whether it touched something.

    \b
    Example:
        realitygap simulate avoidance --controller constant:5,-3 --pose 25 25 90 --json
    """
    from realitygap.control.controllers import named_controller
    from realitygap.simulation.body import drive_simulated

    simulation, pose = placed(**where)
    task = simulation.task
    driver = named_controller(controller, task.feeds, len(simulation.task.sensors))
    trajectory, score = drive_simulated(simulation, driver, stream=seed, pose=pose, seconds=seconds)
    if picture is not None:
        from realitygap.report import save_picture

        save_picture(picture, task, simulation.profile, trajectory, task.title)
    told = [f"\nscore {score:.6g}, end at ({trajectory.end.x:.1f}, {trajectory.end.y:.1f}) cm"]
    told += [] if picture is None else [f"picture {picture}"]
    found = {**facts(simulation, seed), **trajectory.to_dict(), "score": score}
    tell(json_output, found, path_table(trajectory), *told)
