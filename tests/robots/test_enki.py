"""Enki's robots as bodies: another simulator's sensors, wheels and noise, behind one contract."""

from __future__ import annotations

import os
import shutil
import signal
from collections.abc import Iterator
from contextlib import AbstractContextManager, closing, contextmanager

import numpy as np
import pytest

from realitygap.errors import RobotError, UsageError
from realitygap.robots.address import Address, StandIn
from realitygap.robots.body import Body, Clock
from realitygap.robots.enki import MODELS, EnkiBody, EnkiProcess, draw_unit, program
from realitygap.testing import BodyContract
from realitygap.track import read_track
from realitygap.values import Command, Pose
from realitygap.world.robot import load_profile

FLOOR = {"size_cm": [100.0, 100.0]}
ONE = {"size_cm": [60.0, 60.0], "cylinders": [[40.0, 30.0, 4.0]], "walls": [[10.0, 50.0, 30.0, 50.0]]}

if not os.path.exists("/usr/include/enki/PhysicalEngine.h") or shutil.which("g++") is None:
    pytest.skip("Enki is not installed here: apt install libenki-dev g++", allow_module_level=True)


def opened(name: str = "enki", noise: float = 1.0) -> closing[EnkiBody]:
    body = Address.parse(name).open(noise=noise)
    assert isinstance(body, EnkiBody)
    return closing(body)


def driven(name: str = "enki", *, seed: int = 5, noise: float = 1.0, before: int = 0) -> np.ndarray:
    """What it reads and where it is while it runs into a cylinder, then a wall."""
    rows = []
    with opened(name, noise) as body:
        for _ in range(before + 1):
            body.enter(ONE, seed, Pose.from_degrees(30, 30, 10))
            top = round(8 / body._is.unit_cm_s)
            for k in range(60):
                body.clock.sleep_until(body.clock.now() + 0.1)
                rows.append([*body.sense().proximity, body.pose.x, body.pose.y, body.pose.heading])
                body.act(Command(left=top, right=top - (k > 20) * top // 8))
    return np.array(rows[-60:])


class _Contract(BodyContract):
    name = ""

    def opened(self) -> AbstractContextManager[tuple[Body, Clock]]:
        @contextmanager
        def one() -> Iterator[tuple[Body, Clock]]:
            with opened(self.name) as body:
                body.enter({"size_cm": [50.0, 50.0]}, 3, Pose(x=25, y=25, heading=0.0))
                yield body, body.clock

        return one()


class TestKhepera(_Contract):
    """A counter pulse each 10 ms at command 1."""

    name, pulses_per_unit = "enki:khepera:0", 96.0


class TestEPuck(_Contract):
    """A step a second at command 1."""

    name, scale, pulses_per_unit = "enki:epuck:3", 60, 60.0


class TestThymio(_Contract):
    """It has no counters."""

    name, scale = "enki:thymio2", 25


def test_what_was_seen_once_is_forgotten():
    """The packaged library keeps a ray's value for ever; here far, near, far reads dark, bright, dark."""
    with opened("enki:khepera:0") as body:
        read = []
        for x in (50, 2.7, 50):
            body.enter(FLOOR, 1, None) if not read else None
            body.reset(Pose.from_degrees(x, 50, 180))
            body.clock.sleep_until(body.clock.now() + 0.1)
            several = []
            for _ in range(40):
                body.clock.sleep_until(body.clock.now() + 0.02)
                several.append(body.sense().proximity[2])
            read.append(np.mean(several))
    dark, bright, again = read
    assert dark < 15 and again < 15 and 700 < bright < 800


@pytest.mark.parametrize("aside", [0.0, 1.5, 4.5])
@pytest.mark.parametrize("model", MODELS)
def test_a_cylinder_is_not_passed_through(model, aside):
    """Who drives against one stays before it; the packaged library throws a Thymio to its far side."""
    enki, radius = EnkiProcess(), load_profile(MODELS[model].profile).body.radius_cm
    enki.enter({**FLOOR, "cylinders": [[50, 50, 8]]}, model=model, unit=0, noise=0.0, seed=1)
    enki.place(40.5 - radius, 50 + aside, 0.0)
    x, y, _ = enki.run(150, 5.0, 5.0).poses.T
    enki.close()
    assert np.hypot(np.diff(x), np.diff(y)).max() < 0.5
    assert np.hypot(x - 50, y - 50).min() > 8 + 0.6 * radius


@pytest.mark.parametrize("model", MODELS)
def test_the_same_seed_gives_the_same_bits(model):
    """In a process of its own, or after other trials in one; another seed or unit differs from the start."""
    name = f"enki:{model}"
    first = driven(name)
    assert np.array_equal(first, driven(name))
    assert np.array_equal(first, driven(name, before=2))
    assert not np.array_equal(first[0], driven(name, seed=6)[0])
    assert not np.array_equal(first[0], driven(f"{name}:2")[0])


@pytest.mark.parametrize("model", MODELS)
def test_what_a_profile_says_beforehand_is_what_is_published(model):
    """Axle, speed, radius, places, directions and noise of the shipped base are the library's own."""
    profile, enki = load_profile(MODELS[model].profile), EnkiProcess()
    told = enki.enter(FLOOR, model=model, unit=0, noise=1.0, seed=0)
    enki.close()
    axle, top, wheels, radius = told[:4]
    assert profile.wheels.track_cm == axle and profile.wheels.speed_per_unit_cm_s[0] <= top
    assert profile.noise.wheel == pytest.approx(wheels / np.sqrt(3), abs=1e-3)
    assert abs(profile.body.radius_cm - radius) < 1.0
    for sensor, (x, y, direction, most, noise) in zip(
        profile.infrared.sensors, told[4:].reshape(-1, 5), strict=True
    ):
        assert (sensor.x_cm, sensor.y_cm) == (x, y)
        assert np.cos(np.radians(sensor.direction_deg) - direction) == pytest.approx(1, abs=1e-6)
        assert profile.infrared.top == MODELS[model].full_scale and most >= MODELS[model].full_scale * 0.9
        assert profile.noise.proximity == pytest.approx(noise, rel=0.1)


def test_a_unit_differs_from_the_published_model_as_robots_do():
    """Unit 0 is what is published; another has gains, directions and wheels of its own, always the same."""
    published = draw_unit("khepera", 0)
    assert published.track == 1 and set(published.gains) == {1.0} and not any(published.turns)
    one, two = draw_unit("khepera", 1), draw_unit("khepera", 2)
    assert one == draw_unit("khepera", 1) != two != draw_unit("epuck", 2)
    many = [draw_unit("khepera", k) for k in range(1, 60)]
    assert np.std([unit.gains for unit in many]) == pytest.approx(0.2, rel=0.1)
    assert np.degrees(np.std([unit.turns for unit in many])) == pytest.approx(5, rel=0.1)
    assert np.std([unit.wheels for unit in many]) == pytest.approx(0.004, rel=0.3)


def test_a_camera_gets_a_state_each_step(tmp_path):
    """The sealed file begins where the robot stands and has a row each 20 ms."""
    with opened() as body:
        assert body.is_filmed and body.places_itself and body.knows_pose
        body.enter(FLOOR, 4, None)
        body.reset(Pose(x=20, y=30, heading=0.5))
        body.film(tmp_path / "sealed.csv")
        body.act(Command(left=5, right=5))
        body.clock.sleep_until(body.clock.now() + 1.0)
        end = body.pose
        body.film(None)
    truth = read_track(tmp_path / "sealed.csv")
    assert truth.t == pytest.approx(np.arange(51) / 50)
    assert (truth.x[0], truth.y[0]) == pytest.approx((20, 30))
    assert (truth.x[-1], truth.y[-1]) == pytest.approx((end.x, end.y), abs=1e-4)


def test_a_killed_process_is_said_and_nothing_is_left():
    """The next question fails with one message, so does each after it; a closed body has no process."""
    with opened() as body:
        os.kill(body._enki._process.pid, signal.SIGKILL)
        body.clock.sleep_until(body.clock.now() + 0.1)
        for _ in range(2):
            with pytest.raises(RobotError, match="Enki's process is gone"):
                body.reset(Pose(x=20, y=20, heading=0))
        pid = body._enki._process.pid
    with pytest.raises(ProcessLookupError):
        os.kill(pid, 0)


def test_a_process_that_hangs_is_given_up(monkeypatch):
    """It is not waited for longer than said, and is ended."""
    monkeypatch.setattr("realitygap.robots.enki.PATIENCE_S", 0.2)
    with opened() as body:
        pid = body._enki._process.pid
        os.kill(pid, signal.SIGSTOP)
        with pytest.raises(RobotError, match=r"has not answered for 0\.2 s"):
            body.reset(Pose(x=20, y=20, heading=0))
    with pytest.raises(ProcessLookupError):
        os.kill(pid, 0)


def test_its_folder_says_what_it_is():
    """Enki's units are judged apart from the twin's, each model and noise scale apart; a port is a robot."""
    kinds = {
        name: StandIn.of_folder(Address.parse(name).folder(scale))
        for name, scale in (("twin", 1.0), ("enki:epuck:3", 1.0), ("enki", 2.0), ("serial:/dev/ttyUSB0", 1.0))
    }
    assert [one and one.kind for one in kinds.values()] == [
        "twin", "Enki epuck", "Enki khepera with 2 times its noise", None,
    ]  # fmt: skip
    assert kinds["enki:epuck:3"].words == "Enki epuck unit 3" and kinds["twin"].words == "twin unit 1"


def test_what_is_missing_is_said_with_its_cure(tmp_path, monkeypatch):
    """No library, no compiler, no place to keep the program: one message each."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    with monkeypatch.context() as without, pytest.raises(UsageError, match="apt install libenki-dev g\\+\\+"):
        without.setattr("realitygap.robots.enki.LIBRARY", "libnothing.so")
        program()
    with (
        monkeypatch.context() as without,
        pytest.raises(UsageError, match=r"compiler.*apt install libenki-dev"),
    ):
        without.setenv("PATH", str(tmp_path))
        program()
    monkeypatch.setenv("XDG_CACHE_HOME", "/proc/none")
    with pytest.raises(UsageError, match=r"cannot be kept in /proc/none/realitygap.*XDG_CACHE_HOME"):
        program()
