"""When a line is given up: by time and tries, on a clock that passes as the test says."""

from __future__ import annotations

import os
import pty
import select
import tty
from collections.abc import Iterator

import pytest

from realitygap.errors import LineError
from realitygap.robots.khepera import KHEPERA, Khepera
from realitygap.robots.line import Line

LINES = {b"H": b"h,1,2\r\n", b"B": b"b,5.02,5.01\r\n", b"D": b"d\r\n", b"E": b"e,0,0\r\n"}


class Told:
    """A clock and a robot in one: `deaf` questions are not answered, each look at it takes `stall_s`."""

    def __init__(self, *, deaf: int = 0, stall_s: float = 0.0) -> None:
        self.time_s, self.deaf, self.stall_s = 0.0, deaf, stall_s
        self.master, slave = pty.openpty()
        tty.setraw(slave)
        self.device = os.ttyname(slave)

    waits = True

    def now(self) -> float:
        self.time_s += self.stall_s
        return self.time_s

    def sleep_until(self, time_s: float) -> None:
        self.time_s = max(self.time_s, time_s)

    def read(self, until: float, lines: int) -> bytes:
        """What the robot has answered by then."""
        asked = os.read(self.master, 4096).split(b"\n") if self._waits() else []
        out = b""
        for question in filter(None, asked):
            self.deaf -= 1
            out += b"" if self.deaf >= 0 else LINES[question[:1]]
        self.time_s = self.time_s if out else max(until, self.time_s)
        return out

    def _waits(self) -> bool:
        return bool(select.select([self.master], [], [], 0.05)[0])


def line_to(told: Told) -> Line:
    line = Line(told.device, KHEPERA, baud=38400, clock=told)
    line._read, line.forget = told.read, lambda: None  # type: ignore[method-assign]
    return line


@pytest.fixture
def told(request: pytest.FixtureRequest) -> Iterator[Told]:
    clock = Told(**request.param)
    yield clock
    os.close(clock.master)


@pytest.mark.parametrize("told", [{"deaf": 10**6}], indirect=True)
def test_a_silent_line_is_given_up_within_three_seconds(told: Told) -> None:
    """A question after 1.0 to 1.3 s, and the robot that does not confirm its stop before 3 s are over."""
    line = line_to(told)
    with pytest.raises(LineError, match="no answer understood"):
        line.ask(KHEPERA.request("H"))
    assert 1.0 <= told.now() < 1.3
    with pytest.raises(LineError, match="may still be moving"):
        Khepera(line, ("5.02", "5.01"), ()).stop()
    assert told.now() < 3.0
    line.close()


@pytest.mark.parametrize("told", [{"deaf": 3, "stall_s": 2.0}], indirect=True)
def test_a_line_is_not_given_up_for_time_alone(told: Told) -> None:
    """The computer stands still for 2 s now and again: three questions lost, the fourth is answered."""
    line = line_to(told)
    assert line.ask(KHEPERA.request("H")) == [(1, 2)]
    assert told.now() > 4.0 and line.faults > 0
    line.close()


@pytest.mark.parametrize("told", [{"stall_s": 5.0}], indirect=True)
def test_an_answer_that_is_there_counts_however_late_it_is_looked_at(told: Told) -> None:
    """It came in time; it was the driver that stood still."""
    line = line_to(told)
    assert line.ask(KHEPERA.request("H"), KHEPERA.request("E")) == [(1, 2), (0, 0)]
    assert line.faults == 0
    line.close()
