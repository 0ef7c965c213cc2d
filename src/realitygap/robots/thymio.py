"""A Thymio II: seven infrared sensors, motors without encoders, Aseba's protocol.

On its line some of what is sent may be lost, duplicated, garbled or late. The messages are `thymiodirect`'s
(EPFL); who asks, waits and asks again is here. The protocol numbers no questions, so each asks for variables
from another one on than the last ones: that tells an older answer.
"""

from __future__ import annotations

import contextlib
import os
import select
import socket
import time
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from realitygap.errors import LineError, RealityGapWarning, RobotError, UsageError
from realitygap.lazy import needed
from realitygap.robots.body import Channel, RealClock
from realitygap.robots.guard import SILENCE_S
from realitygap.robots.wire import LOOK_S, STALL_S, STAND_S, WAIT_S, Wire, WireBody, why_not_opened
from realitygap.values import Command, Pose, Readings

__all__ = ["AsebaLine", "ThymioBody", "opened", "opened_port"]

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


def opened_port(place: str) -> Any:
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
        port: what `opened_port` gives; closed with the line.
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
        missing = [name for name in NEEDED if name not in self.variables]
        if missing or self.variables[PROXIMITY][1] != SENSORS:
            raise RobotError(
                f"the robot on {device} is not a Thymio II: expected {', '.join(NEEDED)}, "
                f"it has no {', '.join(missing) or PROXIMITY + ' of seven'}"
            )
        self.stop_message = self.targets(0, 0)

    def close(self) -> None:
        with contextlib.suppress(OSError):
            if isinstance(self._port, socket.socket):
                self._port.shutdown(socket.SHUT_WR)
                self._port.settimeout(0.3)
                while self._port.recv(4096):
                    pass
        super().close()

    def targets(self, left: int, right: int) -> bytes:
        """The messages that set the motors' targets."""
        return b"".join(
            self._message("SET_VARIABLES", self.node, self.variables[name][0], value & 0xFFFF)
            for name, value in zip(TARGETS, (left, right), strict=True)
        )

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
            self.write(self._message("GET_VARIABLES", self.node, first, end - first))
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
            self.discard_input()

    def _greeted(self, node: str) -> int:
        """The number of the robot that is driven."""
        wanted = int(node) if node.isdecimal() else None
        found: set[int] = set()
        for _ in range(GREETINGS):
            self.write(self._message("LIST_NODES", self._aseba.PROTOCOL_VERSION))
            until = self.clock.now() + GREET_S
            while (message := self._next(until)) is not None:
                if message.id == self._aseba.ID_NODE_PRESENT:
                    found.add(int(message.source_node))
            if wanted in found or (found and not node):
                break
        names = ", ".join(map(str, sorted(found))) or "none"
        if not found:
            raise LineError(
                f"no Thymio answers on {self.device}; check that it is switched on, its cable or dongle, and "
                "that no other program (Thymio Suite) has it"
            )
        if node and wanted not in found:
            raise LineError(f"no robot {node!r} answers on {self.device} (those that do: {names})")
        if len(found) > 1 and wanted is None:
            raise UsageError(
                f"robot: expected one Thymio on {self.device}, got robots {names}; say which, as in "
                f"thymio:{self.device}@{min(found)}"
            )
        return min(found) if wanted is None else wanted

    def _described(self) -> dict[str, tuple[int, int]]:
        """Place and size of each variable of the robot."""
        for _ in range(GREETINGS):
            sizes: dict[str, int] = {}
            expected = None
            self.write(self._message("GET_NODE_DESCRIPTION", self.node, self._aseba.PROTOCOL_VERSION))
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
            self.discard_input()
        raise LineError(
            f"the robot on {self.device} did not name all of its variables, asked {GREETINGS} times"
        )

    def _next(self, until: float) -> Any:
        """The next message that makes sense, or None at `until`."""
        while True:
            while len(self._input) >= HEADER:
                length, source, kind = np.frombuffer(self._input[:HEADER], "<u2").tolist()
                if length > LONGEST:
                    self._input = b""
                if len(self._input) < HEADER + length:
                    break
                message = self._aseba(kind, source, self._input[HEADER : HEADER + length])
                self._input = self._input[HEADER + length :]
                try:
                    message.decode()
                except (IndexError, ValueError):
                    self._input = b""
                    continue
                return message
            more = self._read(until, 0)
            if not more and self.clock.now() >= until:
                return None
            self._input += more

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


SENSORS, FULL = 7, 4500
"""Front left to front right, then back left and right. What is published of real ones ends at 4491, or at
4525: a robot that reads more has more."""

FASTEST = 500
"""The largest target of a motor, about 16 cm/s."""

SENSE_SHARE = 0.9
"""A reading not there after this share of a step is missed: the last one is used instead."""

GIVE_UP_S = 1.0
"""A robot that is silent for this long when it is first asked is lost."""

STANDS = 40
"""Measured speeds up to this count as standing still (standing motors say up to 20)."""

PROXIMITY = "prox.horizontal"
TARGETS = ("motor.left.target", "motor.right.target")
SPEEDS = ("motor.left.speed", "motor.right.speed")
NEEDED = (PROXIMITY, *TARGETS, *SPEEDS)
FACTS = {"robot": "Thymio II", "units": "Thymio units", "base": "thymio"}
SETTINGS = ("_id", "_productId", "_fwversion", "prox.comm.tx")
"""What says, besides, how the robot is set (firmware 7 and later scales readings by itself)."""


class ThymioBody(WireBody):
    """A command that was lost is seen with the next reading, and given again.

    `read_at` is when the readings arrived, by `clock`, `speeds` those that the motors measured then; in a
    step whose answer does not come, `sense` gives the last ones again.

    Args:
        line: to the robot; `close` closes it.
    """

    channels = (Channel(name="proximity", sensors=SENSORS, high=FULL),)
    line: AsebaLine
    read_at: float
    facts: Mapping[str, Any] = FACTS

    def __init__(self, line: AsebaLine) -> None:
        super().__init__(line)
        self._given = Command(left=0, right=0)
        self._readings: Readings | None = None
        self.speeds: tuple[int, int] | None = None
        self.read_at = self.clock.now()
        said = self._fetched([name for name in SETTINGS if name in line.variables], GIVE_UP_S)
        self.facts = {**FACTS, "port": line.device} | {
            name.strip("_"): values[0] if len(values) == 1 else values for name, values in said.items()
        }

    def reset(self, pose: Pose | None = None) -> None:
        """Stand still where it is: a person sets it down."""
        self.stop()
        self._readings = None

    def sense(self) -> Readings:
        """What the sensors say; the last readings again if the answer does not come in time. After a few of
        these the robot is told to stop, until it answers.

        Raises:
            LineError: it does not.
        """
        said = self.line.fetch(NEEDED, self.clock.now() + SENSE_SHARE * self.period_s)
        if said is None and self._readings is None:
            said = self._fetched(NEEDED, GIVE_UP_S)
        elif said is None and self.clock.now() - self.read_at > SILENCE_S:
            said = self._waited_out()
        if said is not None:
            self.read_at = self.clock.now()
            counts = np.maximum(np.array(said[PROXIMITY], np.float64), 0)
            self._reach(int(counts.max()))
            self._readings = Readings(proximity=counts, ambient=np.empty(0))
            self.speeds = said[SPEEDS[0]][0], said[SPEEDS[1]][0]
            if (*said[TARGETS[0]], *said[TARGETS[1]]) != (self._given.left, self._given.right):
                self.line.faults += 1
                self._send()
        assert self._readings is not None
        return self._readings

    def _reach(self, most: int) -> None:
        """Take a count beyond the full scale for the full scale, and say so."""
        (one,) = self.channels
        if most > one.high:
            self.channels = (replace(one, high=most),)
            said = f"a sensor reads {most}, beyond the full scale of {one.high}: {most} is taken"
            warnings.warn(f"{self.line.device}: {said}", RealityGapWarning, stacklevel=3)

    def act(self, command: Command) -> None:
        """Motor targets from now on, −500 … 500.

        Raises:
            UsageError: a target beyond that.
        """
        if max(abs(command.left), abs(command.right)) > FASTEST:
            raise UsageError(
                f"command: expected targets from {-FASTEST} to {FASTEST}, as a Thymio's motors have, got "
                f"{command.left} and {command.right}; the profile's top_command says how far they go"
            )
        self._guard.watch()
        self.line.moving = True
        self._given = command
        self._send()

    def stop(self) -> None:
        """Stop, and make sure of it: errors as of `WireBody`."""
        self._given = Command(left=0, right=0)
        super().stop()

    def _stands(self) -> bool:
        until = self.clock.now() + STAND_S
        while True:
            said = self.line.fetch((*TARGETS, *SPEEDS), self.clock.now() + SENSE_SHARE * self.period_s)
            if said is None:
                raise LineError("no answer")
            if any(said[TARGETS[0]] + said[TARGETS[1]]):
                return False  # the message was lost
            if max(map(abs, said[SPEEDS[0]] + said[SPEEDS[1]])) <= STANDS:
                return True
            if self.clock.now() >= until:
                return False
            self.clock.sleep_until(self.clock.now() + LOOK_S)

    def _waited_out(self) -> dict[str, list[int]]:
        """What the robot says when it answers again, told to stop until then."""
        self._given = Command(left=0, right=0)
        while True:
            self._send()
            said = self.line.fetch(NEEDED, self.clock.now() + STALL_S)
            silent = self.clock.now() - self.read_at
            if said is not None:
                self.line.stalls.append(silent)
                return said
            if silent > WAIT_S:
                raise LineError(f"the robot on {self.line.device} has said nothing for {silent:.1f} s")

    def _send(self) -> None:
        self.line.write(self.line.targets(self._given.left, self._given.right))

    def _fetched(self, names: Any, within_s: float) -> dict[str, list[int]]:
        said = self.line.fetch(names, self.clock.now() + within_s)
        if said is None:
            raise LineError(f"the robot on {self.line.device} has said nothing for {within_s:g} s")
        return said


def opened(place: str, *, clock: RealClock | None = None, **_: Any) -> ThymioBody:
    """The Thymio on a serial device (a cable or a dongle) or at HOST:PORT, told to stop.

    Raises:
        UsageError: it cannot be opened, or there are several robots.
        LineError: no robot answers.
    """
    body, clock = None, clock or RealClock()
    port = opened_port(place.partition("@")[0])
    try:
        body = ThymioBody(AsebaLine(port, place, clock))
        body.stop()
    except BaseException:
        body.abandon() if body is not None else port.close()
        raise
    return body
