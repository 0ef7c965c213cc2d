"""Options that several commands share, and the kinds of value that they take."""

from __future__ import annotations

import math
import os
from functools import partial
from importlib import import_module
from operator import attrgetter
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

from realitygap.errors import UsageError
from realitygap.robots.address import BAUD_RATES, LARGEST_SCALE

if TYPE_CHECKING:
    from collections.abc import Callable

    from realitygap.values import Pose
    from realitygap.world.arena import Arena
    from realitygap.world.robot import Profile

__all__ = [
    "JSON", "ROBOT", "WIDTH", "OutFile", "Parsed", "StudyPath", "Whole", "arena", "as_json", "base", "baud",
    "checked_pose", "controller", "engine", "evaluations", "given", "individual", "levels", "marker", "noise",
    "out", "picture", "pose", "profile", "resume", "runs", "seconds", "seed", "shard", "spread", "starts",
    "study", "task", "trust", "twin_noise", "unusual", "verbose", "watch", "workers",
]  # fmt: skip

Numbers = tuple[float, float, float]
"""A pose as it is typed: x and y in cm, heading in degrees."""
Decorator = TypeVar("Decorator", bound="Callable[..., Any]")


class PoseType(click.ParamType):
    """A pose as one word: x and y in cm, heading in degrees."""

    name = "X,Y,HEADING_DEG"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Numbers:
        try:
            x, y, heading = map(float, str(value).split(","))
        except ValueError:
            x = math.nan
        if not math.isfinite(x) or not math.isfinite(y + heading):
            self.fail(f"expected x, y (cm) and heading (degrees) as in 25,25,90, got {value!r}.", param, ctx)
        return x, y, math.fmod(heading, 360.0)


class Whole(click.IntRange):
    """A whole number, which may be typed as 1e3."""

    name = "whole number"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        try:
            number = float(value)
        except (TypeError, ValueError):
            number = math.nan
        whole = "e" in str(value).lower() and number.is_integer()
        return super().convert(int(number) if whole else value, param, ctx)


class StudyPath(click.Path):
    """A study's folder, also named by the database in it."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Path:
        path = Path(str(super().convert(value, param, ctx)))
        return path.parent if path.name == "study.db" else path


class NumberOrPool(click.ParamType):
    """A number of processes, or a pool by its name."""

    name = "workers"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        if ":" not in str(value):
            return Whole(1, 1024).convert(value, param, ctx)
        from realitygap.work.cluster import named_pool

        pool = named_pool(value)
        if ctx is not None:
            ctx.call_on_close(pool.close)
        if getattr(pool, "alone", False):
            said = "the Dask scheduler has no worker yet; start some with `dask worker` and its address"
            click.echo(f"note: {said}", err=True)
        return pool


class Parsed(click.ParamType):
    """What a function reads from a word, "module:name", loaded when there is one.

    Its refusal names the option instead of beginning with `says`.
    """

    def __init__(self, name: str, reader: str, says: str = "") -> None:
        self.name, self._reader, self._says = name, reader, says

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        module, _, name = self._reader.partition(":")
        try:
            return attrgetter(name)(import_module(module))(str(value))
        except UsageError as error:
            self.fail(str(error).removeprefix(self._says), param, ctx)


class OutFile(click.Path):
    """A file to write, of one of the named kinds; refused before any work is done."""

    def __init__(self, *kinds: str) -> None:
        super().__init__(dir_okay=False, writable=True, path_type=Path)
        self.kinds, self.name = kinds, "FILE"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        path = Path(str(super().convert(value, param, ctx)))
        if path.suffix.lower() not in self.kinds:
            self.fail(f"expected a file name ending in {' or '.join(self.kinds)}, got {value!r}.", param, ctx)
        if not path.parent.is_dir() or not os.access(path.parent, os.W_OK):
            self.fail(f"the folder {str(path.parent)!r} does not exist or cannot be written to.", param, ctx)
        return path


NOISE = Parsed("LEVEL", "realitygap.world.robot:noise_level", "noise: ")
ROBOT = Parsed("R", "realitygap.robots.address:Address.parse", "robot: ")
WIDTH = Parsed("WIDTH", "realitygap.report.style:inches", "width: ")
SHARD = Parsed("I/N", "realitygap.work.shard:Shard.parse", "shard: ")

LEVELS = Parsed("L,L,…", "realitygap.experiments.noise:levels_of")
JSON = "realitygap.json"
"""Key of a context's `meta`: whether the command prints JSON."""
as_json = click.option(
    "--json",
    is_flag=True,
    expose_value=False,
    callback=lambda context, _, asked: context.meta.update({JSON: asked}),
    help="Print JSON, and nothing else.",
)
"""`console.tell` obeys it."""
arena = click.option(
    "--arena", metavar="A", help="Arena instead of the task's: a shipped arena's name or a TOML file."
)
base = click.option(
    "--base",
    metavar="P",
    help="Rough profile of a robot of your own, a TOML file with its radius, heights, top command and speed.",
)
marker = click.option(
    "--marker",
    metavar="M",
    help="What the robot wears: disk (the shipped one), another disk's FILE.toml, aruco:DICTIONARY:NUMBER or "
    "apriltag:FAMILY:NUMBER, optionally followed by ,size=MM,x=MM,y=MM,angle=DEGREES,height=MM "
    "[default: disk].",
)
baud = click.option(
    "--baud",
    type=click.Choice([*map(str, BAUD_RATES), "any"]),
    default="38400",
    callback=lambda _, __, said: None if said == "any" else int(said),
    help="Baud rate set by the jumpers of a Khepera or a twin; any: try them all.",
)


def _usable(_: click.Context, __: click.Parameter, said: str) -> str:
    """An engine that is there, before anything is done with it."""
    if said != "cores":
        from realitygap.simulation.simulation import engine_named

        engine_named(said)
    return said


engine = click.option(
    "--engine",
    type=click.Choice(["cores", "cuda"]),
    default="cores",
    callback=_usable,
    help="What evolution's trials run on: the processor's cores, or an NVIDIA GPU with all runs side by "
    "side.",
)
evaluations = click.option(
    "--evaluations", type=Whole(1), metavar="N", help="Evaluations in each run [default: 1000]."
)
individual = click.option(
    "--individual",
    default="champion",
    metavar="WHO",
    help="champion (retested), fittest (as in the paper), or the number of an evaluation.",
)
out = partial(click.option, "--out", type=click.Path(path_type=Path), metavar="DIR")
picture = click.option(
    "--picture",
    type=OutFile(".png", ".svg", ".pdf", ".gif", ".mp4"),
    help="Draw the path to FILE (.png, .svg or .pdf), or animate it (.gif or .mp4).",
)
pose = partial(
    click.option,
    "--pose",
    type=PoseType(),
    help="The robot's centre (cm) and heading (degrees), as in 25,25,90.",
)
resume = click.option(
    "--resume", is_flag=True, help="Continue an interrupted study to exactly the same result."
)
runs = partial(click.option, "--runs", type=Whole(1), metavar="K")
seconds = click.option(
    "--seconds",
    type=click.FloatRange(0.1),
    metavar="S",
    help="Length of a trial, which ends at the nearest step [default: the task's own].",
)
study = click.argument("study", type=StudyPath())
trust = click.option(
    "--trust",
    is_flag=True,
    help="Trust the author of what was made elsewhere: from now on the programs that it brings may run.",
)
shard = click.option(
    "--shard",
    type=SHARD,
    help="Do only share I of N of the work, in a folder of its own, DIR-shard-I-of-N (`realitygap merge`).",
)
spread = click.option(
    "--spread",
    "spreads",
    type=click.FloatRange(0.0, 0.9),
    multiple=True,
    metavar="X",
    help="Draw the robot's constants anew for each trial, within this share (0.1: ±10 %). May be repeated, "
    "for several conditions.",
)
starts = partial(click.option, "--starts", metavar="N")
task = click.option(
    "--task", metavar="TASK", help="Task whose arena the tracks were made in [default: guessed]."
)
twin_noise = click.option(
    "--twin-noise",
    type=click.FloatRange(0, LARGEST_SCALE),
    metavar="X",
    help="Noise scale of a twin or of Enki [default: 1].",
)
verbose = click.option("--verbose", "-v", is_flag=True, help="Print all that there is.")
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
) -> Callable[[Decorator], Decorator]:
    """`--noise LEVEL`; with `several` it may be repeated."""
    says = f"Noise level: zero, observed, double or a number.{says}"
    return click.option("--noise", type=NOISE, default=default, multiple=several, help=says)


noise_between = click.option(
    "--noise-between",
    is_flag=True,
    help="Draw once a trial, for each sensor, how its readings differ between recordings (days, units), as "
    "the profile has it, times the noise level.",
)


def seed(default: int | None = 0, says: str = "") -> Callable[[Decorator], Decorator]:
    """`--seed S`."""
    kind = Whole(0)
    return click.option("--seed", type=kind, default=default, metavar="S", help=f"Random seed.{says}")


def levels(usual: str) -> Callable[[Decorator], Decorator]:
    """`--levels L,L,…`."""
    says = f"Noise levels (1 = observed) to evolve at and to compare with [default: {usual}]."
    return click.option("--levels", type=LEVELS, help=says)


def controller(required: bool = True) -> Callable[[Decorator], Decorator]:
    """`--controller C`."""
    says = "A network's file (a genotype's text, or TOML), constant:L,R, braitenberg, or FILE.py:NAME: a "
    says += "function decide(inputs) of yours that returns (left, right), or a class with one."

    def whose(_: click.Context, __: click.Parameter, said: str | None) -> str | None:
        if said is not None and said.endswith(".py"):
            raise click.BadParameter(f"expected a function or class of that file, {said}:NAME, got {said!r}.")
        return said

    return click.option("--controller", required=required, metavar="C", callback=whose, help=says)


def profile(default: str | None = "paper", says: str = "") -> Callable[[Decorator], Decorator]:
    """`--profile P`."""
    says = f"Robot: a shipped profile's name or a TOML file.{says}"
    return click.option("--profile", default=default, metavar="P", help=says)


def given(**options: Any) -> dict[str, Any]:
    """Those options that were not omitted."""
    return {name: value for name, value in options.items() if value is not None}


def checked_pose(numbers: Numbers, arena: Arena, profile: Profile) -> Pose:
    """The pose, unless the robot would stand in something there."""
    from realitygap.values import Pose

    x, y, heading = numbers
    radius = profile.body.radius_cm
    obstacle = arena.obstacle_at(x, y, 0.0 if profile.body.outline_cm else radius)
    if obstacle is not None:
        cure = "choose a free place."
        if 0 < x < radius and 0 < y < radius:
            cure += f" Are these metres? In cm it is {100 * x:g},{100 * y:g},{heading:g}."
        raise click.BadParameter(
            f"a robot of radius {radius:g} cm at ({x:g}, {y:g}) overlaps {obstacle}; {cure}",
            param_hint="'--pose'",
        )
    return Pose.from_degrees(x, y, heading)
