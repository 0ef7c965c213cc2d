"""Whatever ends the driver, the robot stands and the recording is readable."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from realitygap.errors import RobotStoppedError
from realitygap.robots.drive import Recording, StopOnSignal
from tests.robots.conftest import ROOT, Bench
from tests.robots.test_faults import comes_to_stand

ENDS = {
    signal.SIGINT: "RobotStoppedError: stopped by SIGINT",
    signal.SIGTERM: "RobotStoppedError: stopped by SIGTERM",
    signal.SIGHUP: "RobotStoppedError: stopped by SIGHUP",
    signal.SIGKILL: "killed",
}


@pytest.mark.parametrize("number", ENDS, ids=lambda number: number.name)
def test_a_driver_that_is_stopped_or_killed_leaves_the_robot_standing(
    bench: Bench, tmp_path: Path, number: signal.Signals
) -> None:
    """Ctrl-C, SIGTERM and a closed terminal stop the wheels first; after kill -9 the guard does."""
    twin = bench.twin()
    with subprocess.Popen(
        [sys.executable, "-m", "tests.robots.child", twin.device, str(tmp_path / "r")],
        cwd=ROOT,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as driver:
        assert driver.stdout is not None and driver.stdout.readline() == "driving\n"
        driver.send_signal(number)
        assert driver.wait(60) != 0
    assert comes_to_stand(twin, tmp_path)
    recording = Recording.from_folder(tmp_path / "r")
    assert len(recording.t) >= 5 and (recording.counters[-1] > 0).all()
    assert recording.ended.startswith(ENDS[number])


def test_a_second_ctrl_c_does_not_disturb_the_stop(bench: Bench, tmp_path: Path) -> None:
    """Two signals at once: the stop is carried through."""
    twin = bench.twin()
    with subprocess.Popen(
        [sys.executable, "-m", "tests.robots.child", twin.device, str(tmp_path / "r")],
        cwd=ROOT,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    ) as driver:
        assert driver.stdout is not None and driver.stdout.readline() == "driving\n"
        for _ in range(2):
            driver.send_signal(signal.SIGINT)
            time.sleep(0.02)
        assert driver.wait(60) != 0
    khepera = bench.khepera(twin.device)
    assert khepera.speeds() == (0, 0)
    assert Recording.from_folder(tmp_path / "r").ended.startswith("RobotStoppedError")


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
