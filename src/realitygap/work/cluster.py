"""The pool of a Dask cluster: jobs and messages travel, nothing else is shared.

    dask scheduler                                       # on one machine
    dask worker tcp://HOST:8786 --nthreads 1             # on each other one, a worker a core
    realitygap evolve avoidance --workers dask:tcp://HOST:8786

A job's messages come when it is done. The scheduler gives the jobs of a lost worker to others.
"""

import asyncio
import logging
import platform
from collections.abc import Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from functools import cache
from hashlib import blake2b
from importlib.metadata import PackageNotFoundError, version
from itertools import islice
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Any

from realitygap.errors import ConfigError, RealityGapError, StudyError
from realitygap.work.pool import Setup, Tell, bench_of

__all__ = ["Dask"]

PACKAGES = ("realitygap", "numpy", "scipy", "numba", "mujoco-core", "opencv-python-headless")
"""Which versions a result's bits may depend on, beside Python's."""
KINDS = (".py", ".toml", ".npz", ".json", ".csv", ".cpp")
"""Which of realitygap's own files they may depend on."""
TRIES = 3
"""How often a job is given up by the scheduler, which tries more than once itself, until it is here too."""
WAIT_S = 10.0
PATIENCE_S = 600.0
"""How long there may be no worker at all, or no word of the scheduler's."""
AHEAD = 3
"""Jobs that are sent for each thread of the cluster, so that none waits and new workers find some."""
_Answer = tuple[list[Any], RealityGapError | None]
"""A job's messages, and the error that it ended with: what was told before it is heard too."""
KEPT = "What was saved is kept: resume, or start again"


async def _greeted(address: str) -> None:
    """Exchange first words with a scheduler: for one that never answers a client would wait without end."""
    from distributed.comm import connect
    from distributed.security import Security

    how = Security().get_connection_args("client")
    comm = await asyncio.wait_for(connect(address, timeout=WAIT_S, **how), WAIT_S)
    await comm.close()


class Dask:
    """The workers of a scheduler, by its address, such as "tcp://HOST:8786".

    Raises:
        ConfigError: the package is not installed, or no scheduler answers there.
    """

    far = True
    """Its workers do not see this machine's files."""

    def __init__(self, address: str) -> None:
        try:
            from distributed import Client
        except ImportError:
            raise ConfigError(
                "workers: expected the package distributed for dask:…; install it: "
                "pip install 'realitygap[cluster]'."
            ) from None
        for name in ("distributed", "distributed.client"):  # what they have to say is told as an error
            logging.getLogger(name).setLevel(logging.CRITICAL)
        try:
            with ThreadPoolExecutor(1) as apart:  # a notebook's thread has a loop of its own
                apart.submit(asyncio.run, _greeted(address)).result()
            self._client = Client(address, timeout=WAIT_S, set_as_default=False)
        except (OSError, ValueError, TypeError) as error:
            said = f"no Dask scheduler answers at {address!r} ({str(error) or type(error).__name__})"
            cure = (
                "Start one (`dask scheduler`), or give the address that it prints, as dask:tcp://HOST:8786."
            )
            raise ConfigError(f"workers: {said}. {cure}") from None

    def work(self, setup: Setup, jobs: Iterable[Any], tell: Tell) -> None:
        """Carry out all jobs; see `pool.Pool`.

        Raises:
            StudyError: also: other versions there, no worker for a while, or the scheduler is gone.
        """
        sent, done = dict[Any, tuple[Any, int]](), SimpleQueue[Any]()
        source = ((job, 0) for job in jobs)

        def send(tasks: Iterable[tuple[Any, int]]) -> None:
            for job, lost in tasks:
                with _reached():
                    future = self._client.submit(_answer, setup, job, versions(), pure=False)
                sent[future] = job, lost
                future.add_done_callback(done.put)

        try:
            while True:
                send(islice(source, max(0, AHEAD * max(8, self._threads()) - len(sent))))
                if not sent:
                    return
                future = self._next(done)
                job, lost = sent.pop(future)
                answer = self._heard(future, lost)
                if answer is None:
                    send([(job, lost + 1)])
                    continue
                messages, error = answer
                for message in messages:
                    tell(message)
                if error is not None:
                    raise error
        except BaseException:
            with suppress(Exception):  # a scheduler that is gone has nothing to cancel
                self._client.cancel(list(sent), force=True)
            raise

    def _heard(self, future: Any, lost: int) -> _Answer | None:
        """What came of a job that was given up so often before; None if it is to be made again."""
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
            if lost + 1 < TRIES:
                return None
            said = f"a worker process died again and again on one job ({why}). {KEPT}"
            raise StudyError(f"{said}, with workers that have more memory if that ran out.") from None
        except Exception as why:
            said = f"a Dask worker cannot run a job ({type(why).__name__}: {why})"
            raise StudyError(f"{said}. Install the same realitygap there, in the same Python.") from why

    def _next(self, done: SimpleQueue[Any]) -> Any:
        """A job that is over, however long that takes while there are workers."""
        alone_s = 0.0
        while alone_s < PATIENCE_S:
            with suppress(Empty):
                return done.get(timeout=WAIT_S)
            alone_s = 0.0 if self._threads() else alone_s + WAIT_S
        raise StudyError(f"there has been no Dask worker for {PATIENCE_S:g} s. {KEPT}, with `dask worker`.")

    @property
    def alone(self) -> bool:
        """Whether no worker is there."""
        return not self._threads()

    def close(self) -> None:
        """Leave the cluster; its workers stay."""
        self._client.close()

    def _threads(self) -> int:
        """Of all workers that are there."""
        with _reached():
            return sum(self._client.sync(self._client.nthreads, callback_timeout=PATIENCE_S).values())


@contextmanager
def _reached() -> Iterator[None]:
    """What is wrong with the scheduler as one StudyError."""
    from distributed.client import ClosedClientError

    try:
        yield
    except (OSError, ClosedClientError) as error:
        raise _gone(error) from None


def _gone(why: Exception) -> StudyError:
    """A scheduler that no longer answers."""
    said = f"the Dask scheduler no longer answers ({why}). {KEPT}"
    return StudyError(f"{said}, when it and its workers are there.")


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
