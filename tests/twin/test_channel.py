"""The twin's channel: messages in pieces and together, and whoever does not listen."""

from __future__ import annotations

import os
import socket
import threading
import time

import pytest

from realitygap.robots.clock import VirtualClock
from realitygap.twin.server import Server, Settings
from tests.robots.conftest import ARENA, BODY, Bench, bench
from tests.twin.test_server import channel

__all__ = ["bench"]


def test_messages_that_come_together_or_in_pieces_are_answered_in_order(bench: Bench) -> None:
    """However the socket hands them on; and whoever leaves with a message half sent, or its answers not
    fetched, leaves a twin that serves the next."""
    twin = bench.twin()
    for pieces in ((b"run 1000 0 0\nrun 2000 0 0\n",), (b"run 30", b"00 0 0\nrun 4000 0 0", b"\n")):
        with socket.socket(socket.AF_UNIX) as sock:
            sock.connect(twin.channel)
            for piece in pieces:
                sock.sendall(piece)
                time.sleep(0.05)
            with sock.makefile("rb") as file:
                times = [int(file.readline().split()[1]) for _ in range(2)]
        assert times in ([1000, 2000], [3000, 4000])
    for left in (b"run 5000 0 0\nrun 6000", b"run 7000 0 0\n" * 50):
        with socket.socket(socket.AF_UNIX) as sock:
            sock.connect(twin.channel)
            sock.sendall(left)
    assert channel(twin, "run 8000 0 0") == ["at 8000 0"]


def test_whoever_fetches_no_answers_does_not_hold_up_the_others(monkeypatch: pytest.MonkeyPatch) -> None:
    """Once the socket takes no more, its answers are given up, and the next clock is served."""
    monkeypatch.setattr("realitygap.twin.server.ANSWER_S", 0.1)
    with Server(Settings(arena=ARENA, unit=1, body=BODY)) as server, socket.socket(socket.AF_UNIX) as full:
        leash, end = os.pipe()
        serving = threading.Thread(target=server.serve, args=(leash,))
        serving.start()
        full.connect(server.channel)
        full.sendall(b"fly\n" * 8000)
        try:
            clock = VirtualClock(server.channel)
            clock.sleep_until(0.1)
            clock.settle()
            clock.close()
        finally:
            os.close(end)
            serving.join()
            os.close(leash)
