"""`realitygap simulate`: one trial, step by step."""

from pathlib import Path
from typing import Any

import click

from realitygap.cli import option
from realitygap.cli.output import print_json
from realitygap.cli.scene import Scene, print_path

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
    controller: str,
    seed: int,
    seconds: float | None,
    picture: Path | None,
    json_output: bool,
    **scene_of: Any,
) -> None:
    """Simulate one trial of TASK.

    TASK is obstacle-avoidance, light-seeking or a Python file of your own. With --json there is
    an entry for each step of 0.1 s: what the robot read and decided at that time, where it stood
    then, what its wheels achieved in the step that follows, and whether it touched something.

    \b
    Example:
        realitygap simulate avoidance --controller constant:5,-3 --pose 25 25 90 --json
    """
    from realitygap.controller.own import named_controller
    from realitygap.simulation.body import drive_simulated

    scene = Scene.load(**scene_of)
    driver = named_controller(controller, scene.task.feeds, scene.layout)
    settings: dict[str, Any] = {"stream": seed, "pose": scene.pose, "seconds": seconds}
    trajectory, score = drive_simulated(scene.simulation(), driver, **settings)
    if picture is not None:
        scene.save_picture(picture, trajectory)
    if json_output:
        print_json({**scene.facts(seed), **trajectory.to_dict(), "score": score})
        return
    print_path(trajectory)
    click.echo(f"\nscore {score:.6g}, end at ({trajectory.end.x:.1f}, {trajectory.end.y:.1f}) cm")
    if picture is not None:
        click.echo(f"picture {picture}")
