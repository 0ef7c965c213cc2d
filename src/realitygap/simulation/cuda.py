"""The engine of an NVIDIA GPU: a few threads carry out each trial together, by the very steps of the kernels.

Extra `cuda` (`pip install "realitygap[cuda]"`). The steps are compiled from the same Python functions
(kernels/together.py), without what a robot and its task do not use. Nothing reorders a sum and no
multiplication is fused with an addition, so that the GPU rounds where the processor does. With
NUMBA_ENABLE_CUDASIM=1 the launches are simulated, and call the processor's steps.
"""

import hashlib
import importlib.metadata
import importlib.util
import pickle
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext, suppress
from functools import cache, cached_property
from pathlib import Path as File
from threading import Lock
from types import FunctionType
from typing import Any, NamedTuple

import numba
import numpy as np
from numba import cuda
from numba.core.dispatcher import Dispatcher
from numpy.typing import NDArray

from realitygap import tasks
from realitygap.errors import UsageError
from realitygap.kernels import (
    ambient,
    geometry,
    halves,
    infrared,
    light,
    light_beyond,
    outline,
    raywise,
    together,
    trial,
)
from realitygap.kernels.jit import SHELF, kernel
from realitygap.kernels.params import Networks, Path
from realitygap.kernels.together import Own, lanes_of_rays
from realitygap.kernels.work import Work, new_work
from realitygap.simulation.engine import Cores, Streams
from realitygap.tasks.task import Task
from realitygap.values import Floats
from realitygap.world.profile import Profile

__all__ = ["SIMULATED", "Batch", "Cuda", "device", "require_gpu", "scoring", "swapped", "trials", "unfused"]

SIMULATED = bool(numba.config.ENABLE_CUDASIM)
WARP = 32
"""Threads of a block: one warp, so that few trials spread over all of the GPU."""
GROUP = 1 if SIMULATED else 8
"""Threads that share a trial: as many as most robots have sensors of a kind."""
MOST_BYTES = 1 << 31
"""Of paths and scratch at a time."""
SHARED = ("fan", "all_fans", "span", "bounds")
"""What of the scratch nobody writes."""
INSTALL = 'Install it: pip install "realitygap[cuda]".'
CURE = "Leave out --engine, which takes the processor's cores, or see docs/machines.md."
_SIMULATOR: Any = Lock() if SIMULATED else nullcontext()
"""While a thread simulates a launch, another one finds a stand-in for the module `cuda`."""
Swaps = tuple[tuple[Dispatcher, Callable[..., Any]], ...]


class Batch(NamedTuple):
    """Trials of a launch: network and stream of each, paths [T, 6, steps], and score and sum of each path."""

    which: NDArray[np.int64]
    streams: Streams
    paths: Floats
    taken: Floats


class Cuda:
    """Batches of trials on a GPU, side by side; use one in each process.

    Scores of shipped tasks are taken there; a user's own on the processor, where their indices are checked.

    Raises:
        UsageError: there is no GPU, or no package to use it; each trial is to draw constants of its own; or
            sensors read by a look-up table.
    """

    def __init__(self, task: Task, profile: Profile, noise: float) -> None:
        require_gpu()
        if task.spread:
            raise UsageError(
                f"engine cuda: expected a task without a spread, whose trials share one robot, got "
                f"{task.name!r} with spread {task.spread:g}. Leave out --engine, or the spread."
            )
        if profile.infrared.table:
            raise UsageError(
                f"engine cuda: expected a profile without a look-up table, got {profile.name!r} with "
                "infrared.table. Leave out --engine."
            )
        self.cores = Cores(task, profile, noise)
        self._ones: dict[tuple[int, int], Work] = {}
        self._kept: dict[tuple[int, int], Work] = {}
        self._rooms: dict[str, Any] = {}

    def scores(self, networks: Networks, streams: Streams) -> Floats:
        """As `Engine` has it."""
        with _SIMULATOR:
            scores = [self._taken(batch) for batch in self._launched(networks, streams)]
        found = np.concatenate(scores) if scores else np.empty(0)
        self.cores.require_finite(found)
        return found.reshape(streams.shape)

    def tracks(self, networks: Networks, streams: Streams) -> Path:
        """As `Engine` has it."""
        with _SIMULATOR:
            found = [self._fetched(batch.paths) for batch in self._launched(networks, streams)]
        paths = np.concatenate(found) if found else np.empty((0, len(Path._fields), self.cores.trial.steps))
        self.cores.require_finite_path(paths)
        return Path(*(paths[:, i].reshape(*streams.shape, -1) for i in range(len(Path._fields))))

    def compile(self) -> None:
        """Compile what evolution needs, or load it from the cache; the first time takes most of a minute."""
        one = np.zeros(1, np.int64), np.zeros(1, np.uint64)
        self._taken(self._run(_placed(halves.quiet()), *one, self._scratch(halves.quiet(), 1)))

    @cached_property
    def _world(self) -> Any:
        return _placed(self.cores.world)

    @cached_property
    def _room(self) -> Any:
        return _placed(self.cores.room)

    @cached_property
    def _stream(self) -> Any:
        """Of launches: those of engines in other threads do not wait for each other."""
        return 0 if SIMULATED else cuda.stream()

    @cached_property
    def _trials(self) -> Any:
        cores = self.cores
        rays = lanes_of_rays(new_work(cores.robot, cores.trial, halves.quiet()), cores.robot)
        return trials(rays, swapped(cores))

    def _launched(self, networks: Networks, streams: Streams) -> Iterator[Batch]:
        """Trials as they are carried out, so many at a time as there is room for."""
        which, flat = self.cores.named(networks, streams)
        most = max(WARP, MOST_BYTES // self._bytes(networks))
        nets = Networks(*(self._there(name, array) for name, array in networks._asdict().items()))
        for first in range(0, len(flat), most):
            some = slice(first, first + most)
            work = self._scratch(networks, min(most, len(flat)))
            yield self._run(nets, which[some], flat[some], work)

    def _one(self, networks: Networks) -> Work:
        """Scratch of one trial."""
        size = _size(networks)
        if size not in self._ones:
            self._ones[size] = new_work(self.cores.robot, self.cores.trial, networks)
        return self._ones[size]

    def _bytes(self, networks: Networks) -> int:
        """Of the scratch and the path of a trial."""
        arrays = [array for array in self._one(networks) if isinstance(array, np.ndarray)]
        return sum(array.nbytes for array in arrays) + 8 * len(Path._fields) * self.cores.trial.steps

    def _scratch(self, networks: Networks, count: int) -> Work:
        """Scratch of at least so many trials, a row for each."""
        size = _size(networks)
        kept = self._kept.get(size)
        if kept is None or len(kept.pose) < count:
            one, rows = self._one(networks), max(WARP, count)
            spread: dict[str, Any] = {
                name: np.array(np.broadcast_to(array, (rows, *array.shape)), order="C")
                for name, array in one._asdict().items() if name not in SHARED
            }  # fmt: skip
            if not SIMULATED:  # threads have rays of their own, and one uncertain bound would hold up a warp
                spread |= dict.fromkeys((*Own._fields, "bounds"), ())
            kept = self._kept[size] = _placed(one._replace(**spread))
        return kept

    def _run(self, nets: Any, which: NDArray[np.int64], streams: Streams, work: Work) -> Batch:
        """Carry out trials; their paths stay where they are until the next ones."""
        count = len(which)
        paths = self._room_for("paths", (count, len(Path._fields), self.cores.trial.steps))
        taken = self._room_for("taken", (count, 2))
        batch = Batch(self._there("which", which), self._there("streams", streams), paths, taken)
        _launch(self._trials, self._stream, GROUP * count, self._world, nets, work, batch)
        return batch

    def _taken(self, batch: Batch) -> Floats:
        if self.cores.task.source is not None:
            paths = self._fetched(batch.paths)
            self.cores.require_finite_path(paths)
            return self.cores.score.over(paths, self.cores.room)
        score = scoring(self.cores.score.compiled)
        _launch(score, self._stream, len(batch.which), self._room, batch)
        taken = self._fetched(batch.taken)
        self.cores.require_finite_path(taken[:, 1])
        return taken[:, 0]

    def _there(self, name: str, array: Any) -> Any:
        """An array where the GPU finds it, in the place of the last one of that name if it has that size."""
        if SIMULATED:
            return array
        kept = self._room_for(name, array.shape, array.dtype)
        kept.copy_to_device(np.ascontiguousarray(array), stream=self._stream)
        return kept

    def _room_for(self, name: str, shape: tuple[int, ...], kind: Any = np.float64) -> Any:
        """Room on the GPU for an array, the last one of that name if it has that size."""
        if SIMULATED:
            return np.zeros(shape, kind)
        kept = self._rooms.get(name)
        if kept is None or kept.shape != shape:
            kept = self._rooms[name] = cuda.device_array(shape, kind, stream=self._stream)
        return kept

    def _fetched(self, array: Any) -> Floats:
        """An array of the GPU's, here."""
        if SIMULATED:
            return array  # type: ignore[no-any-return]
        self._stream.synchronize()  # a copy that waits would hold up the launches of other threads
        found: Floats = array.copy_to_host(stream=self._stream)
        self._stream.synchronize()
        return found


def require_gpu() -> None:
    """See that there is a GPU, and what it takes to use it.

    Raises:
        UsageError: says what is missing and the cure.
    """
    if importlib.util.find_spec("numba_cuda") is None:
        raise UsageError(f"engine cuda: expected the package numba-cuda, found none. {INSTALL} {CURE}")
    with _SIMULATOR:
        there = cuda.is_available()
    if not there:
        why = cuda.cuda_error()
        if why is None:
            raise UsageError(f"engine cuda: expected NVIDIA's compiler NVVM, found none. {INSTALL} {CURE}")
        expected = "an NVIDIA GPU with its driver, as nvidia-smi shows it"
        raise UsageError(f"engine cuda: expected {expected}, found none: {' '.join(why.split())} {CURE}")


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
    """Called instead of what changes arrays, where it is not called."""


def _none(*_given: Any) -> float:
    """Called instead of what returns a number, where it is not called."""
    return 0.0


def _stay(*_given: Any) -> tuple[float, float, float, bool]:
    """Called instead of `settle_outline`, where it is not called."""
    return 0.0, 0.0, 0.0, False


def _meet(lane: int, group: int) -> None:
    """Wait for the other threads of a group, which is a part of a warp."""
    cuda.syncwarp(((1 << group) - 1) << (cuda.laneid - lane))


def swapped(cores: Cores) -> Swaps:
    """What is called instead of some functions: nothing, where these trials never call them, though they are
    compiled into them; and, with surfaces that reflect alike and a disc for a body, sensors ray by ray."""
    robot, feed = cores.robot, cores.trial.feed
    dark, near = feed == trial.PROXIMITY, feed == trial.AMBIENT
    found: dict[Dispatcher, Callable[..., Any]] = {}
    if dark:
        found[ambient.ambient] = _nothing
    if near:
        found[infrared.infrared] = _nothing
    alike, beyond = not len(cores.arena.reflectance), light_beyond.goes_beyond.py_func(robot)
    if alike and robot.proximity_lambertian == 0.0:
        found[infrared.by_rays] = raywise.by_rays_alone
    if not beyond:
        found[light_beyond.illuminate_beyond] = _nothing
    if alike and not beyond and not len(robot.outline):
        found[ambient.illuminate] = raywise.illuminate_alone
    if not robot.proximity_curve.shape[1]:
        found[infrared.gathered] = _none
    if not len(robot.outline):
        found |= {outline.settle_outline: _stay, light.hide_behind_outline: _nothing}
    if not len(cores.arena.segments):
        found[geometry.see_segments] = _nothing
    return tuple(found.items())


@cache
def trials(rays: tuple[int, int], swaps: Swaps) -> Any:
    """The kernel that carries out a trial in each group of threads.

    Args:
        rays: as `lanes_of_rays` gives them.
        swaps: as `swapped` gives them.
    """
    draw_start, own, (light, wide) = device(trial.draw_start), _own(), rays
    if SIMULATED:  # Python's usual way in, with hundreds of values, takes far longer to compile
        run_trial = kernel(trial.run_trial.py_func)
    else:
        run_together = device(together.run_together, (*swaps, (together.meet, _meet)))

    def simulate(world: Any, nets: Any, work: Any, batch: Any) -> None:
        t = cuda.grid(1)
        if t < batch.which.shape[0]:
            mine, p = own(work, t), batch.paths[t]
            draw_start(world.task, batch.streams[t], mine.start)
            path = Path(p[0], p[1], p[2], p[3], p[4], p[5])
            run_trial(world, nets, batch.which[t], batch.streams[t], mine, path)

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
            if lane == 0:
                draw_start(world.task, batch.streams[t], mine.start)
            path = Path(p[0], p[1], p[2], p[3], p[4], p[5])
            run_together(world, nets, batch.which[t], batch.streams[t], lane, GROUP, mine, rays, path)

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

        with suppress(pickle.PicklingError, TypeError):
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
def unfused() -> Iterator[None]:
    """Compile without fusing multiplications and additions: NVVM has a switch, numba-cuda passes none on."""
    from numba.cuda.cudadrv import nvvm

    compile_ir = nvvm.compile_ir
    nvvm.compile_ir = lambda ir, **options: compile_ir(ir, **{**options, "fma": False})
    try:
        yield
    finally:
        nvvm.compile_ir = compile_ir


def _own() -> Callable[[Work, int], Work]:
    """A thread's own rows of the scratch, by a text: compiled code cannot map over a tuple's fields."""
    whole = SHARED if SIMULATED else SHARED + Own._fields
    rows = (f"all.{name}" if name in whole else f"all.{name}[t]" for name in Work._fields)
    scope: dict[str, Any] = {"Work": Work}
    exec(f"def own(all, t):\n    return Work({', '.join(rows)})", scope)
    own: Callable[[Work, int], Work] = cuda.jit(device=True)(scope["own"])
    return own


_ONE_AT_A_TIME = Lock()


def _launch(kernel: Any, stream: Any, threads: int, *given: Any) -> None:
    """Start a kernel with so many threads."""
    with _ONE_AT_A_TIME, unfused(), warnings.catch_warnings():
        warnings.filterwarnings("ignore", ".*Grid size")  # one run's batches are small; it may be in bold
        kernel[(threads + WARP - 1) // WARP, WARP, stream](*given)


def _size(networks: Networks) -> tuple[int, int]:
    """What the size of scratch follows from: the most neurons and links."""
    return networks.thresholds.shape[1], networks.links.shape[1]


def _placed(value: Any) -> Any:
    """Arrays, however deep in tuples, where the GPU finds them."""
    if isinstance(value, tuple):
        parts = [_placed(one) for one in value]
        return type(value)(*parts) if hasattr(value, "_fields") else tuple(parts)
    return cuda.to_device(value) if isinstance(value, np.ndarray) and not SIMULATED else value
