"""Kinds of value that options take; a value that is refused names its option and what was expected."""

import math
import os
from importlib import import_module
from operator import attrgetter
from pathlib import Path
from typing import Any

import click

from realitygap.errors import UsageError

__all__ = [
    "DISTANCES", "FILM", "MOST", "NOISE", "PICTURE", "ROBOT", "SECONDS", "SEED", "SHARD", "FileToWrite",
    "Finite", "NumberOrPool", "Reflectance", "Whole",
]  # fmt: skip

STEP_S = 0.1
"""Length of one step (the kernels' own constant would load the kernels)."""


class Finite(click.ParamType):
    """A finite number, from `low` to `high` if those are given."""

    name = expected = "number"
    digits = "g"

    def __init__(self, low: float = -math.inf, high: float = math.inf) -> None:
        self.low, self.high = low, high

    def read(self, text: str) -> float:
        """The number in the text; a ValueError if it has none."""
        return float(text)

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        try:
            number = self.read(str(value))
        except ValueError:
            self.fail(f"expected a {self.expected}, got {value!r}.", param, ctx)
        if not math.isfinite(number):
            self.fail(f"expected a finite number, got {value}.", param, ctx)
        if number < self.low:
            self.fail(f"expected {self.low:{self.digits}} or more, got {value}.", param, ctx)
        if number > self.high:
            self.fail(f"expected at most {self.high:{self.digits}}, got {value}.", param, ctx)
        return number


class Reflectance(Finite):
    """How much light a surface throws back; "unknown" is NaN."""

    name = "R"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        return math.nan if value == "unknown" else super().convert(value, param, ctx)


class Whole(Finite):
    """A whole number from `low` to `high`; `name` stands for it in the help."""

    expected, digits = "whole number", "d"

    def __init__(self, low: int, high: int, name: str = "N") -> None:
        self.low, self.high, self.name = low, high, name

    def read(self, text: str) -> int:
        """The number in decimal digits."""
        return int(text, 10)


class NumberOrPool(Whole):
    """A number of processes, or a pool by its name."""

    def __init__(self) -> None:
        super().__init__(1, 1024)

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        if ":" not in str(value):
            return super().convert(value, param, ctx)
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


class Seconds(Finite):
    """The length of a trial: whole steps, one at least."""

    name = "S"

    def __init__(self) -> None:
        super().__init__(low=STEP_S, high=100_000)

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        seconds: float = super().convert(value, param, ctx)
        if abs(seconds / STEP_S - round(seconds / STEP_S)) > 1e-6:
            self.fail(f"expected a multiple of {STEP_S:g} s (one step), got {value}.", param, ctx)
        return seconds


class FileToWrite(click.ParamType):
    """A file to write, of one of the named kinds; checked before any work is done."""

    def __init__(self, *kinds: str, name: str = "file") -> None:
        self.kinds, self.name = kinds, name

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Path:
        path = Path(value)
        if path.suffix.lower() not in self.kinds:
            self.fail(f"expected a file name ending in {' or '.join(self.kinds)}, got {value!r}.", param, ctx)
        if path.is_dir():
            self.fail(f"{value!r} is a folder.", param, ctx)
        if not path.parent.is_dir():
            self.fail(f"the folder {str(path.parent)!r} does not exist; create it first.", param, ctx)
        target = Path(os.path.realpath(path))
        if not all(os.access(one, os.W_OK) for one in (target.parent, target) if one.exists()):
            self.fail(f"{value!r} cannot be written; check its rights, or take another place.", param, ctx)
        return path


MOST = 2**63 - 1
SEED = Whole(0, MOST, "S")
PICTURE = FileToWrite(".png", ".svg", ".pdf")
SECONDS = Seconds()
FILM = FileToWrite(".gif", ".mp4")
DISTANCES = Parsed("CM,CM,…", "realitygap.calibration.plan:distances_of", "distances: ")
NOISE = Parsed("level", "realitygap.world.robot:noise_level")
ROBOT = Parsed("R", "realitygap.robots.address:Address.parse", "robot: ")
SHARD = Parsed("I/N", "realitygap.work.shard:Shard.parse", "shard: ")
