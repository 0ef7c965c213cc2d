"""The pool of a Dask cluster: jobs and messages travel, nothing else is shared.

    dask scheduler                                       # on one machine
    dask worker tcp://HOST:8786 --nthreads 1             # on each other one, a worker a core
    realitygap evolve avoidance --workers dask:tcp://HOST:8786

A job's messages come when it is done. The scheduler gives the jobs of a lost worker to others.
"""

import asyncio
import gc
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
from typing import Any, NamedTuple

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
MUTE = "what listens there is none"
AHEAD = 3
"""Jobs that are sent for each thread of the cluster, so that none waits and new workers find some."""


class _Answer(NamedTuple):
    """A job's messages, and the error that it ended with: what was told before it is heard too."""

    messages: list[Any]
    error: RealityGapError | None = None


async def _greeted(address: str) -> None:
    """Exchange first words with a scheduler, for which a client would wait without end."""
    from distributed.comm import connect
    from distributed.security import Security

    how = Security().get_connection_args("client")
    comm = await asyncio.wait_for(connect(address, timeout=WAIT_S, **how), WAIT_S)
    await comm.close()


class Dask:
    """The workers of a scheduler, by its address, such as "tcp://HOST:8786".

    Raises:
        ConfigError: the package is not installed, or no scheduler answers there.
        StudyError: workers with other versions than this process, by their names.
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
        gc.collect()  # a client that failed earlier waits for ever if it is collected while this one starts
        try:
            with ThreadPoolExecutor(1) as apart:  # a notebook's thread has a loop of its own
                apart.submit(asyncio.run, _greeted(address)).result()
            try:
                self._client = Client(address, timeout=WAIT_S, set_as_default=False)
            except AssertionError:  # its own thread had not begun within ten seconds: the machine stood still
                self._client = Client(address, timeout=WAIT_S, set_as_default=False)
        except (OSError, ValueError, TypeError) as error:
            raise ConfigError(
                f"workers: no Dask scheduler answers at {address!r} ({str(error) or MUTE}). Start one "
                "(`dask scheduler`), or give the address that it prints, such as dask:tcp://HOST:8786."
            ) from None
        try:
            self._check_workers()
        except BaseException:
            self.close()
            raise

    def work(self, setup: Setup, jobs: Iterable[Any], tell: Tell) -> None:
        """Carry out all jobs; see `pool.Pool`.

        Raises:
            StudyError: also: there has been no worker for a while, or the scheduler is gone.
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
            send(islice(source, self._most()))
            while sent:
                future = self._next(done)
                job, lost = sent.pop(future)
                answer = self._heard(future, lost)
                if answer is None:
                    send([(job, lost + 1)])
                    continue
                for message in answer.messages:
                    tell(message)
                if answer.error is not None:
                    raise answer.error
                send(islice(source, max(0, self._most() - len(sent))))
        except BaseException:
            with suppress(Exception):  # a scheduler that is gone has nothing to cancel
                self._client.cancel(list(sent), force=True)
            raise

    def _next(self, done: SimpleQueue[Any]) -> Any:
        """A job that is over, however long that takes while there are workers.

        Raises:
            StudyError: there has been none for a while.
        """
        alone_s = 0.0
        while alone_s < PATIENCE_S:
            with suppress(Empty):
                return done.get(timeout=WAIT_S)
            alone_s = 0.0 if self._threads() else alone_s + WAIT_S
        raise StudyError(
            f"there has been no Dask worker for {PATIENCE_S:g} s. What was saved is kept: start workers "
            "(`dask worker`, with the scheduler's address), and resume or start again."
        )

    @property
    def alone(self) -> bool:
        """Whether no worker is there."""
        return not self._threads()

    def close(self) -> None:
        """Leave the cluster; its workers stay."""
        self._client.close()

    def _most(self) -> int:
        """Jobs to be under way."""
        return AHEAD * max(8, self._threads())

    def _threads(self) -> int:
        """Of all workers that are there."""
        with _reached():
            ask = self._client.nthreads
            return sum(self._client.sync(ask, callback_timeout=PATIENCE_S).values())

    def _heard(self, future: Any, lost: int) -> _Answer | None:
        """What came of a job that was given up so often before; None if it is to be made again.

        Raises:
            StudyError: its workers are lost again and again, or cannot make it.
        """
        from distributed import KilledWorker
        from distributed.client import FutureCancelledError

        try:
            answer: _Answer = future.result(timeout=PATIENCE_S)
            return answer
        except RealityGapError:
            raise
        except (KilledWorker, FutureCancelledError, OSError) as error:
            if self._client.status != "running":
                raise _gone(error) from None
            if lost + 1 >= TRIES:
                raise StudyError(
                    f"a worker process died again and again on one job ({error}). What was saved is kept: "
                    "resume, or start again, with workers that have more memory if that ran out."
                ) from None
            return None
        except Exception as error:
            raise _strange(error) from error

    def _check_workers(self) -> None:
        """Refuse workers that are not as this process; each job asks again."""
        ask, answers = self._client.run, dict[str, Any]()
        with suppress(TimeoutError):  # a worker that is suspended
            answers = self._client.sync(
                ask, _refuse_other, versions(), on_error="return", callback_timeout=WAIT_S
            )
        for answer in answers.values():
            if isinstance(answer, RealityGapError):
                raise answer
            if isinstance(answer, Exception) and not isinstance(answer, OSError):  # or it was just lost
                raise _strange(answer)


@contextmanager
def _reached() -> Iterator[None]:
    """What is wrong with the scheduler as one StudyError."""
    from distributed.client import ClosedClientError

    try:
        yield
    except (OSError, ClosedClientError) as error:
        raise _gone(error) from None


def _gone(error: Exception) -> StudyError:
    """A scheduler that no longer answers."""
    return StudyError(
        f"the Dask scheduler no longer answers ({error}). What was saved is kept: start it and "
        "its workers, and resume or start again."
    )


def _strange(error: Exception) -> StudyError:
    """What a worker says that cannot even begin."""
    return StudyError(
        f"a Dask worker cannot run a job ({type(error).__name__}: {error}). Install the same "
        "realitygap there, in the same Python."
    )


def _answer(setup: Setup, job: Any, theirs: dict[str, str]) -> _Answer:
    """In a worker: what comes of a job."""
    _refuse_other(theirs)
    messages: list[Any] = []
    try:
        bench_of(setup).carry_out(job, messages.append)
    except RealityGapError as error:
        return _Answer(messages, error)
    return _Answer(messages)


def _refuse_other(theirs: dict[str, str]) -> None:
    """In a worker: see that its versions are those of the process that asks.

    Raises:
        StudyError: names the first that differs.
    """
    ours = versions()
    for name, wanted in theirs.items():
        if ours.get(name) != wanted:
            raise StudyError(
                f"the Dask worker on {platform.node()} has {name} {ours.get(name)}, this process {wanted}: "
                "results might differ. Install the same there."
            )


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
