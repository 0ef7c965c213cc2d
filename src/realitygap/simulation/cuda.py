"""The engine of an NVIDIA GPU: batches of trials, side by side.

Extra `cuda` (`pip install "realitygap[cuda]"`). With NUMBA_ENABLE_CUDASIM=1 the launches are simulated.
"""

import importlib.util
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from functools import cached_property
from threading import Lock
from typing import Any, NamedTuple

import numpy as np
from numba import cuda
from numpy.typing import NDArray

from realitygap.control.genotype import Layout, bare
from realitygap.control.network import decode
from realitygap.errors import UsageError
from realitygap.kernels.params import Networks, Path
from realitygap.kernels.work import new_work
from realitygap.simulation.cuda_code import SIMULATED, Kernel, compiling
from realitygap.simulation.cuda_kernels import plan_for, scoring, trials
from realitygap.simulation.cuda_sensors import WARP
from realitygap.simulation.engine import Cores, Streams
from realitygap.tasks.task import Task
from realitygap.values import Floats
from realitygap.world.robot import Profile

__all__ = ["Batch", "Cuda", "require_gpu"]

MOST_BYTES = 1 << 31
"""Of paths at a time."""
BUSY = 4
"""Warps on each multiprocessor from which on a warp has more trials, not a GPU more warps."""
TOO_NEW = "2.5.0"
"""The first NumPy without what numba-cuda 0.30 imports of it."""
INSTALL = 'Install it: pip install "realitygap[cuda]".'
CURE = "Leave out --engine, which takes the processor's cores, or see docs/machines.md."
_SIMULATOR: Any = Lock() if SIMULATED else nullcontext()
"""While a thread simulates a launch, cuda_kernels.py has a stand-in for the module `cuda`."""


class Batch(NamedTuple):
    """Trials of a launch: network and stream of each, paths [T, 6, steps], and score and sum of each path."""

    which: NDArray[np.int64]
    streams: Streams
    paths: Floats
    taken: Floats
    each: int
    """Trials of a warp."""


class Cuda:
    """Batches of trials on a GPU, side by side; use one in each thread.

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
        self._kernels: dict[tuple[int, int], tuple[Kernel, Any]] = {}
        self._rooms: dict[str, Any] = {}

    def scores(self, networks: Networks, streams: Streams) -> Floats:
        """As `Engine` has it."""
        with _SIMULATOR, _enough():
            scores = [self._taken(batch) for batch in self._launched(networks, streams)]
        found = np.concatenate(scores) if scores else np.empty(0)
        self.cores.require_finite(found)
        return found.reshape(streams.shape)

    def tracks(self, networks: Networks, streams: Streams) -> Path:
        """As `Engine` has it."""
        with _SIMULATOR, _enough():
            found = [
                self._fetched(batch.paths)[: len(batch.which)] for batch in self._launched(networks, streams)
            ]
        paths = np.concatenate(found) if found else np.empty((0, len(Path._fields), self.cores.trial.steps))
        self.cores.require_finite_path(paths)
        return Path(*(paths[:, i].reshape(*streams.shape, -1) for i in range(len(Path._fields))))

    def compile(self) -> None:
        """Compile what evolution of the usual layout needs, or load it; the first time takes some 20 s."""
        inputs = len(self.cores.trial.channels)
        layout = Layout(inputs=inputs, slots=max(Layout.slots, inputs + Layout.outputs))
        self.scores(decode(bare(layout), layout), np.zeros((1, 1), np.uint64))

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

    def _trials(self, networks: Networks) -> tuple[Kernel, Any]:
        """The kernel for networks of such a size, and what of the scratch its threads do not make."""
        size = networks.thresholds.shape[1], networks.links.shape[1]
        if size not in self._kernels:
            plan = plan_for(self.cores, networks)
            work = new_work(self.cores.robot, self.cores.trial, networks)
            if not SIMULATED:
                theirs: dict[str, Any] = dict.fromkeys([name for name, _, _ in plan.own], ())
                work = _placed(work._replace(**theirs | {"bounds": ()}))
            self._kernels[size] = trials(plan), work
        return self._kernels[size]

    def _launched(self, networks: Networks, streams: Streams) -> Iterator[Batch]:
        """Trials as they are carried out, so many at a time as there is room for."""
        which, flat = self.cores.named(networks, streams)
        made = self._trials(networks)
        most = max(WARP, MOST_BYTES // (8 * len(Path._fields) * self.cores.trial.steps))
        nets = Networks(*(self._there(name, array) for name, array in networks._asdict().items()))
        for first in range(0, len(flat), most):
            some = slice(first, first + most)
            yield self._run(made, nets, which[some], flat[some])

    def _run(self, made: tuple[Kernel, Any], nets: Any, which: NDArray[np.int64], streams: Streams) -> Batch:
        """Carry out trials; their paths stay where they are until the next ones."""
        (kernel, work), each = made, each_of(len(which))
        whole = each * kernel.block // WARP
        count = -(-len(which) // whole) * whole  # as many more as fill the last block
        paths = self._room_for("paths", (count, len(Path._fields), self.cores.trial.steps))
        taken = self._room_for("taken", (count, 2))
        batch = Batch(self._there("which", which), self._there("streams", streams), paths, taken, each)
        _launch(kernel, self._stream, count // each * WARP, self._world, nets, work, batch)
        return batch

    def _taken(self, batch: Batch) -> Floats:
        if self.cores.task.source is not None:
            paths = self._fetched(batch.paths)[: len(batch.which)]
            self.cores.require_finite_path(paths)
            return self.cores.score.over(paths, self.cores.room)
        score = scoring(self.cores.score.compiled)
        _launch(score, self._stream, len(batch.which), self._room, batch)
        taken = self._fetched(batch.taken)[: len(batch.which)]
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


def each_of(count: int) -> int:
    """Trials of a warp, of so many: a power of two, up to 32."""
    busy = BUSY * (1 if SIMULATED else cuda.get_current_device().MULTIPROCESSOR_COUNT)
    return min(1 << max(0, -(-count // busy) - 1).bit_length(), WARP)


def require_gpu() -> None:
    """See that there is a GPU, and what it takes to use it.

    Raises:
        UsageError: says what is missing and the cure.
    """
    if importlib.util.find_spec("numba_cuda") is None:
        raise UsageError(f"engine cuda: expected the package numba-cuda, found none. {INSTALL} {CURE}")
    if not SIMULATED and np.lib.NumpyVersion(np.__version__) >= TOO_NEW:
        found = f"found {np.__version__}, with which numba-cuda cannot be loaded"
        raise UsageError(f"engine cuda: expected NumPy before {TOO_NEW}, {found}. {INSTALL} {CURE}")
    if not cuda.is_available():
        why = cuda.cuda_error()
        if why is None:
            raise UsageError(f"engine cuda: expected NVIDIA's compiler NVVM, found none. {INSTALL} {CURE}")
        expected = "an NVIDIA GPU with its driver, as nvidia-smi shows it"
        raise UsageError(f"engine cuda: expected {expected}, found none: {' '.join(why.split())} {CURE}")


@contextmanager
def _enough() -> Iterator[None]:
    """Tell of too little memory: threads' own arrays grow with a layout's slots and links."""
    try:
        yield
    except Exception as error:
        if "OUT_OF_MEMORY" not in str(error):
            raise
        raise UsageError(
            f"engine cuda: expected a GPU with memory for its threads' networks and {MOST_BYTES >> 30} GB of "
            f"paths, got too little. Take fewer slots or links. {CURE}"
        ) from None


_ONE_AT_A_TIME = Lock()


def _launch(kernel: Kernel, stream: Any, threads: int, *given: Any) -> None:
    """Start a kernel with at least so many threads."""
    with _ONE_AT_A_TIME, compiling(kernel.steps, kernel.rolled), warnings.catch_warnings():
        warnings.filterwarnings("ignore", ".*Grid size")  # one run's batches are small; it may be in bold
        kernel.made[-(-threads // kernel.block), kernel.block, stream](*given)


def _placed(value: Any) -> Any:
    """Arrays, however deep in tuples, where the GPU finds them."""
    if isinstance(value, tuple):
        parts = [_placed(one) for one in value]
        return type(value)(*parts) if hasattr(value, "_fields") else tuple(parts)
    return cuda.to_device(value) if isinstance(value, np.ndarray) and not SIMULATED else value
