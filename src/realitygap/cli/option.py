"""Options that several commands share, each checked where it is read and named when refused."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click
from click.core import ParameterSource

from realitygap.cli.kinds import NOISE, PICTURE, SECONDS, SEED, SHARD, Finite, NumberOrPool, Whole
from realitygap.robots.address import BAUD_RATES, LARGEST_SCALE

if TYPE_CHECKING:
    from collections.abc import Callable

    from realitygap.robots.address import Address
    from realitygap.values import Pose
    from realitygap.world.arena import Arena
    from realitygap.world.robot import Profile

__all__ = [
    "Numbers", "arena", "as_json", "base", "baud", "check_baud", "checked_pose", "controller", "disk",
    "engine", "evaluations", "given", "individual", "marker", "noise", "out", "picture", "pose",
    "profile", "resume", "runs", "seconds", "seed", "shard", "spread", "task", "trust", "twin_noise",
    "unusual", "watch", "workers",
]  # fmt: skip

BAUDS = tuple(map(str, BAUD_RATES))
RATED = ("khepera", "serial", "twin", "stranger")
"""Robots whose line has a rate that can be chosen."""

Numbers = tuple[float, float, float]
"""A pose as it is typed: x and y in cm, heading in degrees."""
Decorated = TypeVar("Decorated", bound="Callable[..., Any]")

as_json = click.option("--json", "json_output", is_flag=True, help="Print JSON, and nothing else.")
arena = click.option(
    "--arena", metavar="A", help="Arena instead of the task's: a shipped arena's name or a TOML file."
)
base = click.option(
    "--base",
    metavar="P",
    help="Rough profile of a robot of your own, a TOML file with its radius, heights, top command and speed.",
)
disk = click.option("--disk", metavar="FILE", help="The disk's TOML file [default: the shipped disk].")
marker = click.option(
    "--marker",
    metavar="M",
    help="What the robot wears: disk, aruco:DICTIONARY:NUMBER or apriltag:FAMILY:NUMBER, optionally followed "
    "by ,size=MM,x=MM,y=MM,angle=DEGREES,height=MM [default: disk].",
)


def _usable(_: click.Context, __: click.Parameter, said: str) -> str:
    """An engine that is there, before anything is done with it."""
    if said != "cores":
        from realitygap.simulation.simulation import engine_named

        engine_named(said)
    return said


engine = click.option(
    "--engine", type=click.Choice(["cores", "cuda"]), default="cores", callback=_usable,
    help="What evolution's trials run on: the processor's cores, or an NVIDIA GPU with all runs side by "
    "side.",
)  # fmt: skip
evaluations = click.option(
    "--evaluations", type=Whole(1, 10**9), help="Evaluations in each run [default: 1000]."
)
individual = click.option(
    "--individual",
    default="champion",
    metavar="WHO",
    help="champion (retested), fittest (as in the paper), or the number of an evaluation.",
)
picture = click.option("--picture", type=PICTURE, help="Draw the path to FILE (.png, .svg or .pdf).")
resume = click.option(
    "--resume", is_flag=True, help="Continue an interrupted study to exactly the same result."
)
seconds = click.option("--seconds", type=SECONDS, help="Length of a trial [default: the task's own].")
trust = click.option(
    "--trust", is_flag=True, help="Trust a study made elsewhere: run its task files, which are programs."
)
shard = click.option(
    "--shard",
    type=SHARD,
    help="Do only share I of N of the work, in a folder of its own, DIR-shard-I-of-N (`realitygap merge`).",
)
spread = click.option(
    "--spread",
    "spreads",
    type=Finite(0.0, 0.9),
    multiple=True,
    metavar="X",
    help="Draw the robot's constants anew for each trial, within this share (0.1: ±10 %). May be repeated, "
    "for several conditions.",
)
task = click.option(
    "--task", metavar="TASK", help="Task whose arena the tracks were made in [default: guessed]."
)
watch = click.option(
    "--watch",
    is_flag=True,
    help="Keep watch.html in the study's folder up to date: curves as they grow, a drive of the best "
    "robot. Open it in a browser; there is no server. Never changes a result.",
)
workers = click.option(
    "--workers",
    type=NumberOrPool(),
    metavar="N|dask:ADDRESS|FILE.py:NAME",
    help="Worker processes [default: one per core], a Dask cluster (dask:tcp://HOST:8786), or a pool of your "
    "own. Never changes a result.",
)
"""A pool of the user's own is closed when the command ends."""


def unusual(engine: str) -> str:
    """An engine other than the usual one, as it is typed."""
    return "" if engine == "cores" else f" --engine {engine}"


def noise(
    default: str | None = "observed", says: str = "", *, several: bool = False
) -> Callable[[Decorated], Decorated]:
    """`--noise LEVEL`; with `several` it may be repeated."""
    says = f"Noise level: zero, observed, double or a number.{says}"
    return click.option("--noise", type=NOISE, default=default, multiple=several, help=says)


def seed(default: int | None = 0, says: str = "") -> Callable[[Decorated], Decorated]:
    """`--seed S`."""
    return click.option("--seed", type=SEED, default=default, help=f"Random seed.{says}")


def runs(says: str) -> Callable[[Decorated], Decorated]:
    """`--runs K`."""
    return click.option("--runs", type=Whole(1, 10**6, "K"), help=says)


def out(default: str | None = None, says: str = "The study's folder.") -> Callable[[Decorated], Decorated]:
    """`--out DIR`."""
    kind, usual = click.Path(path_type=Path), None if default is None else Path(default)
    return click.option("--out", type=kind, default=usual, metavar="DIR", help=says)


def controller(required: bool = True) -> Callable[[Decorated], Decorated]:
    """`--controller C`."""
    says = "A network's file (a genotype's text, or TOML), constant:L,R, braitenberg, or FILE.py:NAME: a "
    says += "function decide(inputs) of yours that returns (left, right), or a class with one."

    def whose(_: click.Context, __: click.Parameter, said: str | None) -> str | None:
        if said is not None and said.endswith(".py"):
            raise click.BadParameter(f"expected a function or class of that file, {said}:NAME, got {said!r}.")
        return said

    return click.option("--controller", required=required, metavar="C", callback=whose, help=says)


def pose(required: bool = True) -> Callable[[Decorated], Decorated]:
    """`--pose X Y HEADING_DEG`."""
    says, letters = "The robot's centre (cm) and heading (degrees).", "X Y HEADING_DEG"
    return click.option("--pose", type=Finite(), nargs=3, required=required, metavar=letters, help=says)


def profile(default: str | None = "paper", says: str = "") -> Callable[[Decorated], Decorated]:
    """`--profile P`."""
    says = f"Robot: a shipped profile's name or a TOML file.{says}"
    return click.option("--profile", default=default, metavar="P", help=says)


def twin_noise() -> Callable[[Decorated], Decorated]:
    """`--twin-noise X`; None if omitted."""
    kind, says = Finite(0, LARGEST_SCALE), "Noise scale of a twin or of Enki, 0 to 10 [default: 1]."
    return click.option("--twin-noise", type=kind, metavar="X", help=says)


def baud(
    says: str = "Baud rate set by the robot's jumpers; any: try them all.", *, any_rate: bool = True
) -> Callable[[Decorated], Decorated]:
    """`--baud B`; with `any_rate` also "any", which is passed on as None."""
    kind = click.Choice([*BAUDS, "any"] if any_rate else BAUDS)

    def rate(_: click.Context, __: click.Parameter, said: str) -> int | None:
        return None if said == "any" else int(said)

    return click.option("--baud", type=kind, default="38400", callback=rate, help=says)


def check_baud(*robots: Address) -> None:
    """Refuse `--baud` beside robots of which none has a rate that can be chosen."""
    default = click.get_current_context().get_parameter_source("baud") is ParameterSource.DEFAULT
    if not default and not any(robot.kind in RATED for robot in robots):
        told = f"{robots[0]} has no rate that can be chosen. Leave it out."
        raise click.UsageError(f"--baud: expected a Khepera or a twin; {told}")


def given(options: dict[str, Any]) -> dict[str, Any]:
    """Those options that were not omitted."""
    return {name: value for name, value in options.items() if value is not None}


def checked_pose(numbers: Numbers, arena: Arena, profile: Profile) -> Pose:
    """The pose, unless the robot would stand in something there."""
    from realitygap.values import Pose

    x, y, heading = numbers[0], numbers[1], math.fmod(numbers[2], 360.0)
    radius = profile.body.radius_cm
    obstacle = arena.obstacle_at(x, y, 0.0 if profile.body.outline_cm else radius)
    if obstacle is not None:
        raise click.BadParameter(
            f"a robot of radius {radius:g} cm at ({x:g}, {y:g}) overlaps {obstacle}; choose a free place.",
            param_hint="'--pose'",
        )
    return Pose.from_degrees(x, y, heading)
