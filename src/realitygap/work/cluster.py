"""The pool of a Dask cluster: jobs and messages travel, nothing else is shared.

    dask scheduler                                       # on one machine
    dask worker tcp://HOST:8786 --nthreads 1             # on each other one, a worker a core
    realitygap evolve avoidance --workers dask:tcp://HOST:8786

A job's messages come when it is done. The scheduler gives the jobs of a lost worker to others.
"""

import logging
import platform
from collections.abc import Callable, Iterable
from functools import cache
from hashlib import blake2b
from importlib.metadata import PackageNotFoundError, version
from itertools import islice
from pathlib import Path
from typing import Any

from realitygap.errors import ConfigError, RealityGapError, StudyError
from realitygap.work.pool import Setup, Tell, messages_of

__all__ = ["Dask"]

PACKAGES = ("realitygap", "numpy", "scipy", "numba", "mujoco-core", "opencv-python-headless")
"""Which versions a result's bits may depend on, beside Python's."""
TRIES = 3
"""How often a job is given up by the scheduler, which tries more than once itself, until it is here too."""
WAIT_S = 10.0
AHEAD = 3
"""Jobs that are sent for each thread of the cluster, so that none waits and new workers find some."""


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
        logging.getLogger("distributed").setLevel(logging.CRITICAL)  # what it has to say is told as an error
        try:
            try:
                self._client = Client(address, timeout=WAIT_S, set_as_default=False)
            except AssertionError:  # its own thread had not begun within ten seconds: the machine stood still
                self._client = Client(address, timeout=WAIT_S, set_as_default=False)
        except (OSError, ValueError, TypeError) as error:
            raise ConfigError(
                f"workers: no Dask scheduler answers at {address!r} ({error}). Start one (`dask scheduler`), "
                "or give the address that it prints, such as dask:tcp://HOST:8786."
            ) from None
        try:
            self._check_workers()
        except BaseException:
            self.close()
            raise

    def work(self, setup: Setup, jobs: Iterable[Any], tell: Tell) -> None:
        """Carry out all jobs; see `pool.Pool`."""
        from distributed import as_completed

        source, lost = iter(jobs), dict[Any, int]()
        sent: dict[Any, Any] = {}
        done = as_completed(loop=self._client.loop)

        def send(job: Any) -> None:
            future = self._client.submit(_answer, setup, job, versions(), pure=False)
            sent[future] = job
            done.add(future)

        try:
            for job in islice(source, self._most()):
                send(job)
            for future in done:
                job = sent.pop(future)
                for message in self._heard(future, lost, job, send):
                    tell(message)
                for following in islice(source, max(0, self._most() - len(sent))):
                    send(following)
        except BaseException:
            self._client.cancel(list(sent), force=True)
            raise

    def close(self) -> None:
        """Leave the cluster; its workers stay."""
        self._client.close()

    def _most(self) -> int:
        """Jobs to be under way."""
        threads: int = sum(self._client.nthreads().values())
        return AHEAD * max(8, threads)

    def _heard(self, future: Any, lost: dict[Any, int], job: Any, send: Callable[[Any], None]) -> list[Any]:
        """What came of a job; nothing if it is made again.

        Raises:
            RealityGapError: as the job raised it.
            StudyError: its workers are lost again and again, or cannot make it.
        """
        from distributed import KilledWorker
        from distributed.client import FutureCancelledError

        try:
            messages: list[Any] = future.result()
            return messages
        except RealityGapError:
            raise
        except (KilledWorker, FutureCancelledError, OSError) as error:
            lost[id(job)] = lost.get(id(job), 0) + 1
            if lost[id(job)] >= TRIES or self._client.status != "running":
                raise StudyError(
                    f"a worker process died again and again at one job, or the scheduler did ({error}). "
                    "What was saved is kept: resume, with workers that have more memory if that ran out."
                ) from None
            send(job)
            return []
        except Exception as error:
            raise _strange(error) from error

    def _check_workers(self) -> None:
        """Refuse workers that are not as this process."""
        answers = self._client.run(_refuse_other, versions(), on_error="return")
        for answer in answers.values():
            if isinstance(answer, RealityGapError):
                raise answer
            if isinstance(answer, Exception):
                raise _strange(answer)


def _strange(error: Exception) -> StudyError:
    """What a worker says that cannot even begin."""
    return StudyError(
        f"a Dask worker cannot carry out a job ({type(error).__name__}: {error}). Install the same "
        "realitygap there, in the same Python."
    )


def _answer(setup: Setup, job: Any, theirs: dict[str, str]) -> list[Any]:
    """In a worker: all messages of a job."""
    _refuse_other(theirs)
    return messages_of(setup, job)


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
    """What a worker has to have in common with who asks; of realitygap its very text."""
    found = {"Python": platform.python_version()}
    for name in PACKAGES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = "missing"
    home, text = Path(__file__).parent.parent, blake2b(digest_size=6)
    for file in sorted(home.rglob("*.py")):
        text.update(f"{file.relative_to(home)}\n".encode() + file.read_bytes())
    return {**found, "realitygap's text": text.hexdigest()}
