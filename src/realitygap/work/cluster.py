"""The pool of a Dask cluster, where jobs and messages travel and nothing else is shared; pools by name.

    dask scheduler                                       # on one machine
    dask worker tcp://HOST:8786 --nthreads 1             # on each other one, a worker a core
    realitygap evolve avoidance --workers dask:tcp://HOST:8786

A job's messages come when it is done. The scheduler gives the jobs of a lost worker to others.
"""

import asyncio
import logging
import platform
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from functools import cache
from hashlib import blake2b
from importlib.metadata import PackageNotFoundError, version
from itertools import islice
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Any

from realitygap.errors import ConfigError, RealityGapError, StudyError
from realitygap.lazy import needed
from realitygap.plugins import blamed_on, named_object, place_of
from realitygap.work.pool import Pool, Setup, Tell, bench_of

__all__ = ["Dask", "named_pool"]

PACKAGES = ("realitygap", "numpy", "scipy", "numba", "mujoco-core", "opencv-python-headless")
"""Which versions a result's bits may depend on, beside Python's."""
KINDS = (".py", ".toml", ".npz", ".json", ".csv", ".cpp")
"""Which of realitygap's own files they may depend on."""
TRIES = 3
"""How often the scheduler may give up a job, which it itself tries several times."""
WAIT_S = 10.0
PATIENCE_S = 600.0
"""How long there may be no word of the scheduler's."""
AHEAD = 3
"""Jobs that are sent for each thread of the cluster, so that none waits and new workers find some."""
_Answer = tuple[list[Any], RealityGapError | None]
"""A job's messages, and the error that it ended with: what was told before it is heard too."""


def named_pool(text: str) -> Pool:
    """The pool that `file.py:Name` or `module:Name` makes, called without arguments; or "dask:ADDRESS".

    Raises:
        ConfigError: what is named is not a pool; says what it lacks.
    """
    if text.startswith("dask:"):
        return Dask(text.removeprefix("dask:"))
    make, file = named_object(text, ConfigError, "workers"), place_of(text)
    place = text.rpartition(":")[0] if file is None else file[0].resolve()
    with blamed_on(place, ConfigError, f"{text.rpartition(':')[2]}() fails"):
        pool = make() if callable(make) else make
    if not isinstance(pool, Pool):
        raise ConfigError(f"workers: {text}: expected a pool, with methods work and close, got {pool!r}.")
    return pool


async def _greet(address: str) -> None:
    """Exchange first words with a scheduler: for one that never answers a client would wait without end."""
    from distributed.comm import connect
    from distributed.security import Security

    how = Security().get_connection_args("client")
    comm = await asyncio.wait_for(connect(address, timeout=WAIT_S, **how), WAIT_S)
    await comm.close()


class Dask:
    """The workers of a scheduler, by its address, such as "tcp://HOST:8786".

    Raises:
        UsageError: the package is not installed.
        ConfigError: no scheduler answers there.
    """

    far = True
    """Its workers do not see this machine's files."""

    def __init__(self, address: str) -> None:
        distributed = needed("distributed", "cluster")
        for name in ("distributed", "distributed.client"):  # what they have to say is told as an error
            logging.getLogger(name).setLevel(logging.CRITICAL)
        try:
            with ThreadPoolExecutor(1) as apart:  # a notebook's thread has a loop of its own
                apart.submit(asyncio.run, _greet(address)).result()
            self._client = distributed.Client(address, timeout=WAIT_S, set_as_default=False)
        except (OSError, ValueError, TypeError) as error:
            raise ConfigError(
                f"workers: no Dask scheduler answers at {address!r} ({str(error) or type(error).__name__}). "
                "Start one (`dask scheduler`), or give the address that it prints, as dask:tcp://HOST:8786."
            ) from None

    def work(self, setup: Setup, jobs: Iterable[Any], tell: Tell) -> None:
        """Carry out all jobs, once there is a worker; see `pool.Pool`.

        Raises:
            StudyError: also: other versions there, or the scheduler is gone.
        """
        sent, done = dict[Any, tuple[Any, int]](), SimpleQueue[Any]()
        source = ((job, 0) for job in jobs)

        def send(tasks: Iterable[tuple[Any, int]]) -> None:
            for job, lost in tasks:
                future = self._ask(self._client.submit, _answer, setup, job, versions(), pure=False)
                sent[future] = job, lost
                future.add_done_callback(done.put)

        try:
            while True:
                send(islice(source, max(0, AHEAD * max(8, self._threads()) - len(sent))))
                if not sent:
                    return
                with suppress(Empty):
                    future = done.get(timeout=WAIT_S)
                    job, lost = sent.pop(future)
                    answer = self._heard(future, lost + 1)
                    if answer is None:
                        send([(job, lost + 1)])
                        continue
                    for message in answer[0]:
                        tell(message)
                    if answer[1] is not None:
                        raise answer[1]
        except BaseException:
            with suppress(Exception):  # a scheduler that is gone has nothing to cancel
                self._client.cancel(list(sent), force=True)
            raise

    def _heard(self, future: Any, tries: int) -> _Answer | None:
        """What came of a job that was tried so often; None if it is to be made again."""
        from distributed import KilledWorker
        from distributed.client import FutureCancelledError

        try:
            answer: _Answer = future.result(timeout=PATIENCE_S)
            return answer
        except RealityGapError:
            raise
        except (KilledWorker, FutureCancelledError, OSError) as why:
            if self._client.status != "running":
                raise _gone(why) from None
            if tries < TRIES:
                return None
            raise StudyError(
                f"a worker process died again and again on one job ({why}). What was saved is kept: resume, "
                "with workers that have more memory if that ran out."
            ) from None
        except Exception as why:
            raise StudyError(
                f"a Dask worker cannot run a job ({type(why).__name__}: {why}). Install the same realitygap "
                "there, in the same Python."
            ) from why

    @property
    def alone(self) -> bool:
        """Whether no worker is there."""
        return not self._threads()

    def close(self) -> None:
        """Leave the cluster; its workers stay."""
        self._client.close()

    def _threads(self) -> int:
        """Of all workers that are there."""
        return sum(self._ask(self._client.sync, self._client.nthreads, callback_timeout=PATIENCE_S).values())

    def _ask(self, call: Any, *words: Any, **more: Any) -> Any:
        """What the scheduler answers to a call of the client's."""
        from distributed.client import ClosedClientError

        try:
            return call(*words, **more)
        except (OSError, ClosedClientError) as error:
            raise _gone(error) from None


def _gone(why: Exception) -> StudyError:
    """A scheduler that no longer answers."""
    return StudyError(
        f"the Dask scheduler no longer answers ({why}). What was saved is kept: resume when it and its "
        "workers are there."
    )


def _answer(setup: Setup, job: Any, theirs: dict[str, str]) -> _Answer:
    """In a worker: what comes of a job.

    Raises:
        StudyError: this worker has other versions than the process that asks; names the first that differs.
    """
    ours = versions()
    for name, wanted in theirs.items():
        if ours.get(name) != wanted:
            raise StudyError(
                f"the Dask worker on {platform.node()} has {name} {ours.get(name)}, this process {wanted}: "
                "results might differ. Install the same there."
            )
    messages: list[Any] = []
    try:
        bench_of(setup).carry_out(job, messages.append)
    except RealityGapError as error:
        return messages, error
    return messages, None


@cache
def versions() -> dict[str, str]:
    """What a worker must have in common with this process; of realitygap its very files."""
    found = {"Python": platform.python_version()}
    for name in PACKAGES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = "missing"
    home, text = Path(__file__).parent.parent, blake2b(digest_size=6)
    for file in sorted(file for kind in KINDS for file in home.rglob(f"*{kind}")):
        text.update(f"{file.relative_to(home)}\n".encode() + file.read_bytes())
    return {**found, "realitygap's text": text.hexdigest()}
