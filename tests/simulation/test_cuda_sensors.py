"""What the threads of a warp do together has the processor's bits: by a warp of Python's threads."""

from __future__ import annotations

import importlib.util
import threading
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from realitygap.kernels.batch import stand
from realitygap.kernels.jit import kernel
from realitygap.kernels.light_beyond import goes_beyond
from realitygap.kernels.trial import ambient, draw_noise, infrared
from realitygap.simulation.engine import Cores
from realitygap.tasks import load_task
from realitygap.world.arena import Arena, Cylinder
from realitygap.world.robot import load_profile

if importlib.util.find_spec("numba_cuda") is None:
    pytest.skip('no numba-cuda here: pip install "realitygap[cuda]"', allow_module_level=True)

from realitygap.simulation import cuda_sensors

LANES = 32


class Warp:
    """Threads that meet, vote and share arrays, as a GPU's do, for cuda_sensors.py."""

    def __init__(self) -> None:
        self.meeting, self.votes = threading.Barrier(LANES, timeout=60), np.zeros(LANES, bool)
        self.thread, self.lock = threading.local(), threading.Lock()
        self.arrays: dict[int, np.ndarray] = {}
        self.shared = SimpleNamespace(array=self._shared)

    @property
    def threadIdx(self) -> SimpleNamespace:
        return SimpleNamespace(x=self.thread.lane)

    def _shared(self, shape: tuple[int, ...], kind: Any) -> np.ndarray:
        """The array that all threads ask for at this place."""
        self.thread.asked += 1
        with self.lock:
            return self.arrays.setdefault(self.thread.asked, np.full(shape, 77, np.dtype(str(kind))))

    def syncwarp(self) -> None:
        self.meeting.wait()

    def ballot_sync(self, mask: int, vote: Any) -> int:
        assert mask == 2**LANES - 1
        self.votes[self.thread.lane] = vote
        self.meeting.wait()
        found = sum(1 << int(lane) for lane in np.flatnonzero(self.votes))
        self.meeting.wait()
        return found

    def any_sync(self, mask: int, vote: Any) -> bool:
        return self.ballot_sync(mask, vote) != 0

    def popc(self, bits: int) -> int:
        return int(bits).bit_count()

    def jit(self, **_how: Any) -> Any:
        return lambda function: function

    def run(self, lane_does: Any) -> None:
        """Call a function in each of the threads, with its number."""
        failed: list[BaseException] = []

        def go(lane: int) -> None:
            self.thread.lane, self.thread.asked = lane, 0
            try:
                lane_does(lane)
            except BaseException as error:  # the others would wait
                failed.append(error)
                self.meeting.abort()

        threads = [threading.Thread(target=go, args=(lane,)) for lane in range(LANES)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        for error in failed:
            raise error


@pytest.fixture
def warp(monkeypatch) -> Warp:
    found = Warp()
    monkeypatch.setattr(cuda_sensors, "cuda", found)
    return found


@kernel
def set_up(pose, work):
    stand(pose, work)


@kernel
def seen(robot, arena, work, out):
    infrared(robot, arena, work, out)


@kernel
def lit(robot, arena, work, out):
    ambient(robot, arena, work, out)


@kernel
def drawn(level, stream, k, sensors, work):
    draw_noise(level, stream, k, sensors, work)


class Trials:
    """Robots at random places, and the scratch of each thread that has one of them."""

    def __init__(self, name: str, profile: str, each: int, arena: Arena | None = None) -> None:
        robot, task = load_profile(profile), load_task(name)
        lamps = task.arena.lamps
        if lamps:  # two of them
            lamps = (*lamps, replace(lamps[0], x_cm=lamps[0].x_cm - 5.0))
        task = replace(task, arena=arena or replace(task.arena, lamps=lamps), sensors=()).of(robot)
        self.cores, self.each, random = Cores(task, robot, 1.0), each, np.random.default_rng(each)
        width, depth = task.arena.size_cm
        self.poses = [random.uniform((4, 4, -3), (width - 4, depth - 4, 3)) for _ in range(each)]

    def scratch(self, which: int) -> Any:
        from realitygap.kernels.work import new_work, quiet

        work = new_work(self.cores.robot, self.cores.trial, quiet())
        set_up(self.poses[which], work)
        return work._replace(settled=np.array([0, self.each], np.int64))


@pytest.mark.parametrize("each", [32, 8, 2, 1])
@pytest.mark.parametrize(
    ("profile", "walls"), [("paper", False), ("khepera", False), ("enki-epuck", False), ("paper", True)]
)
def test_proximity_sensors_read_as_the_processors(warp, profile, walls, each):
    """Printed, Lambertian and measured ones, among cylinders, and inner walls."""
    plain = load_task("obstacle-avoidance").arena
    some = tuple(Cylinder(x_cm=x, y_cm=y, radius_cm=2.5) for x, y in ((15, 40), (44, 14)))
    inner = ((20.0, 8.0, 30.0, 10.0), (40.0, 35.0, 41.0, 50.0))
    room = replace(plain, cylinders=some, walls=inner) if walls else plain
    trials = Trials("obstacle-avoidance", profile, each, room)
    sensors = len(trials.cores.robot.proximity_place)
    see = cuda_sensors.shared_infrared(lambda made: made, sensors, 1)
    found, expected = np.zeros((LANES, sensors)), np.zeros((each, sensors))
    robot, arena = trials.cores.robot, trials.cores.arena
    warp.run(lambda lane: see(robot, arena, trials.scratch(lane % each), found[lane]))
    for which in range(each):
        seen(robot, arena, trials.scratch(which), expected[which])
    assert np.array_equal(found, expected[np.arange(LANES) % each])
    assert each < 8 or np.count_nonzero(expected) > each


@pytest.mark.parametrize("each", [32, 8, 2, 1])
def test_ambient_sensors_read_as_the_processors(warp, each):
    """By the printed law, two lamps; the number of rays does not divide by that of a trial's threads."""
    trials = Trials("light-seeking", "paper", each)
    robot, arena, sensors = trials.cores.robot, trials.cores.arena, 8
    assert not goes_beyond.py_func(robot) and len(arena.lamp_points) == 2
    see = cuda_sensors.shared_ambient(lambda made: made, 1)
    found, expected = np.zeros((LANES, sensors)), np.zeros((each, sensors))
    warp.run(lambda lane: see(robot, arena, trials.scratch(lane % each), found[lane]))
    for which in range(each):
        lit(robot, arena, trials.scratch(which), expected[which])
    assert np.array_equal(found, expected[np.arange(LANES) % each])
    assert len(np.unique(expected)) > 4


@pytest.mark.parametrize("each", [32, 4, 1])
def test_normal_numbers_are_the_processors(warp, each):
    """Of three steps; each thread has its own, since readings by a table scale them in place."""
    trials = Trials("obstacle-avoidance", "khepera", each)
    draw = cuda_sensors.shared_noise(lambda made: made, 16, 1)
    works = [trials.scratch(lane % each) for lane in range(LANES)]
    alone, streams = trials.scratch(0), np.arange(40, 40 + each).astype(np.uint64)

    def step(lane: int, k: int) -> None:
        draw(1.0, streams[lane % each], k, 8, works[lane])
        seen[lane] = works[lane].noise
        works[lane].noise[:] *= lane + 2.0

    for k in range(3):
        seen = np.zeros((LANES, 16))
        warp.run(lambda lane, k=k: step(lane, k))
        for lane in range(LANES):
            drawn(1.0, streams[lane % each], k, 8, alone)
            assert np.array_equal(seen[lane], alone.noise) and alone.noise.any()
