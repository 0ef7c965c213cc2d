"""Workers as a person asks for them: a number of processes, or a pool of your own."""

import os
from collections.abc import Iterator
from contextlib import closing, contextmanager

from realitygap.errors import ConfigError
from realitygap.plugins import blamed_on, named_object, place_of
from realitygap.work.pool import Counted, Here, Pool, Processes

__all__ = ["MOST", "Workers", "cores", "far", "named_pool", "near", "opened", "size_of"]

MOST = 1024
"""Processes."""

Workers = int | Pool | None
"""So many processes, 1 for this one alone, None for one a core; or a pool."""


def cores() -> int:
    """Cores that this process may use."""
    if hasattr(os, "process_cpu_count"):  # Python 3.13
        return os.process_cpu_count() or 1
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


@contextmanager
def opened(workers: Workers, *, one_thread: bool = False) -> Iterator[Pool]:
    """The pool for a while; one that was given is counted, and left open. `one_thread`: as of `Processes`.

    Raises:
        ConfigError: neither a number nor a pool.
    """
    if isinstance(workers, Pool):
        yield workers if type(workers) in (Here, Processes, Counted) else Counted(workers)
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


def named_pool(text: str) -> Pool:
    """The pool that `file.py:Name` or `module:Name` makes, called without arguments; or "dask:ADDRESS".

    Raises:
        ConfigError: what is named is not a pool; says what it lacks.
        StudyError: workers with other versions than this process.
    """
    if text.startswith("dask:"):
        from realitygap.work.cluster import Dask

        return Dask(text.removeprefix("dask:"))
    make, file = named_object(text, ConfigError, "workers"), place_of(text)
    place = text.rpartition(":")[0] if file is None else file[0].resolve()
    with blamed_on(place, ConfigError, f"{text.rpartition(':')[2]}() fails"):
        pool = make() if callable(make) else make
    if not isinstance(pool, Pool):
        raise ConfigError(f"workers: {text}: expected a pool, with methods work and close, got {pool!r}.")
    return pool
