"""Whatever ends, freezes or suspends the driver or its guard, the robot stands, and what was read is kept."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from realitygap.errors import FrozenError, RobotStoppedError
from realitygap.robots.drive import Recorder, Recording, StopOnSignal, drive
from realitygap.robots.guard import SILENCE_S, TICK_S, Watchdog
from tests.robots.conftest import ROOT, Bench
from tests.robots.controllers import Constant, Wary, bands
from tests.robots.test_faults import comes_to_stand
from tests.served import Served

ENDS = {
    signal.SIGINT: "RobotStoppedError: stopped by SIGINT",
    signal.SIGTERM: "RobotStoppedError: stopped by SIGTERM",
    signal.SIGHUP: "RobotStoppedError: stopped by SIGHUP",
    signal.SIGKILL: "killed",
}


@contextmanager
def child(twin: Served, folder: Path) -> Iterator[subprocess.Popen[str]]:
    """A driver in a process of its own that has begun to drive; in a group of its own, as a shell's job."""
    with subprocess.Popen(
        [sys.executable, "-m", "tests.robots.child", twin.device, str(folder)],
        cwd=ROOT,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        process_group=0,
    ) as driver:
        try:
            assert driver.stdout is not None and driver.stdout.readline() == "driving\n"
            yield driver
        finally:
            driver.send_signal(signal.SIGCONT)
            driver.kill()


@pytest.mark.parametrize("number", ENDS, ids=lambda number: number.name)
def test_a_driver_that_is_stopped_or_killed_leaves_the_robot_standing(
    bench: Bench, tmp_path: Path, number: signal.Signals
) -> None:
    """Ctrl-C, also twice, SIGTERM and a closed terminal stop it first; after kill -9 the guard does."""
    twin = bench.twin()
    with child(twin, tmp_path / "r") as driver:
        driver.send_signal(number)
        if number == signal.SIGINT:
            time.sleep(0.02)
            driver.send_signal(number)
        assert driver.wait(60) != 0
    assert comes_to_stand(twin, tmp_path)
    recording = Recording.from_folder(tmp_path / "r")
    assert len(recording.t) >= 5 and (recording.counters[-1] > 0).all()
    assert recording.ended.startswith(ENDS[number])


def test_a_stop_that_hangs_can_be_left(monkeypatch: pytest.MonkeyPatch) -> None:
    """A signal while the robot is stopped waits; one that comes long after ends the wait."""
    monkeypatch.setattr("realitygap.robots.drive.PATIENCE_S", 0.2)
    passed = []
    with pytest.raises(RobotStoppedError, match="SIGINT again: the robot has not confirmed"):  # noqa: SIM117
        with StopOnSignal() as stopping, stopping.held():  # a driver's `stop`
            for _ in range(3):
                os.kill(os.getpid(), signal.SIGINT)
                passed.append("not disturbed")
            time.sleep(0.3)
            os.kill(os.getpid(), signal.SIGINT)
            passed.append("hangs")
    assert passed == ["not disturbed"] * 3


def test_a_silence_is_ended_within_half_a_second() -> None:
    """Counted from the driver's last word while its wheels may turn; a computer that stood still is none."""
    silence = Watchdog()
    assert not any(silence.expired(TICK_S) for _ in range(100)), "nobody drives"
    for words in (b"+", b"-+", b"++"):
        silence.hear(words)
        ticks = [silence.expired(TICK_S) for _ in range(100)]
        assert ticks.count(True) == 1
        assert SILENCE_S <= (ticks.index(True) + 1) * TICK_S <= 0.5 - TICK_S
    silence.hear(b"+-")
    assert not any(silence.expired(TICK_S) for _ in range(100)), "it stands"
    for _ in range(2):  # a guard that was frozen with its driver hears it first
        silence.hear(b"+")
        assert not silence.expired(60.0)


@pytest.mark.parametrize(
    ("number", "says"),
    [
        (signal.SIGSTOP, "FrozenError: the drive was frozen for"),
        (signal.SIGTSTP, "RobotStoppedError: suspended; the robot was told to stop first"),
    ],
    ids=lambda value: getattr(value, "name", ""),
)
def test_a_suspended_driver_leaves_the_robot_standing(
    bench: Bench, tmp_path: Path, number: signal.Signals, says: str
) -> None:
    """The robot stands while its driver is suspended, by SIGSTOP or Ctrl-Z; woken, the drive is over."""
    twin = bench.twin()
    with child(twin, tmp_path / "r") as driver:
        driver.send_signal(number)
        _, status = os.waitpid(driver.pid, os.WUNTRACED)
        assert os.WIFSTOPPED(status) and os.WSTOPSIG(status) == number
        assert comes_to_stand(twin, tmp_path)
        driver.send_signal(signal.SIGCONT)
        _, errors = driver.communicate(timeout=60)
        assert driver.returncode != 0 and says.split(": ", 1)[1] in errors
        assert ("guard: heard nothing" in errors) == (number == signal.SIGSTOP)
    assert comes_to_stand(twin, tmp_path)
    recording = Recording.from_folder(tmp_path / "r")
    assert len(recording.t) >= 5 and recording.ended.startswith(says)


class Once(Constant):
    """Does something in its sixth step."""

    def __init__(self, act: Callable[[], object]) -> None:
        super().__init__()
        self.act = act

    def decide(self, inputs: object) -> object:
        if self.steps == 5:
            self.act()
        return super().decide([])


def test_a_controller_that_hangs_is_no_danger(
    bench: Bench, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """The guard stops the robot meanwhile and says so; when the controller comes back the drive is over."""
    twin = bench.twin()
    khepera = bench.khepera(twin.device)
    stood: list[bool] = []
    controller = Once(lambda: stood.append(comes_to_stand(twin, tmp_path)))
    with pytest.raises(FrozenError, match=r"frozen for \d+\.\d s .*; the robot was stopped meanwhile"):
        drive(khepera, controller, seconds=2, inputs=bands, recorder=Recorder(tmp_path / "r"))
    assert stood == [True] and khepera.read("E") == (0, 0)
    assert "guard: heard nothing from the driver for half a second" in capfd.readouterr().err
    assert len(Recording.from_folder(tmp_path / "r").t) == 5
    again = drive(khepera, Constant(), seconds=0.5, inputs=bands)
    assert len(again.t) == 5, "the next drive is watched as the first was"


def test_no_robot_is_driven_without_a_guard(bench: Bench) -> None:
    """A guard that is killed ends the drive, and the robot stands."""
    khepera = bench.khepera(bench.twin().device)
    assert khepera._guard._process is not None
    with pytest.raises(FrozenError, match="the guard's process has ended"):
        drive(khepera, Once(khepera._guard._process.kill), seconds=2, inputs=bands)
    assert khepera.read("E") == (0, 0)


def test_a_guard_that_is_frozen_ends_the_drive(bench: Bench) -> None:
    """The driver hears no echo, stops the robot after 0.3 s, and says so."""
    khepera = bench.khepera(bench.twin().device)
    guard = khepera._guard._process
    assert guard is not None
    try:
        with pytest.raises(FrozenError, match=r"guard's process has not answered for \d\.\d s"):
            drive(khepera, Once(partial(guard.send_signal, signal.SIGSTOP)), seconds=3, inputs=bands)
        assert khepera.read("E") == (0, 0)
    finally:
        guard.send_signal(signal.SIGCONT)
    assert len(drive(khepera, Constant(), seconds=0.5, inputs=bands).t) == 5


def test_a_pause_of_driver_and_guard_together_ends_the_drive(bench: Bench, tmp_path: Path) -> None:
    """As a paused container: the guard has lived through no silence, but the driver sees its own gap."""
    twin = bench.twin()
    with child(twin, tmp_path / "r") as driver:
        children = Path(f"/proc/{driver.pid}/task/{driver.pid}/children").read_text().split()
        both = [*map(int, children), driver.pid]
        for pid in both:
            os.kill(pid, signal.SIGSTOP)
        time.sleep(1.5)
        for pid in both:
            os.kill(pid, signal.SIGCONT)
        _, errors = driver.communicate(timeout=60)
        assert driver.returncode != 0 and "the drive was frozen for 1." in errors
    assert comes_to_stand(twin, tmp_path)


def test_a_robot_whose_time_waits_needs_no_guard(bench: Bench) -> None:
    """In the twin's time a step that takes the computer long changes no bit of a drive."""
    made = []
    for pause_s in (0.0, 0.7):
        khepera = bench.virtual(seed=3)

        class Slow(Wary):
            def decide(self, inputs: object, pause_s: float = pause_s) -> object:
                self.steps += 1
                time.sleep(pause_s * (self.steps == 5))
                return super().decide(inputs)  # type: ignore[arg-type]

        assert khepera._guard._process is None
        made.append(drive(khepera, Slow(), seconds=1, inputs=bands))
    for name in ("t", "late", "proximity", "commands", "counters"):
        assert np.array_equal(getattr(made[0], name), getattr(made[1], name))
