"""A line in Aseba's protocol, on which some of what is sent may be lost, duplicated, garbled or late.

The messages are `thymiodirect`'s (EPFL); who asks, waits and asks again is here. The protocol numbers no
questions, so each asks for variables from another one on than the last ones: that tells an older answer.
"""

from __future__ import annotations

import contextlib
import os
import select
import socket
import time
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from realitygap.errors import LineError, UsageError
from realitygap.lazy import needed
from realitygap.robots.line.line import Wire, why_not_opened

if TYPE_CHECKING:
    from realitygap.robots.clock import RealClock

__all__ = ["AsebaLine", "opened"]

BAUD = 115200
"""Of the dongle and of the cable, both USB, which ignore it."""

HOST = 1
"""This computer, as a node."""

HEADER, LONGEST = 6, 1024
"""Bytes: length, source and kind, two each; and the longest payload: what says more is noise."""

BEGINNINGS = 4
"""Answers may be so late, in questions, and are still told apart."""

AGAIN_S = 0.04
"""After this time an answer is requested again (a dongle takes 10 to 30 ms)."""

GREET_S, QUIET_S, GREETINGS = 0.5, 0.4, 5
"""For the first word of a node; a node that has said nothing for this long has said all; tries."""


def opened(place: str) -> Any:
    """A serial device, or a connection to HOST:PORT, for this process alone.

    Raises:
        UsageError: it cannot be opened.
    """
    host, colon, port = place.rpartition(":")
    try:
        if colon and port.isdecimal() and not os.path.exists(place):
            if not 0 < int(port) < 2**16:  # glibc takes the lower 16 bits
                raise OverflowError(f"expected a port from 1 to 65535, got {port}")
            return _connected((host.strip("[]"), int(port)))
        import serial

        return serial.Serial(place, BAUD, timeout=0, write_timeout=0.5, exclusive=True)
    except (OSError, OverflowError) as error:  # a SerialException is one
        raise UsageError(
            f"{place!r} cannot be opened: {why_not_opened(error)}; check the cable or dongle, the name "
            "(/dev/ttyACM0, or HOST:PORT of a simulator), your right to use it (group dialout), and that no "
            "other program has it"
        ) from None


class AsebaLine(Wire):
    """The line to one Thymio.

    Args:
        port: what `opened` gives; closed with the line.
        place: its name; "@NODE" behind it says which of several robots.
        clock: the clock of the time-outs.

    Raises:
        UsageError: there are several robots, or `thymiodirect` is missing.
        LineError: no robot answers.
    """

    def __init__(self, port: Any, place: str, clock: RealClock) -> None:
        device, _, node = place.partition("@")
        super().__init__(device, clock)
        self._port, self._turn = port, 0
        self._aseba = needed("thymiodirect.message", "thymio").Message
        self.node = self._greeted(node)
        self.variables = self._described()

    def close(self) -> None:
        with contextlib.suppress(OSError):
            if isinstance(self._port, socket.socket):
                self._port.shutdown(socket.SHUT_WR)
                self._port.settimeout(0.3)
                while self._port.recv(4096):
                    pass
        super().close()

    def setting(self, name: str, value: int) -> bytes:
        """The message that sets a variable."""
        return self._message("SET_VARIABLES", self.node, self.variables[name][0], value & 0xFFFF)

    def fetch(self, names: Sequence[str], until: float) -> dict[str, list[int]] | None:
        """The values of some variables, requested until they come; None if they do not in time.

        Raises:
            LineError: the line is lost.
        """
        spans = [self.variables[name] for name in names]
        end = max(at + size for at, size in spans)
        while True:
            self._turn = (self._turn + 1) % BEGINNINGS
            first = max(min(at for at, _ in spans) - self._turn, 0)
            self.tell(self._message("GET_VARIABLES", self.node, first, end - first))
            again = min(until, self.clock.now() + AGAIN_S)
            while (message := self._next(again)) is not None:
                if message.id != self._aseba.ID_VARIABLES or message.source_node != self.node:
                    continue
                if message.var_offset == first and len(message.var_data) == end - first:
                    data = np.array(message.var_data, np.uint16).astype(np.int16).tolist()
                    return {
                        name: data[at - first :][:size] for name, (at, size) in zip(names, spans, strict=True)
                    }
            self.faults += 1
            if self.clock.now() >= until:
                return None
            self.forget()

    def _greeted(self, node: str) -> int:
        """The number of the robot that is driven."""
        wanted = int(node) if node.isdecimal() else None
        found: set[int] = set()
        for _ in range(GREETINGS):
            self.tell(self._message("LIST_NODES", self._aseba.PROTOCOL_VERSION))
            until = self.clock.now() + GREET_S
            while (message := self._next(until)) is not None:
                if message.id == self._aseba.ID_NODE_PRESENT:
                    found.add(int(message.source_node))
            if wanted in found or (found and not node):
                break
        told = ", ".join(map(str, sorted(found))) or "none"
        if not found:
            raise LineError(
                f"no Thymio answers on {self.device}; check that it is switched on, its cable or dongle, and "
                "that no other program (Thymio Suite) has it"
            )
        if node and wanted not in found:
            raise LineError(f"no robot {node!r} answers on {self.device} (those that do: {told})")
        if len(found) > 1 and wanted is None:
            raise UsageError(
                f"robot: expected one Thymio on {self.device}, got robots {told}; say which, as in "
                f"thymio:{self.device}@{min(found)}"
            )
        return min(found) if wanted is None else wanted

    def _described(self) -> dict[str, tuple[int, int]]:
        """Place and size of each variable of the robot."""
        for _ in range(GREETINGS):
            sizes: dict[str, int] = {}
            expected = None
            self.tell(self._message("GET_NODE_DESCRIPTION", self.node, self._aseba.PROTOCOL_VERSION))
            while (message := self._next(self.clock.now() + QUIET_S)) is not None:
                if message.source_node != self.node:
                    continue
                if message.id == self._aseba.ID_DESCRIPTION:
                    expected, sizes = message.num_named_var, {}
                elif message.id == self._aseba.ID_NAMED_VARIABLE_DESCRIPTION:
                    sizes[message.var_name] = message.var_size
            if sizes and len(sizes) == expected:
                ends = np.cumsum(list(sizes.values())).tolist()
                return {
                    name: (end - size, size) for (name, size), end in zip(sizes.items(), ends, strict=True)
                }
            self.faults += 1
            self.forget()
        raise LineError(
            f"the robot on {self.device} did not name all of its variables, asked {GREETINGS} times"
        )

    def _next(self, until: float) -> Any:
        """The next message that makes sense, or None at `until`."""
        while True:
            while len(self._heard) >= HEADER:
                length, source, kind = np.frombuffer(self._heard[:HEADER], "<u2").tolist()
                if length > LONGEST:
                    self._heard = b""
                if len(self._heard) < HEADER + length:
                    break
                message = self._aseba(kind, source, self._heard[HEADER : HEADER + length])
                self._heard = self._heard[HEADER + length :]
                try:
                    message.decode()
                except (IndexError, ValueError):
                    self._heard = b""
                    continue
                return message
            heard = self._read(until, 0)
            if not heard and self.clock.now() >= until:
                return None
            self._heard += heard

    def _message(self, kind: str, *words: int) -> bytes:
        payload = self._aseba.uint16array_to_bytes(words)
        return bytes(self._aseba(getattr(self._aseba, f"ID_{kind}"), HOST, payload).serialize())


def _connected(where: tuple[str, int]) -> socket.socket:
    """To a simulator, which hangs up at once while it has not noticed yet that its last guest is gone."""
    for last in (False, False, True):
        line = socket.create_connection(where, timeout=3.0)
        gone = select.select([line], [], [], 0.2)[0] and not line.recv(1, socket.MSG_PEEK)
        if last or not gone:
            return line
        line.close()
        time.sleep(0.5)
    raise AssertionError("the last one is returned")
