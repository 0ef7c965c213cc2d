"""A controller of the user's own in Python: a function, or a class with `decide`, and perhaps `reset`."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from realitygap.controller.handmade import controller_genes
from realitygap.controller.layout import Layout
from realitygap.controller.network import TOP, NetworkController
from realitygap.errors import UsageError
from realitygap.user_code import blamed_on, named_object
from realitygap.values import Command, shown

__all__ = ["OwnController", "as_controller", "named_controller", "own_controller"]


class OwnController:
    """What drives a body as `decide(inputs) → (left, right)` says: whole numbers −10 … 10 in and out.

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
            UsageError: it fails, or does not return two whole numbers −10 … 10.
        """
        with blamed_on(self._place, UsageError, "decide fails"):
            given = self._decide(list(inputs))
        pair = (given.left, given.right) if isinstance(given, Command) else given
        try:
            left, right = (int(value) for value in pair)
            whole = (left, right) == tuple(pair) and max(abs(left), abs(right)) <= TOP
            whole = whole and not isinstance(pair, set | frozenset | dict)
            whole = whole and not any(isinstance(value, bool | np.bool_) for value in pair)
        except (TypeError, ValueError, OverflowError):
            whole = False
        if not whole:
            expected = f"(left, right), whole numbers from -{TOP} to {TOP}"
            raise UsageError(f"{self._place}: decide: expected {expected}, got {given!r}.")
        return Command(left=left, right=right)


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


def named_controller(spec: str, feeds: str, layout: Layout) -> OwnController | NetworkController:
    """The controller that a person names: `file.py:name`, or as of `controller_genes`.

    Raises:
        UsageError: it is none of these; says why.
    """
    place, _, name = spec.rpartition(":")
    if place and name.isidentifier() and place != "constant":
        return own_controller(spec)
    genes = controller_genes(spec, feeds, layout)
    return NetworkController(genes, Layout.of(genes, inputs=layout.inputs))
