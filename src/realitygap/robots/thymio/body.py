"""A Thymio II as a body: seven infrared sensors, no ambient light, no counters."""

from typing import Any

import numpy as np

from realitygap.errors import LineError, RealityGapError, RobotError, UsageError
from realitygap.robots.body import Channel
from realitygap.robots.clock import RealClock
from realitygap.robots.guard import Guard
from realitygap.robots.line.line import nothing
from realitygap.robots.thymio.line import AsebaLine
from realitygap.robots.thymio.line import opened as opened_port
from realitygap.values import Command, Pose, Readings

__all__ = ["ThymioBody", "opened"]

SENSORS, FULL = 7, 4500
"""Front left to front right, then back left and right. What is published of real ones ends at 4491; a count
above this is taken for it."""

FASTEST = 500
"""The largest target of a motor, about 16 cm/s."""

SENSE_S = 0.09
"""A reading not there this long after its request is missed: the last one is used instead."""

GIVE_UP_S = 1.0
"""A robot that is silent for this long is lost."""

STOP_S, STANDS = 1.4, 40
"""Time in which it has to stand, and measured speeds up to which it does (standing motors say up to 20)."""

PROXIMITY = "prox.horizontal"
TARGETS = ("motor.left.target", "motor.right.target")
SPEEDS = ("motor.left.speed", "motor.right.speed")
NEEDED = (PROXIMITY, *TARGETS, *SPEEDS)
FACTS = {"robot": "Thymio II", "units": "Thymio units", "base": "thymio"}
TOLD = ("_id", "_productId", "_fwversion", "prox.comm.tx")
"""What says, besides, how the robot is set (firmware 7 and later scales readings by itself)."""


class ThymioBody:
    """From `act` to `stop` something must be asked or told twice a second, or the guard stops the robot.

    A command that was lost is seen with the next reading, and given again. `read_at` is when the readings
    arrived, by `clock`, `speeds` those that the motors measured then; in a step whose answer does not come,
    `sense` gives the last ones again.

    Args:
        line: to the robot; `close` closes it.
    """

    channels = (Channel(name="proximity", sensors=SENSORS, high=FULL),)
    period_s = 0.1
    counts_turns = False

    def __init__(self, line: AsebaLine) -> None:
        self.line, self.clock = line, line.clock
        missing = [name for name in NEEDED if name not in line.variables]
        if missing or line.variables[PROXIMITY][1] != SENSORS:
            raise RobotError(
                f"the robot on {line.device} is not a Thymio II: expected {', '.join(NEEDED)}, "
                f"it has no {', '.join(missing) or PROXIMITY + ' of seven'}"
            )
        self._stop = line.setting(TARGETS[0], 0) + line.setting(TARGETS[1], 0)
        self._guard = Guard(line.fileno(), self._stop)
        line.before = self._guard.beat
        self._given = Command(left=0, right=0)
        self._readings: Readings | None = None
        self.speeds: tuple[int, int] | None = None
        self.read_at = self.clock.now()
        told = self._fetched([name for name in TOLD if name in line.variables], GIVE_UP_S)
        self.facts: dict[str, Any] = {**FACTS, "port": line.device} | {
            name.strip("_"): values[0] if len(values) == 1 else values for name, values in told.items()
        }

    def reset(self, pose: Pose | None = None) -> None:
        """Stand still where it is: a person sets it down."""
        self.stop()
        self._readings = None

    def sense(self) -> Readings:
        """What the sensors say; the last readings again if the answer does not come in time.

        Raises:
            LineError: the robot has said nothing for a second.
        """
        said = self.line.fetch(NEEDED, self.clock.now() + SENSE_S)
        if said is None and (self._readings is None or self.clock.now() - self.read_at > GIVE_UP_S):
            said = self._fetched(NEEDED, GIVE_UP_S)
        if said is not None:
            self.read_at = self.clock.now()
            counts = np.clip(np.array(said[PROXIMITY], np.float64), 0, FULL)
            self._readings = Readings(proximity=counts, ambient=np.empty(0))
            self.speeds = said[SPEEDS[0]][0], said[SPEEDS[1]][0]
            if (*said[TARGETS[0]], *said[TARGETS[1]]) != (self._given.left, self._given.right):
                self.line.faults += 1
                self._tell()
        assert self._readings is not None
        return self._readings

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
        self._given = command
        self._tell()

    def stop(self) -> None:
        """Stop, and make sure of it.

        Raises:
            LineError: the robot did not confirm: it may still be moving.
        """
        failure: RealityGapError = RobotError("its motors still turn")
        self._given, until = Command(left=0, right=0), self.clock.now() + STOP_S
        while True:
            try:
                self.line.tell(self._stop)
                said = self.line.fetch((*TARGETS, *SPEEDS), self.clock.now() + SENSE_S)
                if said is None:
                    failure = LineError("no answer")
                elif not any(said[TARGETS[0]] + said[TARGETS[1]]):
                    if max(map(abs, said[SPEEDS[0]] + said[SPEEDS[1]])) <= STANDS:
                        break
                    self.clock.sleep_until(self.clock.now() + 0.02)
            except RobotError as error:
                failure = error
            if self.clock.now() >= until:
                raise LineError(
                    f"the robot did not confirm that it stopped ({failure}); it may still be moving: "
                    "lift it or switch it off"
                )
        self._guard.rest()

    def close(self) -> None:
        """Stop, then close the line, in any case."""
        try:
            self.stop()
        finally:
            self.abandon()

    def abandon(self) -> None:
        """Close the line without a word to the robot."""
        self.line.before = nothing
        self.line.close()
        self._guard.release()

    def inspect(self) -> dict[str, Any]:
        """Count the requests repeated so far."""
        return {"faults": self.line.faults}

    def _tell(self) -> None:
        self.line.tell(
            self.line.setting(TARGETS[0], self._given.left) + self.line.setting(TARGETS[1], self._given.right)
        )

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
