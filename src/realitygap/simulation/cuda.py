"""The engine of an NVIDIA GPU: each thread carries out a trial, by the kernels' own steps.

Extra `cuda` (`pip install "realitygap[cuda]"`). The steps are compiled from the same Python functions,
without fast-math flags. With NUMBA_ENABLE_CUDASIM=1 launches are simulated, and call the processor's steps.
"""

import importlib.util
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from functools import cache, cached_property
from threading import RLock
from types import FunctionType
from typing import Any, NamedTuple

import numba
import numpy as np
from numba import cuda
from numpy.typing import NDArray

from realitygap.control.genotype import Genotype
from realitygap.errors import UsageError
from realitygap.kernels import trial
from realitygap.kernels.trial import NO_RECORD, Scratch, State, new_scratch
from realitygap.kernels.types import Networks, Path
from realitygap.values import Floats

__all__ = ["SIMULATED", "Batch", "Cuda", "device", "require_gpu", "scoring", "trials"]

SIMULATED = bool(numba.config.ENABLE_CUDASIM)
BLOCK = 32
"""Threads of a block: one warp, so that few trials spread over all of the GPU."""
MOST_BYTES = 1 << 31
"""Of paths and scratch at a time."""
TOO_NEW = "2.5.0"
"""The first NumPy without what numba-cuda 0.30 imports of it."""
INSTALL = 'Install it: pip install "realitygap[cuda]".'
CURE = "Leave out --engine, which takes the processor's cores."
_ONE_AT_A_TIME = RLock()
"""Launches. A simulated one puts a stand-in for `cuda` into this module meanwhile."""


class Batch(NamedTuple):
    """Trials of a launch: network and stream of each, paths [T, 6, steps], and score and sum of each path."""

    which: NDArray[np.int64]
    streams: NDArray[np.uint64]
    paths: Floats
    taken: Floats


class Cuda:
    """Batches of a simulation's trials on a GPU, side by side; use one in each thread.

    Scores of shipped tasks are taken there; a user's own on the processor, where their indices are checked.

    Raises:
        UsageError: there is no GPU, or no package to use it; each trial is to draw constants of its own; or
            sensors read by a look-up table.
    """

    def __init__(self, simulation: Any) -> None:
        task, profile = simulation.task, simulation.profile
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
        self.simulation = simulation
        self._scratch: dict[tuple[int, int], Any] = {}

    def scores(self, networks: Networks, streams: NDArray[np.uint64]) -> Floats:
        """As `Engine` has it."""
        with _memory_told():
            scores = [self._scored(batch) for batch in self._launched(networks, streams)]
        found = np.concatenate([np.empty(0), *scores])
        self.simulation.require_finite(found)
        return found.reshape(streams.shape)

    def tracks(self, networks: Networks, streams: NDArray[np.uint64]) -> Path:
        """As `Engine` has it."""
        with _memory_told():
            found = [self._fetched(batch.paths) for batch in self._launched(networks, streams)]
        none = np.empty((0, len(Path._fields), self.simulation.trial.steps))
        paths = np.concatenate([none, *found])
        self.simulation.require_finite_path(paths)
        return Path(*(paths[:, i].reshape(*streams.shape, paths.shape[2]) for i in range(paths.shape[1])))

    def compile(self) -> None:
        """Compile what evolution needs, in each process anew."""
        still = Genotype.constant(0, 0, len(self.simulation.trial.channels)).networks()
        self.scores(still, np.zeros((1, 1), np.uint64))

    @cached_property
    def _world(self) -> Any:
        return self._placed(self.simulation.world)

    @cached_property
    def _record(self) -> Any:
        return self._placed(NO_RECORD)

    @cached_property
    def _room(self) -> Any:
        return self._placed(self.simulation.room)

    @cached_property
    def _stream(self) -> Any:
        return 0 if SIMULATED else cuda.stream()

    def _launched(self, networks: Networks, streams: NDArray[np.uint64]) -> Iterator[Batch]:
        """Trials as they are carried out, as many at a time as there is memory for."""
        which, flat = self.simulation.checked(networks, streams)
        trial = self.simulation.trial
        one = new_scratch(self.simulation.robot, trial, networks)
        path = 8 * len(Path._fields) * trial.steps
        most = max(BLOCK, MOST_BYTES // (path + sum(_bytes(row) for row in one)))
        nets, scratch = self._placed(networks), self._rows(one, networks, min(most, len(flat)))
        for first in range(0, len(flat), most):
            some = slice(first, first + most)
            yield self._run(nets, scratch, which[some], flat[some])

    def _run(self, nets: Any, scratch: Any, which: NDArray[np.int64], streams: NDArray[np.uint64]) -> Batch:
        """Carry out trials; their paths stay on the GPU."""
        empty: Any = np.zeros if SIMULATED else cuda.device_array
        paths = empty((len(which), len(Path._fields), self.simulation.trial.steps))
        made = Batch(self._placed(which), self._placed(streams), paths, empty((len(which), 2)))
        _launch(trials(), self._stream, len(which), self._world, nets, self._record, scratch, made)
        return made

    def _rows(self, one: Scratch, networks: Networks, count: int) -> Any:
        """Scratch of at least so many trials, in an order in which threads side by side read side by side."""
        size = networks.thresholds.shape[1], networks.links.shape[1]
        kept = self._scratch.get(size)
        if kept is None or len(kept.start) < count:
            order: Any = "C" if SIMULATED else "F"

            def widened(value: Any) -> Any:
                if isinstance(value, tuple):
                    return type(value)(*map(widened, value))
                return np.array(np.broadcast_to(value, (max(BLOCK, count), *value.shape)), order=order)

            kept = self._scratch[size] = self._placed(widened(one))
        return kept

    def _scored(self, batch: Batch) -> Floats:
        if self.simulation.task.source is not None:
            paths = self._fetched(batch.paths)
            self.simulation.require_finite_path(paths)
            scores: Floats = self.simulation.score.over(paths, self.simulation.room)
            return scores
        _launch(scoring(self.simulation.score.compiled), self._stream, len(batch.which), self._room, batch)
        taken = self._fetched(batch.taken)
        self.simulation.require_finite_path(taken[:, 1])
        return taken[:, 0]

    def _placed(self, value: Any) -> Any:
        """Arrays, however deep in tuples, where the GPU finds them."""
        if SIMULATED:
            return value
        if isinstance(value, tuple):
            parts = [self._placed(one) for one in value]
            return type(value)(*parts) if hasattr(value, "_fields") else tuple(parts)
        return cuda.to_device(value, stream=self._stream) if isinstance(value, np.ndarray) else value

    def _fetched(self, array: Any) -> Floats:
        """An array of the GPU's, here."""
        found: Floats = array if SIMULATED else array.copy_to_host(stream=self._stream)
        if not SIMULATED:
            self._stream.synchronize()
        return found


def require_gpu() -> None:
    """See that there is a GPU, and what it takes to use it.

    Raises:
        UsageError: says what is missing and the cure.
    """
    if importlib.util.find_spec("numba_cuda") is None:
        raise UsageError(f"engine cuda: expected the package numba-cuda, found none. {INSTALL} {CURE}")
    if not SIMULATED and np.lib.NumpyVersion(np.__version__) >= TOO_NEW:
        raise UsageError(
            f"engine cuda: expected NumPy before {TOO_NEW}, found {np.__version__}, with which numba-cuda "
            f"cannot be loaded. {INSTALL} {CURE}"
        )
    with _ONE_AT_A_TIME:
        found, why = cuda.is_available(), getattr(cuda, "cuda_error", lambda: None)()
    if not found:
        if why is None:
            raise UsageError(f"engine cuda: expected NVIDIA's compiler NVVM, found none. {INSTALL} {CURE}")
        expected = "an NVIDIA GPU with its driver, as nvidia-smi shows it"
        raise UsageError(f"engine cuda: expected {expected}, found none: {' '.join(why.split())} {CURE}")


@contextmanager
def _memory_told() -> Iterator[None]:
    """Say so where there is too little memory: a trial's scratch grows with a layout's slots and links."""
    try:
        with _ONE_AT_A_TIME if SIMULATED else nullcontext():
            yield
    except Exception as error:
        if "OUT_OF_MEMORY" not in str(error):
            raise
        raise UsageError(
            f"engine cuda: expected a GPU with memory for {MOST_BYTES >> 30} GB of trials at a time, got too "
            f"little. Take fewer slots or links. {CURE}"
        ) from None


@cache
def device(made: Any) -> Any:
    """A compiled function, and all that it calls, for the GPU: the same Python, without fast-math flags."""
    if SIMULATED:
        return made
    plain = made.py_func
    scope = {name: plain.__globals__[name] for name in plain.__code__.co_names if name in plain.__globals__}
    for name, one in scope.items():
        step = one.dispatch(Networks) if hasattr(one, "dispatch") else one  # a brain's step, by its type
        scope[name] = device(step) if hasattr(step, "py_func") else step
    scope |= {name: plain.__globals__[name] for name in ("__name__", "__builtins__")}
    copy = FunctionType(plain.__code__, scope, plain.__name__, plain.__defaults__, plain.__closure__)
    return cuda.jit(device=True)(copy)


@cache
def trials() -> Any:
    """The kernel that carries out a trial in each thread."""
    scratch_of, run = _one_of(Scratch), trial.run_trials if SIMULATED else device(trial.run_each)

    def carry_out(world: Any, nets: Any, record: Any, scratch: Any, batch: Any) -> None:
        t = cuda.grid(1)
        if t < batch.which.shape[0]:
            which, streams, paths = batch.which[t : t + 1], batch.streams[t : t + 1], batch.paths[t : t + 1]
            run(world, nets, which, streams, paths, record, scratch_of(scratch, t))

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


def _bytes(value: Any) -> int:
    """Of an array, or of all in a tuple."""
    return sum(map(_bytes, value)) if isinstance(value, tuple) else int(value.nbytes)


def _one_of(kind: Any) -> Any:
    """What gives a trial its own of a tuple of that kind: its row of each array."""
    parts = _parts_before(kind, len(kind._fields))
    return cuda.jit(device=True)(lambda rows, t: kind(*parts(rows, t)))


def _parts_before(kind: Any, end: int) -> Any:
    """What gives the first `end` of those: compiled code cannot loop over fields of several types."""
    if end == 0:
        return cuda.jit(device=True)(lambda rows, t: ())
    before, i = _parts_before(kind, end - 1), end - 1
    if kind is Scratch and kind._fields[i] == "state":
        state = _one_of(State)
        return cuda.jit(device=True)(lambda rows, t: (*before(rows, t), state(rows[i], t)))
    return cuda.jit(device=True)(lambda rows, t: (*before(rows, t), rows[i][t]))


def _launch(kernel: Any, stream: Any, count: int, *given: Any) -> None:
    """A thread for each of so many trials."""
    with _ONE_AT_A_TIME, warnings.catch_warnings():
        warnings.filterwarnings("ignore", ".*Grid size")  # one run's batches are small; it may be in bold
        kernel[(count + BLOCK - 1) // BLOCK, BLOCK, stream](*given)
