"""`realitygap drive`: let any controller drive a robot, beside its simulation."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from realitygap.cli import option
from realitygap.cli.kinds import ROBOT, Whole
from realitygap.cli.output import shown, table, tell

if TYPE_CHECKING:
    from realitygap.robots.address import Address

__all__ = ["drive"]


@click.command()
@click.argument("task")
@option.controller()
@click.option(
    "--robot", type=ROBOT, default="twin:1", metavar="R",
    help="It must place itself: twin:UNIT, stranger:UNIT, enki:khepera (epuck, thymio2) or FILE.py:CLASS.",
)  # fmt: skip
@option.pose(required=False)
@click.option(
    "--starts", type=Whole(1, 10**6, "K"), default=1, help="Trials, each from a start that the task draws."
)
@option.profile()
@option.arena
@option.noise()
@option.twin_noise()
@option.seed()
@option.seconds
@option.out(says="Keep the tracks there, for `realitygap score DIR`.")
@option.as_json
def drive(
    task: str,
    controller: str,
    robot: "Address",
    pose: option.Numbers | None,
    profile: str,
    arena: str | None,
    noise: float,
    out: Path | None,
    json_output: bool,
    **words: Any,
) -> None:
    """Drive a robot at TASK with any controller, and simulate it from the same starts.

    You need no study: the controller is a file of yours. TASK is obstacle-avoidance, light-seeking or a
    Python file of your own. The robot must have the sensors of --profile.

    \b
    Example:
        realitygap drive avoidance --controller my.py:decide --robot twin:1 --starts 3 --out out/mine
        realitygap score out/mine
    """
    from realitygap.control.controllers import named_controller
    from realitygap.simulation.simulation import Simulation
    from realitygap.transfer.drive import pairs

    simulation = Simulation(task, profile, noise, arena)
    at = None if pose is None else option.checked_pose(pose, simulation.task.arena, simulation.profile)
    driver = named_controller(controller, simulation.task.feeds, len(simulation.task.sensors))
    made = list(pairs(simulation, driver, robot, pose=at, folder=out, **words))
    facts = {"task": simulation.task.name, "robot": str(robot), "trials": [one.to_dict() for one in made]}
    rows = [
        [one.start, shown(one.score_simulated), shown(one.score_situated), one.track.lost] for one in made
    ]
    kept = () if out is None else (f"\ntracks {out}",)
    tell(json_output, facts, table(("start", "simulated", "situated", "steps lost"), rows), *kept)
