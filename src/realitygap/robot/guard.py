"""The robot's guard: a small process that stops the wheels if the driver's is killed.

It shares the driver's open line and waits on a pipe. When the pipe closes without a word the driver
is dead (kill -9 leaves no time for anything), and the guard tells the robot to stand.
"""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import time

__all__ = ["Guard"]

STOP = b"\nD,0,0\n"
REPEATS = 5
PAUSE_S = 0.05
LEAVE_S = 2.0


class Guard:
    """Watches over this process, for the line with descriptor `fd`."""

    def __init__(self, fd: int) -> None:
        watched, self._alive = os.pipe()
        try:
            self._process = subprocess.Popen(
                [sys.executable, "-m", "realitygap.robot.guard", str(watched), str(fd)],
                pass_fds=(watched, fd),
                stdin=subprocess.DEVNULL,
                start_new_session=True,
            )
        finally:
            os.close(watched)

    def release(self) -> None:
        """Send the guard away: the robot stands, or is another's business."""
        with contextlib.suppress(OSError):
            os.write(self._alive, b".")
        os.close(self._alive)
        try:
            self._process.wait(LEAVE_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()


def watch(watched: int, line: int) -> None:
    """Wait for the driver's word or its death; after its death tell the robot to stand."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    if os.read(watched, 1):
        return
    for _ in range(REPEATS):
        with contextlib.suppress(OSError):
            os.write(line, STOP)
        time.sleep(PAUSE_S)


if __name__ == "__main__":
    watch(int(sys.argv[1]), int(sys.argv[2]))
