"""The control loop on a twin's serial line, and what a drive keeps."""

from __future__ import annotations

import os
import signal
from contextlib import AbstractContextManager, nullcontext, suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from realitygap.errors import LineError, RobotStoppedError, UsageError
from realitygap.robots.body import Body, Clock, Odometry
from realitygap.robots.drive import Recorder, Recording, Step, drive
from realitygap.robots.khepera import KheperaBody
from realitygap.robots.twin import TwinLine
from realitygap.testing import BodyContract
from realitygap.twin.firmware import Firmware
from realitygap.values import Command, Pose, Readings
from tests.robots.conftest import ARENA, Bench
from tests.robots.controllers import Constant, Wary, bands
from tests.robots.kinematic import KinematicBody

BOTH = ("proximity", "ambient")


class TestSerialBodyInRealTime(BodyContract):
    """A body on a serial line (tests/test_bodies.py has it in the twin's time)."""

    pulses_per_unit = 100.0
    bench: Bench

    @pytest.fixture(autouse=True)
    def _at_the_bench(self, bench: Bench) -> None:
        self.bench = bench

    def opened(self) -> AbstractContextManager[tuple[Body, Clock]]:
        twin = self.bench.twin()
        khepera = self.bench.khepera(twin.device, carry=twin.place)
        return nullcontext((khepera, khepera.clock))


def equal(one: Recording, two: Recording) -> bool:
    """Array for array."""
    arrays = ("t", "late", "proximity", "ambient", "inputs", "commands", "counters", "speeds")
    same = all(np.array_equal(getattr(one, a), getattr(two, a), equal_nan=True) for a in arrays)
    return same and one.ended == two.ended and one.facts == two.facts


def test_a_drive_is_repeatable_bit_for_bit(bench: Bench) -> None:
    """Same unit, seed and start: the same recording; another seed: another."""
    made = []
    for seed in (1, 1, 2):
        body = bench.virtual(seed=seed, kinds=BOTH)
        body.reset(Pose.from_degrees(25, 20, 45))
        made.append(drive(body, Wary(), seconds=5, inputs=bands))
    one, two, other = made
    assert equal(one, two)
    assert not np.array_equal(one.proximity, other.proximity)
    assert one.late_steps == 0 and len(one.t) == 50


def test_counters_and_speeds_say_what_the_wheels_did(bench: Bench) -> None:
    """Row k holds the counters at its time; a constant command adds 10 of its units a step."""
    body = bench.virtual()
    body.reset()
    recording = drive(body, Constant(6, -3), seconds=2, inputs=bands)
    gains = np.diff(recording.counters[1:], axis=0)
    assert np.abs(gains - (60, -30)).max() <= 1
    assert (recording.speeds[1:] == (6, -3)).all()
    assert np.array_equal(recording.commands, np.tile((6, -3), (20, 1)))


def test_the_conversation_in_process_and_on_a_pseudo_terminal_has_the_same_bytes(bench: Bench) -> None:
    """Nothing on the line tells a twin's own time from real time; no command of it means a step."""

    class Tapped(Firmware):
        """Keeps what passes."""

        asked = answered = b""

        def receive(self, data: bytes) -> None:
            self.asked += data
            super().receive(data)

        def run(self, until: int, lines: int = 0) -> bytes:
            out = super().run(until, lines)
            self.answered += out
            return out

    def driven(body: KheperaBody) -> int:
        body.attend(*BOTH)
        drive(body, Constant(0, 0), seconds=1, inputs=bands)
        return body.line.faults

    tapped = Tapped(KinematicBody(ARENA, unit=1, noise=0.0, seed=0), baud=38400, name="twin unit 1")
    assert driven(KheperaBody(TwinLine(tapped)).stopped()) == 0
    for _ in range(8):  # if the computer stands still, real answers come late and are asked for again
        pump = bench.pump(bench.twin(noise=0.0))
        if not driven(bench.khepera(pump.device)):
            break
    assert (pump.asked, pump.answered) == (tapped.asked, tapped.answered)


def test_a_late_step_is_counted_and_the_timetable_moves_on(bench: Bench) -> None:
    """A controller that once takes 350 ms makes one step late, not a burst of short ones."""
    body = bench.virtual()

    class Slow(Constant):
        def decide(self, inputs: Any) -> Any:
            if self.steps == 4:
                body.clock.sleep_until(body.clock.now() + 0.35)
            return super().decide(inputs)

    recording = drive(body, Slow(), seconds=2, inputs=bands)
    assert recording.late_steps == 1 and recording.late[5] == pytest.approx(0.265, abs=0.02)
    assert np.diff(recording.t)[5:].min() == pytest.approx(0.1, abs=1e-3)


def test_any_baud_rate_is_found(bench: Bench) -> None:
    """The jumper's rate is found by trying; at a wrong one nobody answers."""
    twin = bench.twin(baud=57600)
    with pytest.raises(LineError, match=r"no Khepera answers .* at 9600 baud"):
        bench.khepera(twin.device, baud=9600, give_up_s=0.1)
    assert bench.khepera(twin.device, baud=None, give_up_s=0.1).line.baud == 57600


def test_a_drive_that_breaks_is_stopped_and_recorded(bench: Bench, tmp_path: Path) -> None:
    """The controller fails in step 8: wheels at rest, seven steps kept, the reason written."""
    body = bench.virtual()
    recorder = Recorder(tmp_path / "r", facts={"unit": 1})
    with pytest.raises(RuntimeError, match="the controller broke"):
        drive(body, Constant(fails_at=7), seconds=2, inputs=bands, recorder=recorder)
    assert body.read("E") == (0, 0)
    recording = Recording.from_folder(tmp_path / "r")
    assert len(recording.t) == 7 and recording.ended == "RuntimeError: the controller broke"


def test_ctrl_c_that_a_robot_catches_stops_it_all_the_same(bench: Bench, tmp_path: Path) -> None:
    """A driver that takes every exception for a lost answer may not keep the robot going."""
    body = bench.virtual()
    sense = body.sense

    def stubborn() -> Readings:
        with suppress(Exception):
            os.kill(os.getpid(), signal.SIGINT)
        return sense()

    body.sense = stubborn  # type: ignore[method-assign]
    with pytest.raises(RobotStoppedError, match="stopped by SIGINT; the robot was told to stop first"):
        drive(body, Constant(5, 5), seconds=1, inputs=bands, recorder=Recorder(tmp_path / "one"))
    kept = Recording.from_folder(tmp_path / "one")
    assert len(kept.t) == 1 and kept.ended.startswith("RobotStoppedError: stopped by SIGINT")


def step(k: int, speeds: tuple[int, int] | None = (4, 5)) -> Step:
    """Some step."""
    readings = Readings(proximity=np.arange(8.0) + k, ambient=np.zeros(0))
    odometry = Odometry((k, 2 * k), speeds)
    return Step(k / 10, 0.02 * (k == 2), readings, [k, -k], Command(left=k, right=-k), odometry)


@pytest.mark.parametrize("steps", [0, 1, 5])
@pytest.mark.parametrize("speeds", [(4, 5), None])
def test_a_recording_reads_back_as_it_was(tmp_path: Path, steps: int, speeds: tuple[int, int] | None) -> None:
    """From memory, and from the folder it was written to as it went."""
    facts = {"port": 'a "port"', "noise": 0.5, "unit": {"number": 3, "kinds": ["proximity"]}}
    recorder = Recorder(tmp_path / "one", facts=facts)
    for k in range(steps):
        recorder.add(step(k, speeds))
    recorder.finish("LineError: gone")
    recording = recorder.recording()
    assert recording.late_steps == (steps > 2) and recording.commands.shape == (steps, 2)
    assert equal(Recording.from_folder(tmp_path / "one"), recording)


def test_a_killed_recording_is_readable_to_its_last_whole_line(tmp_path: Path) -> None:
    """Nothing was closed, and the last line is cut short; an invalid one is named."""
    recorder = Recorder(tmp_path / "r")
    for k in range(3):
        recorder.add(step(k))
    with (tmp_path / "r/steps.csv").open("a") as file:
        file.write("0.3,0,1,2")
    recording = Recording.from_folder(tmp_path / "r")
    assert recording.ended == "killed" and len(recording.t) == 3
    with (tmp_path / "r/steps.csv").open("a") as file:
        file.write(",a\n")
    with pytest.raises(UsageError, match=r"steps\.csv, line 5: "):
        Recording.from_folder(tmp_path / "r")
    recorder.finish("too late")


def test_a_recording_is_never_overwritten(tmp_path: Path) -> None:
    """A second one wants a folder of its own, and so does one beside a calibration's."""
    with pytest.raises(UsageError, match="holds no recording"):
        Recording.from_folder(tmp_path)
    Recorder(tmp_path / "r").finish("finished")
    for name in ("drive.toml", "recording.toml"):
        (tmp_path / "r" / "drive.toml").replace(tmp_path / "r" / name)
        with pytest.raises(UsageError, match="already holds a recording"):
            Recorder(tmp_path / "r")
