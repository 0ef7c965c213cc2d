"""The twin's process: a robot behind a pseudo-terminal, its clock and the experimenter's hand.

On the pseudo-terminal there is the robot's protocol and nothing else. A second channel, a Unix
socket, takes lines of text: `run` from a virtual clock (realitygap.robots.clock says how), and from
the experimenter `place X_CM Y_CM HEADING_RAD`, `film FILE` (write where the robot is every 20 ms,
for the camera; `film` alone ends it), `renew {"seed": SEED}` (switch this robot off and another on: all that
a fresh process would make of these settings, the others staying, so that many trials need one process) and
`quit`. Each is answered with one line.
"""

import atexit
import contextlib
import gc
import importlib
import json
import math
import os
import select
import signal
import socket
import sys
import tempfile
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import IO, Any, Self

from realitygap.errors import RealityGapError, UsageError
from realitygap.files import naming_errors
from realitygap.robots.khepera.protocol import KHEPERA
from realitygap.twin.firmware import Firmware
from realitygap.twin.port import Port
from realitygap.work import child

__all__ = ["BODY", "STRANGER", "Server", "Settings"]

BODY = "realitygap.twin.body:TwinBody"
"""The robot's physics: any class with this one's interface may take its place."""
STRANGER = "realitygap.twin.stranger:StrangerBody"
"""One that does: outside the family of laws that a calibration can fit."""

FILM_MS = 20
TICK_S = 0.01
"""How often the physics is brought to the present under the real clock."""

CHUNK = 4096
ANSWER_S = 60.0
"""Real time after which an answer that nobody fetches is given up."""


@dataclass(frozen=True, kw_only=True)
class Settings:
    """How a twin is started.

    Args:
        arena, unit, noise, seed: as of `TwinBody`.
        clock: "virtual", or "real" time.
        baud: the robot's jumper.
        pose: x, y (cm) and heading (rad) at first; None leaves it to the body.
        body: the physics, "module:class".

    Raises:
        UsageError: another clock, or no rate of the robot's.
    """

    arena: Mapping[str, Any]
    unit: int
    noise: float = 1.0
    seed: int = 0
    clock: str = "virtual"
    baud: int = 38400
    pose: tuple[float, float, float] | None = None
    body: str = BODY

    def __post_init__(self) -> None:
        if self.clock not in ("virtual", "real"):
            raise UsageError(f'a twin\'s clock is "virtual" or "real"; got {self.clock!r}')
        if self.baud not in KHEPERA.rates:
            raise UsageError(
                f"the robot's baud rates are {', '.join(map(str, KHEPERA.rates))}; got {self.baud}"
            )


class Server:
    """Serves one robot, at first of these settings. As a context it opens and closes the device and the
    channel."""

    def __init__(self, settings: Settings) -> None:
        self.settings = settings
        self.firmware = _switched_on(settings)
        self.virtual = settings.clock == "virtual"
        self._film: IO[str] | None = None
        self._running = True
        self._buffers: dict[socket.socket, bytes] = {}

    def __enter__(self) -> Self:
        self._folder = tempfile.TemporaryDirectory(prefix="realitygap-")
        self.channel = os.path.join(self._folder.name, "clock")
        self._listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        self._listener.bind(self.channel)
        self._listener.listen()
        self._port = Port(self.firmware.baud)
        self.device = self._port.name
        return self

    def __exit__(self, *error: object) -> None:
        with contextlib.suppress(OSError):  # a full disk: whoever fetches the film is told
            self._end_film()
        for connection in (self._listener, *self._buffers):
            connection.close()
        self._port.close()
        self._folder.cleanup()

    def serve(self, leash: int | None = None) -> None:
        """Serve until told to quit, or until the descriptor `leash` closes."""
        self._start = time.monotonic_ns() - self.firmware.now
        watched: list[Any] = [self._listener, *([] if leash is None else [leash])]
        if not self.virtual:
            watched.append(self._port)
        while self._running:
            ready, _, _ = select.select([*watched, *self._buffers], [], [], self._nap())
            if not self.virtual:
                self._keep_up(self._port in ready)
            for source in ready:
                if source is self._listener:
                    self._greet()
                elif isinstance(source, socket.socket):
                    self._hear(source)
                elif source == leash and not os.read(source, CHUNK):
                    self._running = False

    def _greet(self) -> None:
        """Hear another clock, or hand; whoever fetches no answers is not waited for without end."""
        connection, _ = self._listener.accept()
        child.give_up_after(connection, ANSWER_S)
        self._buffers[connection] = b""

    def _nap(self) -> float | None:
        """How long nothing happens, real time in s."""
        if self.virtual:
            return None
        due = (self.firmware.next_event() - (time.monotonic_ns() - self._start)) / 1e9
        return min(TICK_S, max(0.0, due))

    def _keep_up(self, written: bool) -> None:
        """The real clock: the bytes that are there are being written now."""
        out = self.firmware.run(time.monotonic_ns() - self._start)
        if written:
            self.firmware.receive(self._port.read(CHUNK))
        self._port.write(out)

    def _hear(self, source: socket.socket) -> None:
        try:
            data = source.recv(CHUNK)
        except OSError:
            data = b""
        if not data:
            del self._buffers[source]
            source.close()
            return
        *lines, rest = (self._buffers[source] + data).split(b"\n")
        self._buffers[source] = rest
        answers = [self._do(line.decode("utf-8", "replace")) + "\n" for line in lines]
        with contextlib.suppress(OSError):  # whoever asked is gone
            source.sendall("".join(answers).encode())

    def _do(self, line: str) -> str:
        """Carry out one line of the channel; the answer."""
        word, _, rest = line.partition(" ")
        try:
            if word == "run":
                until, written, lines = map(int, rest.split())
                return self._allow(until, written, lines)
            if word == "place":
                x_cm, y_cm, heading = map(float, rest.split())
                self.firmware.catch_up()
                self.firmware.body.place(x_cm, y_cm, heading)
            elif word == "film":
                self._end_film()
                if rest:
                    self._start_film(Path(rest))
            elif word == "renew":
                self._end_film()
                self._renew(json.loads(rest))
            elif word == "quit":
                self._running = False
            else:
                return f"error expected run, place, film, renew or quit; got {line!r}"
        except (AttributeError, ImportError, TypeError, ValueError, OSError, RealityGapError) as error:
            return f"error {' '.join(str(error).split())}"
        return "ok"

    def _renew(self, given: Mapping[str, Any]) -> None:
        """Another robot, by the settings of this one and those given."""
        settings = replace(self.settings, **given)
        if settings.clock != self.settings.clock:
            raise UsageError(f"its clock stays {self.settings.clock!r}; start another twin")
        self.firmware, self.settings = _switched_on(settings), settings
        self._port.clear(settings.baud)
        self._start = time.monotonic_ns() - self.firmware.now

    def _allow(self, until: int, written: int, lines: int) -> str:
        """Let time run; under the real clock it runs by itself."""
        if not self.virtual:
            return "error this twin runs in real time: connect to it without a clock channel"
        if written:
            self.firmware.receive(self._port.read_all(written))
        out = self.firmware.run(until, lines)
        return f"at {self.firmware.now} {self._port.write(out)}"

    def _start_film(self, path: Path) -> None:
        film = self._film = path.open("w", encoding="utf-8")
        film.write("t_s,x_cm,y_cm,heading_deg,led_0,led_1\n")

        def look() -> None:
            body = self.firmware.body
            x, y, heading = body.truth()
            where = f"{body.time_ms / 1000:.3f},{x:.6f},{y:.6f},{math.degrees(heading):.6f}"
            film.write(f"{where},{int(body.leds[0])},{int(body.leds[1])}\n")

        self.firmware.watch(FILM_MS, look)

    def _end_film(self) -> None:
        if self._film is not None:
            film, self._film = self._film, None
            self.firmware.watch(FILM_MS, None)
            with naming_errors(film.name):
                film.close()


def _switched_on(settings: Settings) -> Firmware:
    """A robot of these settings."""
    who = "stranger" if settings.body == STRANGER else "twin"
    banner = (
        f"Khepera, {who} unit {settings.unit}: pseudo-reality, no robot",
        "bios 5.02, serial protocol 5.01",
    )
    module, name = settings.body.split(":")
    make = getattr(importlib.import_module(module), name)
    body = make(settings.arena, unit=settings.unit, noise=settings.noise, seed=settings.seed)
    if settings.pose:
        body.place(*settings.pose)
    if settings.clock == "real":  # what it calls is compiled now: drivers wait a second for an answer
        body.advance(1), body.proximity(), body.ambient()
    return Firmware(body, baud=settings.baud, banner=banner)


def _main() -> int:
    """Settings as a JSON line on stdin, device and channel as one on stdout; ends with stdin."""
    atexit.register(gc.freeze)  # else all that was loaded is searched for garbage, up to a third of a second
    stop: Callable[..., None] = lambda *_: sys.exit(0)  # noqa: E731
    signal.signal(signal.SIGTERM, stop)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the driver's: it must stop the robot first
    order = sys.stdin.buffer.readline()
    if not order.endswith(b"\n"):
        return 0  # whoever started it is gone already
    try:
        with Server(Settings(**json.loads(order))) as server:
            _say({"device": server.device, "channel": server.channel})
            server.serve(leash=sys.stdin.fileno())
    except UsageError as error:
        _say({"error": str(error)})
        return error.exit_code
    except BrokenPipeError:
        return 0  # gone meanwhile
    return 0


def _say(answer: Mapping[str, Any]) -> None:
    """A line on stdout, past its buffer: nothing is left there to fail again at the end."""
    os.write(sys.stdout.fileno(), json.dumps(answer).encode() + b"\n")


if __name__ == "__main__":
    sys.exit(_main())
