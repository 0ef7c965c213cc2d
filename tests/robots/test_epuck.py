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

from realitygap.calibration.load import load_recording
from realitygap.cli import realitygap
from realitygap.errors import LineError, UsageError
from realitygap.robots.address import Address
from realitygap.robots.body import Body, Clock
from realitygap.robots.drive import Recorder, Recording, drive
from realitygap.robots.epuck import EpuckBody
from realitygap.robots.khepera import KheperaBody
from realitygap.testing import BodyContract
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
        body.attend("proximity", "ambient")
        body.reset()
        body.act(Command(left=300, right=-100))
        time.sleep(0.2)
        read = body.sense()
        assert read.proximity.tolist() == [10, 200, 3000, 4095, 0, 5, 6, 7]
        assert read.ambient.tolist() == [3900.0] * 8
        left, right = body.odometry.counters or (0, 0)
        assert left > 20 and right < 0
        body.stop()
        body.led(0, True)
        body.led(5, True)
        assert [bool(led) for led in robot.leds] == [True, *[False] * 4, True, False, False]
        assert body.line.faults == 0


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
        body.line.give_up_s = 10.0  # type: ignore[attr-defined]
        pump.faults = faults
        recording = drive(body, Constant(300, 200), seconds=2.5, inputs=nothing)
        pump.faults = Faults()
        assert body.line.faults > 0  # type: ignore[attr-defined]
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
        body.line.give_up_s = 10.0
        wifi.spoil = spoiler = Spoiler(spoil)
        recording = drive(body, Constant(300, 200), seconds=2.5, inputs=nothing)
        wifi.spoil = lambda packet: packet
        assert spoiler.answers > 40
        assert (body.line.faults > 0) is (len(spoil(b"\3")) != 2)
    assert len(recording.t) == 25 and wifi.stands()


def test_a_stall_stops_the_wheels_and_is_waited_out(wifi: WifiEpuck, tmp_path: Path) -> None:
    """As long as the longest of a real e-puck2: told to stand before anything else, then it drives on; the
    recording counts it."""
    stalled: list[int] = []

    def once(packet: bytes) -> bytes:
        if len(packet) > 1 and len(wifi.told) > 20 and not stalled:
            stalled.append(len(wifi.told))
            time.sleep(2.19)
        return packet

    with opened(wifi) as body:
        wifi.spoil = once
        folder = tmp_path / "r"
        made = drive(body, Constant(300, 200), seconds=2, inputs=nothing, recorder=Recorder(folder))
    assert made.ended == "finished" and len(made.t) == 20 and made.stalls == 1
    assert 2.0 < made.stalled_s < 3.0 and "stalled" in (made.timing or "")
    behind = wifi.told[stalled[0] :]
    assert behind[0] == (0, 0) and (300, 200) in behind and wifi.stands()
    end = tomllib.loads((folder / "drive.toml").read_text("utf-8"))["end"]
    assert end["stalls"] == 1 and end["stalled_s"] == made.stalled_s
    assert Recording.from_folder(folder).stalled_s == made.stalled_s


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (lambda packet: b"", r"did not confirm that it stopped .* may still be moving: lift it"),
        (lambda packet: packet[:99], r"packets are short: expected 104 bytes behind the first, got 98"),
    ],
    ids=["gone", "short"],
)
def test_a_robot_that_stays_silent_or_says_too_little_is_named(
    wifi: WifiEpuck, spoil: Callable[[bytes], bytes], said: str
) -> None:
    """After five seconds in which it was told to stand, it is given up."""
    with pytest.raises(LineError, match=said), opened(wifi) as body:
        wifi.spoil = lambda packet: spoil(packet) if len(wifi.told) > 10 else packet
        drive(body, Constant(300, 200), seconds=2, inputs=nothing)
    last = max(k for k, told in enumerate(wifi.told) if told != (0, 0))
    assert len(wifi.told) - last > 5


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
        EpuckBody.connect(khepera.device, give_up_s=0.1)
    with pytest.raises(LineError, match=said("Khepera", "z,Command not found")):
        KheperaBody.connect(serial.device, baud=115200, give_up_s=0.1)


def test_nobody_there_says_what_to_check(serial: SerialEpuck, tmp_path: Path) -> None:
    """No such device, no right to it, no answer; nothing at the address, no such name, another service."""
    with pytest.raises(UsageError, match="No such file or directory; check the cable"):
        Address.parse(f"epuck:{tmp_path}/rfcomm0").open()
    with pytest.raises(UsageError, match="No such file or directory"):
        Address.parse(f"epuck2:{tmp_path}/ttyACM0").open()
    with Pump(serial.device, Faults()) as pump:
        pump.silent = True
        with pytest.raises(LineError, match=r"no e-puck answers on .* check that it is switched on"):
            EpuckBody.connect(pump.device, give_up_s=0.1)
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
    for wrong in (place, "no.such.host.invalid", "localhost:port", "localhost:99999", "[::1]"):
        with pytest.raises(UsageError, match=r"cannot be reached: (?!Unknown error).*HOST or HOST:PORT"):
            Address.parse(f"epuck2:{wrong}").open()


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
