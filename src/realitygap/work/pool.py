"""Pools of workers: this process, processes, or one of your own; and how a person asks for one."""

import multiprocessing
import os
import pickletools
import signal
import threading
import warnings
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass, field
from multiprocessing import resource_tracker, spawn
from multiprocessing.connection import Connection, wait
from typing import Any, Protocol, runtime_checkable

from threadpoolctl import threadpool_limits

from realitygap.errors import ConfigError, RealityGapError, StudyError
from realitygap.plugins import packed, unpacked

__all__ = [
    "Bench", "Here", "Pool", "Processes", "Setup", "Tell", "Workers", "bench_of", "cores", "far",
    "messages_of", "near", "one_thread", "opened", "size_of",
]  # fmt: skip

MOST = 1024
"""Processes."""


def cores() -> int:
    """Cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def one_thread() -> threadpool_limits:
    """For the whole process: from now on, or within a `with` statement."""
    return threadpool_limits(1, user_api="blas")


Tell = Callable[[Any], None]
"""Called with each message of a job."""


class Bench(Protocol):
    """Carries out jobs of one kind; made once in a worker, used by one thread."""

    def carry_out(self, job: Any, tell: Tell) -> None:
        """One job; `tell` receives its messages, the same ones in the same order each time."""

    def close(self) -> None:
        """Release what it holds."""


@dataclass(frozen=True)
class Setup:
    """How a worker makes its bench: a function and its arguments, which can be pickled.

    What a user's file defines travels too: the worker runs that file. `here` is a bench that this process has
    already; it stays behind when the setup is sent.
    """

    make: Callable[..., Bench]
    words: tuple[Any, ...] = ()
    here: Bench | None = field(default=None, compare=False)

    def __call__(self) -> Bench:
        return self.make(*self.words)

    def __reduce__(self) -> tuple[Any, ...]:
        return _unpacked_setup, packed((self.make, self.words))


def _unpacked_setup(files: list[str], data: bytes) -> Setup:
    return Setup(*unpacked(files, data))


@runtime_checkable
class Pool(Protocol):
    """Carries out jobs. `realitygap.testing.PoolContract` is what every one keeps to."""

    def work(self, setup: Setup, jobs: Iterable[Any], tell: Tell) -> None:
        """Carry out all jobs, in any order; `tell` receives each message of each job once, in this thread.

        A worker that is lost is replaced, and its job made again. What `tell` raises ends the work.

        Raises:
            RealityGapError: as a job raised it.
            StudyError: a job's workers are lost again and again.
        """

    def close(self) -> None:
        """End all workers; a second time does nothing."""


class Here:
    """The pool that is this process."""

    def work(self, setup: Setup, jobs: Iterable[Any], tell: Tell) -> None:
        """One job after the other."""
        with closing(setup.here or setup()) as bench:
            for job in jobs:
                bench.carry_out(job, tell)

    def close(self) -> None:
        """Nothing to end."""


class _Kept:
    """A thread's bench, closed when another takes its place, or with the thread."""

    def __init__(self, setup: Setup) -> None:
        self.setup, self.bench = setup, setup()

    def __del__(self) -> None:
        if hasattr(self, "bench"):
            self.bench.close()


_threads = threading.local()


def bench_of(setup: Setup) -> Bench:
    """This thread's bench of a setup, kept for its next job."""
    kept: _Kept | None = getattr(_threads, "kept", None)
    if kept is None or kept.setup != setup:
        _threads.kept = kept = None
        _threads.kept = kept = _Kept(setup)
    return kept.bench


def messages_of(setup: Setup, job: Any) -> list[Any]:
    """All messages of a job at once, for pools whose workers answer once; a bench serves a thread's next job.

    Raises:
        RealityGapError: as the job raises it.
    """
    messages: list[Any] = []
    bench_of(setup).carry_out(job, messages.append)
    return messages


TRIES = 3
"""Workers that one job may cost."""

MESSAGE, DONE, ERROR = range(3)
"""What a worker sends, with something beside it."""

ALONE = "realitygap worker"
"""Name of a process that does not run the user's script again, as Python's own would."""

_Parcel = tuple[list[str], bytes]
"""What `plugins.packed` makes of a thing that is sent."""


class _Task:
    """A job: how many of its messages were passed on, and how many workers it has cost."""

    def __init__(self, job: Any) -> None:
        self.job: _Parcel = packed(job)
        self.heard = self.told = self.lost = 0

    def hear(self, message: Any, tell: Tell) -> None:
        """Pass on what is new: a job that is made again says the same."""
        self.heard += 1
        if self.heard > self.told:
            self.told = self.heard
            tell(message)


class _Worker:
    """A process, and what it has last been set up for; `script`: it knows what the user's script defines."""

    def __init__(self, one_thread: bool, script: bool) -> None:
        context = multiprocessing.get_context("spawn")
        self.connection, there = context.Pipe()
        self.process = context.Process(target=_serve, args=(there, one_thread), daemon=True)
        if not script:
            self.process.name = ALONE
        self.script, self._setup = script, b""
        with _without_script():
            self.process.start()
        there.close()

    def give(self, setup: _Parcel, job: _Parcel) -> bool:
        """Send a job; False if the process is gone."""
        try:
            self.connection.send((None if setup[1] == self._setup else setup, job))
        except OSError:
            return False
        self._setup = setup[1]
        return True

    def end(self, wait_s: float = 0.0) -> int | None:
        """End it now; its exit code if it ends by itself."""
        self.process.join(wait_s)
        code = self.process.exitcode
        self.process.kill()
        self.process.join()
        self.process.close()
        self.connection.close()
        return code


class Processes:
    """A pool of processes, which start when there is work for them and stay for more.

    `one_thread`: their linear algebra takes one thread each.
    """

    def __init__(self, size: int, *, one_thread: bool = False) -> None:
        self.size, self._one_thread = size, one_thread
        self._workers: set[_Worker] = set()

    def work(self, setup: Setup, jobs: Iterable[Any], tell: Tell) -> None:
        """Carry out all jobs; see `pool.Pool`."""
        if multiprocessing.current_process().daemon:
            note = "a daemonic process may start no others: one worker, this process, does all of the work"
            warnings.warn(note, RuntimeWarning, stacklevel=2)
            Here().work(setup, jobs, tell)
            return
        bench = packed((setup.make, setup.words))
        tasks, again = map(_Task, jobs), deque[_Task]()
        free, busy = list(self._workers), dict[Connection, tuple[_Worker, _Task]]()
        try:
            while True:
                while len(busy) < self.size:
                    task = again.popleft() if again else next(tasks, None)
                    if task is None:
                        break
                    script = _of_script(bench) or _of_script(task.job)
                    worker = free.pop() if free else self._start(script)
                    if script and not worker.script:
                        self._workers.remove(worker)
                        worker.end()
                        worker = self._start(script)
                    if worker.give(bench, task.job):
                        busy[worker.connection] = worker, task
                    else:
                        again.append(self._lost(worker, task))
                if not busy:
                    return
                for connection in wait(list(busy)):
                    assert isinstance(connection, Connection)
                    worker, task = busy[connection]
                    kind, content = _take(connection)
                    if kind == MESSAGE:
                        task.hear(content, tell)
                        continue
                    del busy[connection]
                    if kind == DONE:
                        free.append(worker)
                    elif content is None:
                        again.append(self._lost(worker, task))
                    else:
                        raise content
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """End all processes now; what they sent is with the parent, the rest is made again."""
        while self._workers:
            self._workers.pop().end()

    def _start(self, script: bool) -> _Worker:
        resource_tracker.ensure_running()  # now, since its start would let Ctrl-C through again
        with _deaf():
            worker = _Worker(self._one_thread, script)
            self._workers.add(worker)
        return worker

    def _lost(self, worker: _Worker, task: _Task) -> _Task:
        """The task, to be made again by another.

        Raises:
            StudyError: it ended with an error, or the job has cost too many workers.
        """
        self._workers.discard(worker)
        code = worker.end(5.0)
        task.heard, task.lost = 0, task.lost + 1
        if code == 1 or task.lost >= TRIES:  # 1: Python's own, with a traceback on stderr
            how = f"signal {-code}" if code is not None and code < 0 else f"exit code {code}"
            raise StudyError(
                f"a worker process died ({how}). What was saved is kept: resume, or start again, with "
                "fewer --workers if memory ran out; where workers use what a script of your own defines, its "
                'work must begin under `if __name__ == "__main__":`.'
            )
        return task


def _of_script(parcel: _Parcel) -> bool:
    """Whether a parcel holds what the user's script defines, so that a worker has to run the script too."""
    data = parcel[1]
    return b"__main__" in data and any(name == "__main__" for _, name, _ in pickletools.genops(data))


_starting = threading.Lock()


@contextmanager
def _without_script() -> Iterator[None]:
    """Spawn a process named ALONE without the user's script, which then needs no guard and may be anything:
    standard input, a notebook's cell. Python's own, of which other names are, would run it there first."""
    with _starting:
        prepare = spawn.get_preparation_data

        def without(name: str) -> dict[str, Any]:
            facts = prepare(name)
            return {key: facts[key] for key in facts if name != ALONE or not key.startswith("init_main")}

        spawn.get_preparation_data = without
        try:
            yield
        finally:
            spawn.get_preparation_data = prepare


def _take(connection: Connection) -> tuple[int, Any]:
    """What a worker sends; an error without content if it is gone."""
    try:
        kind, content = connection.recv()
    except (EOFError, OSError):
        return ERROR, None
    return kind, content


def _serve(connection: Connection, one_thread: bool) -> None:
    """A worker's life: it takes jobs and sends their messages, until the parent is gone."""
    if one_thread:  # before NumPy is loaded
        os.environ.update(OPENBLAS_NUM_THREADS="1", OMP_NUM_THREADS="1")
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the parent's to handle
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
    threading.Thread(target=_die_with_parent, daemon=True).start()
    setup: Setup | None = None
    try:
        while True:
            other, job = connection.recv()
            setup = Setup(*unpacked(*other)) if other else setup
            assert setup is not None
            bench_of(setup).carry_out(unpacked(*job), lambda message: connection.send((MESSAGE, message)))
            connection.send((DONE, None))
    except RealityGapError as error:
        connection.send((ERROR, error))
        connection.recv()  # the parent ends this process when it has heard
    except (EOFError, ConnectionError):
        pass


def _die_with_parent() -> None:
    """Wait for the parent's end, then end this process."""
    parent = multiprocessing.parent_process()
    assert parent is not None
    parent.join()
    os._exit(1)


@contextmanager
def _deaf() -> Iterator[None]:
    """Ctrl-C waits: a process that starts here is spared it until it can ignore it, as it soon does."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


Workers = int | Pool | None
"""So many processes, 1 for this one alone, None for one a core; or a pool."""


@contextmanager
def opened(workers: Workers, *, one_thread: bool = False) -> Iterator[Pool]:
    """The pool for a while; one that was given is left open. `one_thread`: as of `Processes`.

    Raises:
        ConfigError: neither a number nor a pool.
    """
    if isinstance(workers, Pool):
        yield workers
        return
    size = size_of(workers)
    with closing(Here() if size == 1 else Processes(size, one_thread=one_thread)) as pool:
        yield pool


def size_of(workers: int | None) -> int:
    """How many processes.

    Raises:
        ConfigError: neither a number nor a pool.
    """
    size = cores() if workers is None else workers
    if isinstance(size, bool) or not isinstance(size, int) or not 1 <= size <= MOST:
        expected = f"a whole number from 1 to {MOST}, or a pool (work, close; see realitygap.work.pool)"
        raise ConfigError(f"workers: expected {expected}, got {workers!r}.")
    return size


def far(pool: object) -> bool:
    """Whether a pool says that its workers do not see this machine's files."""
    return bool(getattr(pool, "far", False))


def near(workers: Workers) -> Workers:
    """The same, or one process a core where those do not see this machine's files."""
    return None if far(workers) else workers
