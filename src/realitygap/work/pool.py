"""Pools of workers: this process, processes, threads, or one of your own."""

import multiprocessing
import os
import signal
import threading
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass, field
from itertools import count
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection, wait
from queue import Empty, Full, Queue
from threading import Event, Thread
from typing import Any, NamedTuple, Protocol, TypeVar, runtime_checkable

from threadpoolctl import threadpool_limits

from realitygap.errors import RealityGapError, StudyError

__all__ = [
    "Bench", "Counted", "Here", "Pool", "Processes", "Setup", "Tell", "bench_of", "merged", "messages_of",
    "one_thread", "refuse_unguarded_script",
]  # fmt: skip


def one_thread() -> threadpool_limits:
    """For the whole process: from now on, or within a `with` statement."""
    return threadpool_limits(1, user_api="blas")


Tell = Callable[[Any], None]
"""Called with each message of a job."""
LOST = (
    "workers: expected each message of a job once and in order, but one was lost or duplicated. What was "
    "saved is kept: continue with other workers, and fix the pool (realitygap.testing.PoolContract)."
)


class Bench(Protocol):
    """Carries out jobs of one kind; made once in a worker, used by one thread."""

    def carry_out(self, job: Any, tell: Tell) -> None:
        """One job; `tell` receives its messages, the same ones in the same order each time."""

    def close(self) -> None:
        """Release what it holds."""


@dataclass(frozen=True)
class Setup:
    """How a worker makes its bench: a function of a module and its arguments, which can be pickled.

    `here` is a bench that this process has already; it stays behind when the setup is sent.
    """

    make: Callable[..., Bench]
    words: tuple[Any, ...] = ()
    here: Bench | None = field(default=None, compare=False)

    def __call__(self) -> Bench:
        return self.make(*self.words)

    def __reduce__(self) -> tuple[Any, ...]:
        return Setup, (self.make, self.words)


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


class _Part(NamedTuple):
    """A message of a job by its number, or after the last one the end."""

    job: int
    number: int
    message: Any = None
    end: bool = False


class _Numbering:
    """A bench whose messages are numbered."""

    def __init__(self, bench: Setup | Bench) -> None:
        self._bench = bench() if isinstance(bench, Setup) else bench
        self.close = self._bench.close

    def carry_out(self, job: tuple[int, Any], tell: Tell) -> None:
        """One job by its number; `tell` receives parts."""
        numbers = count()
        self._bench.carry_out(job[1], lambda message: tell(_Part(job[0], next(numbers), message)))
        tell(_Part(job[0], next(numbers), end=True))


class Counted:
    """A given pool, checked: no message is lost, duplicated or out of turn."""

    def __init__(self, pool: Pool) -> None:
        self._pool, self.close = pool, pool.close
        self.far = bool(getattr(pool, "far", False))

    def work(self, setup: Setup, jobs: Iterable[Any], tell: Tell) -> None:
        """Carry out all jobs; see `Pool`.

        Raises:
            StudyError: at the first message that is not the next one of its job, or where one is missing.
        """
        due: dict[int, int] = {}

        def numbered() -> Iterator[tuple[int, Any]]:
            for number, job in enumerate(jobs):
                due[number] = 0
                yield number, job

        def heard(part: Any) -> None:
            if not isinstance(part, _Part) or due.pop(part.job, None) != part.number:
                raise StudyError(LOST)
            if not part.end:
                due[part.job] = part.number + 1
                tell(part.message)

        here = None if setup.here is None else _Numbering(setup.here)
        parts = numbered()
        self._pool.work(Setup(_Numbering, (setup,), here=here), parts, heard)
        if due or next(parts, None) is not None:
            raise StudyError(LOST)


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

ONE_THREAD = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}


class _Task:
    """A job: how many of its messages were passed on, and how many workers it has cost."""

    def __init__(self, job: Any) -> None:
        self.job = job
        self.heard = self.told = self.lost = 0

    def hear(self, message: Any, tell: Tell) -> None:
        """Pass on what is new: a job that is made again says the same."""
        self.heard += 1
        if self.heard > self.told:
            self.told = self.heard
            tell(message)


class _Worker:
    """A process, and what it has last been set up for."""

    def __init__(self, threads: dict[str, str]) -> None:
        context = multiprocessing.get_context("spawn")
        self.connection, there = context.Pipe()
        self.process = context.Process(target=_serve, args=(there,), daemon=True)
        self._setup: Setup | None = None
        with _environment(threads):
            self.process.start()
        there.close()

    def give(self, setup: Setup, job: Any) -> bool:
        """Send a job; False if the process is gone."""
        try:
            self.connection.send((None if setup == self._setup else setup, job))
        except OSError:
            return False
        self._setup = setup
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
        refuse_unguarded_script()
        self.size = size
        self._threads = ONE_THREAD if one_thread else {}
        self._workers: set[_Worker] = set()

    def work(self, setup: Setup, jobs: Iterable[Any], tell: Tell) -> None:
        """Carry out all jobs; see `pool.Pool`."""
        tasks, again = map(_Task, jobs), deque[_Task]()
        free, busy = list(self._workers), dict[Connection, tuple[_Worker, _Task]]()
        try:
            while True:
                while len(busy) < self.size:
                    task = again.popleft() if again else next(tasks, None)
                    if task is None:
                        break
                    worker = free.pop() if free else self._start()
                    if worker.give(setup, task.job):
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

    def _start(self) -> _Worker:
        resource_tracker.ensure_running()  # now, since its start would let Ctrl-C through again
        with _deaf():
            worker = _Worker(self._threads)
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
                "fewer --workers if memory ran out; a script of your own must begin its work under "
                '`if __name__ == "__main__":`.'
            )
        return task


def refuse_unguarded_script() -> None:
    """Refuse to start processes while this one is itself being spawned: a script without a guard.

    Raises:
        StudyError: says where the call belongs.
    """
    if getattr(multiprocessing.current_process(), "_inheriting", False):
        raise StudyError('call run_study under `if __name__ == "__main__":`, or with workers=1.')


def _take(connection: Connection) -> tuple[int, Any]:
    """What a worker sends; an error without content if it is gone."""
    try:
        kind, content = connection.recv()
    except (EOFError, OSError):
        return ERROR, None
    return kind, content


def _serve(connection: Connection) -> None:
    """A worker's life: it takes jobs and sends their messages, until the parent is gone."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the parent's to handle
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
    threading.Thread(target=_die_with_parent, daemon=True).start()
    setup: Setup | None = None
    try:
        while True:
            other, job = connection.recv()
            setup = other or setup
            assert setup is not None
            bench_of(setup).carry_out(job, lambda message: connection.send((MESSAGE, message)))
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


@contextmanager
def _environment(changes: dict[str, str]) -> Iterator[None]:
    """What a process that starts here finds in its environment."""
    before = {key: os.environ.get(key) for key in changes}
    os.environ.update(changes)
    try:
        yield
    finally:
        for key, value in before.items():
            if value is None:
                os.environ.pop(key, None)
            else:
                os.environ[key] = value


T = TypeVar("T")

MOST = 128
"""Items that wait to be taken; then the threads wait."""
PATIENCE_S = 0.05


def merged(sources: Sequence[Iterator[Sequence[T]]]) -> Generator[list[T], None, None]:
    """All that the sources yield, in lists as it comes; in order, of each source.

    A source's error ends this generator. When it ends or is closed, each source is left at its next list,
    which may be an empty one; no thread outlives it.
    """
    came: Queue[Any] = Queue(MOST)
    stop = Event()

    def put(what: object) -> None:
        while not stop.is_set():
            with suppress(Full):
                came.put(what, timeout=PATIENCE_S)
                return

    def drive(source: Iterator[Sequence[T]]) -> None:
        try:
            for items in source:
                for item in items:
                    put((item, None))
                if stop.is_set():
                    return
            put(None)
        except BaseException as error:
            put((None, error))

    threads = [Thread(target=drive, args=(source,), daemon=True) for source in sources]
    try:
        for thread in threads:
            thread.start()
        left = len(threads)
        while left:
            found = []
            with suppress(Empty):
                found.append(came.get(timeout=PATIENCE_S))  # no longer: Ctrl-C waits for it on Windows
                while len(found) < MOST:
                    found.append(came.get_nowait())
            left -= found.count(None)
            told = [one for one in found if one is not None]
            error = next((error for _, error in told if error is not None), None)
            if items := [item for item, failed in told if failed is None]:
                yield items
            if error is not None:
                raise error
    finally:
        stop.set()
        for thread in threads:
            if thread.ident is not None:
                thread.join()
