"""Processes that carry out whole runs and send what they find to the parent, the only writer.

They are spawned, so nothing is shared but the pipe; they die with the parent, however it ends.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection, wait
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from realitygap.errors import RealityGapError, StudyError
from realitygap.study.folder import agree, read_materials
from realitygap.study.jobs import Finished, Workshop

__all__ = ["Pool", "at_work", "cores", "refuse_unguarded_script"]

Life = Callable[[Connection, str], None]


def cores() -> int:
    """Cores that this process may use."""
    if hasattr(os, "process_cpu_count"):  # Python 3.13
        return os.process_cpu_count() or 1
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


class Pool:
    """A context with `size` processes; `work` gives what they send, until all jobs are done.

    Args:
        folder: the study's.
        size: of the pool.
        life: what a process does with its connection: runs of evolution by default.
        last: kind of the message with which a job is done.
    """

    def __init__(
        self, folder: Path, size: int, *, life: Life | None = None, last: type[Any] = Finished
    ) -> None:
        refuse_unguarded_script()
        self._last = last
        context = multiprocessing.get_context("spawn")
        resource_tracker.ensure_running()  # now, since its start would let Ctrl-C through again
        self._processes: dict[Connection, Any] = {}
        try:
            for _ in range(size):
                here, there = context.Pipe()
                process = context.Process(target=life or serve, args=(there, str(folder)), daemon=True)
                with _deaf():
                    process.start()
                    self._processes[here] = process
                there.close()
        except BaseException:
            self.stop()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.stop()

    def work(self, jobs: Iterator[Any]) -> Iterator[Any]:
        """Messages of all jobs as they come; a process that is free takes the next job.

        Raises:
            RealityGapError: as a worker raised it.
            StudyError: a worker died.
        """
        busy = set()
        for connection in self._processes:
            if self._give(connection, next(jobs, None)):
                busy.add(connection)
        while busy:
            for connection in [one for one in wait(list(busy)) if isinstance(one, Connection)]:
                message = self._take(connection)
                if isinstance(message, self._last) and not self._give(connection, next(jobs, None)):
                    busy.discard(connection)
                yield message

    def stop(self) -> None:
        """End all processes now; what they sent is with the parent, the rest is made again."""
        for process in self._processes.values():
            process.kill()
        for connection, process in self._processes.items():
            process.join()
            process.close()
            connection.close()
        self._processes.clear()

    def _give(self, connection: Connection, job: Any) -> bool:
        if job is None:
            return False
        try:
            connection.send(job)
        except OSError:
            self._mourn(connection)
        return True

    def _take(self, connection: Connection) -> Any:
        try:
            message = connection.recv()
        except (EOFError, OSError):
            self._mourn(connection)
        if isinstance(message, RealityGapError):
            raise message
        return message

    def _mourn(self, connection: Connection) -> None:
        process = self._processes[connection]
        process.join(5)
        code = process.exitcode
        how = f"signal {-code}" if code is not None and code < 0 else f"exit code {code}"
        raise StudyError(
            f"a worker process died ({how}). What was saved is kept: resume, with fewer --workers if memory "
            'ran out; in a script of your own, call run_study under `if __name__ == "__main__":`.'
        )


@contextmanager
def at_work(connection: Connection) -> Iterator[None]:
    """A worker's life around its jobs: it ends with the parent, and sends the error that stops it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the parent's to handle
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
    threading.Thread(target=_die_with_parent, daemon=True).start()
    try:
        yield
    except RealityGapError as error:
        connection.send(error)
    except (EOFError, OSError):
        pass


@contextmanager
def _deaf() -> Iterator[None]:
    """Ctrl-C waits: a process that starts here is spared it until it can ignore it, as it soon does."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def serve(connection: Connection, folder: str) -> None:
    """Take a run, send its messages, until the parent is gone."""
    with at_work(connection):
        agree(Path(folder))  # the parent has asked
        workshop = Workshop(read_materials(Path(folder)))
        while True:
            for message in workshop.carry_out(connection.recv()):
                connection.send(message)


def refuse_unguarded_script() -> None:
    """Refuse to start processes while this one is itself being spawned: a script without a guard.

    Raises:
        StudyError: says where the call belongs.
    """
    if getattr(multiprocessing.current_process(), "_inheriting", False):
        raise StudyError('call run_study under `if __name__ == "__main__":`, or with workers=1.')


def _die_with_parent() -> None:
    """Wait for the parent's end, then end this process."""
    parent = multiprocessing.parent_process()
    assert parent is not None
    parent.join()
    os._exit(1)
