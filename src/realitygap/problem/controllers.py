"""What a vector of numbers stands for: controllers with weights, of ours or of a user's own file."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from realitygap.compiled import compiled, kernel, naming
from realitygap.errors import UsageError
from realitygap.kernels import policy
from realitygap.kernels.network import LIMIT
from realitygap.plugins import blamed_on, named_object, place_of
from realitygap.tasks.score import reason
from realitygap.values import Command, Floats, as_count

__all__ = ["Form", "WeightedController", "form_of", "stopped"]

Decide = Callable[[Floats, Floats, Floats, Floats], None]
WIDEST = 256
"""Hidden neurons at most."""


@dataclass(frozen=True, kw_only=True)
class Form:
    """A kind of controller with real-valued weights.

    Attributes:
        inputs: how many feed it.
        weights: how many; memory: numbers that it keeps from step to step.
        decide: writes outputs, see `kernels.policy`; the compiled function, or a user's.
        run: trials under it, compiled, as of `kernels.trial.run_each`.
    """

    inputs: int
    weights: int
    memory: int
    decide: Decide
    run: Callable[..., None]

    def brain(self, weights: Floats) -> tuple[Any, ...]:
        """What `run` takes for controllers with weights [N, W]: those, and scratch as of `policy.Weights`."""
        own = np.zeros(self.weights), np.zeros(self.memory), np.zeros(self.inputs), np.zeros(2)
        return weights, *own, np.zeros(1, np.int64)


class WeightedController:
    """One of them that drives any body, as a network does: inputs −10 … 10 in, commands −10 … 10 out."""

    def __init__(self, form: Form, weights: Floats) -> None:
        self.form, self.weights = form, np.array(weights, np.float64)
        self._memory, self._outputs = np.zeros(form.memory), np.zeros(2)
        self.reset()

    def reset(self) -> None:
        """Before a trial: it remembers nothing, and has learnt nothing."""
        self._weights = self.weights.copy()
        self._memory[:] = 0.0
        self._outputs[:] = 0.0

    def decide(self, inputs: Sequence[int]) -> Command:
        """One step.

        Raises:
            UsageError: another number of inputs, or one beyond ±10; an output that is not finite, or a
                user's function that fails.
        """
        try:
            given = np.array(inputs)
            kind, fed = given.dtype.kind, given.astype(np.float64) / LIMIT
            fits = kind in "iuf" and np.abs(fed).max() <= 1 and (kind != "f" or not (given % 1).any())
        except (TypeError, ValueError):
            fits = False
        if not fits or fed.shape != (self.form.inputs,):
            expected = f"{self.form.inputs} whole numbers from -{LIMIT} to {LIMIT}"
            raise UsageError(f"inputs: expected {expected}, got {inputs!r}.")
        try:
            self.form.decide(self._weights, self._memory, fed, self._outputs)
        except Exception as error:
            raise stopped(self.form, error, self._weights, self._memory, fed, self._outputs) from None
        if not np.isfinite(self._outputs).all():
            raise UsageError(f"controller: expected finite outputs, got {self._outputs.tolist()}.")
        left, right = (int(policy.command(value)) for value in self._outputs)
        return Command(left=left, right=right)


def stopped(form: Form, error: Exception, *given: Floats) -> UsageError:
    """The error of a user's function that failed when given these: names its line."""
    plain: Any = getattr(form.decide, "py_func", form.decide)
    try:
        with blamed_on(plain.__code__.co_filename, UsageError, "the controller fails"):
            plain(*given)
    except UsageError as told:
        return told
    return UsageError(
        f"{plain.__code__.co_filename}: the controller fails with {type(error).__name__}: {error}."
    )


def form_of(given: object, inputs: int) -> Form:
    """A controller by its name, or a user's own.

    Args:
        given: "feed-forward:8" or "recurrent:4", with its hidden neurons; or FILE.py:NAME, or what such a
            name stands for: a function decide(weights, memory, inputs, outputs) whose file says how many
            `WEIGHTS` and how much `MEMORY` it needs (numbers, or functions of the inputs' number), or a class
            that holds all three.
        inputs: how many sensors feed it.

    Raises:
        UsageError: no such controller; names what was expected.
    """
    if callable(given):
        return _own(given, getattr(given, "__qualname__", repr(given)), inputs)
    if place_of(str(given)) is not None:
        return _own(named_object(str(given), UsageError, "controller"), str(given), inputs)
    kind, _, size = str(given).partition(":")
    hidden = int(size) if size.isdecimal() else 0
    if kind not in ("feed-forward", "recurrent") or not 1 <= hidden <= WIDEST:
        raise UsageError(
            "controller: expected feed-forward:N or recurrent:N (hidden neurons, 1 to "
            f"{WIDEST}), delay-network, FILE.py:NAME, or a function or class of yours, got {given!r}."
        )
    if kind == "feed-forward":
        weights, memory, decide = hidden * (inputs + 1), hidden, policy.feed_forward
    else:
        weights, memory, decide = hidden * (inputs + hidden + 1), 2 * hidden, policy.recurrent
    weights += 2 * (hidden + 1)
    run = _compiled(decide, False)
    return Form(inputs=inputs, weights=weights, memory=memory, decide=decide, run=run)


def _own(given: Any, name: str, inputs: int) -> Form:
    """A user's function, or class that has it, compiled."""
    plain: Any = getattr(given, "decide", None) if isinstance(given, type) else given
    plain = getattr(plain, "py_func", plain)  # a user's own @njit
    if not hasattr(plain, "__code__"):
        raise UsageError(
            f"{name}: expected a function decide(weights, memory, inputs, outputs), or a class with one and "
            f"with WEIGHTS, got {given!r}."
        )
    parts = {key: getattr(given, key) for key in dir(given)} if isinstance(given, type) else plain.__globals__
    with blamed_on(plain.__code__.co_filename, UsageError, "the size of its controller fails"):
        weights, memory = (
            size(inputs) if callable(size) else size
            for size in (parts.get("WEIGHTS"), parts.get("MEMORY", 0))
        )
    weights, memory = as_count(weights, f"{name}: WEIGHTS"), as_count(memory, f"{name}: MEMORY", 0)
    decide = compiled(plain, boundscheck=True)
    try:
        decide(np.zeros(weights), np.zeros(memory), np.zeros(inputs), np.zeros(2))
    except Exception as error:
        file, why = Path(plain.__code__.co_filename).name, reason(error).rstrip(".")
        raise UsageError(
            f"{file}: the controller cannot be run: {why}. It is given weights[{weights}], "
            f"memory[{memory}], inputs[{inputs}] and outputs[2]."
        ) from None
    run = _compiled(decide, True)
    return Form(inputs=inputs, weights=weights, memory=memory, decide=decide, run=run)


@lru_cache(maxsize=16)
def _compiled(decide: Any, may_allocate: bool) -> Callable[..., None]:
    """Trials under a controller: ours never allocate, which halves their time."""
    flags = {"fastmath": False, "allocates": True} if may_allocate else {}
    loop, home = naming(policy.run, function=decide), getattr(decide, "py_func", decide)
    run: Callable[..., None] = kernel(loop, home=home, **flags)
    return run
