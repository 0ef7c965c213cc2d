"""The engine of an NVIDIA GPU: batches of trials, side by side, each shared by a few threads.

Extra `cuda` (`pip install "realitygap[cuda]"`). With NUMBA_ENABLE_CUDASIM=1 the launches are simulated.
"""

import importlib.util
import warnings
from collections.abc import Iterator
from contextlib import nullcontext
from functools import cached_property
from threading import Lock
from typing import Any, NamedTuple

import numpy as np
from numba import cuda
from numpy.typing import NDArray

from realitygap.errors import UsageError
from realitygap.kernels import halves, together
from realitygap.kernels.params import Networks, Path
from realitygap.kernels.shared_rays import most_of_a_kind
from realitygap.kernels.together import Own, lanes_of_rays
from realitygap.kernels.work import Work, new_work
from realitygap.simulation.cuda_code import SIMULATED, Kernel, compiling
from realitygap.simulation.cuda_kernels import GROUP, SHARED, scoring, swapped, trials
from realitygap.simulation.engine import Cores, Streams
from realitygap.tasks.task import Task
from realitygap.values import Floats
from realitygap.world.profile import Profile

__all__ = ["Batch", "Cuda", "require_gpu"]

MOST_BYTES = 1 << 31
"""Of paths and scratch at a time."""
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
            found = [
                self._fetched(batch.paths)[: len(batch.which)] for batch in self._launched(networks, streams)
            ]
        paths = np.concatenate(found) if found else np.empty((0, len(Path._fields), self.cores.trial.steps))
        self.cores.require_finite_path(paths)
        return Path(*(paths[:, i].reshape(*streams.shape, -1) for i in range(len(Path._fields))))

    def compile(self) -> None:
        """Compile what evolution needs, or load it from the cache; the first time takes some 20 s."""
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
    def _trials(self) -> Kernel:
        cores = self.cores
        rays = lanes_of_rays(new_work(cores.robot, cores.trial, halves.quiet()), cores.robot)
        swaps = swapped(cores)
        shares = together.sense_together in dict(swaps)
        return trials((*rays, most_of_a_kind(cores.robot) if shares else 1), swaps)

    @property
    def _groups(self) -> int:
        """Trials of a block."""
        return self._trials.block // GROUP

    def _whole(self, count: int) -> int:
        """So many trials, and as many more as fill the last block."""
        return -(-count // self._groups) * self._groups

    def _launched(self, networks: Networks, streams: Streams) -> Iterator[Batch]:
        """Trials as they are carried out, so many at a time as there is room for."""
        which, flat = self.cores.named(networks, streams)
        most = max(self._groups, MOST_BYTES // self._bytes(networks))
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
        rows = self._whole(count)
        if kept is None or len(kept.pose) < rows:
            one = self._one(networks)
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
        count = self._whole(len(which))
        paths = self._room_for("paths", (count, len(Path._fields), self.cores.trial.steps))
        taken = self._room_for("taken", (count, 2))
        batch = Batch(self._there("which", which), self._there("streams", streams), paths, taken)
        _launch(self._trials, self._stream, GROUP * count, self._world, nets, work, batch)
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


_ONE_AT_A_TIME = Lock()


def _launch(kernel: Kernel, stream: Any, threads: int, *given: Any) -> None:
    """Start a kernel with at least so many threads."""
    with _ONE_AT_A_TIME, compiling(kernel.small), warnings.catch_warnings():
        warnings.filterwarnings("ignore", ".*Grid size")  # one run's batches are small; it may be in bold
        kernel.made[-(-threads // kernel.block), kernel.block, stream](*given)


def _size(networks: Networks) -> tuple[int, int]:
    """What the size of scratch follows from: the most neurons and links."""
    return networks.thresholds.shape[1], networks.links.shape[1]


def _placed(value: Any) -> Any:
    """Arrays, however deep in tuples, where the GPU finds them."""
    if isinstance(value, tuple):
        parts = [_placed(one) for one in value]
        return type(value)(*parts) if hasattr(value, "_fields") else tuple(parts)
    return cuda.to_device(value) if isinstance(value, np.ndarray) and not SIMULATED else value
