"""The kernels of a GPU, made of the processor's steps: threads share a trial, one takes its score.

The steps are compiled from the same Python functions (kernels/together.py), without what a robot and its task
do not use, and kept on file. Nothing reorders a sum and no multiplication is fused with an addition, so that
the GPU rounds where the processor does. Simulated launches call the processor's steps.
"""

from collections.abc import Callable
from functools import cache
from types import FunctionType
from typing import Any

import numba
from numba import cuda
from numba.core.dispatcher import Dispatcher

from realitygap.kernels import (
    ambient,
    geometry,
    infrared,
    light,
    light_beyond,
    outline,
    shared_rays,
    together,
    trial,
)
from realitygap.kernels.batch import run_trials
from realitygap.kernels.params import RAYS, Path
from realitygap.kernels.shared_rays import Common
from realitygap.kernels.together import Own
from realitygap.kernels.work import Work
from realitygap.simulation.cuda_code import SIMULATED, Kernel, kept
from realitygap.simulation.engine import Cores

__all__ = ["GROUP", "ROOM", "SHARED", "block_for", "device", "scoring", "swapped", "trials"]

GROUP = 1 if SIMULATED else 8
"""Threads that share a trial: as many as most robots have sensors of a kind."""
WARP = 32
BLOCK = WARP if SIMULATED else 256
"""Threads of a block at most. They carry out the same stage of a step at a time, so that what one warp has
fetched of the code is there for the others."""
REGISTERS = 128
"""Of a thread: a multiprocessor has room for two such blocks."""
ROOM = 47 * 1024
"""Bytes that the threads of a block may share, less a little for alignment."""
SHARED = ("fan", "all_fans", "span", "bounds")
"""What of the scratch nobody writes."""
Swaps = tuple[tuple[Dispatcher, Callable[..., Any]], ...]


@cache
def device(made: Dispatcher, swaps: Swaps = ()) -> Any:
    """A compiled function, and all that it calls, for the GPU: the same Python, without fast-math flags.

    Args:
        made: the processor's.
        swaps: functions that are called, with what is called instead.
    """
    if SIMULATED:
        return made
    if made in dict(swaps):
        other = dict(swaps)[made]
        return device(other, swaps) if isinstance(other, Dispatcher) else _standing_in(other)
    plain = made.py_func
    scope = {name: plain.__globals__[name] for name in plain.__code__.co_names if name in plain.__globals__}
    scope = {name: device(one, swaps) if isinstance(one, Dispatcher) else one for name, one in scope.items()}
    scope |= {
        name: plain.__globals__[name] for name in ("__name__", "__builtins__") if name in plain.__globals__
    }
    copy = FunctionType(plain.__code__, scope, plain.__name__, plain.__defaults__, plain.__closure__)
    return cuda.jit(device=True)(copy)


@cache
def _standing_in(plain: Callable[..., Any]) -> Any:
    return cuda.jit(device=True)(plain)


def _nothing(*_given: Any) -> None:
    """Stands in for a function that changes arrays and is never called."""


def _none(*_given: Any) -> float:
    """Stands in for a function that returns a number and is never called."""
    return 0.0


def _stay(*_given: Any) -> tuple[float, float, float, bool]:
    """Stands in for `settle_outline`, where it is never called."""
    return 0.0, 0.0, 0.0, False


def _meet(_lane: int, _group: int) -> None:
    """Wait for the other threads of a group: here for those of the whole block."""
    cuda.syncthreads()


def swapped(cores: Cores) -> Swaps:
    """Functions that these trials never call, each with something small to be compiled in its place.

    And sensors whose rays threads share, where surfaces and light allow it and there is room.
    """
    robot, feed = cores.robot, cores.trial.feed
    seen, lit = feed != trial.AMBIENT, feed != trial.PROXIMITY
    beyond = light_beyond.goes_beyond.py_func(robot)
    found: dict[Dispatcher, Callable[..., Any]] = {}
    if not seen:
        found |= {infrared.infrared: _nothing, shared_rays.sense_near: _nothing}
    if not lit:
        found |= {ambient.ambient: _nothing, shared_rays.sense_light: _nothing}
    printed = not len(cores.arena.reflectance) and not (lit and (beyond or len(robot.outline)))
    if printed and block_for(shared_rays.most_of_a_kind(robot)):
        found[together.sense_together] = shared_rays.sense_by_rays
    if not beyond:
        found[light_beyond.illuminate_beyond] = _nothing
    if not robot.proximity_curve.shape[1]:
        found[infrared.gathered] = _none
    if not len(robot.outline):
        found |= {outline.settle_outline: _stay, light.hide_behind_outline: _nothing}
    if not len(cores.arena.segments):
        found[geometry.see_segments] = _nothing
    return tuple(found.items())


def block_for(sensors: int) -> int:
    """Threads of a block whose groups have room for so many sensors; 0 if not even a warp's have."""
    if SIMULATED:
        return WARP
    one = sum(array.nbytes for array in shared_rays.common_room(sensors))
    warps = ROOM // (WARP // GROUP * one)
    return int(min(WARP * warps, BLOCK))


@cache
def trials(rays: tuple[int, int, int], swaps: Swaps) -> Kernel:
    """The kernel that carries out a trial in each group of threads.

    Args:
        rays: as `lanes_of_rays` gives them, and of how many sensors of a kind threads share the rays.
        swaps: as `swapped` gives them.
    """
    draw_start, own, (light, wide, sensors) = device(trial.draw_start), _own(), rays
    block, more, terms = block_for(sensors), sensors + 1, RAYS + 1
    groups = block // GROUP
    run_together = device(together.run_together, (*swaps, (together.meet, _meet)))

    def simulate(world: Any, nets: Any, work: Any, batch: Any) -> None:
        t = cuda.grid(1)
        if t < batch.which.shape[0]:
            one = slice(t, t + 1)
            run_trials(world, nets, batch.which[one], batch.streams[one], batch.paths[one], own(work, t))

    def carry_out(world: Any, nets: Any, work: Any, batch: Any) -> None:
        thread = cuda.grid(1)
        t, lane = thread // GROUP, thread % GROUP
        mine, p, d = own(work, t), batch.paths[t], numba.float64
        i = min(t, batch.which.shape[0] - 1)  # the last block is full, too: all its threads meet
        rays = Own(
            cuda.local.array(wide, d), cuda.local.array(wide, d), cuda.local.array(wide, d),
            cuda.local.array(wide, d), cuda.local.array(light, d), cuda.local.array(wide, d),
            cuda.local.array(wide, d), cuda.local.array(wide, d), cuda.local.array(wide, d),
            cuda.local.array(wide, d), cuda.local.array(wide, d), cuda.local.array(wide, d),
            cuda.local.array(1, numba.int64), cuda.local.array(1, numba.uint64),
        )  # fmt: skip
        group = cuda.threadIdx.x // GROUP
        common = Common(
            cuda.shared.array((groups, sensors, 6), d)[group],
            cuda.shared.array((groups, sensors), numba.int32)[group],
            cuda.shared.array((groups, more), numba.int32)[group],
            cuda.shared.array((groups, sensors, terms), d)[group],
        )
        n, stream, path = batch.which[i], batch.streams[i], Path(p[0], p[1], p[2], p[3], p[4], p[5])
        if lane == 0:
            draw_start(world.task, stream, mine.start)
        run_together(world, nets, n, stream, lane, GROUP, mine, rays, common, path)

    named = [(one.py_func.__name__, getattr(other, "__name__", "")) for one, other in swaps]
    made = cuda.jit(simulate) if SIMULATED else cuda.jit(carry_out, max_registers=REGISTERS)
    return Kernel(kept(made, rays, named), block, small=True)


@cache
def scoring(score: Any) -> Kernel:
    """The kernel that takes the score of each trial's path."""
    whose, score = (score.py_func.__module__, score.py_func.__qualname__), device(score)

    def take(room: Any, batch: Any) -> None:
        t = cuda.grid(1)
        if t < batch.which.shape[0]:
            p = batch.paths[t]
            total = 0.0
            for i in range(p.shape[0]):
                for k in range(p.shape[1]):
                    total += p[i, k]
            batch.taken[t, 0] = score(Path(p[0], p[1], p[2], p[3], p[4], p[5]), room)
            batch.taken[t, 1] = total

    return Kernel(kept(cuda.jit(take), whose), WARP, small=False)


def _own() -> Callable[[Work, int], Work]:
    """A thread's own rows of the scratch, by a text: compiled code cannot map over a tuple's fields."""
    whole = SHARED if SIMULATED else SHARED + Own._fields
    rows = (f"all.{name}" if name in whole else f"all.{name}[t]" for name in Work._fields)
    scope: dict[str, Any] = {"Work": Work}
    exec(f"def own(all, t):\n    return Work({', '.join(rows)})", scope)
    own: Callable[[Work, int], Work] = cuda.jit(device=True)(scope["own"])
    return own
