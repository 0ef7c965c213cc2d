"""The emulated robot answers as the robot does, at its time on the wire."""

from __future__ import annotations

import csv
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from realitygap.twin.firmware import NEVER, Firmware
from realitygap.values import Pose
from tests.robots.kinematic import KinematicBody

MS = 1_000_000
ARENA = {"size_cm": [50.0, 50.0]}


def firmware(baud: int = 115200, banner: bool = False) -> Firmware:
    """A robot without noise, its banner read."""
    made = Firmware(KinematicBody(ARENA, unit=1, noise=0, seed=0), baud=baud, name="twin unit 1")
    if not banner:
        made.run(100 * MS)
    return made


def says(robot: Firmware, text: str, ms: int = 50) -> str:
    """What the robot answers to a text within some time."""
    robot.receive(text.encode("latin-1"))
    return robot.run(robot.now + ms * MS).decode().replace("\r\n", "|")


@pytest.mark.parametrize(
    ("text", "answer"),
    [
        ("A,3800,800,100\n", "a|"),
        ("B\n", "b,5.02,5.01|"),
        ("C,100,200\n", "c|"),
        ("D,5,-5\n", "d|"),
        ("E\n", "e,0,0|"),
        ("F,3000,20,4000\n", "f|"),
        ("G,7,-8\n", "g|"),
        ("H\n", "h,0,0|"),
        ("I,3\n", "i,300|"),
        ("J,20,64,20,64\n", "j|"),
        ("K\n", "k,1,0,0,1,0,0|"),
        ("L,0,1\n", "l|"),
        ("P,100,-100\n", "p|"),
        ("T,1,2\n", "Command not found|"),
        ("D,128,0\n", "z,Protocol error|"),
        ("D,5\n", "z,Protocol error|"),
        ("hello\n", "Command not found|"),
        ("d,1,1\n", "Command not found|"),
        ("\n\r\n", ""),
        ("B\rE\r\n", "b,5.02,5.01|e,0,0|"),
    ],
)
def test_each_command_has_its_answer(text: str, answer: str) -> None:
    """Right ones in lower case, wrong ones in the robot's words, empty lines none."""
    assert says(firmware(), text) == answer


def test_wheels_leds_and_settings_follow_their_commands() -> None:
    """Counters count, position control arrives, LEDs change, gains reach the body."""
    robot = firmware()
    says(robot, "D,10,-10\n", 1000)
    left, right = robot.body.pulses()
    assert abs(left - 1000) <= 12 and right == -left
    assert says(robot, "E\n") == "e,10,-10|"
    assert says(robot, "G,0,0\nC,120,60\nK\n", 20).startswith("g|c|k,0,1,")
    robot.run(robot.now + 2000 * MS)
    assert says(robot, "K\nH\n") == "k,1,1,0,1,1,0|h,120,60|"
    says(robot, "L,1,2\nL,0,1\n")
    assert robot.body.leds == [1, 1]
    says(robot, "L,1,2\nA,1,2,3\n")
    assert robot.body.leds == [1, 0] and robot.body.settings["speed gains"] == (1, 2, 3)


@pytest.mark.parametrize("baud", [9600, 38400, 115200])
def test_each_character_takes_eleven_bits(baud: int) -> None:
    """An answer is out when command and answer have gone over the wire, not a nanosecond before."""
    robot = firmware(baud)
    start = robot.now
    robot.receive(b"H\n")
    out = robot.run(NEVER - 1, 1)
    assert out == b"h,0,0\r\n"
    assert robot.now - start == pytest.approx((2 + len(out)) * 11e9 / baud, abs=2)


def test_a_command_in_pieces_is_one_command() -> None:
    """Its line end decides."""
    robot = firmware()
    assert says(robot, "D,1") == "" and says(robot, "0,10") == ""
    assert says(robot, "\n") == "d|"
    assert says(robot, "E\n") == "e,10,10|"
    assert says(robot, "N" * 5000 + "\n", 1000) == "Command not found|"


def test_time_does_not_depend_on_how_it_is_cut() -> None:
    """One long stretch or many short ones: same answers, same place, same time."""
    ends = []
    for cut in (1, 7, 50):
        robot = firmware()
        robot.receive(b"D,7,5\nH\nN\n")
        out = b"".join(robot.run(100 * MS + k * 1000 * MS // cut) for k in range(1, cut + 1))
        ends.append((out, robot.now, robot.body.time_ms, robot.body.pulses()))
    assert ends[0] == ends[1] == ends[2]


def test_a_film_has_the_pose_each_20_ms(tmp_path: Path) -> None:
    """Of the twin's own time, from now on, however time is cut; the file says no more after its end."""
    robot = firmware()
    robot.place(Pose(x=11, y=12, heading=0.5))
    robot.film(tmp_path / "states.csv")
    for until in (115, 120, 121, 333):
        robot.run(until * MS)
    robot.film(None)
    robot.run(400 * MS)
    rows = list(csv.DictReader((tmp_path / "states.csv").read_text().splitlines()))
    assert [row["t_s"] for row in rows] == [f"{ms / 1000:.3f}" for ms in range(100, 334, 20)]
    assert {(row["x_cm"], row["y_cm"], row["heading_deg"]) for row in rows} == {
        ("11.000000", "12.000000", "28.647890")
    }


@given(st.lists(st.binary(max_size=40), max_size=10))
def test_no_bytes_break_the_robot(pieces: list[bytes]) -> None:
    """After any noise, a line end and a question are answered."""
    robot = firmware()
    for piece in pieces:
        robot.receive(piece)
        robot.run(robot.now + 5 * MS)
    robot.receive(b"\n")
    robot.run(robot.now + 1000 * MS)
    assert says(robot, "B\n") == "b,5.02,5.01|"
