"""What drives a body: a controller of one's own, or one that a person names."""

import math
import os
import re
import warnings
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from realitygap.control.genotype import Genotype, NetworkController
from realitygap.control.origin import Origin
from realitygap.errors import GenotypeError, RealityGapWarning, UsageError
from realitygap.files import read_text
from realitygap.kernels.network import LIMIT
from realitygap.plugins import blamed_on, named_object
from realitygap.values import Command, shown

__all__ = ["OwnController", "as_controller", "named_controller", "own_controller"]


_rounded: set[str] = set()
"""Whose commands have been warned about."""


class OwnController:
    """What drives a body as `decide(inputs) → (left, right)` says: whole numbers −10 … 10 in and out.

    Other numbers are rounded and clipped, with one warning.

    Args:
        decide: the user's.
        reset: called before each trial.
        place: its file or module; an error in it names the line there.
    """

    def __init__(
        self, decide: Callable[..., Any], reset: Callable[[], Any] | None = None, place: str = "controller"
    ) -> None:
        self._decide, self._reset, self._place = decide, reset, place

    def reset(self) -> None:
        """Before a trial."""
        if self._reset is not None:
            with blamed_on(self._place, UsageError, "reset fails"):
                self._reset()

    def decide(self, inputs: Sequence[int]) -> Command:
        """One step.

        Raises:
            UsageError: it fails, or does not return two numbers.
        """
        with blamed_on(self._place, UsageError, "decide fails"):
            given = self._decide(list(inputs))
        pair = (given.left, given.right) if isinstance(given, Command) else given
        expected = f"(left, right), whole numbers from -{LIMIT} to {LIMIT}"
        try:
            left, right = (max(-LIMIT, min(LIMIT, round(value))) for value in pair)
            numbers = not isinstance(pair, set | frozenset | dict)
            numbers &= not any(isinstance(value, bool | np.bool_) for value in pair)
            numbers &= all(map(math.isfinite, pair))
        except (TypeError, ValueError, OverflowError):
            numbers = False
        if not numbers:
            raise UsageError(f"{self._place}: decide: expected {expected}, got {given!r}.")
        whose = f"{self._place}:{getattr(self._decide, '__qualname__', '')}"
        if whose not in _rounded and (left, right) != tuple(pair):
            _rounded.add(whose)
            told = f"decide: expected {expected}, got {given!r}: such commands are rounded and clipped"
            warnings.warn(f"{self._place}: {told}.", RealityGapWarning, stacklevel=2)
        return Command(left=int(left), right=int(right))


def own_controller(named: object) -> OwnController:
    """A controller of `file.py:name`, of a function decide(inputs), or of an object that has `decide`.

    A class is called without arguments.

    Raises:
        UsageError: no such file or name, or nothing that decides.
    """
    place = "controller"
    if isinstance(named, str):
        text, place = named, named.rpartition(":")[0]
        place = str(Path(place).expanduser().resolve()) if place.endswith(".py") else place
        named = named_object(text, UsageError, "controller")
    if isinstance(named, type):
        with blamed_on(place, UsageError, f"{named.__name__}() fails"):
            named = named()
    decide = getattr(named, "decide", named)
    if not callable(decide):
        expected = "a function decide(inputs), or a class that has one"
        raise UsageError(f"controller: expected {expected}, got {shown(named)}.")
    if place == "controller":
        place = getattr(getattr(decide, "__code__", None), "co_filename", place)
    return OwnController(decide, getattr(named, "reset", None), place)


def as_controller(given: Any) -> Any:
    """One of this package as it is; else as of `own_controller`, whose commands are checked."""
    ready = hasattr(given, "reset") and type(given).__module__.startswith("realitygap.")
    return given if ready else own_controller(given)


def named_controller(spec: str, feeds: str, inputs: int, task: str = "") -> OwnController | NetworkController:
    """The controller that a person names for a task with so many inputs: "constant:L,R", "braitenberg",
    `file.py:name`, or the file of a genotype or of a network written by hand (.toml). With the task's name, a
    champion that evolved at another, or on other sensors, is warned about.

    Raises:
        UsageError: it is none of these; says why.
    """
    place, _, name = spec.rpartition(":")
    if place == "constant" or spec == "constant":
        match = re.fullmatch(r"\s*([-+]?\d+)\s*,\s*([-+]?\d+)\s*", name)
        if not match:
            raise UsageError(f"a constant controller: expected constant:L,R, as in constant:5,5, got {spec}.")
        return Genotype.constant(int(match[1]), int(match[2]), inputs).controller()
    if spec == "braitenberg":
        if inputs != 8:
            expected = f"a task with eight sensors; this task feeds {inputs}: name another controller"
            raise UsageError(f"the Braitenberg controller: expected {expected}.")
        return Genotype.braitenberg(feeds).controller()
    if place and name.isidentifier():
        return own_controller(spec)
    if not os.path.exists(spec):
        raise UsageError(
            f"the controller: expected constant:L,R, braitenberg, FILE.py:NAME, or a file with a genotype or "
            f"a network (.toml); there is no file {spec!r}."
        )
    made = Genotype.load(spec, inputs).controller()
    origin = Origin.told(read_text(spec, GenotypeError, "")) if task else None
    if origin is not None:
        origin.warn(task, feeds)
    return made
