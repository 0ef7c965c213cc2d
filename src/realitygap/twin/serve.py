"""A twin in real time behind a pseudo-terminal, for any program that talks to a Khepera.

On the pseudo-terminal there is the robot's protocol and nothing else. A Unix socket beside it takes lines of
text from the experimenter: `place X_CM Y_CM HEADING_RAD`, `film FILE` (write where the robot is every 20 ms,
for the camera; `film` alone ends it) and `quit`. Each is answered with one line.
"""

import contextlib
import errno
import fcntl
import os
import pty
import select
import socket
import tempfile
import termios
import time
import tty
from pathlib import Path
from typing import Any, Self

from realitygap.errors import RealityGapError
from realitygap.twin.firmware import Firmware
from realitygap.values import Pose
from realitygap.work import child

__all__ = ["Server"]

TICK_S = 0.01
"""How often the physics is brought to the present."""

CHUNK = 4096
ANSWER_S = 60.0
"""After this time an answer is given up that a client does not read."""

_NOISE = bytes(range(128, 256)) * 2
"""What a character becomes at another rate than the robot's: nothing that anyone could read."""


class Server:
    """Serves one robot. As a context it opens and closes the device and the socket.

    Attributes:
        device: path of the pseudo-terminal; channel: path of the socket.
    """

    def __init__(self, firmware: Firmware) -> None:
        self.firmware = firmware
        body = firmware.body  # what it calls is compiled now: drivers wait a second for an answer
        body.advance(1)
        body.proximity()
        body.ambient()
        firmware.now = max(firmware.now, body.time_ms * 1_000_000)
        self._running = True
        self._buffers: dict[socket.socket, bytes] = {}

    def __enter__(self) -> Self:
        self._folder = tempfile.TemporaryDirectory(prefix="realitygap-twin-")
        self.channel = os.path.join(self._folder.name, "hand")
        self._listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        self._listener.bind(self.channel)
        self._listener.listen()
        self._port = _Port(self.firmware.baud)
        self.device = self._port.name
        return self

    def __exit__(self, *error: object) -> None:
        with contextlib.suppress(OSError):  # a full disk: whoever ends the film is told
            self.firmware.film(None)
        for connection in (self._listener, *self._buffers):
            connection.close()
        self._port.close()
        self._folder.cleanup()

    def serve(self, parent_pipe: int | None = None) -> None:
        """Serve until told to quit, or until the descriptor `parent_pipe` closes."""
        start = time.monotonic_ns() - self.firmware.now
        watched: list[Any] = [self._port, self._listener, *([] if parent_pipe is None else [parent_pipe])]
        while self._running:
            nap = (self.firmware.next_event() - (time.monotonic_ns() - start)) / 1e9
            ready, _, _ = select.select([*watched, *self._buffers], [], [], min(TICK_S, max(0.0, nap)))
            out = self.firmware.run(time.monotonic_ns() - start)
            if self._port in ready:
                self.firmware.receive(self._port.read())
            self._port.write(out)
            for source in ready:
                if source is self._listener:
                    connection, _ = self._listener.accept()
                    child.give_up_after(connection, ANSWER_S)
                    self._buffers[connection] = b""
                elif isinstance(source, socket.socket):
                    self._hear(source)
                elif source == parent_pipe and not os.read(source, CHUNK):
                    self._running = False

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
            if word == "place":
                x_cm, y_cm, heading = map(float, rest.split())
                self.firmware.place(Pose.reached(x_cm, y_cm, heading))
            elif word == "film":
                self.firmware.film(Path(rest) if rest else None)
            elif word == "quit":
                self._running = False
            else:
                return f"error expected place, film or quit; got {line!r}"
        except (ValueError, OSError, RealityGapError) as error:
            return f"error {' '.join(str(error).split())}"
        return "ok"


class _Port:
    """A pseudo-terminal, `name`, set to the robot's rate; a driver may set it to another.

    Its own end of the driver's side stays open, so that drivers may come and go.
    """

    def __init__(self, baud: int) -> None:
        self._master, self._slave = pty.openpty()
        tty.setraw(self._slave)
        self._rate = int(getattr(termios, f"B{baud}"))
        settings = termios.tcgetattr(self._slave)
        settings[4] = settings[5] = self._rate
        termios.tcsetattr(self._slave, termios.TCSANOW, settings)
        fcntl.fcntl(self._master, fcntl.F_SETFL, fcntl.fcntl(self._master, fcntl.F_GETFL) | os.O_NONBLOCK)
        self.name = os.ttyname(self._slave)

    def fileno(self) -> int:
        """For select."""
        return self._master

    def close(self) -> None:
        """Hang up."""
        os.close(self._master)
        os.close(self._slave)

    def read(self) -> bytes:
        """The bytes that are there; at a wrong rate noise."""
        try:
            return self._tuned(os.read(self._master, CHUNK))
        except OSError as error:
            if error.errno not in (errno.EAGAIN, errno.EIO):  # nothing there; nobody there
                raise
            return b""

    def write(self, data: bytes) -> None:
        """Bytes onto the line; what nobody fetches is lost, as a robot's would be."""
        with contextlib.suppress(BlockingIOError):
            os.write(self._master, self._tuned(data))

    def _tuned(self, data: bytes) -> bytes:
        """The bytes as they come through at the rate that the driver has set."""
        if not data or termios.tcgetattr(self._slave)[5] == self._rate:
            return data
        return data.translate(_NOISE)
