"""A body of the user's own: opened by its address, held to what it declares, blamed by its line."""

from __future__ import annotations

import inspect
import json
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from realitygap.cli.robot import robot
from realitygap.errors import LineError, UsageError
from realitygap.robots.address import Address
from realitygap.robots.body import Placing, Seen, Timed, channel, clock_of, facts_of, odometry_of
from realitygap.robots.clock import RealClock
from realitygap.robots.own import OwnBody
from realitygap.values import Pose

BODY = """\
import numpy as np
from realitygap.errors import LineError
from realitygap.robots.body import Channel, Odometry
from realitygap.robots.clock import SteppedClock
from realitygap.values import Pose, Readings


class Three:
    channels = (Channel(name="proximity", sensors=3, high=4095),)
    period_s, counts_turns = 0.1, False

    def __init__(self):
        self.clock, self.gone = SteppedClock(self.step, 0.1), 0
        self.enter({}, 0, None)

    def step(self): self.gone += 1
    def enter(self, room, seed, pose): self.pose = pose or Pose(x=1, y=2, heading=0)
    def reset(self, pose=None): self.pose = pose or self.pose
    def sense(self): return Readings(proximity=np.full(3, 4000.0), ambient=np.empty(0))
    def act(self, command): self.command = command
    def stop(self): pass
    def close(self): pass


class Many(Three):
    def sense(self): return Readings(proximity=np.zeros(8), ambient=np.empty(0))
class Loud(Three):
    def sense(self): return Readings(proximity=np.full(3, 5000.0), ambient=np.empty(0))
class Listed(Three):
    def sense(self): return Readings(proximity=[1, 2, 3], ambient=[])
class Unplugged(Three):
    def reset(self, pose=None): raise OSError("no such device")
class Wordy(Three):
    def sense(self): return [1, 2, 3]
class Broken(Three):
    def reset(self, pose=None): return 1 / 0
class Lost(Three):
    def act(self, command): raise LineError("unplugged")
class Late(Three):
    def step(self): return {}["no"]
class Counting(Three):
    counts_turns = True
class Paired(Counting):
    odometry = (120, 118)
class Arrayed(Counting):
    odometry = Odometry(counters=np.array([120, 118]))
class Placed(Three):
    @property
    def pose(self): return 1.0, 2.0, 0.0
    @pose.setter
    def pose(self, pose): pass
class Astray(Three):
    pose = property(lambda self: Pose(x=1.0, y=2.0, heading=float("nan")), lambda self, pose: None)
class Carried(Three):
    def __init__(self): self.pose = None
class Mine(Three):
    facts = {"base": "e-puck", "units": "steps/s"}
class Chatty(Three):
    facts = {"colour": "red"}
class Numpy(Three):
    channels = (Channel(name="proximity", sensors=np.int64(3), high=np.int32(4095)),)
class Shaky(Three):
    @property
    def period_s(self): return {}["no"]
class Secret(Three):
    @property
    def facts(self): return {}["no"]
class Timeless(Three):
    def enter(self, *words): self.clock = super().enter(*words)
class Nowhere(Counting):
    odometry = Odometry(counters=(3, float("nan")))
class Slow(Three):
    asked = 0
    @property
    def read_at(self):
        self.asked += 1
        return None if self.asked < 2 else 0.0
class Vague(Three):
    def inspect(self): return "all is well"
class Proxy:
    def __init__(self): self.inner = Three()
    def __getattr__(self, name): return getattr(self.inner, name)
class Real:
    channels, period_s, counts_turns = Three.channels, 0.1, False
    def reset(self, pose=None): pass
    sense, act, stop, close = Three.sense, Three.act, Three.stop, Three.close
class Empty: pass
class Endless(Three):
    stop = None
class Odd(Three):
    channels = ("proximity",)
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


def test_what_a_body_has_is_found_by_its_name(file: Path) -> None:
    """Its time, its room, its pose; what it declares of sensors and counters."""
    with closing(Address.parse(f"{file}:Three").open()) as body:
        assert isinstance(body, Timed) and isinstance(body, Placing) and isinstance(body, Seen)
        assert channel(body, "proximity").high == 4095 and odometry_of(body).counters is None
        with pytest.raises(UsageError, match="expected ambient sensors, which this one does not have"):
            channel(body, "ambient")
        clock = clock_of(body)
        clock.sleep_until(clock.now() + 0.5)
        assert clock.now() == 0.5 and (body.pose.x, body.pose.y) == (1, 2)


@pytest.mark.parametrize(("name", "has"), [("Three", True), ("Real", False)])
def test_what_it_has_besides_is_in_its_class(file: Path, name: str, has: bool) -> None:
    """From Python 3.12 on isinstance asks a protocol's members of the class, not of __getattr__."""
    with closing(Address.parse(f"{file}:{name}").open()) as body:
        found = [inspect.getattr_static(body, member, None) for member in ("clock", "enter", "pose")]
        assert [one is not None for one in found] == [has] * 3
        assert [isinstance(body, kind) for kind in (Timed, Placing, Seen)] == [has] * 3
        assert isinstance(clock_of(body), RealClock) is not has


def test_a_pose_may_be_none_before_it_is_known(file: Path) -> None:
    """Until it is put down: it is a body that will know."""
    with closing(Address.parse(f"{file}:Carried").open()) as body:
        assert isinstance(body, Seen) and body.pose is None
        body.reset(Pose(x=1, y=2, heading=0))
        assert body.pose == Pose(x=1, y=2, heading=0)


def test_what_a_body_tells_is_kept(file: Path) -> None:
    """Counters that are an array; what its recordings are to say of it."""
    with closing(Address.parse(f"{file}:Arrayed").open()) as body:
        assert odometry_of(body) == ((120, 118), None)
        assert facts_of(body) == {"robot": "mine.py:Arrayed"}
    with closing(Address.parse(f"{file}:Mine").open()) as body:
        assert facts_of(body) == {"robot": "mine.py:Mine", "base": "e-puck", "units": "steps/s"}


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
        ("Broken", r"mine.py, line \d+: Broken.reset fails with ZeroDivisionError"),
        ("Late", r"mine.py, line \d+: SteppedClock.sleep_until fails with KeyError"),
        ("Unplugged", r"mine.py, line \d+: Unplugged.reset fails with OSError: no such device\.$"),
        ("Counting", "odometry: expected, since it counts turns"),
        ("Paired", r"odometry: expected an Odometry\(counters=\(left, right\)\), got \(120, 118\)"),
        ("Placed", r"pose: expected a Pose of finite numbers, got \(1.0, 2.0, 0.0\)"),
        ("Astray", r"pose: expected a Pose of finite numbers, got Pose\(x=1.0, y=2.0, heading=nan\)"),
        ("Chatty", "facts: expected a dict of base, pulses_per_mm, robot, units, got {'colour': 'red'}"),
        ("Empty", "expected channels, period_s, counts_turns, reset, sense, act, stop, close"),
        ("Endless", "stop: expected a method, got None"),
        ("Odd", "channels: expected a tuple of Channel"),
        ("Shy", r"mine.py, line \d+: Shy\(\) fails with RuntimeError: no robot here"),
        ("Shaky", r"mine.py, line \d+: Shaky.period_s fails with KeyError: 'no'"),
        ("Secret", r"mine.py, line \d+: Secret.facts fails with KeyError: 'no'"),
        ("Timeless", "clock: expected a clock, with waits, now and sleep_until, got None"),
        ("Nowhere", r"expected an Odometry\(counters=\(left, right\)\), got Odometry\(counters=\(3, nan\)"),
        ("Slow", r"read_at: expected a time \(s\) by its clock, got None"),
        ("Vague", "inspect: expected a dict, got 'all is well'"),
        ("Nobody", "expected 'Nobody' in it. It has Three, "),
        ("number", "expected a class, or a function that makes a body, got 3"),
    ],
)
def test_what_is_no_body_is_said_in_one_line(file: Path, name: str, says: str) -> None:
    """By the member and the line of the user's file."""
    with pytest.raises(UsageError, match=says), closing(Address.parse(f"{file}:{name}").open()) as body:
        body.reset()
        body.sense()
        clock_of(body).sleep_until(1.0)
        assert odometry_of(body) and body.pose and facts_of(body)  # type: ignore[attr-defined]
        assert getattr(body, "read_at", 0.0) is not None and isinstance(
            getattr(body, "inspect", dict)(), dict
        )


@pytest.mark.parametrize("name", ["Numpy", "Proxy"])
def test_a_body_may_be_made_otherwise(file: Path, name: str) -> None:
    """Of NumPy's numbers, or passing on what another object does."""
    with closing(Address.parse(f"{file}:{name}").open()) as body:
        body.reset()
        assert channel(body, "proximity").sensors == len(body.sense().proximity) == 3


def test_readings_may_be_lists(file: Path) -> None:
    """They are written down and fed as arrays are."""
    with closing(Address.parse(f"{file}:Listed").open()) as body:
        read = body.sense()
    assert read.proximity.tolist() == [1.0, 2.0, 3.0] and read.ambient.shape == (0,)


def test_a_driver_beside_the_file_is_said_to_lie_there(file: Path) -> None:
    """The folder of a user's file is none that Python looks in."""
    (file.parent / "my_driver.py").write_text("")
    file.write_text("import my_driver\n")
    with pytest.raises(
        UsageError, match=f"my_driver'. It lies in {file.parent}: set PYTHONPATH={file.parent}"
    ):
        Address.parse(f"{file}:Three").open()


def test_a_robot_that_is_lost_is_no_mistake_of_its_file(file: Path) -> None:
    """Its own RobotError passes as it is."""
    with closing(Address.parse(f"{file}:Lost").open()) as body, pytest.raises(LineError, match="unplugged"):
        body.act(None)  # type: ignore[arg-type]


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


def test_a_body_without_a_time_of_its_own_has_the_computers(file: Path) -> None:
    """And is placed by a person."""
    own = Address.parse(f"{file}:Three").open()._own  # type: ignore[attr-defined]
    del own.clock
    body = OwnBody(own, str(file))
    assert isinstance(clock_of(body), RealClock) and np.isfinite(clock_of(body).now())
