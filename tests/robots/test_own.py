"""A body of the user's own: opened by its address, held to what it declares, blamed by its line."""

from __future__ import annotations

import json
from contextlib import closing
from pathlib import Path

import pytest
from click.testing import CliRunner

from realitygap.cli.robot import robot
from realitygap.errors import LineError, UsageError
from realitygap.robots.address import Address
from realitygap.robots.body import RealClock
from realitygap.robots.drive import ConstantController, drive
from realitygap.values import Command, Pose

BODY = """\
import numpy as np
from realitygap.errors import LineError
from realitygap.robots import Body, Channel, SteppedClock
from realitygap.values import Pose, Readings


class Real(Body):
    channels = (Channel(name="proximity", sensors=3, high=4095),)

    def reset(self, pose=None): pass
    def sense(self): return Readings(proximity=np.full(3, 4000.0), ambient=np.empty(0))
    def act(self, command): self.command = command
    def stop(self): pass


class Three(Real):
    def __init__(self):
        self.clock, self.gone = SteppedClock(self.step, 0.1), 0
        self.enter({}, 0, None)

    def step(self): self.gone += 1
    def enter(self, room, seed, pose): self.pose = pose or Pose(x=1, y=2, heading=0)
    def reset(self, pose=None): self.pose = pose or self.pose


class Many(Three):
    def sense(self): return Readings(proximity=np.zeros(8), ambient=np.empty(0))
class Loud(Three):
    def sense(self): return Readings(proximity=np.full(3, 5000.0), ambient=np.empty(0))
class Wordy(Three):
    def sense(self): return [1, 2, 3]
class Broken(Three):
    def act(self, command): return 1 / 0
class Lost(Three):
    def act(self, command): raise LineError("unplugged")
class Carried(Three):
    def __init__(self): self.pose = None
class Empty: pass
class Shy(Three):
    def __init__(self): raise RuntimeError("no robot here")
number = 3
"""


@pytest.fixture
def file(tmp_path: Path) -> Path:
    """A file with bodies."""
    (tmp_path / "mine.py").write_text(BODY)
    return tmp_path / "mine.py"


def check(address: str, *words: str) -> tuple[int, str]:
    """What `robot check` says, or the error."""
    result = CliRunner().invoke(robot, ["check", "--robot", address, "--seconds", "0.5", *words])
    return result.exit_code, result.stdout or str(result.exception)


def test_what_a_body_has_is_known(file: Path) -> None:
    """Its time, its room, its pose; what it declares of sensors and counters; defaults for the rest."""
    with closing(Address.parse(f"{file}:Three").open()) as body:
        assert body.places_itself and body.knows_pose and not body.is_filmed and not body.measures_speeds
        assert body.channel("proximity").high == 4095 and body.odometry.counters is None
        with pytest.raises(UsageError, match="expected ambient sensors, which this one does not have"):
            body.channel("ambient")
        body.clock.sleep_until(body.clock.now() + 0.5)
        assert body.clock.now() == 0.5 and body.pose == Pose(x=1, y=2, heading=0)
    with closing(Address.parse(f"{file}:Real").open()) as body:
        assert not body.places_itself and not body.knows_pose and isinstance(body.clock, RealClock)
    with closing(Address.parse(f"{file}:Carried").open()) as body:  # it will know, once it is put down
        assert body.knows_pose and body.pose is None


def test_it_is_checked_as_any_robot(file: Path) -> None:
    """Three sensors, no ambient light, no counters; it moves if it may."""
    code, said = check(f"{file}:Three", "--json", "--yes")
    facts = json.loads(said)
    assert code == 0 and facts["proximity"] == [4000] * 3 and "ambient" not in facts
    assert facts["counters"] is None and facts["loop"]["steps"] == 5 and facts["loop"]["wire_ms"] is None
    assert "moved ahead and back" in check(f"{file}:Three", "--yes")[1]


@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("Many", r"sense: expected 3 proximity readings, as its channels say, got \(8,\)"),
        ("Loud", "expected proximity counts from 0 to 4095"),
        ("Wordy", r"sense: expected Readings, got \[1, 2, 3\]"),
        ("Broken", r"mine.py, line \d+: Broken fails with ZeroDivisionError"),
        ("Empty", "expected a subclass of realitygap.robots.Body"),
        ("Shy", r"mine.py, line \d+: Shy\(\) fails with RuntimeError: no robot here"),
        ("Nobody", "expected 'Nobody' in it. It has Real, "),
        ("number", "expected a class, or a function that makes a body, got 3"),
    ],
)
def test_what_is_no_body_is_said_in_one_line(file: Path, name: str, says: str) -> None:
    """By the member or the line of the user's file, when it is opened or drives."""
    with pytest.raises(UsageError, match=says), closing(Address.parse(f"{file}:{name}").open()) as body:
        still = ConstantController(Command(left=0, right=0))
        drive(body, still, seconds=0.5, inputs=lambda readings: [])


def test_a_robot_that_is_lost_is_no_mistake_of_its_file(file: Path) -> None:
    """Its own RobotError passes as it is."""
    with closing(Address.parse(f"{file}:Lost").open()) as body, pytest.raises(LineError, match="unplugged"):
        drive(body, ConstantController(Command(left=0, right=0)), seconds=0.5, inputs=lambda readings: [])


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("ant", "expected twin, twin:UNIT, stranger:UNIT, enki:MODEL:UNIT, khepera:PORT"),
        ("khepera:", "expected twin"),
        ("twin:x", "whole number"),
        ("nowhere.py:Me", "no such file"),
        ("nowhere:Me", "no module 'nowhere' is installed. A file of your own: nowhere.py:Me"),
    ],
)
def test_an_address_that_leads_nowhere_is_refused(text: str, says: str) -> None:
    """With the forms that there are."""
    with pytest.raises(UsageError, match=says):
        Address.parse(text).open()


def test_addresses_name_folders() -> None:
    """As they always did, and for one's own by file and class."""
    names = {"twin": "twin-1", "serial:/dev/ttyUSB0": "serial-ttyUSB0", "a/mine.py:Three": "mine-Three"}
    assert {text: Address.parse(text).folder() for text in names} == names
    assert Address.parse("twin:2").folder(0.5) == "twin-2-noise-0.5"
    assert [str(Address.parse(text)) for text in ("twin", "a/mine.py:Three")] == ["twin:1", "a/mine.py:Three"]
