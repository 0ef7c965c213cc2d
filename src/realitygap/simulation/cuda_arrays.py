"""Arrays of a GPU's threads: a thread's own, and copies that those of a block share.

Their shapes are known when a kernel is compiled, so that finding a place in them costs little.
"""

from typing import Any

import numba
from numba import cuda

from realitygap.kernels.params import Arena, Robot, Trial, World
from realitygap.kernels.work import Work
from realitygap.simulation.cuda_sensors import EACH

__all__ = ["Sizes", "way_in"]

Sizes = tuple[tuple[str, tuple[int, ...], str], ...]
"""Name, shape and type of each of some arrays."""


def way_in(own: Sizes, near: tuple[Sizes, Sizes, Sizes, Sizes], go: Any) -> Any:
    """A kernel that calls another with such arrays; of a text, since compiled code cannot map over fields.

    A thread's arrays have to be made here: those that a function makes end with it.

    Args:
        own: of each thread's scratch.
        near: of a robot, an arena, a task and the scratch that nobody writes.
        go: takes the world, networks, scratch and batch.
    """
    robot, arena, task, scratch = near
    made = {name: f"cuda.local.array({shape}, numba.{kind})" for name, shape, kind in own}
    made["settled"] = f"cuda.local.array({EACH + 1}, numba.int64)"
    parts = (("world.robot", Robot, robot), ("world.arena", Arena, arena), ("world.task", Trial, task))
    copied = ", ".join(_made_of(kind, whole, _copies(whole, sizes)) for whole, kind, sizes in parts)
    mine = _made_of(Work, "work", made | _copies("work", scratch))
    text = (
        f"def carry_out(world, nets, work, batch):\n    go(World({copied}, world.level), nets, {mine}, batch)"
    )
    scope: dict[str, Any] = {one.__name__: one for one in (Work, World, Robot, Arena, Trial)}
    scope |= {"cuda": cuda, "numba": numba, "go": go, "copy1": _copy1, "copy2": _copy2, "copy3": _copy3}
    exec(text, scope)
    return scope["carry_out"]


def _made_of(made: type, whole: str, others: dict[str, str]) -> str:
    """A tuple as another one is, but for some fields."""
    fields = made._fields  # type: ignore[attr-defined]
    return f"{made.__name__}({', '.join(others.get(field, f'{whole}.{field}') for field in fields)})"


def _copies(whole: str, sizes: Sizes) -> dict[str, str]:
    """Of arrays of a tuple copies, whose shapes are known when they are compiled for, or the shape alone."""
    found = {}
    for name, shape, kind in sizes:
        if 0 in shape:
            least, cut = tuple(max(n, 1) for n in shape), ", ".join(f":{n}" for n in shape)
            found[name] = f"cuda.local.array({least}, numba.{kind})[{cut}]"
        else:
            found[name] = f"copy{len(shape)}(cuda.shared.array({shape}, numba.{kind}), {whole}.{name})"
    return found


@cuda.jit(device=True)
def _copy1(to: Any, array: Any) -> Any:
    """A block's copy of an array, made by its first thread."""
    if cuda.threadIdx.x == 0:
        for i in range(to.shape[0]):
            to[i] = array[i]
    return to


@cuda.jit(device=True)
def _copy2(to: Any, array: Any) -> Any:
    for i in range(to.shape[0]):
        _copy1(to[i], array[i])
    return to


@cuda.jit(device=True)
def _copy3(to: Any, array: Any) -> Any:
    for i in range(to.shape[0]):
        _copy2(to[i], array[i])
    return to
