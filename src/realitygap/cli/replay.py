"""`realitygap replay`: let an evolved individual live again."""

from __future__ import annotations

from pathlib import Path

import click

from realitygap.cli.kinds import FILM, PICTURE, SECONDS
from realitygap.cli.options import as_json, checked_pose, noise_option, pose_option, seed_option
from realitygap.cli.output import print_json
from realitygap.cli.scene import Scene, print_path, stream_of
from realitygap.cli.show import find_run

__all__ = ["replay"]


@click.command()
@click.argument("study", type=click.Path())
@click.argument("run")
@click.option(
    "--individual",
    default="champion",
    show_default=True,
    metavar="WHO",
    help="champion (retested), fittest (as in the paper), or the number of an evaluation.",
)
@noise_option(None, " [default: the run's own]")
@seed_option()
@pose_option(required=False)
@click.option("--seconds", type=SECONDS, metavar="S", help="Length [default: the task's own].")
@click.option("--picture", type=PICTURE, metavar="FILE", help="Draw the path there (.png, .svg or .pdf).")
@click.option("--animation", type=FILM, metavar="FILE", help="Animate the trial there (.gif or .mp4).")
@as_json
def replay(
    study: str,
    run: str,
    individual: str,
    noise: float | None,
    seed: int,
    pose: tuple[float, float, float] | None,
    seconds: float | None,
    picture: Path | None,
    animation: Path | None,
    json_output: bool,
) -> None:
    """Let an individual of a run live again.

    Simulates it in the run's own task and prints its trajectory.

    RUN is a number or a name, as `realitygap show STUDY` lists them. Without --pose the robot
    starts as the task says, drawn with --seed.

    \b
    Example:
        realitygap replay out/reproduce 1 --noise double --animation champion.gif
    """
    from realitygap.controller.layout import Layout
    from realitygap.controller.network import decode
    from realitygap.study.load import load_study

    loaded = load_study(study)
    one = find_run(loaded, run)
    scene = Scene(
        task=loaded.task(one.task), profile=loaded.profile, noise=one.noise if noise is None else noise
    )
    start = None if pose is None else checked_pose(pose, scene.arena, scene.profile)
    genes, who = _individual(loaded, one, individual)
    networks = decode(genes, Layout.of(genes, inputs=len(scene.task.sensors)))
    trajectory, score = scene.simulation().trajectory(
        networks, stream=stream_of(seed), pose=start, seconds=seconds
    )
    if picture is not None:
        from realitygap.cli.pictures import save_path

        save_path(picture, scene, trajectory)
    if animation is not None:
        from realitygap.cli.pictures import save_film

        save_film(animation, scene, trajectory)
    if json_output:
        facts = {"study": study, "run": one.id, "name": one.name, "individual": who, **scene.facts(seed)}
        print_json({**facts, **trajectory.to_dict(), "score": score})
        return
    print_path(trajectory)
    click.echo(f"\n{one.name}, {who}: score {score:.6g}")
    for made in (picture, animation):
        if made is not None:
            click.echo(f"saved {made}")
