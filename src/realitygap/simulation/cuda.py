"""The engine of an NVIDIA GPU: each thread carries out a trial, by the very steps of the kernels.

Extra `cuda` (`pip install "realitygap[cuda]"`). The steps are compiled from the same Python functions.
Nothing reorders a sum and no multiplication is fused with an addition, so that the GPU rounds where the
processor does. With NUMBA_ENABLE_CUDASIM=1 the launches are simulated, and call the processor's steps.
"""

import importlib.util
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache, cached_property
from types import FunctionType
from typing import Any, NamedTuple

import numba
import numpy as np
from numba import cuda
from numba.core.dispatcher import Dispatcher
from numpy.typing import NDArray

from realitygap.errors import UsageError
from realitygap.kernels import halves, trial
from realitygap.kernels.jit import kernel
from realitygap.kernels.params import Networks, Path
from realitygap.kernels.work import Work, new_work
from realitygap.simulation.engine import Cores, Streams
from realitygap.tasks.task import Task
from realitygap.values import Floats
from realitygap.world.profile import Profile

__all__ = ["SIMULATED", "Batch", "Cuda", "device", "require_gpu", "scoring", "trials", "unfused"]

SIMULATED = bool(numba.config.ENABLE_CUDASIM)
BLOCK = 32
"""Threads of a block: one warp, so that few trials spread over all of the GPU."""
MOST_BYTES = 1 << 31
"""Of paths and scratch at a time."""
SHARED = ("fan", "all_fans", "span", "bounds")
"""What of a trial's scratch nobody writes."""
INSTALL = 'Install it: pip install "realitygap[cuda]".'
CURE = "Leave out --engine, which takes the processor's cores, or see docs/machines.md."


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
        self._kept: dict[tuple[int, int], Work] = {}

    def scores(self, networks: Networks, streams: Streams) -> Floats:
        """As `Engine` has it."""
        scores = [self._taken(batch) for batch in self._launched(networks, streams)]
        found = np.concatenate(scores) if scores else np.empty(0)
        self.cores.require_finite(found)
        return found.reshape(streams.shape)

    def tracks(self, networks: Networks, streams: Streams) -> Path:
        """As `Engine` has it."""
        found = [_fetched(batch.paths) for batch in self._launched(networks, streams)]
        paths = np.concatenate(found) if found else np.empty((0, len(Path._fields), self.cores.trial.steps))
        self.cores.require_finite_path(paths)
        return Path(*(paths[:, i].reshape(*streams.shape, -1) for i in range(len(Path._fields))))

    def compile(self) -> None:
        """Compile what evolution needs; takes about half a minute."""
        one = np.zeros(1, np.int64), np.zeros(1, np.uint64)
        self._taken(self._run(halves.quiet(), *one, self._scratch(halves.quiet(), 1)))

    @cached_property
    def _world(self) -> Any:
        return _placed(self.cores.world)

    @cached_property
    def _room(self) -> Any:
        return _placed(self.cores.room)

    def _launched(self, networks: Networks, streams: Streams) -> Iterator[Batch]:
        """Trials as they are carried out, so many at a time as there is room for."""
        which, flat = self.cores.named(networks, streams)
        one = new_work(self.cores.robot, self.cores.trial, networks)
        room = (
            sum(array.nbytes for array in one if isinstance(array, np.ndarray))
            + 8 * len(Path._fields) * self.cores.trial.steps
        )
        most = max(BLOCK, MOST_BYTES // room)
        nets = _placed(networks)
        for first in range(0, len(flat), most):
            some = slice(first, first + most)
            work = self._scratch(networks, min(most, len(flat)))
            yield self._run(nets, which[some], flat[some], work)

    def _scratch(self, networks: Networks, count: int) -> Work:
        """Scratch of at least so many trials, a thread's elements as far apart as there are threads."""
        size = (networks.thresholds.shape[1], networks.links.shape[1])
        kept = self._kept.get(size)
        if kept is None or len(kept.pose) < count:
            one, rows = new_work(self.cores.robot, self.cores.trial, networks), max(BLOCK, count)
            order: Any = "C" if SIMULATED else "F"
            spread = {
                name: np.array(np.broadcast_to(array, (rows, *array.shape)), order=order)
                for name, array in one._asdict().items() if name not in SHARED
            }  # fmt: skip
            bounds: Any = one.bounds if SIMULATED else ()  # an uncertain thread would hold up its warp
            kept = self._kept[size] = _placed(one._replace(bounds=bounds, **spread))
        return kept

    def _run(self, nets: Any, which: NDArray[np.int64], streams: Streams, work: Work) -> Batch:
        """Carry out trials; their paths stay where they are."""
        count = len(which)
        empty: Any = np.zeros if SIMULATED else cuda.device_array
        paths = empty((count, len(Path._fields), self.cores.trial.steps))
        batch = Batch(_placed(which), _placed(streams), paths, empty((count, 2)))
        _launch(trials(), count, self._world, nets, work, batch)
        return batch

    def _taken(self, batch: Batch) -> Floats:
        if self.cores.task.source is not None:
            paths = _fetched(batch.paths)
            self.cores.require_finite_path(paths)
            return self.cores.score.over(paths, self.cores.room)
        _launch(scoring(self.cores.score.compiled), len(batch.which), self._room, batch)
        taken = _fetched(batch.taken)
        self.cores.require_finite_path(taken[:, 1])
        return taken[:, 0]


def require_gpu() -> None:
    """See that there is a GPU, and what it takes to use it.

    Raises:
        UsageError: says what is missing and the cure.
    """
    if importlib.util.find_spec("numba_cuda") is None:
        raise UsageError(f"engine cuda: expected the package numba-cuda, found none. {INSTALL} {CURE}")
    if not cuda.is_available():
        why = cuda.cuda_error()
        if why is None:
            raise UsageError(f"engine cuda: expected NVIDIA's compiler NVVM, found none. {INSTALL} {CURE}")
        expected = "an NVIDIA GPU with its driver, as nvidia-smi shows it"
        raise UsageError(f"engine cuda: expected {expected}, found none: {' '.join(why.split())} {CURE}")


@cache
def device(made: Dispatcher) -> Any:
    """A compiled function, and all that it calls, for the GPU: the same Python, without fast-math flags."""
    if SIMULATED:
        return made
    plain = made.py_func
    scope = {name: plain.__globals__[name] for name in plain.__code__.co_names if name in plain.__globals__}
    scope = {name: device(one) if isinstance(one, Dispatcher) else one for name, one in scope.items()}
    scope |= {name: plain.__globals__[name] for name in ("__name__", "__builtins__")}
    copy = FunctionType(plain.__code__, scope, plain.__name__, plain.__defaults__, plain.__closure__)
    return cuda.jit(device=True)(copy)


@cache
def trials() -> Any:
    """The kernel that carries out a trial in each thread."""
    draw_start, run_trial, own = device(trial.draw_start), device(trial.run_trial), _own()
    if SIMULATED:  # Python's usual way in, with hundreds of values, takes far longer to compile
        run_trial = kernel(run_trial.py_func)

    def carry_out(world: Any, nets: Any, work: Any, batch: Any) -> None:
        t = cuda.grid(1)
        if t < batch.which.shape[0]:
            mine, p = own(work, t), batch.paths[t]
            draw_start(world.task, batch.streams[t], mine.start)
            path = Path(p[0], p[1], p[2], p[3], p[4], p[5])
            run_trial(world, nets, batch.which[t], batch.streams[t], mine, path)

    return cuda.jit(carry_out)


@cache
def scoring(score: Any) -> Any:
    """The kernel that takes the score of each trial's path."""
    score = device(score)

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

    return cuda.jit(take)


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
    rows = (f"all.{name}" if name in SHARED else f"all.{name}[t]" for name in Work._fields)
    scope: dict[str, Any] = {"Work": Work}
    exec(f"def own(all, t):\n    return Work({', '.join(rows)})", scope)
    own: Callable[[Work, int], Work] = cuda.jit(device=True)(scope["own"])
    return own


def _launch(kernel: Any, count: int, *given: Any) -> None:
    """A thread for each of so many trials."""
    with unfused(), warnings.catch_warnings():
        warnings.filterwarnings("ignore", ".*Grid size")  # one run's batches are small; it may be in bold
        kernel[(count + BLOCK - 1) // BLOCK, BLOCK](*given)


def _placed(value: Any) -> Any:
    """Arrays, however deep in tuples, where the GPU finds them."""
    if isinstance(value, tuple):
        parts = [_placed(one) for one in value]
        return type(value)(*parts) if hasattr(value, "_fields") else tuple(parts)
    return cuda.to_device(value) if isinstance(value, np.ndarray) and not SIMULATED else value


def _fetched(array: Any) -> Floats:
    """An array of the GPU's, here."""
    found: Floats = array if SIMULATED else array.copy_to_host()
    return found
