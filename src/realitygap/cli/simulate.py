"""`realitygap simulate`: one trial, step by step."""

from __future__ import annotations

from pathlib import Path

import click

from realitygap.cli.kinds import PICTURE, SECONDS
from realitygap.cli.options import (
    arena_option,
    as_json,
    noise_option,
    pose_option,
    profile_option,
    seed_option,
)
from realitygap.cli.output import print_json
from realitygap.cli.scene import Scene, print_path

__all__ = ["simulate"]


@click.command()
@click.argument("task")
@click.option(
    "--controller",
    required=True,
    metavar="FILE|constant:L,R|braitenberg",
    help="A genotype's text file, two constant wheel commands, or Braitenberg's vehicle.",
)
@pose_option()
@profile_option()
@arena_option
@noise_option()
@seed_option()
@click.option("--seconds", type=SECONDS, metavar="S", help="Length of the trial [default: the task's own].")
@click.option("--picture", type=PICTURE, metavar="FILE", help="Draw the path to FILE (.png, .svg or .pdf).")
@as_json
def simulate(
    task: str,
    controller: str,
    pose: tuple[float, float, float],
    profile: str,
    arena: str | None,
    noise: float,
    seed: int,
    seconds: float | None,
    picture: Path | None,
    json_output: bool,
) -> None:
    """Simulate one trial of TASK.

    TASK is obstacle-avoidance, light-seeking or a Python file of your own. With --json there is
    an entry for each step of 0.1 s: what the robot read and decided at that time, where it stood
    then, what its wheels achieved in the step that follows, and whether it touched something.

    \b
    Example:
        realitygap simulate avoidance --controller constant:5,-3 --pose 25 25 90 --json
    """
    from realitygap.controller.handmade import controller_genes
    from realitygap.controller.layout import Layout
    from realitygap.controller.network import decode

    scene = Scene.load(task=task, profile=profile, noise=noise, pose=pose, arena=arena)
    genes = controller_genes(controller, scene.task.feeds, scene.layout)
    network = decode(genes, Layout.of(genes, inputs=scene.layout.inputs))
    trajectory, score = scene.simulation().trajectory(network, stream=seed, pose=scene.pose, seconds=seconds)
    if picture is not None:
        scene.save_picture(picture, trajectory)
    if json_output:
        print_json({**scene.facts(seed), **trajectory.to_dict(), "score": score})
        return
    print_path(trajectory)
    click.echo(f"\nscore {score:.6g}, end at ({trajectory.end.x:.1f}, {trajectory.end.y:.1f}) cm")
    if picture is not None:
        click.echo(f"picture {picture}")
