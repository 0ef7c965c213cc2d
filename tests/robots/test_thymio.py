"""A Thymio II on Aseba's protocol: faults on its line, Aseba's own simulator, the stop on every way out."""

from __future__ import annotations

import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, closing
from pathlib import Path

import numpy as np
import pytest

from realitygap.errors import LineError, RealityGapWarning, RobotError, UsageError
from realitygap.robots.body import Body, Clock, RealClock
from realitygap.robots.drive import Recorder, Recording, drive
from realitygap.robots.thymio import AsebaLine
from realitygap.robots.thymio import opened_port as port
from realitygap.testing import BodyContract
from realitygap.values import Command, Readings
from tests.robots.aseba import Node, at_a_node, playground
from tests.robots.conftest import ROOT
from tests.robots.controllers import Constant

READ = [0, 1500, 3000, 1500, 0, 1100, 0]
Fault = Callable[[bytes], list[tuple[float, bytes]]]


@pytest.fixture
def simulator(tmp_path: Path) -> Iterator[str]:
    if shutil.which("asebaplayground") is None:
        pytest.skip("asebaplayground is not there (Debian's package aseba)")
    with playground(tmp_path) as place:
        yield place


def nothing(readings: Readings) -> list[int]:
    return []


class AtANode:
    """A body at a node in memory."""

    def __enter__(self) -> tuple[Body, Clock]:
        node = Node()
        node.set("prox.horizontal", *READ)
        self.kept = at_a_node(node)
        return self.kept.__enter__(), node

    def __exit__(self, *error: object) -> None:
        self.kept.__exit__(None, None, None)


class TestThymioBody(BodyContract):
    """The contract of a body, on a line in memory."""

    def opened(self) -> AbstractContextManager[tuple[Body, Clock]]:
        return AtANode()  # type: ignore[return-value]


def some(random: np.random.Generator, what: Fault, share: float = 0.2) -> Fault:
    """A fault that befalls a share of the messages."""
    return lambda data: what(data) if random.random() < share else [(0.0, data)]


FAULTS: dict[str, Fault] = {
    "lost": lambda data: [],
    "doubled": lambda data: [(0.0, data), (0.0, data)],
    "late": lambda data: [(0.06, data)],
    "garbled": lambda data: [(0.0, b"\xff\xff" + data[2:])],
    "cut": lambda data: [(0.0, data[:-3])],
}


@pytest.mark.parametrize("name", FAULTS)
def test_what_is_read_and_done_is_right_on_a_bad_line(name: str) -> None:
    """With a fifth of all messages lost, doubled, late, garbled or cut, no reading is another step's, no
    command stays undone for more than a step or two, and the robot stands at the end."""
    node, random = Node(), np.random.default_rng(3)
    with at_a_node(node) as body:
        body.reset()
        node.fault = some(random, FAULTS[name])
        undone = 0
        for k in range(200):
            node.set("prox.horizontal", *[k + 1100] * 7)
            asked = node.now()
            read = body.sense()
            if body.read_at >= asked:
                assert (read.proximity == k + 1100).all()
            body.act(Command(left=k, right=-k))
            node.sleep_until(asked + body.period_s)
            undone = 0 if node.get("motor.left.target") == k else undone + 1
            assert undone <= 3
        body.stop()
        assert node.get("motor.left.target") == node.get("motor.right.target") == 0
        assert (body.line.faults > 10) == (name != "doubled")


def test_a_missed_step_is_counted_and_its_reading_is_the_last_one(tmp_path: Path) -> None:
    """Each row tells when what was read arrived; three silent steps are three missed ones."""
    node = Node()
    node.set("prox.horizontal", *READ)
    with at_a_node(node) as body:
        steps = [0]

        class Deaf(Constant):
            def decide(self, inputs: object) -> Command:
                steps[0] += 1
                node.fault = (lambda data: []) if 4 <= steps[0] < 7 else (lambda data: [(0.0, data)])
                return self.command

        drive(body, Deaf(100, 100), seconds=1.0, inputs=nothing, recorder=Recorder(tmp_path / "r"))
    kept = Recording.from_folder(tmp_path / "r")
    assert kept.missed_steps == 3 and (np.diff(kept.read) >= 0).all() and (kept.proximity == READ).all()
    assert "missed_steps = 3" in (tmp_path / "r" / "drive.toml").read_text()


def test_a_silent_robot_ends_the_drive(tmp_path: Path) -> None:
    """After a second without a word: it may still be moving, and the message says so."""
    node = Node()
    with pytest.raises(LineError, match="may still be moving"), at_a_node(node) as body:
        body.sense()

        class Gone(Constant):
            def decide(self, inputs: object) -> Command:
                node.fault = lambda data: []
                return self.command

        drive(body, Gone(100, 100), seconds=5.0, inputs=nothing)


def test_a_target_beyond_the_motors_is_refused() -> None:
    """The message says what they take."""
    with at_a_node(Node()) as body, pytest.raises(UsageError, match="from -500 to 500"):
        body.act(Command(left=501, right=0))


def test_a_count_beyond_the_full_scale_is_read_and_said() -> None:
    """Some Thymios read up to 4525, and what was beyond 4500 had been cut off without a word."""
    node = Node()
    with at_a_node(node) as body:
        body.reset()
        node.set("prox.horizontal", 4525, *[1100] * 6)
        with pytest.warns(RealityGapWarning, match="reads 4525, beyond the full scale of 4500"):
            assert body.sense().proximity[0] == 4525
        assert body.sense().proximity[0] == body.channel("proximity").high == 4525  # said once


CHILD = """
import sys
from realitygap.robots.drive import drive
from realitygap.robots.thymio import opened
from realitygap.values import Command
class Turning:
    def reset(self): pass
    def decide(self, inputs):
        print("driving", flush=True)
        return Command(left=-200, right=200)
drive(opened(sys.argv[1]), Turning(), seconds=30, inputs=lambda readings: [])
"""


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGKILL, signal.SIGSTOP])
def test_a_driver_that_ends_or_freezes_leaves_the_robot_standing(
    simulator: str, tmp_path: Path, number: signal.Signals
) -> None:
    """Ctrl-C and SIGTERM stop the motors first; after kill -9 and in a frozen driver the guard does."""
    try:
        targets = _targets_after(simulator, number)
    except (RobotError, UsageError):  # the simulator now and then ends itself when a guest is killed
        with playground(tmp_path) as another:
            targets = _targets_after(another, number)
    assert targets == {"motor.left.target": [0], "motor.right.target": [0]}


def _targets_after(place: str, number: signal.Signals) -> dict[str, list[int]] | None:
    """What the motors are told to do when a driver has had a signal; they turned before."""
    words = [sys.executable, "-c", CHILD, place]
    quiet = subprocess.DEVNULL
    with subprocess.Popen(words, cwd=ROOT, stdout=subprocess.PIPE, stderr=quiet, text=True) as driver:
        assert driver.stdout is not None
        for _ in range(3):
            assert driver.stdout.readline() == "driving\n"
        driver.send_signal(number)
        if number == signal.SIGSTOP:
            time.sleep(1.5)
            driver.kill()
        driver.wait(30)
    time.sleep(0.5)
    with closing(AsebaLine(port(place), place, RealClock())) as line:
        return line.fetch(("motor.left.target", "motor.right.target"), line.clock.now() + 1.0)
