"""`realitygap replay`: replay an evolved individual."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from realitygap.cli import option
from realitygap.cli.kinds import FILM
from realitygap.cli.notes import ask_trust
from realitygap.cli.output import tell
from realitygap.cli.scene import facts, path_table
from realitygap.errors import StudyError

if TYPE_CHECKING:
    from realitygap.evolution.algorithm import Genes
    from realitygap.study.load import Run

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

    Simulates the individual in the run's own task and prints its trajectory.

    RUN is a number or a name, as `realitygap show STUDY` lists them. Without --pose the robot
    starts as the task says, drawn with --seed.

    \b
    Example:
        realitygap replay out/reproduce 1 --noise double --animation champion.gif
    """
    from realitygap.simulation.simulation import Simulation
    from realitygap.study.load import load_study
    from realitygap.world.robot import load_profile

    ask_trust(study, trust)
    loaded = load_study(study)
    one = loaded.run(run)
    who, genes = the_individual(one, individual)
    task, level = loaded.task(one.task), one.noise if noise is None else noise
    robot = loaded.profile if profile is None else load_profile(profile)
    place = None if pose is None else option.checked_pose(pose, task.arena, robot)
    simulation, networks = Simulation(task, robot, level), loaded.networks(one.task, genes)
    trajectory, score = simulation.trajectory(networks, stream=seed, pose=place, seconds=seconds)
    if picture is not None or animation is not None:
        from realitygap.report import save_animation, save_picture

        for made, save in ((picture, save_picture), (animation, save_animation)):
            if made is not None:
                save(made, task, robot, trajectory, task.title)
    whose = {"study": study, "run": one.id, "name": one.name, "individual": who}
    found = {**whose, **facts(simulation, seed), **trajectory.to_dict(), "score": score}
    saved = [f"saved {made}" for made in (picture, animation) if made is not None]
    tell(json_output, found, path_table(trajectory), f"\n{one.name}, {who}: score {score:.6g}", *saved)


def the_individual(run: Run, who: str) -> tuple[str, Genes]:
    """An individual of a run in words, and its genotype."""
    try:
        return run.individual(who)
    except StudyError as error:
        raise click.BadParameter(str(error), param_hint="'--individual'") from None
