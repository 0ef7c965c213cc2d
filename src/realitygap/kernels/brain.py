"""What decides in a trial, by its type: a delay network (network.py), a controller with weights (policy.py).

A brain stands for N controllers; of each, `load` and `decide` are registered for the brain's type.
"""

from collections.abc import Callable
from functools import singledispatch
from typing import Any

from numba.extending import overload


def by_type(stub: Callable[..., Any]) -> Any:
    """A function of (brain, n, work) that is another one for each type of brain, compiled or not."""
    chosen = singledispatch(stub)

    @overload(chosen, inline="always", strict=False)
    def choose(brain: Any, n: Any, work: Any) -> Any:
        step = chosen.dispatch(brain.instance_class)
        return lambda brain, n, work: step(brain, n, work)

    return chosen


@by_type
def load(brain, n, work):
    """Make controller `n` ready for a trial: it has no past."""
    raise NotImplementedError


@by_type
def decide(brain, n, work):
    """Controller `n`'s commands (left, right), −10 … 10, for work.inputs."""
    raise NotImplementedError
