"""The control loop on a twin's serial line."""

from __future__ import annotations

import os
import signal
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from realitygap.errors import BaudError, LineError, RobotStoppedError, UsageError
from realitygap.robots.drive import Recorder, Recording, drive
from realitygap.robots.khepera import Khepera, KheperaBody
from realitygap.robots.twin import TwinLine
from realitygap.twin.firmware import Firmware
from realitygap.values import Pose
from tests.robots.conftest import ARENA, Bench
from tests.robots.controllers import Constant, Wary, bands
from tests.robots.kinematic import KinematicBody
from tests.robots.test_recording import equal

BOTH = ("proximity", "ambient")


def trial(khepera: Khepera, seconds: float = 5.0, **settings: Any) -> Recording:
    """One drive from where the robot stands."""
    body = KheperaBody(khepera, kinds=settings.pop("kinds", BOTH), carry=settings.pop("carry", None))
    body.reset(settings.pop("pose", None))
    return drive(body, Wary(), seconds=seconds, clock=khepera.clock, inputs=bands, **settings)


def test_a_drive_is_repeatable_bit_for_bit(bench: Bench) -> None:
    """Same unit, seed and start: the same recording; another seed: another."""
    one, two, other = (
        trial(khepera, carry=twin.place, pose=Pose.from_degrees(25, 20, 45))
        for twin, khepera in (bench.virtual(seed=seed) for seed in (1, 1, 2))
    )
    assert equal(one, two)
    assert not np.array_equal(one.proximity, other.proximity)
    assert one.late_steps == 0 and len(one.t) == 50


def test_counters_and_speeds_say_what_the_wheels_did(bench: Bench) -> None:
    """Row k holds the counters at its time; a constant command adds 10 of its units a step."""
    _, khepera = bench.virtual()
    body = KheperaBody(khepera)
    body.reset()
    recording = drive(body, Constant(6, -3), seconds=2, clock=khepera.clock, inputs=bands)
    gains = np.diff(recording.counters[1:], axis=0)
    assert np.abs(gains - (60, -30)).max() <= 1
    assert (recording.speeds[1:] == (6, -3)).all()
    assert np.array_equal(recording.commands, np.tile((6, -3), (20, 1)))


def test_the_conversation_in_process_and_on_a_pseudo_terminal_has_the_same_bytes(bench: Bench) -> None:
    """Nothing on the line tells a twin's own time from real time; no command of it means a step."""

    def driven(khepera: Khepera) -> int:
        body = KheperaBody(khepera, kinds=BOTH)
        body.reset()
        drive(body, Constant(0, 0), seconds=1, inputs=bands)
        return khepera.line.faults

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

    tapped = Tapped(KinematicBody(ARENA, unit=1, noise=0.0, seed=0), baud=38400, name="twin unit 1")
    assert driven(Khepera.awake(TwinLine(tapped))) == 0
    for _ in range(8):  # if the computer stands still, real answers come late and are asked for again
        pump = bench.pump(bench.twin(noise=0.0))
        if not driven(bench.khepera(pump.device)):
            break
    assert (pump.asked, pump.answered) == (tapped.asked, tapped.answered)


def test_a_real_clock_keeps_its_time(bench: Bench) -> None:
    """No step begins before its time, and one that begins late says how late."""
    khepera = bench.khepera(bench.twin().device)
    recording = trial(khepera, seconds=1.5)
    due = recording.t - recording.late
    assert (np.diff(due) >= 0.1 - 1e-5).all()
    whole = recording.late[:-1] <= 0.1
    assert np.diff(due)[whole] == pytest.approx(0.1, abs=1e-5)


def test_time_on_the_wire_passes_in_virtual_time(bench: Bench) -> None:
    """Reading sensors at 9600 baud takes at least its characters' time."""
    taken = {}
    for baud in (9600, 115200):
        _, khepera = bench.virtual(baud=baud)
        before = khepera.clock.now()
        values = khepera.read("N")
        taken[baud] = khepera.clock.now() - before
        count = len("N\n") + len("n," + ",".join(map(str, values)) + "\r\n")
        assert taken[baud] == pytest.approx(count * 11 / baud, abs=1e-6)


def test_9600_baud_is_refused_for_both_sensors(bench: Bench) -> None:
    """With the arithmetic; one kind alone is fine."""
    _, khepera = bench.virtual(baud=9600)
    with pytest.raises(BaudError, match="118 ms"):
        KheperaBody(khepera, kinds=BOTH)
    recording = trial(khepera, seconds=1, kinds=("proximity",))
    assert recording.late_steps == 0 and np.isnan(recording.speeds).all()


def test_any_baud_rate_is_found(bench: Bench) -> None:
    """The jumper's rate is found by trying; at a wrong one nobody answers."""
    twin = bench.twin(baud=57600)
    with pytest.raises(LineError, match=r"no Khepera answers .* at 9600 baud"):
        bench.khepera(twin.device, baud=9600, give_up_s=0.1)
    assert bench.khepera(twin.device, baud=None, give_up_s=0.1).line.baud == 57600


def test_the_banner_of_a_fresh_robot_is_heard(bench: Bench) -> None:
    """Two lines after a reset; none the second time."""
    firmware, khepera = bench.virtual(unit=7)
    assert len(khepera.banner) == 2 and "unit 7" in khepera.banner[0]
    assert khepera.versions == {"bios": "5.02", "protocol": "5.01"}
    assert Khepera.awake(TwinLine(firmware)).banner == ()


def test_a_body_that_breaks_is_stopped_and_recorded(bench: Bench, tmp_path: Path) -> None:
    """The controller fails in step 8: wheels at rest, seven steps kept, the reason written."""
    _, khepera = bench.virtual()
    body = KheperaBody(khepera)
    recorder = Recorder(tmp_path / "r", facts={"unit": 1})
    with pytest.raises(RuntimeError, match="the controller broke"):
        drive(body, Constant(fails_at=7), seconds=2, clock=khepera.clock, inputs=bands, recorder=recorder)
    assert khepera.speeds() == (0, 0)
    recording = Recording.from_folder(tmp_path / "r")
    assert len(recording.t) == 7 and recording.ended == "RuntimeError: the controller broke"


def test_ctrl_c_that_a_robot_catches_stops_it_all_the_same(bench: Bench, tmp_path: Path) -> None:
    """A driver that takes every exception for a lost answer may not keep the robot going."""
    _, khepera = bench.virtual()

    class Stubborn(KheperaBody):
        def sense(self) -> Any:
            with suppress(Exception):
                os.kill(os.getpid(), signal.SIGINT)
            return super().sense()

    with pytest.raises(RobotStoppedError, match="stopped by SIGINT; the robot was told to stop first"):
        drive(
            Stubborn(khepera), Constant(5, 5), seconds=1, clock=khepera.clock, inputs=bands,
            recorder=Recorder(tmp_path / "one"),
        )  # fmt: skip
    kept = Recording.from_folder(tmp_path / "one")
    assert len(kept.t) == 1 and kept.ended.startswith("RobotStoppedError: stopped by SIGINT")


def test_a_late_step_is_counted_and_the_timetable_moves_on(bench: Bench) -> None:
    """A controller that once takes 350 ms makes one step late, not a burst of short ones."""
    _, khepera = bench.virtual()

    class Slow(Constant):
        def decide(self, inputs: Any) -> Any:
            if self.steps == 4:
                khepera.clock.sleep_until(khepera.clock.now() + 0.35)
            return super().decide(inputs)

    recording = drive(KheperaBody(khepera), Slow(), seconds=2, clock=khepera.clock, inputs=bands)
    assert recording.late_steps == 1 and recording.late[5] == pytest.approx(0.265, abs=0.02)
    assert np.diff(recording.t)[5:].min() == pytest.approx(0.1, abs=1e-3)


def test_a_trial_has_whole_steps(bench: Bench) -> None:
    """0.25 s is none."""
    _, khepera = bench.virtual()
    with pytest.raises(UsageError, match=r"whole steps of 0\.1 s"):
        drive(KheperaBody(khepera), Constant(), seconds=0.25, clock=khepera.clock, inputs=bands)
