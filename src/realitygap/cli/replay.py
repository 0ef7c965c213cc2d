"""`realitygap replay`: replay an evolved individual."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from realitygap.cli import option
from realitygap.cli.estimate import ask_trust
from realitygap.cli.kinds import FILM
from realitygap.cli.output import print_json
from realitygap.cli.scene import Scene, print_path
from realitygap.errors import StudyError

if TYPE_CHECKING:
    from realitygap.cli.option import Numbers
    from realitygap.controller.layout import Genes
    from realitygap.study.load import Run, Study

__all__ = ["replay", "the_individual"]


@click.command()
@click.argument("study", type=click.Path())
@click.argument("run")
@option.individual
@option.profile(None, " [default: the study's own]")
@option.noise(None, " [default: the run's own]")
@option.seed()
@option.pose(required=False)
@option.seconds
@option.picture
@click.option("--animation", type=FILM, help="Animate the trial to FILE (.gif or .mp4).")
@option.trust
@option.as_json
def replay(
    study: str,
    run: str,
    individual: str,
    profile: str | None,
    noise: float | None,
    seed: int,
    pose: tuple[float, float, float] | None,
    seconds: float | None,
    picture: Path | None,
    animation: Path | None,
    trust: bool,
    json_output: bool,
) -> None:
    """Replay an evolved individual.

    Simulates it in the run's own task and prints its trajectory.

    RUN is a number or a name, as `realitygap show STUDY` lists them. Without --pose the robot
    starts as the task says, drawn with --seed.

    \b
    Example:
        realitygap replay out/reproduce 1 --noise double --animation champion.gif
    """
    from realitygap.study.load import load_study

    ask_trust(study, trust)
    loaded = load_study(study)
    one = loaded.run(run)
    who, genes = the_individual(one, individual)
    scene = _scene(loaded, one, profile, noise, pose)
    trajectory, score = scene.simulation().trajectory(
        loaded.networks(one.task, genes), stream=seed, pose=scene.pose, seconds=seconds
    )
    if picture is not None:
        scene.save_picture(picture, trajectory)
    if animation is not None:
        scene.save_animation(animation, trajectory)
    if json_output:
        facts = {"study": study, "run": one.id, "name": one.name, "individual": who, **scene.facts(seed)}
        print_json({**facts, **trajectory.to_dict(), "score": score})
        return
    print_path(trajectory)
    click.echo(f"\n{one.name}, {who}: score {score:.6g}")
    for made in (picture, animation):
        if made is not None:
            click.echo(f"saved {made}")


def _scene(study: Study, run: Run, profile: str | None, noise: float | None, pose: Numbers | None) -> Scene:
    """The run's own task and robot; another robot, level of noise or pose if one is given."""
    from realitygap.world.profile import load_profile

    task, level = study.task(run.task), run.noise if noise is None else noise
    robot = study.profile if profile is None else load_profile(profile)
    place = None if pose is None else option.checked_pose(pose, task.arena, robot)
    return Scene(task=task, profile=robot, noise=level, pose=place)


def the_individual(run: Run, who: str) -> tuple[str, Genes]:
    """An individual of a run in words, and its genotype."""
    try:
        return run.individual(who)
    except StudyError as error:
        raise click.BadParameter(str(error), param_hint="'--individual'") from None
