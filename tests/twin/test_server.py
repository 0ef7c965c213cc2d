"""The twin's process: a device that any program can open, a channel for clock and hand."""

from __future__ import annotations

import csv
import os
import select
import signal
import socket
import subprocess
import sys
import termios
import time
from pathlib import Path
from typing import Any

import pytest

from realitygap.errors import RobotError, UsageError
from realitygap.robots.clock import VirtualClock
from realitygap.robots.khepera.twin import TwinBody
from realitygap.twin.process import TwinProcess, start_twin
from realitygap.twin.server import Server, Settings
from realitygap.values import Command, Pose
from tests.robots.conftest import ARENA, BODY, ROOT, Bench, bench
from tests.robots.kinematic import KinematicBody

__all__ = ["bench"]


def ask(fd: int, text: str, end: bytes = b"\r\n", seconds: float = 20.0) -> bytes:
    """Write to a device and collect what comes, up to an end that is waited for."""
    os.write(fd, text.encode())
    out, until = b"", time.monotonic() + seconds
    while not out.endswith(end) and (left := until - time.monotonic()) > 0:
        if select.select([fd], [], [], left)[0]:
            out += os.read(fd, 4096)
    return out


def channel(twin: TwinProcess, *lines: str) -> list[str]:
    """What the second channel answers."""
    with socket.socket(socket.AF_UNIX) as sock:
        sock.connect(twin.channel)
        file = sock.makefile("rw")
        answers = []
        for line in lines:
            file.write(line + "\n")
            file.flush()
            answers.append(file.readline().strip())
        file.close()
        return answers


def test_any_program_can_talk_to_it(bench: Bench) -> None:
    """With nothing but open, write and read, in real time."""
    twin = bench.twin(clock="real", unit=4)
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
    twin = bench.twin(clock="real", baud=9600)
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
    answers = channel(twin, "fly", "place 1 2", "run x", "film /nowhere/at/all", "run 0 0 0", "renew it")
    assert answers[0] == "error expected run, place, film, renew or quit; got 'fly'"
    assert all(answer.startswith("error") for answer in answers[1:4])
    assert answers[4] == "at 0 0" and answers[5].startswith("error")


def test_a_clock_for_a_real_time_twin_is_refused(bench: Bench) -> None:
    """Real time cannot be told how far to run."""
    twin = bench.twin(clock="real")
    with pytest.raises(RobotError, match="runs in real time"):
        VirtualClock(twin.channel)


@pytest.mark.parametrize("clock", ["real", "virtual"])
def test_what_is_compiled_is_called_before_real_time_runs(monkeypatch, clock: str) -> None:
    """A driver does not wait for a compilation; in virtual time, which waits, nothing happens beforehand."""
    called = []
    for name in ("advance", "proximity", "ambient"):
        monkeypatch.setattr(KinematicBody, name, lambda *_, name=name: called.append(name))
    Server(Settings(arena=ARENA, unit=1, clock=clock, body=BODY))
    assert called == (["advance", "proximity", "ambient"] if clock == "real" else [])


def test_virtual_time_stands_until_it_is_let_go(bench: Bench, tmp_path: Path) -> None:
    """However long one waits; and the hand's poses are filmed to the sealed file every 20 ms."""
    twin = bench.twin()
    clock = VirtualClock(twin.channel)
    twin.place(Pose(x=11, y=12, heading=0.5))
    twin.film(tmp_path / "states.csv")
    time.sleep(0.1)
    clock.sleep_until(0.1)
    clock.settle()
    twin.film(None)
    clock.close()
    rows = list(csv.DictReader((tmp_path / "states.csv").read_text().splitlines()))
    assert [row["t_s"] for row in rows] == ["0.000", "0.020", "0.040", "0.060", "0.080", "0.100"]
    assert {(row["x_cm"], row["y_cm"], row["heading_deg"]) for row in rows} == {
        ("11.000000", "12.000000", "28.647890")
    }


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="the system has no /dev/full")
@pytest.mark.parametrize("told", [True, False])
def test_a_film_on_a_full_disk_is_told_to_whoever_asks(told: bool) -> None:
    """By the file's name; and the process ends without a traceback, whether anybody asked or not."""
    with Server(Settings(arena=ARENA, unit=1, body=BODY)) as server:
        assert server._do("film /dev/full") == "ok"
        if told:
            assert server._do("film") == "error [Errno 28] No space left on device: '/dev/full'"


def test_a_renewed_twin_is_a_fresh_one(bench: Bench) -> None:
    """Whatever the one before did, read or left on the line: banner, time, counters, place and noise
    are those of a process started with the new seed, and so is every bit of the conversation."""

    def life(twin: TwinProcess) -> tuple[object, ...]:
        clock = VirtualClock(twin.channel)
        khepera = bench.khepera(twin.device, clock)
        said = [khepera.banner, khepera.counters(), khepera.read("N")]
        khepera.command(7, -2)
        clock.sleep_until(clock.now() + 0.7)
        said += [khepera.read("O"), khepera.counters(), khepera.speeds(), clock.now()]
        khepera.line.tell(b"N\nH\nD,1")  # left half said, its answers unheard
        clock.sleep_until(clock.now() + 0.1)
        clock.settle()
        khepera.abandon()
        clock.close()
        return tuple(said)

    body = "realitygap.twin.body:TwinBody"
    twin = bench.twin(seed=4, body=body)
    one, two = life(twin), (twin.renew(seed=9), life(twin))[1]
    assert two == life(bench.twin(seed=9, body=body)) != one
    twin.renew(seed=4)
    assert life(twin) == one


def test_a_process_serves_one_body_after_another(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of another unit, in another room, at another rate, with the bits of a process of its own; one that
    was abandoned, or has died, serves nobody."""
    monkeypatch.setattr("realitygap.robots.khepera.twin._IDLE", [])
    rooms: tuple[dict[str, object], ...] = (
        {"size_cm": [50, 50], "cylinders": [[28, 34, 3]]},
        {"size_cm": [40, 60]},
    )

    def life(body: TwinBody, room: dict[str, object]) -> tuple[int, list[object]]:
        body.enter(room, 3, Pose(x=20, y=30, heading=1.0))
        assert body.twin is not None
        pid, said = body.twin.pid, [body.driver.banner, list(body.sense().proximity)]
        body.act(Command(left=5, right=2))
        body.clock.sleep_until(0.5)
        return pid, [*said, list(body.sense().proximity), body.driver.counters()]

    def drive(last: str, **settings: Any) -> tuple[int, list[object]]:
        body = TwinBody(**settings)
        try:
            return life(body, rooms[settings["unit"] - 1])
        finally:
            getattr(body, last)()

    one, two = {"unit": 1, "baud": 38400}, {"unit": 2, "baud": 57600, "noise": 2.0}
    first, second, third = drive("close", **one), drive("close", **two), drive("abandon", **one)
    assert first == third and first[0] == second[0]
    fresh = drive("abandon", **two)
    assert fresh[0] != first[0] and fresh[1] == second[1]
    pid, said = drive("close", **one)
    os.kill(pid, signal.SIGKILL)
    again = drive("abandon", **one)
    assert again[0] != pid and again[1] == said == first[1]


def test_a_forked_process_takes_no_twin_of_its_parents() -> None:
    """Two processes that commanded one twin would both be wrong, and neither would know."""
    code = f"""
import os
from realitygap.robots.khepera.twin import TwinBody

def pid():
    body = TwinBody(1)
    body.enter({ARENA!r}, 3, None)
    found = body.twin.pid
    body.close()
    return found

first = pid()
if os.fork() == 0:
    print(pid() == first, flush=True)
    os._exit(0)
os.wait()
print(pid() == first)
"""
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["False", "True"]


def test_a_twin_ends_with_its_parent(bench: Bench, tmp_path: Path) -> None:
    """A parent killed with kill -9 leaves no twin behind, nor its channel's folder."""
    code = f"""
import time
from realitygap.twin.process import start_twin
twin = start_twin({ARENA!r}, unit=1, body={BODY!r})
print(twin.pid, twin.channel, flush=True)
time.sleep(60)
"""
    command = [sys.executable, "-c", code]
    with subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True) as parent:
        assert parent.stdout is not None
        pid, path = parent.stdout.readline().split()
        parent.send_signal(signal.SIGKILL)
    until = time.monotonic() + 60
    while time.monotonic() < until and (Path(path).parent.exists() or _alive(pid)):
        time.sleep(0.02)
    assert not Path(path).parent.exists() and not _alive(pid)


def _alive(pid: str) -> bool:
    """Whether a process holds anything open (one that nobody has waited for does not)."""
    try:
        return bool(os.listdir(f"/proc/{pid}/fd"))
    except OSError:
        return False


@pytest.mark.parametrize(
    "words",
    [
        "twin serve --arena light",
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


@pytest.mark.parametrize(
    ("settings", "says"),
    [({"clock": "sun"}, "clock is"), ({"baud": 1200}, "9600, 19200"), ({"body": "no.such:Body"}, "start")],
)
def test_a_wrong_setting_is_refused(bench: Bench, settings: dict[str, object], says: str) -> None:
    """Before or by the process; it never hangs."""
    with pytest.raises(UsageError, match=says):
        start_twin(ARENA, **{"unit": 1, "body": BODY, **settings})  # type: ignore[arg-type]
