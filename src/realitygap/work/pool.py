"""A pool carries out jobs and passes on their results: this process, processes, or one of your own.

A job is a value, and what it comes to a function of it alone: any worker may carry it out, twice if the
first is lost. A worker gets its bench from a `Setup`, which travels as a message; where it is, is up to
the pool. One whose workers do not see the parent's files says so by an attribute, `far = True`:
then what they need of them travels too. examples/own_pool.py is a pool of one's own.
"""

import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import closing
from dataclasses import dataclass, field
from itertools import count
from typing import Any, NamedTuple, Protocol, runtime_checkable

from realitygap.errors import StudyError

__all__ = ["Bench", "Counted", "Here", "Pool", "Setup", "Tell", "bench_of", "messages_of"]

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
