"""A Dask cluster of real processes: the contract, lost workers, the same bits as in one process."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

pytest.importorskip("distributed", reason="needs the extra: pip install 'realitygap[cluster]'")

from realitygap.errors import ConfigError, StudyError
from realitygap.study.runner import run_study
from realitygap.testing import PoolContract
from realitygap.transfer.options import Transfer
from realitygap.transfer.run import run_transfer
from realitygap.work import cluster
from realitygap.work.archive import unpacked
from realitygap.work.cluster import Dask, named_pool
from realitygap.work.pool import Setup
from tests.study.helpers import content, small

pytestmark = pytest.mark.filterwarnings("ignore::ResourceWarning", "ignore::DeprecationWarning")
KILLS = 2


def dask(kind: str, *words: object, log: Path) -> subprocess.Popen[bytes]:
    """A process of the cluster."""
    command = [sys.executable, "-m", f"distributed.cli.dask_{kind}", *map(str, words), "--no-dashboard"]
    with log.open("wb") as file:
        return subprocess.Popen(command, stdout=file, stderr=file)


@pytest.fixture(scope="module")
def cluster_of_two(tmp_path_factory):
    """A scheduler's address; two workers, the second one's nanny starts it anew when it is killed."""
    place = tmp_path_factory.mktemp("dask")
    file = place / "scheduler.json"
    started = [dask("scheduler", "--port", "0", "--scheduler-file", file, log=place / "scheduler.log")]
    while not file.is_file():
        assert started[0].poll() is None, (place / "scheduler.log").read_text()
        time.sleep(0.05)
    address = json.loads(file.read_text())["address"]
    for kind in ("--no-nanny", "--nanny"):
        words = (address, "--nthreads", "1", kind, "--local-directory", place / kind)
        started.append(dask("worker", *words, log=place / f"worker{kind}.log"))
    yield address, started[2].pid
    started[2].terminate()  # a nanny ends its worker with itself
    try:
        started[2].wait(60)
    finally:
        for process in started:
            process.kill()
            process.wait()


@pytest.fixture(scope="module")
def address(cluster_of_two) -> str:
    """When both workers are there."""
    pool = Dask(cluster_of_two[0])
    pool._client.wait_for_workers(2, timeout=60)
    pool.close()
    return cluster_of_two[0]


class TestDask(PoolContract):
    """Two workers; that they are lost again and again is tried below."""

    @pytest.fixture(autouse=True)
    def _at(self, address):
        self.address = address

    def opened(self):
        return Dask(self.address)


def killing(nanny: int, kills: list[int], over: threading.Event) -> None:
    """Kill the nanny's worker whenever it is up and at work for a moment."""
    while len(kills) < KILLS and not over.wait(0.4):
        told = subprocess.run(["pgrep", "-P", str(nanny), "-f", "spawn_main"], capture_output=True, text=True)
        for pid in map(int, told.stdout.split()):
            if pid not in kills:
                time.sleep(0.6)
                os.kill(pid, signal.SIGKILL)
                kills.append(pid)


def test_a_study_is_the_same_though_a_worker_dies_again_and_again(
    cluster_of_two,
    address,
    finished,
    tmp_path,
):
    """Every table, genotype and checkpoint, as one process made them."""
    kills: list[int] = []
    over = threading.Event()
    killer = threading.Thread(target=killing, args=(cluster_of_two[1], kills, over))
    pool = named_pool(f"dask:{address}")
    killer.start()
    try:
        late, number = time.monotonic() + 180.0, 0
        while not number or (len(kills) < KILLS and time.monotonic() < late):  # studies are small
            number += 1
            folder = tmp_path / f"study-{number}"
            assert content(run_study(folder, small(), workers=pool).folder) == content(finished.folder)
        pool._client.wait_for_workers(2, timeout=60)
    finally:
        over.set()
        killer.join()
        pool.close()
    assert len(kills) == KILLS


def _files(transfers):
    """What transfers keep, by name; trials in archives included."""
    with unpacked(transfers) as folder:
        return {str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("[!.]*.*") if p.is_file()}


def test_trials_come_back_as_messages(address, finished, tmp_path):
    """A transfer by workers that see nothing of the study is that of one process, file by file."""
    places = [Path(shutil.copytree(finished.folder, tmp_path / name)) for name in ("near", "far")]
    pool = Dask(address)
    for place, workers in zip(places, (1, pool), strict=True):
        run_transfer(place, Transfer(robots=("twin:1",), runs=("1",), starts=2, seconds=1.0), workers=workers)
    pool.close()
    near, away = (_files(one / "transfer") for one in places)
    assert near.keys() == away.keys() and sum(name.endswith("situated.csv") for name in near) == 2
    for name, data in near.items():
        if name.endswith((".csv", ".json")) and "steps.csv" not in name:  # which has the computer's own times
            assert data == away[name], name
    theirs = Transfer(robots=("mine.py:Robot",), runs=("1",))
    assert theirs.bodies[0].kind == "own"


def test_what_is_no_cluster_is_refused(address, monkeypatch):
    """An address where nobody answers, one of nonsense, and workers with other versions, by name."""
    monkeypatch.setattr(cluster, "WAIT_S", 0.5)
    for wrong in ("tcp://127.0.0.1:9", "nonsense://", ""):
        with pytest.raises(
            ConfigError, match=r"no Dask scheduler answers at .*Start one \(`dask scheduler`\)"
        ):
            named_pool(f"dask:{wrong}")
    other = {**cluster.versions(), "numba": "0.1"}
    monkeypatch.setattr(cluster, "versions", lambda: other)
    pool = Dask(address)
    with pytest.raises(
        StudyError, match=r"the Dask worker on .* has numba \S+, this process 0\.1: .*the same"
    ):
        pool.work(Setup(Bench), [[1]], [].append)
    pool.close()


class Future:
    """What a scheduler promises: an error or an answer."""

    def __init__(self, outcome) -> None:
        self.outcome = outcome

    def add_done_callback(self, call) -> None:
        call(self)

    def result(self, timeout):
        assert timeout > 0
        if isinstance(self.outcome, Exception):
            raise self.outcome
        return self.outcome


class Client:
    """A cluster that carries a job out when it has lost it so often."""

    status = "running"

    def __init__(self, losses=0, threads=1, *, gone=False, mute=False) -> None:
        self.losses, self.threads, self.gone, self.mute = losses, threads, gone, mute
        self.lost: dict[int, int] = {}

    def submit(self, carry_out, setup, job, theirs, *, pure):
        self.lost[job[0]] = self.lost.get(job[0], 0) + 1
        if self.lost[job[0]] <= self.losses:
            return Future(OSError("the worker is gone"))
        return Future(carry_out(setup, job, theirs))

    def sync(self, call, *words, callback_timeout, **more):
        if self.mute:
            raise TimeoutError(f"mute for {callback_timeout:g} s")
        return call(*words, **more)

    def nthreads(self):
        assert not self.mute, "waits without end"
        if self.gone:
            raise OSError("no route to host")
        return {"worker": self.threads} if self.threads else {}

    def cancel(self, futures, force):
        raise OSError("nobody there to cancel")


class Bench:
    """Tells a job's number; a negative one is refused after that."""

    def carry_out(self, job, tell):
        tell(job[0])
        if job[0] < 0:
            raise ConfigError(f"{job[0]} is refused")

    def close(self):
        pass


def worked(client: Client, jobs: range = range(60)) -> list[int]:
    """What is heard of jobs, each an object of its own that is soon forgotten."""
    pool = object.__new__(Dask)
    pool._client = client
    heard: list[int] = []
    pool.work(Setup(Bench), ([number] for number in jobs), heard.append)
    return heard


def test_losses_are_counted_job_by_job():
    """Sixty jobs that are each lost twice are all made; one that is lost three times ends the work."""
    assert sorted(worked(Client(losses=2))) == [*range(60)]
    with pytest.raises(StudyError, match="a worker process died again and again on one job"):
        worked(Client(losses=3))


def test_what_was_told_before_an_error_is_heard():
    """As by processes: what a trial recorded until it failed is kept."""
    heard: list[int] = []
    pool = object.__new__(Dask)
    pool._client = Client()
    with pytest.raises(ConfigError, match=r"^-1 is refused$"):
        pool.work(Setup(Bench), [[-1]], heard.append)
    assert heard == [-1]


def test_no_wait_for_a_cluster_is_without_end(monkeypatch):
    """Without a scheduler: one message with the cure."""
    lost = Client(losses=1)
    lost.status = "connecting"
    with pytest.raises(StudyError, match=r"scheduler no longer answers \(the worker is gone\)\. .*resume"):
        worked(lost)
    monkeypatch.setattr(cluster, "WAIT_S", 0.01)
    monkeypatch.setattr(cluster, "PATIENCE_S", 0.05)
    with pytest.raises(StudyError, match=r"scheduler no longer answers \(no route to host\)\. .*resume"):
        worked(Client(gone=True))
    with pytest.raises(StudyError, match=r"scheduler no longer answers \(mute for 0\.05 s\)\. .*resume"):
        worked(Client(mute=True))
