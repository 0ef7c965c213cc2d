"""The pool of processes: spawned, so that nothing is shared but messages; they die with the parent, however
it ends.

`concurrent.futures` does not serve here: one process that is killed breaks its whole executor, answers come
only at the end of a job, and what runs cannot be ended.
"""

import multiprocessing
import os
import signal
import threading
from collections import deque
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection, wait
from typing import Any

from realitygap.errors import RealityGapError, StudyError
from realitygap.work.pool import Setup, Tell, bench_of

__all__ = ["Processes", "refuse_unguarded_script"]

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
