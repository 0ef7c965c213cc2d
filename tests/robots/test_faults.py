"""Bytes lost, doubled, garbled, late; half lines; the device gone: nothing hangs, the robot stands."""

from __future__ import annotations

import threading
import time
from collections.abc import Sequence
from pathlib import Path

import pytest

from realitygap.errors import LineError, UsageError
from realitygap.robots.drive import Recorder, Recording, drive
from realitygap.robots.khepera import KHEPERA
from realitygap.robots.line import GIVE_UP_S, LEAST_TRIES, Answer, GarbledError, Request
from tests.robots.conftest import Bench
from tests.robots.controllers import Constant, bands
from tests.robots.pump import Faults
from tests.served import Served

FAULTS = {
    "lost": Faults(lost=0.004, seed=1),
    "doubled": Faults(doubled=0.01, seed=2),  # of a line's end nobody notices that
    "garbled": Faults(garbled=0.004, seed=3),
    "late": Faults(late=0.05, late_s=0.15, seed=4),
    "all": Faults(lost=0.002, doubled=0.002, garbled=0.002, late=0.02, late_s=0.12, seed=5),
}


def comes_to_stand(twin: Served, folder: Path) -> bool:
    """Whether the robot stands, now or soon: for 0.2 s it does not move."""
    for k in range(60):
        twin.film(folder / f"look-{k}.csv")
        time.sleep(0.25)
        twin.film(None)
        rows = (folder / f"look-{k}.csv").read_text().splitlines()[1:]
        if len(rows) > 10 and len({tuple(row.split(",")[1:4]) for row in rows}) == 1:
            return True
    return False


@pytest.mark.parametrize("name", FAULTS)
def test_a_drive_gets_through_a_bad_line(bench: Bench, name: str, tmp_path: Path) -> None:
    """Some answers are asked for again; the drive ends, every step is kept, the robot stands."""
    twin = bench.twin(baud=115200)
    pump = bench.pump(twin)
    khepera = bench.khepera(pump.device, baud=115200)
    pump.faults = FAULTS[name]
    recording = drive(khepera, Constant(4, 5), seconds=3, inputs=bands, recorder=Recorder(tmp_path / "r"))
    assert khepera.line.faults > 0
    assert len(recording.t) == 30 and (recording.proximity <= 1023).all()
    pump.faults = Faults()
    assert comes_to_stand(twin, tmp_path)


def test_half_a_line_does_not_spoil_the_next(bench: Bench) -> None:
    """Whatever half a command the robot still holds, the next question is answered."""
    khepera = bench.virtual()
    for half in (b"D,5", b"N,", b"\x00\xff", b"D,1" * 200, b"K\nH\nB\nE"):
        khepera.line.write(half)
        assert len(khepera.read("N")) == 8
        assert khepera.read("H") == (0, 0)


def test_an_old_answer_is_not_taken_for_a_new_one(bench: Bench) -> None:
    """An answer that comes after its time-out is dropped, not read as the next question's."""
    pump = bench.pump(bench.twin(noise=0.0))
    khepera = bench.khepera(pump.device)
    for k in range(20):  # until one has come late: it does not if the computer stands still meanwhile
        khepera.line.ask(KHEPERA.request("G", k, k))
        pump.faults = Faults(late=1.0, late_s=0.2)
        threading.Timer(0.3, lambda: setattr(pump, "faults", Faults())).start()
        assert khepera.read("H") == (k, k)
        khepera.line.ask(KHEPERA.request("G", 7, 8))
        assert khepera.read("H") == (7, 8)
        if khepera.line.faults:
            return
    raise AssertionError("no answer came late")


def test_a_silent_line_is_given_up(bench: Bench, tmp_path: Path) -> None:
    """No answers from step 5 on: an error that warns of a moving robot, steps kept."""
    pump = bench.pump(bench.twin())
    khepera = bench.khepera(pump.device)

    class Cut(Constant):
        def decide(self, inputs: object) -> object:
            if self.steps == 5:
                pump.silent, khepera.line.give_up_s = True, GIVE_UP_S
            return super().decide([])

    with pytest.raises(LineError, match="may still be moving"):
        drive(khepera, Cut(), seconds=2, inputs=bands, recorder=Recorder(tmp_path / "r"))
    recording = Recording.from_folder(tmp_path / "r")
    assert len(recording.t) == 5 and recording.ended.startswith("LineError: no answer understood")


def test_a_line_is_given_up_by_time_and_tries(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    """A question after 1.0 to 1.3 s, a stop before 3 s are over; but not for time alone, if the computer
    stands still now and again."""
    khepera = bench.virtual()
    exchange, asked = khepera.line._exchange, 0

    def deaf(requests: Sequence[Request]) -> list[Answer]:
        nonlocal asked
        asked += 1
        if asked < LEAST_TRIES:
            khepera.clock.sleep_until(khepera.clock.now() + 2.0)
            raise GarbledError("nothing")
        return exchange(requests)

    monkeypatch.setattr(khepera.line, "_exchange", deaf)
    assert khepera.read("H") == (0, 0) and khepera.line.faults == LEAST_TRIES - 1
    monkeypatch.undo()
    monkeypatch.setattr(khepera.line, "_send", lambda data: None)
    for ask, least, most in ((lambda: khepera.read("H"), 1.0, 1.3), (khepera.stop, 1.4, 3.0)):
        start = khepera.clock.now()
        with pytest.raises(LineError, match="no answer understood"):
            ask()
        assert least <= khepera.clock.now() - start < most


def test_a_device_gone_in_mid_trial_ends_the_drive_at_once(bench: Bench, tmp_path: Path) -> None:
    """The plug is pulled: an error that says so, and a readable recording."""
    pump = bench.pump(bench.twin())
    khepera = bench.khepera(pump.device)

    class Pulled(Constant):
        def decide(self, inputs: object) -> object:
            if self.steps == 3:
                pump.pull()
            return super().decide([])

    with pytest.raises(LineError, match="the line is lost"):
        drive(khepera, Pulled(), seconds=2, inputs=bands, recorder=Recorder(tmp_path / "r"))
    assert len(Recording.from_folder(tmp_path / "r").t) == 3


def test_a_robot_that_takes_one_command_at_a_time_is_asked_so(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    """After three failures of questions sent together, they are sent one by one."""
    khepera = bench.virtual()
    exchange = khepera.line._exchange

    def one_only(requests: Sequence[Request]) -> list[Answer]:
        if len(requests) > 1:
            raise GarbledError("half of it lost")
        return exchange(requests)

    monkeypatch.setattr(khepera.line, "_exchange", one_only)
    for _ in range(5):
        assert len(khepera.sense().proximity) == 8
    assert khepera.line.faults == 3


def test_a_port_that_cannot_be_opened_says_why(bench: Bench, tmp_path: Path) -> None:
    """No such device; a device that another driver has."""
    with pytest.raises(UsageError, match="No such file or directory; check the cable"):
        bench.khepera(str(tmp_path / "ttyUSB9"))
    twin = bench.twin()
    bench.khepera(twin.device)
    with pytest.raises(UsageError, match="no other program has it"):
        bench.khepera(twin.device)
