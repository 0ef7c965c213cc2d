"""The served twin: a device that any program can open, a channel for the experimenter's hand."""

from __future__ import annotations

import os
import select
import subprocess
import sys
import termios
import time
from pathlib import Path

import pytest

from realitygap.robots.twin import Twin
from realitygap.values import Command, Pose
from tests.robots.conftest import ARENA, ROOT, Bench, bench
from tests.served import channel

__all__ = ["bench"]


def ask(fd: int, text: str, end: bytes = b"\r\n", seconds: float = 20.0) -> bytes:
    """Write to a device and collect what comes, up to an end that is waited for."""
    os.write(fd, text.encode())
    out, until = b"", time.monotonic() + seconds
    while not out.endswith(end) and (left := until - time.monotonic()) > 0:
        if select.select([fd], [], [], left)[0]:
            out += os.read(fd, 4096)
    return out


def test_any_program_can_talk_to_it(bench: Bench) -> None:
    """With nothing but open, write and read, in real time."""
    twin = bench.twin(unit=4)
    fd = os.open(twin.device, os.O_RDWR | os.O_NOCTTY)
    assert b"twin unit 4" in ask(fd, "", end=b"5.01\r\n")
    assert ask(fd, "B\r") == b"b,5.02,5.01\r\n"
    assert ask(fd, "nonsense\n") == b"Command not found\r\n"
    before = time.monotonic()
    ask(fd, "D,10,10\n")
    after = time.monotonic()
    time.sleep(0.4)
    least = time.monotonic() - after
    left = int(ask(fd, "H\n").split(b",")[1])
    assert 1000 * least - 50 < left < 1000 * (time.monotonic() - before) + 50
    os.close(fd)


def test_another_baud_rate_is_noise(bench: Bench) -> None:
    """A driver that sets another rate than the jumper's is not understood, nor understands."""
    twin = bench.twin(baud=9600)
    fd = os.open(twin.device, os.O_RDWR | os.O_NOCTTY)
    ask(fd, "", end=b"5.01\r\n")
    settings = termios.tcgetattr(fd)
    settings[4] = settings[5] = termios.B38400
    termios.tcsetattr(fd, termios.TCSANOW, settings)
    noise = ask(fd, "B\n", end=b"\n", seconds=0.4)
    assert b"b" not in noise
    settings[4] = settings[5] = termios.B9600
    termios.tcsetattr(fd, termios.TCSANOW, settings)
    assert ask(fd, "\nB\n", end=b"b,5.02,5.01\r\n").endswith(b"b,5.02,5.01\r\n")
    os.close(fd)


def test_the_channel_refuses_what_it_does_not_know(bench: Bench) -> None:
    """With one line each, and goes on."""
    twin = bench.twin()
    answers = channel(twin, "fly", "place 1 2", "film /nowhere/at/all", "place 11 12 0.5")
    assert answers[0] == "error expected place, film or quit; got 'fly'"
    assert all(answer.startswith("error") for answer in answers[1:3]) and answers[3] == "ok"


def test_a_twin_that_enters_again_is_a_fresh_one() -> None:
    """Whatever the one before did: banner, time, counters, place and noise are a new one's, to the bit."""
    rooms: tuple[dict[str, object], ...] = (
        {"size_cm": [50, 50], "cylinders": [[28, 34, 3]]},
        {"size_cm": [40, 60]},
    )

    def life(body: Twin, seed: int) -> list[object]:
        body.enter(rooms[seed % 2], seed, Pose(x=20, y=30, heading=1.0))
        said = [body.banner, list(body.sense().proximity)]
        body.act(Command(left=5, right=2))
        body.clock.sleep_until(0.5)
        return [*said, list(body.sense().proximity), body.read("H"), body.clock.now()]

    settings: dict[str, object] = {"unit": 2, "baud": 57600, "noise": 2.0}
    one = Twin(**settings)
    first, other, again = life(one, 4), life(one, 9), life(one, 4)
    assert first == again != other == life(Twin(**settings), 9)


def test_a_broken_gl_library_is_no_matter_of_the_twin() -> None:
    """MUJOCO_GL concerns the renderer alone: with a library that is not there, trials are as before."""
    code = (
        f"from realitygap.robots.twin import Twin; one = Twin(1); one.enter({ARENA!r}, 3, None)\n"
        "print(one.sense().proximity.tolist())"
    )
    said = [
        subprocess.run(
            [sys.executable, "-c", code], env={**os.environ, "MUJOCO_GL": name}, cwd=ROOT,
            capture_output=True, text=True, check=True,
        ).stdout
        for name in ("", "osmesa", "nonsense")
    ]  # fmt: skip
    assert said[0] == said[1] == said[2]


@pytest.mark.parametrize(
    "words",
    [
        "robot serve --arena light",
        "record --robot twin --plan wheels --out made",
        "record --robot thymio:COM3 --plan wheels --out made",
        "evolve light --out made",
    ],
)
def test_a_system_without_locks_is_told_so(words: str, tmp_path: Path) -> None:
    """As Windows: one line that a person can act on, whichever command comes first, and nothing is made."""
    absent = "import sys; sys.modules |= dict.fromkeys(['fcntl', 'pty', 'termios', 'tty'])"
    begin = f"{absent}; from realitygap.cli import main; main()"
    order = [sys.executable, "-c", begin, *words.split()]
    made = subprocess.run(order, cwd=tmp_path, capture_output=True, text=True, timeout=120)
    assert made.returncode == 2 and not list(tmp_path.iterdir())
    assert made.stderr.startswith("error: realitygap needs Linux or macOS") and "WSL" in made.stderr
    assert len(made.stderr.splitlines()) == 1
