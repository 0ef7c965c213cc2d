"""`realitygap twin`: the stand-in for reality, for any program that talks to a Khepera."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from realitygap.cli import option
from realitygap.cli.kinds import MOST, Whole
from realitygap.cli.output import tell

if TYPE_CHECKING:
    from realitygap.values import Pose
    from realitygap.world.arena import Arena

__all__ = ["twin"]


@click.group()
def twin() -> None:
    """Serve a physics twin of the Khepera (pseudo-reality).

    \b
    Example:
        realitygap twin serve --arena avoidance --clock real
    """


@twin.command()
@click.option(
    "--arena", "arena_name", required=True, metavar="TASK", help="A task, or an arena's name or TOML file."
)
@click.option("--unit", type=Whole(0, MOST), default=1, help="Which robot.")
@option.twin_noise()
@option.seed(says=" It does not change the unit's constants: those depend on --unit alone.")
@option.baud("Baud rate set by its jumper.", any_rate=False)
@click.option(
    "--clock", type=click.Choice(["real", "virtual"]), default="real",
    help="virtual: time runs as far as a clock on the second channel allows.",
)  # fmt: skip
@option.pose(required=False)
@option.as_json
def serve(
    arena_name: str, twin_noise: float | None, pose: option.Numbers | None, json_output: bool, **words: Any
) -> None:
    """Put a twin on a pseudo-terminal and serve it until Ctrl-C.

    \b
    Example: a robot that any Khepera program can talk to
        realitygap twin serve --arena avoidance
    """
    import signal

    from realitygap.twin.server import Server, Settings
    from realitygap.world.robot import load_profile

    arena, start = _arena(arena_name)
    if pose is not None:
        start = option.checked_pose(pose, arena, load_profile("paper"))
    noise = 1.0 if twin_noise is None else twin_noise
    settings = {"arena": arena.plain(), "noise": noise, **words}
    if start is not None:
        settings["pose"] = (start.x, start.y, start.heading)
    for number in (signal.SIGTERM, signal.SIGHUP):  # its folder is removed however it is ended
        signal.signal(number, signal.default_int_handler)
    with Server(Settings(**settings)) as server:
        facts = {"device": server.device, "clock_channel": server.channel, **settings}
        told = "{baud} baud, {clock} clock, unit {unit}; Ctrl-C ends it".format(**words)
        tell(json_output, facts, f"device: {server.device}", f"second channel: {server.channel}", told)
        try:
            server.serve()
        except KeyboardInterrupt:
            click.echo("stopped", err=True)


def _arena(name: str) -> tuple[Arena, Pose | None]:
    """A task's arena and the middle of its start, or an arena alone."""
    from realitygap.errors import TaskError
    from realitygap.tasks import load_task
    from realitygap.values import Pose
    from realitygap.world.arena import load_arena

    if name.endswith(".toml"):
        return load_arena(name), None
    try:
        task = load_task(name)
    except TaskError:
        if name.endswith(".py"):
            raise
        return load_arena(name), None
    return task.arena, Pose.from_degrees(task.start.x_cm, task.start.y_cm, sum(task.start.heading_deg) / 2)
