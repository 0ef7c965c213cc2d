"""`realitygap twin`: the stand-in for reality, for any program that talks to a Khepera."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from realitygap.cli.kinds import SEED, Whole
from realitygap.cli.options import as_json, baud_option, pose_option, seed_option, twin_noise_option
from realitygap.cli.output import print_json

if TYPE_CHECKING:
    from realitygap.values import Pose
    from realitygap.world.arena import Arena

__all__ = ["plain_arena", "twin"]


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
@click.option("--unit", type=Whole(0, SEED.high), default=1, show_default=True, help="Which robot.")
@twin_noise_option("--noise")
@seed_option(says=" It does not change the unit's constants: those depend on --unit alone.")
@baud_option("Rate that its jumper is set to.", any_rate=False)
@click.option(
    "--clock",
    type=click.Choice(["real", "virtual"]),
    default="real",
    show_default=True,
    help="virtual: its time runs as far as a clock on the second channel allows.",
)
@pose_option(required=False)
@as_json
def serve(
    arena_name: str,
    unit: int,
    twin_noise: float | None,
    seed: int,
    baud: str,
    clock: str,
    pose: tuple[float, float, float] | None,
    json_output: bool,
) -> None:
    """Put a twin on a pseudo-terminal and serve it until Ctrl-C.

    \b
    Example: a robot that any Khepera program can talk to
        realitygap twin serve --arena avoidance
    """
    import signal

    from realitygap.twin.server import Settings, serving

    arena, start = _arena(arena_name)
    if pose is not None:
        start = _free(arena, pose)
    noise = 1.0 if twin_noise is None else twin_noise
    settings: dict[str, Any] = {"arena": plain_arena(arena), "unit": unit, "noise": noise, "seed": seed}
    settings |= {"baud": int(baud), "clock": clock}
    if start is not None:
        settings["pose"] = (start.x, start.y, start.heading)
    for number in (signal.SIGTERM, signal.SIGHUP):  # its folder is removed however it is ended
        signal.signal(number, signal.default_int_handler)
    with serving(Settings(**settings)) as server:
        if json_output:
            print_json({"device": server.device, "clock_channel": server.channel, **settings})
        else:
            click.echo(f"device: {server.device}")
            click.echo(f"second channel: {server.channel}")
            click.echo(f"{baud} baud, {clock} clock, unit {unit}; Ctrl-C ends it")
        try:
            server.serve()
        except KeyboardInterrupt:
            click.echo("stopped", err=True)


def plain_arena(arena: Arena) -> dict[str, Any]:
    """An arena as plain numbers in cm, all that a twin may know of it."""
    return arena.plain()


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
    arena = task.arena if not isinstance(task.arena, str) else load_arena(task.arena)
    return arena, Pose.from_degrees(task.start.x_cm, task.start.y_cm, sum(task.start.heading_deg) / 2)


def _free(arena: Arena, pose: tuple[float, float, float]) -> Pose:
    """The pose, unless the robot would stand in something there."""
    from realitygap.cli.options import checked_pose
    from realitygap.world.profile import load_profile

    return checked_pose(pose, arena, load_profile("paper"))
