"""The virtual clock's exchanges with a twin: one a step, and exact whatever becomes of an answer."""

from __future__ import annotations

import re
import socket
from collections.abc import Callable
from pathlib import Path

import pytest

from realitygap.errors import LineError
from realitygap.robots.clock import VirtualClock
from realitygap.robots.khepera.body import KheperaBody
from realitygap.robots.loop import drive
from realitygap.values import Command
from tests.robots.conftest import Bench
from tests.robots.controllers import Constant, bands

LOST: Callable[[bytes], bytes] = lambda said: said.replace(b"d\r\n", b"", 1)  # noqa: E731
SPOILT: dict[str, Callable[[bytes], bytes]] = {
    "lost": LOST,
    "garbled": lambda said: said.replace(b"d\r\n", b"\xfft\r\n", 1),
    "without its end": lambda said: said.replace(b"d\r\n", b"d", 1),
    "refused": lambda said: said.replace(b"d\r\n", b"Command not found\r\n", 1),
    "after the others": lambda said: LOST(said) + b"d\r\n",
}


class Counted:
    """A clock's socket that keeps what was sent."""

    def __init__(self, socket: object) -> None:
        self._socket = socket
        self.sent: list[bytes] = []

    def sendall(self, data: bytes) -> None:
        self.sent.append(data)
        self._socket.sendall(data)

    def __getattr__(self, name: str) -> object:
        return getattr(self._socket, name)


def test_a_step_is_one_exchange(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    """Time runs to the next step, and on until its questions are answered, by one message to the twin."""
    _, khepera = bench.virtual()
    body, clock = KheperaBody(khepera), khepera.clock
    counted = Counted(clock._socket)
    monkeypatch.setattr(clock, "_socket", counted)
    drive(body, Constant(4, -3), seconds=2, clock=clock, inputs=bands)
    steps = [one for one in counted.sent if one.count(b"\n") == 2]
    assert len(steps) == 19  # the first begins at once
    assert len(counted.sent) < 20 + 6  # and the robot is stopped


@pytest.mark.parametrize("name", SPOILT)
def test_a_promised_answer_that_is_spoilt_is_asked_for_again(
    bench: Bench, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    """With its command, and so are the questions sent with it; the next step is as any other."""
    _, khepera = bench.virtual(noise=0.0)
    body, clock, line = KheperaBody(khepera), khepera.clock, khepera.line
    told: list[bytes] = []
    spoil = [SPOILT[name]]
    collect, tell = clock._collect, line.tell

    def collected(*arguments: int) -> bytes:
        said = collect(*arguments)
        return spoil.pop()(said) if b"d\r\n" in said and spoil else said

    monkeypatch.setattr(clock, "_collect", collected)
    monkeypatch.setattr(line, "tell", lambda data: (told.append(data), tell(data)))
    body.reset()
    rows = []
    for k in range(4):
        clock.sleep_until(1.0 + 0.1 * k)
        spoil[:] = [SPOILT[name]] if k == 2 else []
        rows.append((body.sense(), body.odometry))
        assert line.faults == (k >= 2)
        body.act(Command(left=6, right=-3))
    body.stop()
    sent = b"".join(told)
    assert sent.count(b"D,6,-3\n") == 5 and sent.count(b"N\n") == 5
    assert [odometry.speeds for _, odometry in rows] == [(0, 0), (6, -3), (6, -3), (6, -3)]
    assert re.search(rb"D,6,-3\nN\n.*\nB\nD,6,-3\nN\n", sent, re.DOTALL)


def test_what_was_said_during_a_sleep_is_no_answer(bench: Bench) -> None:
    """The robot's words that nobody waited for are dropped before the next question."""
    _, khepera = bench.virtual()
    clock = khepera.clock
    khepera.line.tell(b"H\nE\nB\n")
    clock.sleep_until(clock.now() + 0.5)
    assert len(khepera.read("N")) == 8 and khepera.line.faults == 0


def test_a_twin_that_does_not_answer_is_given_up(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Stopped, say, or on a computer that has no memory left: an error, not a wait without end."""
    monkeypatch.setattr("realitygap.robots.clock.TWIN_LOST_S", 0.2)
    with socket.socket(socket.AF_UNIX) as deaf:
        deaf.bind(str(tmp_path / "clock"))
        deaf.listen()
        with pytest.raises(LineError, match=r"does not answer on its clock channel for 0\.2 s"):
            VirtualClock(str(tmp_path / "clock"))


def test_a_closed_clock_leaves_nothing_on_its_way(bench: Bench) -> None:
    """Time that nobody waited for does not pass: it would pass for the robot that is switched on next."""
    twin = bench.twin()
    clock = VirtualClock(twin.channel)
    clock.sleep_until(0.25)
    clock.settle()
    clock.sleep_until(0.5)
    clock.close()
    clock = VirtualClock(twin.channel)
    assert clock.now() == 0.25
    clock.close()
