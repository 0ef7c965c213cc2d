"""The kernels of a GPU, made of the processor's steps: threads share a trial, one takes its score.

The steps are compiled from the same Python functions (kernels/together.py), without what a robot and its task
do not use, and kept on file. Nothing reorders a sum and no multiplication is fused with an addition, so that
the GPU rounds where the processor does. Simulated launches call the processor's steps.
"""

import hashlib
import importlib.metadata
import pickle
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path as File
from types import FunctionType
from typing import Any

import numba
from numba import cuda, types
from numba.core.dispatcher import Dispatcher

from realitygap import tasks
from realitygap.kernels import (
    ambient,
    geometry,
    infrared,
    light,
    light_beyond,
    outline,
    together,
    trial,
)
from realitygap.kernels.batch import run_trials
from realitygap.kernels.jit import SHELF
from realitygap.kernels.params import RAYS, Path
from realitygap.kernels.together import Common, Own
from realitygap.kernels.work import Work
from realitygap.simulation.engine import Cores

__all__ = ["GROUP", "SHARED", "SIMULATED", "WARP", "device", "lean", "scoring", "swapped", "trials"]

SIMULATED = bool(numba.config.ENABLE_CUDASIM)
GROUP = 1 if SIMULATED else 8
"""Threads that share a trial: as many as most robots have sensors of a kind."""
WARP = 32
"""Threads of a block: one warp, so that few trials spread over all of the GPU."""
GROUPS = WARP // GROUP
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
    """Wait for the other threads of a group: here for those of the whole warp."""
    cuda.syncwarp()


def swapped(cores: Cores) -> Swaps:
    """Functions that these trials never call, each with something small to be compiled in its place.

    And those that go ray by ray instead, where surfaces reflect alike.
    """
    robot, feed = cores.robot, cores.trial.feed
    seen, lit = feed != trial.AMBIENT, feed != trial.PROXIMITY
    beyond = light_beyond.goes_beyond.py_func(robot)
    found: dict[Dispatcher, Callable[..., Any]] = {}
    if not seen:
        found |= {infrared.infrared: _nothing, together.sense_near: _nothing}
    if not lit:
        found |= {ambient.ambient: _nothing, together.sense_light: _nothing}
    if not len(cores.arena.reflectance) and not (lit and (beyond or len(robot.outline))):
        found[together.sense_together] = together.sense_by_rays
    if not beyond:
        found[light_beyond.illuminate_beyond] = _nothing
    if not robot.proximity_curve.shape[1]:
        found[infrared.gathered] = _none
    if not len(robot.outline):
        found |= {outline.settle_outline: _stay, light.hide_behind_outline: _nothing}
    if not len(cores.arena.segments):
        found[geometry.see_segments] = _nothing
    return tuple(found.items())


@cache
def trials(rays: tuple[int, int, int], swaps: Swaps) -> Any:
    """The kernel that carries out a trial in each group of threads.

    Args:
        rays: as `lanes_of_rays` gives them, and the number of proximity sensors.
        swaps: as `swapped` gives them.
    """
    draw_start, own, (light, wide, sensors) = device(trial.draw_start), _own(), rays
    more, terms = sensors + 1, RAYS + 1
    run_together = device(together.run_together, (*swaps, (together.meet, _meet)))

    def simulate(world: Any, nets: Any, work: Any, batch: Any) -> None:
        t = cuda.grid(1)
        if t < batch.which.shape[0]:
            one = slice(t, t + 1)
            run_trials(world, nets, batch.which[one], batch.streams[one], batch.paths[one], own(work, t))

    def carry_out(world: Any, nets: Any, work: Any, batch: Any) -> None:
        thread = cuda.grid(1)
        t, lane = thread // GROUP, thread % GROUP
        if t < batch.which.shape[0]:
            mine, p, d = own(work, t), batch.paths[t], numba.float64
            rays = Own(
                cuda.local.array(wide, d), cuda.local.array(wide, d), cuda.local.array(wide, d),
                cuda.local.array(wide, d), cuda.local.array(light, d), cuda.local.array(wide, d),
                cuda.local.array(wide, d), cuda.local.array(wide, d), cuda.local.array(wide, d),
                cuda.local.array(wide, d), cuda.local.array(wide, d), cuda.local.array(wide, d),
                cuda.local.array(1, numba.int64), cuda.local.array(1, numba.uint64),
            )  # fmt: skip
            group = cuda.threadIdx.x // GROUP
            common = Common(
                cuda.shared.array((GROUPS, sensors, 6), d)[group],
                cuda.shared.array((GROUPS, sensors), numba.int32)[group],
                cuda.shared.array((GROUPS, more), numba.int32)[group],
                cuda.shared.array((GROUPS, sensors, terms), d)[group],
            )
            if lane == 0:
                draw_start(world.task, batch.streams[t], mine.start)
            path = Path(p[0], p[1], p[2], p[3], p[4], p[5])
            run_together(world, nets, batch.which[t], batch.streams[t], lane, GROUP, mine, rays, common, path)

    named = [(one.py_func.__name__, getattr(other, "__name__", "")) for one, other in swaps]
    return _kept(cuda.jit(simulate if SIMULATED else carry_out), rays, named)


@cache
def scoring(score: Any) -> Any:
    """The kernel that takes the score of each trial's path."""
    whose, score = (score.py_func.__module__, score.py_func.__qualname__), device(score)

    def take(room: Any, batch: Any) -> None:
        t = cuda.grid(1)
        if t < batch.taken.shape[0]:
            p = batch.paths[t]
            total = 0.0
            for i in range(p.shape[0]):
                for k in range(p.shape[1]):
                    total += p[i, k]
            batch.taken[t, 0] = score(Path(p[0], p[1], p[2], p[3], p[4], p[5]), room)
            batch.taken[t, 1] = total

    return _kept(cuda.jit(take), whose)


class _Entries:
    """What numba-cuda asks for a kernel's machine code, one entry for each signature and kind of GPU.

    Args:
        name: the kernel's.
        facts: what it is made of besides the text of kernels, tasks and this file.
    """

    def __init__(self, name: str, *facts: object) -> None:
        texts = [File(__file__), *sorted(File(tasks.__file__).parent.glob("*.py"))]
        known = repr((facts, importlib.metadata.version("numba-cuda"))).encode()
        self._name, self._of = name, known + b"".join(text.read_bytes() for text in texts)

    def load_overload(self, sig: Any, _target_context: Any) -> Any:
        """What was compiled for a signature; None where it has to be compiled."""
        from numba.cuda.dispatcher import _Kernel

        content = SHELF.read(self._entry(sig))
        if content is not None:
            try:
                return _Kernel._rebuild(**pickle.loads(content))
            except Exception:  # whole, but not to be used: of another making
                SHELF.refuse(self._entry(sig))
        return None

    def save_overload(self, sig: Any, made: Any) -> None:
        """Keep what was compiled, if it can be."""
        from numba.cuda.serialize import dumps

        with suppress(pickle.PicklingError, TypeError, RuntimeError):
            SHELF.write(self._entry(sig), dumps(made._reduce_states()))

    def _entry(self, sig: Any) -> str:
        facts = repr((sig, cuda.get_current_device().compute_capability)).encode()
        return f"{self._name}-{hashlib.sha256(self._of + facts).hexdigest()[:24]}.cuda"


def _kept(made: Any, *facts: object) -> Any:
    """A kernel whose machine code is kept on file."""
    if not SIMULATED:
        made._cache = _Entries(made.py_func.__name__, *facts)
    return made


@contextmanager
def lean() -> Iterator[None]:
    """Compile for a GPU as numba-cuda does not offer to.

    Multiplications and additions are not fused: NVVM has a switch for that. No index counts from an array's
    end, as negative ones otherwise do: steps have none.
    """
    from numba.cuda.cudadrv import nvvm
    from numba.cuda.np import arrayobj

    compile_ir, fix_index = nvvm.compile_ir, arrayobj.fix_integer_index
    nvvm.compile_ir = lambda ir, **options: compile_ir(ir, **{**options, "fma": False})
    arrayobj.fix_integer_index = _as_it_is
    try:
        yield
    finally:
        nvvm.compile_ir, arrayobj.fix_integer_index = compile_ir, fix_index


def _as_it_is(context: Any, builder: Any, kind: Any, index: Any, _size: Any) -> Any:
    """An index as a number of the width of a pointer."""
    return context.cast(builder, index, kind, types.intp if kind.signed else types.uintp)


def _own() -> Callable[[Work, int], Work]:
    """A thread's own rows of the scratch, by a text: compiled code cannot map over a tuple's fields."""
    whole = SHARED if SIMULATED else SHARED + Own._fields
    rows = (f"all.{name}" if name in whole else f"all.{name}[t]" for name in Work._fields)
    scope: dict[str, Any] = {"Work": Work}
    exec(f"def own(all, t):\n    return Work({', '.join(rows)})", scope)
    own: Callable[[Work, int], Work] = cuda.jit(device=True)(scope["own"])
    return own
