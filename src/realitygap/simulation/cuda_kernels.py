"""The kernels of a GPU, made of the processor's steps: a thread carries out a trial, or takes its score.

The steps are compiled from the same Python functions, without what a robot and its task do not use, and kept
on file. Nothing reorders a sum and no multiplication is fused with an addition, so that the GPU rounds where
the processor does. The threads of a warp share their sensors (cuda_sensors.py), those of a block the robot
and the arena. Simulated launches call the processor's steps.
"""

from collections.abc import Callable
from functools import cache
from types import FunctionType
from typing import Any, NamedTuple

import numpy as np
from numba import cuda
from numba.core.dispatcher import Dispatcher

from realitygap.kernels import ambient, geometry, infrared, light, light_beyond, outline, trial
from realitygap.kernels.batch import run_trials
from realitygap.kernels.params import RAYS, Networks, Path
from realitygap.kernels.work import new_work
from realitygap.simulation.cuda_arrays import Sizes, way_in
from realitygap.simulation.cuda_code import SIMULATED, Kernel, kept
from realitygap.simulation.cuda_sensors import (
    EACH,
    MOST,
    WARP,
    shared_ambient,
    shared_infrared,
    shared_noise,
)
from realitygap.simulation.engine import Cores

__all__ = ["Plan", "device", "plan_for", "scoring", "trials"]

BLOCK = 128
"""Threads of a block at most: fewer where the sensors' rooms are large."""
REGISTERS = 128
"""Of a thread: a multiprocessor has room for four such blocks."""
ROOM = 47 * 1024
"""Bytes that the threads of a block may share, less a little for alignment."""
NEAR, LEAST = 16 * 1024, 8 * 1024
"""Bytes of a robot and an arena that they share at most, and that there is to be room for."""
SHARED = ("fan", "all_fans", "span")
"""What of the scratch nobody writes."""
SMALL = {
    "outputs": "int8", "base": "int16", "inputs": "int8", "change": "int8", "sensor_link": "int8",
    "link_end": "uint16", "link_back": "uint16", "link_weight": "int8", "noticed": "int8", "listed": "uint16",
}  # fmt: skip
"""Types of what is small: the nearest cache has room for few numbers of each thread."""
Swaps = tuple[tuple[Dispatcher, Callable[..., Any]], ...]


class Plan(NamedTuple):
    """What a kernel is made for; all that it is compiled from, with the types of its arguments."""

    block: int
    """Threads of a block."""
    sensors: int
    """Proximity sensors whose rays threads share, or 0."""
    lit: bool
    """Whether they share those of the ambient sensors."""
    own: Sizes
    """Of each thread's scratch."""
    near: tuple[Sizes, Sizes, Sizes, Sizes]
    """Of a robot, an arena, a task and the scratch: what the threads of a block share."""
    swaps: Swaps


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
    scope |= {"max": _higher, "min": _lower}
    copy = FunctionType(plain.__code__, scope, plain.__name__, plain.__defaults__, plain.__closure__)
    return cuda.jit(device=True)(copy)


@cache
def _standing_in(plain: Callable[..., Any]) -> Any:
    return cuda.jit(device=True)(plain)


@cuda.jit(device=True)
def _higher(one: Any, other: Any) -> Any:
    """As `max`, in fewer instructions: no step meets what is not a number."""
    return other if other > one else one


@cuda.jit(device=True)
def _lower(one: Any, other: Any) -> Any:
    """As `min`."""
    return other if other < one else one


def _nothing(*_given: Any) -> None:
    """Stands in for a function that changes arrays and is never called."""


def _none(*_given: Any) -> float:
    """Stands in for a function that returns a number and is never called."""
    return 0.0


def _stay(*_given: Any) -> tuple[float, float, float, bool]:
    """Stands in for `settle_outline`, where it is never called."""
    return 0.0, 0.0, 0.0, False


def _never(*_given: Any) -> bool:
    """Stands in for a function that says whether, and is never called."""
    return False


def plan_for(cores: Cores, networks: Networks) -> Plan:
    """The kernel for such trials of networks of such a size."""
    robot, arena, feed = cores.robot, cores.arena, cores.trial.feed
    one, tinted = new_work(robot, cores.trial, networks), len(arena.reflectance) > 0
    sensors = 0 if feed == trial.AMBIENT or tinted else len(robot.proximity_place)
    bent = light_beyond.goes_beyond.py_func(robot) or len(robot.outline) > 0
    lit = feed != trial.PROXIMITY and not tinted and not bent
    block = block_for(sensors, len(one.noise), lit)
    if block == 0 or sensors > MOST:
        sensors, block = 0, block_for(0, len(one.noise), lit)
    room = [min(NEAR, ROOM - block // WARP * room_of(sensors, len(one.noise), lit))]
    scratch = {name: getattr(one, name) for name in SHARED}
    near = tuple(
        _small(part, room) for part in (*(p._asdict() for p in (robot, arena, cores.trial)), scratch)
    )
    own = tuple(
        (name, array.shape, SMALL.get(name, array.dtype.name))
        for name, array in one._asdict().items()
        if name not in SHARED and isinstance(array, np.ndarray)
    )
    return Plan(block, sensors, lit, own, near, swapped(cores))  # type: ignore[arg-type]


def room_of(sensors: int, drawn: int, lit: bool) -> int:
    """Bytes that a warp's threads share: normal numbers, proximity sensors and ambient ones."""
    near = WARP * (4 * 8 + sensors * 10) if sensors else 0
    return WARP * 8 * drawn + near + (WARP * 8 * (RAYS + 1) if lit else 0)


def block_for(sensors: int, drawn: int, lit: bool) -> int:
    """Threads of a block whose warps have room for as much; 0 if not even one has."""
    blocks = (block for block in (BLOCK, BLOCK // 2, BLOCK // 4))
    return next((b for b in blocks if b // WARP * room_of(sensors, drawn, lit) + LEAST <= ROOM), 0)


def _small(arrays: dict[str, Any], room: list[int]) -> Sizes:
    """Of those arrays that there is room for, the smallest first."""
    found = []
    for name, array in sorted(arrays.items(), key=lambda each: getattr(each[1], "nbytes", 0)):
        if isinstance(array, np.ndarray) and array.nbytes <= room[0]:
            room[0] -= array.nbytes
            found.append((name, array.shape, array.dtype.name))
    return tuple(found)


def swapped(cores: Cores) -> Swaps:
    """Functions that these trials never call, each with something small to be compiled in its place."""
    robot, feed = cores.robot, cores.trial.feed
    found: dict[Dispatcher, Callable[..., Any]] = {trial.bound_readings: _never}
    if feed == trial.AMBIENT:
        found |= {infrared.infrared: _nothing}
    if feed == trial.PROXIMITY:
        found |= {ambient.ambient: _nothing}
    if not light_beyond.goes_beyond.py_func(robot):
        found[light_beyond.illuminate_beyond] = _nothing
    if not robot.proximity_curve.shape[1]:
        found[infrared.gathered] = _none
    if not len(robot.outline):
        found |= {outline.settle_outline: _stay, light.hide_behind_outline: _nothing}
    if not len(cores.arena.segments):
        found[geometry.see_segments] = _nothing
    return tuple(found.items())


@cache
def trials(plan: Plan) -> Kernel:
    """The kernel that carries out a trial in each thread, or in several."""
    if SIMULATED:
        return Kernel(cuda.jit(_simulate), plan.block, steps=True)
    warps, draw_start = plan.block // WARP, device(trial.draw_start)
    drawn = next(shape[0] for name, shape, _ in plan.own if name == "noise")
    shared: Swaps = ((trial.draw_noise, shared_noise(device, drawn, warps)),)
    if plan.sensors:
        shared += ((infrared.infrared, shared_infrared(device, plan.sensors, warps)),)
    if plan.lit:
        shared += ((ambient.ambient, shared_ambient(device, warps)),)
    one_trial = device(trial.run_trial, (*plan.swaps, *shared))

    def carry_out(world: Any, nets: Any, mine: Any, batch: Any) -> None:
        thread, each = cuda.grid(1), batch.each
        t = thread // WARP * each + thread % each
        i = min(t, batch.which.shape[0] - 1)  # the last warps are full, too: all their threads meet
        p, stream = batch.paths[t], batch.streams[i]
        cuda.syncthreads()
        mine.settled[EACH] = each
        draw_start(world.task, stream, mine.start)
        one_trial(world, nets, batch.which[i], stream, mine, Path(p[0], p[1], p[2], p[3], p[4], p[5]))

    made = cuda.jit(way_in(plan.own, plan.near, cuda.jit(device=True)(carry_out)), max_registers=REGISTERS)
    named = [(one.py_func.__name__, getattr(other, "__name__", "")) for one, other in plan.swaps]
    code = kept(made, plan._replace(swaps=()), REGISTERS, named)
    rolled = plan.sensors > 0 or not plan.lit  # else there is too much code
    return Kernel(code, plan.block, steps=True, rolled=rolled)


def _simulate(world: Any, nets: Any, work: Any, batch: Any) -> None:
    if cuda.grid(1) == 0:  # one thread carries out all trials, for there is scratch for one
        run_trials(world, nets, batch.which, batch.streams, batch.paths, work)


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

    return Kernel(kept(cuda.jit(take), whose), WARP, steps=False)
