"""`realitygap twin`: the stand-in for reality, for any program that talks to a Khepera."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from realitygap.cli import options
from realitygap.cli.console import tell

if TYPE_CHECKING:
    from realitygap.values import Pose
    from realitygap.world.arena import Arena

__all__ = ["twin"]


@click.group()
def twin() -> None:
    """Serve a physics twin of the Khepera (pseudo-reality).

    \b
    Example:
        realitygap twin serve --arena avoidance
    """


@twin.command()
@click.option(
    "--arena", "arena_name", required=True, metavar="TASK", help="A task, or an arena's name or TOML file."
)
@click.option("--unit", type=click.IntRange(0), default=1, help="Which robot.")
@options.twin_noise()
@options.seed(says=" It does not change the unit's constants: those depend on --unit alone.")
@options.baud("Baud rate set by its jumper.", any_rate=False)
@options.pose(required=False)
@options.as_json
def serve(
    arena_name: str, unit: int, twin_noise: float | None, seed: int, baud: int, pose: options.Numbers | None,
    json_output: bool,
) -> None:  # fmt: skip
    """Put a twin on a pseudo-terminal and serve it until Ctrl-C.

    \b
    Example: a robot that any Khepera program can talk to
        realitygap twin serve --arena avoidance
    """
    import signal

    from realitygap.twin.body import TwinBody
    from realitygap.twin.firmware import Firmware
    from realitygap.twin.serve import Server
    from realitygap.world.robot import load_profile

    arena, start = _arena(arena_name)
    if pose is not None:
        start = options.checked_pose(pose, arena, load_profile("paper"))
    noise = 1.0 if twin_noise is None else twin_noise
    body = TwinBody(arena.plain(), unit=unit, noise=noise, seed=seed)
    if start is not None:
        body.place(start.x, start.y, start.heading)
    for number in (signal.SIGTERM, signal.SIGHUP):  # its folder is removed however it is ended
        signal.signal(number, signal.default_int_handler)
    with Server(Firmware(body, baud=baud, name=f"twin unit {unit}")) as server:
        facts = {"device": server.device, "channel": server.channel, "unit": unit, "noise": noise,
                 "seed": seed, "baud": baud, "arena": arena.plain(),
                 "pose": None if start is None else (start.x, start.y, start.heading)}  # fmt: skip
        line = f"{baud} baud, unit {unit}; Ctrl-C ends it"
        tell(json_output, facts, f"device: {server.device}", f"second channel: {server.channel}", line)
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
