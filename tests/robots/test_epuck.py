"""An emulated e-puck behind a pseudo-terminal, an e-puck2 behind a TCP port; Enki's e-puck is their body."""

from __future__ import annotations

import json
import os
import shutil
import signal
import socket
import subprocess
import sys
import threading
import time
import tomllib
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, closing, contextmanager
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from realitygap.calibration.recordings import load_recording
from realitygap.cli import realitygap
from realitygap.errors import LineError, UsageError
from realitygap.robots.address import Address
from realitygap.robots.body import Body
from realitygap.robots.clock import Clock
from realitygap.robots.epuck.body import Epuck, EpuckBody
from realitygap.robots.khepera.body import Khepera
from realitygap.robots.loop import drive
from realitygap.robots.recording import Recording
from realitygap.study.config import StudyConfig
from realitygap.study.runner import run_study
from realitygap.testing import BodyContract
from realitygap.transfer.record import load_transfers
from realitygap.values import Command
from tests.robots.conftest import ROOT
from tests.robots.controllers import Constant
from tests.robots.pump import Faults, Pump

if not os.path.exists("/usr/include/enki/PhysicalEngine.h") or shutil.which("g++") is None:
    pytest.skip("Enki is not installed here: apt install libenki-dev g++", allow_module_level=True)

from tests.robots.epuck import Emulated, Kheperalike, SerialEpuck, WifiEpuck


def nothing(readings: object) -> list[int]:
    return []


@pytest.fixture
def serial() -> Iterator[SerialEpuck]:
    with closing(SerialEpuck()) as robot:
        yield robot


@pytest.fixture
def wifi() -> Iterator[WifiEpuck]:
    with closing(WifiEpuck()) as robot:
        yield robot


def address(robot: Emulated) -> str:
    return f"epuck:{robot.device}" if isinstance(robot, SerialEpuck) else f"epuck2:{robot.place}"  # type: ignore[attr-defined]


@contextmanager
def opened(robot: Emulated) -> Iterator[EpuckBody]:
    body = Address.parse(address(robot)).open()
    assert isinstance(body, EpuckBody)
    with closing(body):
        yield body


class TestSerialContract(BodyContract):
    """A step a second at command 1."""

    kind: type[Emulated] = SerialEpuck
    scale, pulses_per_unit = 60, 60.0

    def opened(self) -> AbstractContextManager[tuple[Body, Clock]]:
        @contextmanager
        def one() -> Iterator[tuple[Body, Clock]]:
            with closing(self.kind()) as robot, opened(robot) as body:
                yield body, body.clock

        return one()


class TestWifiContract(TestSerialContract):
    """The same in packets."""

    kind = WifiEpuck


@pytest.mark.parametrize("name", ["serial", "wifi"])
def test_sensors_and_wheels_are_the_robots(name: str, request: pytest.FixtureRequest) -> None:
    """Each reading comes in its place, 12 bits; left is left; each LED is one; all of it without a fault."""
    robot: Emulated = request.getfixturevalue(name)
    robot.proximity = lambda: [10, 200, 3000, 4095, 0, 5, 6, 7]  # type: ignore[method-assign]
    with opened(robot) as body:
        body.attend(("proximity", "ambient"), turns=True)
        body.reset()
        body.act(Command(left=300, right=-100))
        time.sleep(0.2)
        read = body.sense()
        assert read.proximity.tolist() == [10, 200, 3000, 4095, 0, 5, 6, 7]
        assert read.ambient.tolist() == [3900.0] * 8
        left, right = body.odometry.counters or (0, 0)
        assert left > 20 and right < 0
        body.stop()
        body.driver.led(0, True)
        body.driver.led(5, True)
        assert [bool(led) for led in robot.leds] == [True, *[False] * 4, True, False, False]
        assert body.driver.line.faults == 0


@pytest.mark.parametrize("name", ["serial", "wifi"])
def test_counters_go_on_where_the_robots_begin_again(name: str, request: pytest.FixtureRequest) -> None:
    """They have 16 bits: 4 m either way."""
    robot: Emulated = request.getfixturevalue(name)
    with opened(robot) as body:
        body.reset()
        seen = []
        for steps in (30000, 50000, 70000, 40000, 10000, -20000, -50000):
            robot.set_steps(steps, -steps)
            body.sense()
            seen.append(body.odometry.counters)
        assert np.abs(np.array(seen)[:, 0] - [30000, 50000, 70000, 40000, 10000, -20000, -50000]).max() <= 2
        assert np.abs(np.array(seen).sum(axis=1)).max() <= 2


@pytest.mark.parametrize(
    "faults",
    [
        Faults(lost=0.004, seed=1),
        Faults(doubled=0.004, seed=2),
        Faults(garbled=0.004, seed=3),
        Faults(late=0.05, late_s=0.4, seed=4),
    ],
    ids=["lost", "doubled", "garbled", "late"],
)
def test_a_drive_gets_through_a_bad_line(serial: SerialEpuck, faults: Faults) -> None:
    """Some answers are asked for again; every step is kept, the robot stands."""
    with Pump(serial.device, Faults()) as pump, closing(Address.parse(f"epuck:{pump.device}").open()) as body:
        body.driver.line.give_up_s = 10.0  # type: ignore[attr-defined]
        pump.faults = faults
        recording = drive(body, Constant(300, 200), seconds=2.5, inputs=nothing)
        pump.faults = Faults()
        assert body.driver.line.faults > 0  # type: ignore[attr-defined]
    assert len(recording.t) == 25 and (recording.proximity <= 4095).all() and serial.stands()


class Spoiler:
    """Every ninth answer is spoilt."""

    def __init__(self, spoil: Callable[[bytes], bytes]) -> None:
        self.spoil, self.answers = spoil, 0

    def __call__(self, packet: bytes) -> bytes:
        self.answers += 1
        return packet if self.answers % 9 else self.spoil(packet)


def slowly(packet: bytes) -> bytes:
    time.sleep(0.4)
    return packet


@pytest.mark.parametrize(
    "spoil",
    [lambda packet: b"", lambda packet: packet * 2, lambda packet: b"\xfe" + packet[2:], slowly],
    ids=["lost", "doubled", "garbled", "late"],
)
def test_a_drive_gets_through_bad_packets(wifi: WifiEpuck, spoil: Callable[[bytes], bytes]) -> None:
    """As on a serial line; a doubled answer is dropped before the next question."""
    with opened(wifi) as body:
        body.driver.line.give_up_s = 10.0
        wifi.spoil = spoiler = Spoiler(spoil)
        recording = drive(body, Constant(300, 200), seconds=2.5, inputs=nothing)
        wifi.spoil = lambda packet: packet
        assert spoiler.answers > 40
        assert (body.driver.line.faults > 0) is (len(spoil(b"\3")) != 2)
    assert len(recording.t) == 25 and wifi.stands()


@pytest.mark.parametrize("name", ["serial", "wifi"])
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGKILL])
def test_a_driver_that_is_stopped_or_killed_leaves_the_robot_standing(
    name: str, number: signal.Signals, request: pytest.FixtureRequest, tmp_path: Path
) -> None:
    """Ctrl-C, SIGTERM and a closed terminal stop the wheels first; after kill -9 the guard does."""
    robot: Emulated = request.getfixturevalue(name)
    command = [sys.executable, "-m", "tests.robots.child", address(robot), str(tmp_path / "r")]
    with subprocess.Popen(
        command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as child:
        assert child.stdout is not None and child.stdout.readline() == "driving\n"
        assert robot.told[-1] == (3, 4)
        child.send_signal(number)
        assert child.wait(60) != 0
    assert robot.stands()
    ended = Recording.from_folder(tmp_path / "r").ended
    assert ended == "killed" if number == signal.SIGKILL else number.name in ended


@pytest.mark.parametrize("name", ["serial", "wifi"])
def test_an_exception_leaves_the_robot_standing(name: str, request: pytest.FixtureRequest) -> None:
    """A controller that fails, in the third step."""

    class Failing(Constant):
        def decide(self, inputs: object) -> object:
            if self.steps == 3:
                raise ZeroDivisionError
            return super().decide([])

    robot: Emulated = request.getfixturevalue(name)
    with opened(robot) as body:
        with pytest.raises(ZeroDivisionError):
            drive(body, Failing(300, 200), seconds=2, inputs=nothing)
        assert robot.stands() and (300, 200) in robot.told


def test_a_connection_that_breaks_is_made_anew_to_stop_the_robot(wifi: WifiEpuck) -> None:
    """It is told to stand before the drive ends; the new connection, which has no guard, drives nothing."""

    def breaks(packet: bytes) -> bytes:
        if (300, 200) in wifi.told:
            wifi.spoil = lambda packet: packet
            wifi.source.shutdown(socket.SHUT_RDWR)  # type: ignore[attr-defined]
        return packet

    with opened(wifi) as body:
        wifi.spoil = breaks
        with pytest.raises(LineError, match="the line is lost"):
            drive(body, Constant(300, 200), seconds=2, inputs=nothing)
        assert wifi.stands()
        told = len(wifi.told)
        with pytest.raises(LineError, match=r"the connection to .* broke"):
            body.act(Command(left=300, right=200))
    assert wifi.stands() and (300, 200) not in wifi.told[told:]


def test_another_robot_is_named_by_what_it_says(serial: SerialEpuck) -> None:
    """A Khepera at an e-puck's address, and an e-puck at a Khepera's."""
    said = "expected {} to answer, got {!r}".format
    with (
        closing(Kheperalike()) as khepera,
        pytest.raises(LineError, match=said("e-puck", "Command not found")),
    ):
        Epuck.connect(khepera.device, give_up_s=0.1)
    with pytest.raises(LineError, match=said("Khepera", "z,Command not found")):
        Khepera.connect(serial.device, baud=115200, give_up_s=0.1)


def test_nobody_there_says_what_to_check(serial: SerialEpuck, tmp_path: Path) -> None:
    """No such device, no right to it, no answer; nothing at the address, no such name, another service."""
    with pytest.raises(UsageError, match="No such file or directory; check the cable"):
        Address.parse(f"epuck:{tmp_path}/rfcomm0").open()
    with pytest.raises(UsageError, match="No such file or directory"):
        Address.parse(f"epuck2:{tmp_path}/ttyACM0").open()
    with Pump(serial.device, Faults()) as pump:
        pump.silent = True
        with pytest.raises(LineError, match=r"no e-puck answers on .* check that it is switched on"):
            Epuck.connect(pump.device, give_up_s=0.1)
    with socket.create_server(("127.0.0.1", 0)) as server:
        place = f"127.0.0.1:{server.getsockname()[1]}"

        heard = []

        def greet() -> None:
            heard.append(server.accept()[0])
            heard[0].sendall(b"SSH-2.0-OpenSSH_9.2\r\n" * 9)

        threading.Thread(target=greet, daemon=True).start()
        with pytest.raises(LineError, match=r"no e-puck2 answers at .*it says b'SSH-2.0"):
            Address.parse(f"epuck2:{place}").open()
        heard[0].close()
    for wrong in (place, "no.such.host.invalid", "localhost:port", "localhost:99999"):
        with pytest.raises(UsageError, match=r"cannot be reached: (?!Unknown error).*HOST or HOST:PORT"):
            Address.parse(f"epuck2:{wrong}").open()


def test_brackets_about_an_ipv6_address_are_known() -> None:
    """A Thymio's simulator may have one; an e-puck2 has none, and is told so."""
    with pytest.raises(UsageError, match=r"expected a port from 1 to 65535 \(an e-puck2 has no IPv6\)"):
        Address.parse("epuck2:[::1]").open()
    with socket.socket(socket.AF_INET6) as there:
        try:
            there.bind(("::1", 0))
        except OSError:
            pytest.skip("no IPv6 here")
        with pytest.raises(UsageError, match="refused"):  # nobody listens
            Address.parse(f"thymio:[::1]:{there.getsockname()[1]}").open()


def test_a_port_beyond_the_last_is_not_taken_for_another(wifi: WifiEpuck) -> None:
    """The system would take 66536 for 1000, in silence."""
    host, _, port = wifi.place.partition(":")
    for kind in ("epuck2", "thymio"):
        with pytest.raises(UsageError, match=r"expected a port from 1 to 65535, got '?\d{5,6}"):
            Address.parse(f"{kind}:{host}:{int(port) + 2**16}").open()


@pytest.mark.parametrize("name", ["serial", "wifi"])
def test_check_and_record(name: str, request: pytest.FixtureRequest, tmp_path: Path) -> None:
    """`robot check` moves it 2 cm; `record` keeps its eight sensors of 12 bits."""
    robot: Emulated = request.getfixturevalue(name)
    words = f"robot check --robot {address(robot)} --seconds 0.5 --yes --json"
    made = CliRunner().invoke(realitygap, words.split())
    assert made.exit_code == 0, made.output
    facts = json.loads(made.stdout)
    assert facts["firmware"].startswith("Version") and facts["faults"] == 0
    assert len(facts["proximity"]) == len(facts["ambient"]) == 8
    assert 130 < facts["movement"]["left"] < 170
    words = f"record --robot {address(robot)} --plan infrared --object wall --repeats 2 --out {tmp_path}/r"
    made = CliRunner().invoke(realitygap, words.split(), input="\n" * 4 + "q\n")
    assert made.exit_code == 0, made.output
    file = next((tmp_path / "r").rglob("recording.toml"))
    assert load_recording(file.parent).kind == "infrared"
    facts = tomllib.loads(file.read_text())
    assert (facts["sensors"], facts["full_scale"], facts["robot"]) == (8, 4095, "e-puck")
    assert (facts["base"], facts["pulses_per_mm"], facts["body_radius_cm"]) == ("e-puck", 7.8125, 3.7)


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A small one, evolved for the profile e-puck."""
    folder = tmp_path_factory.mktemp("epuck") / "study"
    config = StudyConfig.single("obstacle-avoidance", profile="e-puck", evaluations=9).with_settings(
        ["task.seconds=1", "evolution.rows=3", "evolution.columns=3", "fresh_trials=1", "retest_trials=1"]
    )
    run_study(folder, config, workers=1)
    return folder


@pytest.mark.parametrize("name", ["serial", "wifi"])
def test_transfer(name: str, request: pytest.FixtureRequest, study: Path) -> None:
    """A person carries it to its start; what a network says are steps per second, up to the profile's 625."""
    robot: Emulated = request.getfixturevalue(name)
    words = f"transfer {study} --robot {address(robot)} --starts 1"
    made = CliRunner().invoke(realitygap, words.split(), input="\n" * 9)
    assert made.exit_code == 0, made.output
    [one] = [one for one in load_transfers(study) if one.robot == Address.parse(address(robot)).folder()]
    assert one.situated_from == "counters" and 0 <= one.fitness_situated <= 1
    assert 10 < max(max(map(abs, pair)) for pair in robot.told) <= 625 and robot.stands()
