"""Options that several commands share, each checked where it is read and named when refused."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, TypeVar

import click

from realitygap.cli.kinds import SEED, Finite, Noise, NumberOrPool, Whole
from realitygap.robots.address import BAUD_RATES

if TYPE_CHECKING:
    from collections.abc import Callable

    from realitygap.values import Pose
    from realitygap.world.arena import Arena
    from realitygap.world.profile import Profile

__all__ = [
    "Numbers",
    "arena_option",
    "as_json",
    "baud_option",
    "checked_pose",
    "evaluations_option",
    "noise_option",
    "pose_option",
    "profile_option",
    "runs_option",
    "seed_option",
    "twin_noise_option",
    "workers_option",
]

BAUDS = tuple(map(str, BAUD_RATES))
LARGEST_SCALE = 10.0
"""A twin that is noisier than that can hardly be steered."""

Numbers = tuple[float, float, float]
"""A pose as it is typed: x and y in cm, heading in degrees."""
Decorated = TypeVar("Decorated", bound="Callable[..., Any]")


def noise_option(
    default: str | None = "observed", says: str = "", *, several: bool = False
) -> Callable[[Decorated], Decorated]:
    """`--noise LEVEL`; with `several` it may be repeated."""
    return click.option(
        "--noise",
        type=Noise(),
        default=default,
        multiple=several,
        show_default=default is not None,
        metavar="LEVEL",
        help=f"Noise level: zero, observed, double or a number.{says}",
    )


def seed_option(default: int | None = 0, says: str = "") -> Callable[[Decorated], Decorated]:
    """`--seed S`."""
    return click.option(
        "--seed",
        type=SEED,
        default=default,
        show_default=default is not None,
        metavar="S",
        help=f"Random seed.{says}",
    )


def runs_option(says: str) -> Callable[[Decorated], Decorated]:
    """`--runs K`."""
    return click.option("--runs", type=Whole(1, 10**6), metavar="K", help=says)


def evaluations_option(command: Decorated) -> Decorated:
    """`--evaluations N`."""
    return click.option(
        "--evaluations",
        type=Whole(1, 10**9),
        metavar="N",
        help="Evaluations in each run [default: 1000].",
    )(command)


def pose_option(required: bool = True) -> Callable[[Decorated], Decorated]:
    """`--pose X Y HEADING_DEG`."""
    return click.option(
        "--pose",
        type=Finite(),
        nargs=3,
        required=required,
        metavar="X Y HEADING_DEG",
        help="The robot's centre (cm) and heading (degrees).",
    )


def profile_option(default: str | None = "paper", says: str = "") -> Callable[[Decorated], Decorated]:
    """`--profile P`."""
    return click.option(
        "--profile",
        default=default,
        show_default=default is not None,
        metavar="P",
        help=f"Robot: a shipped profile's name or a TOML file.{says}",
    )


def arena_option(command: Decorated) -> Decorated:
    """`--arena A`."""
    return click.option(
        "--arena", metavar="A", help="Arena instead of the task's: a shipped arena's name or a TOML file."
    )(command)


def twin_noise_option(*aliases: str) -> Callable[[Decorated], Decorated]:
    """`--twin-noise X`; None if omitted."""
    return click.option(
        "--twin-noise",
        *aliases,
        "twin_noise",
        type=Finite(0, LARGEST_SCALE),
        metavar="X",
        help="Noise scale of a twin or of Enki, 0 to 10 [default: 1].",
    )


def baud_option(
    says: str = "Baud rate set by the robot's jumpers; any: try them all.", *, any_rate: bool = True
) -> Callable[[Decorated], Decorated]:
    """`--baud B`; with `any_rate` also "any"."""
    return click.option(
        "--baud",
        type=click.Choice([*BAUDS, "any"] if any_rate else BAUDS),
        default="38400",
        show_default=True,
        help=says,
    )


def workers_option(command: Decorated) -> Decorated:
    """`--workers N`, or a pool of the user's own, which is closed when the command ends."""
    return click.option(
        "--workers",
        type=NumberOrPool(),
        metavar="N|FILE.py:NAME",
        help="Worker processes [default: one per core], or a pool of your own. Never changes a result.",
    )(command)


def as_json(command: Decorated) -> Decorated:
    """`--json`, passed on as `json_output`."""
    return click.option("--json", "json_output", is_flag=True, help="Print JSON, and nothing else.")(command)


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
