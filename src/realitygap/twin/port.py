"""The twin's end of the serial line: a pseudo-terminal that any program can open."""

import errno
import fcntl
import os
import pty
import select
import termios
import tty

__all__ = ["Port"]

PATIENCE_S = 3.0
"""Real time to wait for bytes that were announced: after it they are lost."""

_NOISE = bytes(range(128, 256)) * 2
"""What a character becomes at another rate than the robot's: nothing that anyone could read."""


class Port:
    """A pseudo-terminal, `name`, set to the robot's rate; a driver may set it to another.

    Its own end of the driver's side stays open, so that drivers may come and go.
    """

    def __init__(self, baud: int) -> None:
        self._master, self._slave = pty.openpty()
        tty.setraw(self._slave)
        self._tune(baud)
        flags = fcntl.fcntl(self._master, fcntl.F_GETFL)
        fcntl.fcntl(self._master, fcntl.F_SETFL, flags | os.O_NONBLOCK)
        self.name = os.ttyname(self._slave)

    def _tune(self, baud: int) -> None:
        self._rate = int(getattr(termios, f"B{baud}"))
        settings = termios.tcgetattr(self._slave)
        settings[4] = settings[5] = self._rate
        termios.tcsetattr(self._slave, termios.TCSANOW, settings)

    def fileno(self) -> int:
        """For select."""
        return self._master

    def close(self) -> None:
        """Hang up."""
        os.close(self._master)
        os.close(self._slave)

    def clear(self, baud: int) -> None:
        """Drop what is on the line, both ways; set it to the robot's rate."""
        termios.tcflush(self._slave, termios.TCIOFLUSH)
        termios.tcflush(self._master, termios.TCIOFLUSH)
        self._tune(baud)

    def read(self, count: int) -> bytes:
        """At most so many bytes, those that are there; at a wrong rate noise."""
        try:
            return self._tuned(os.read(self._master, count))
        except OSError as error:
            if error.errno not in (errno.EAGAIN, errno.EIO):  # nothing there; nobody there
                raise
            return b""

    def read_all(self, count: int) -> bytes:
        """So many bytes, or fewer if some were lost on the way to here."""
        data = self.read(count)
        while len(data) < count and select.select([self._master], [], [], PATIENCE_S)[0]:
            data += self.read(count - len(data))
        return data

    def write(self, data: bytes) -> int:
        """Bytes onto the line; what nobody fetches is lost, as a robot's would be.

        Returns:
            How many of them are on it.
        """
        try:
            return os.write(self._master, self._tuned(data)) if data else 0
        except BlockingIOError:
            return 0

    def _tuned(self, data: bytes) -> bytes:
        """The bytes as they come through at the rate that the driver has set."""
        if not data or termios.tcgetattr(self._slave)[5] == self._rate:
            return data
        return data.translate(_NOISE)
