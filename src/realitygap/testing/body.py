"""What every body does, wherever its wheels are."""

from contextlib import AbstractContextManager
from typing import Any
from unittest import SkipTest

import numpy as np
from numpy.typing import NDArray

from realitygap.robots.body import KINDS, Body, Placing, Seen, attend, odometry_of
from realitygap.robots.clock import Clock
from realitygap.robots.loop import Steady, drive
from realitygap.robots.own import OwnBody
from realitygap.values import Command, Pose

__all__ = ["BodyContract"]

MIDDLE = Pose.from_degrees(25, 25, 90)


class BodyContract:
    """Tests of a body: override `opened`, and `pulses_per_unit` if its wheels are known.

    Example:
        class TestMyRobot(BodyContract):
            pulses_per_unit = 100.0

            def opened(self):
                return nullcontext((MyRobot(), RealClock()))
    """

    pulses_per_unit: float | None = None
    """Counter pulses a second at command `scale`; None: only the ratio of the two wheels is tested."""
    scale: int = 1
    """So many of the robot's units are one of the test's, which drives at up to 5: 4 cm/s of a Khepera."""

    def opened(self) -> AbstractContextManager[tuple[Body, Clock]]:
        """A body in an arena of 50 by 50 cm that is free in the middle, and its clock."""
        raise NotImplementedError("override opened()")

    def test_a_reset_body_stands_with_counters_at_zero(self) -> None:
        """After a drive, too."""
        with self.opened() as (body, clock):
            body.act(self._command(5, 5))
            clock.sleep_until(clock.now() + 0.3)
            body.reset(MIDDLE)
            body.sense()
            assert np.abs(_counters(body)).max() <= 5

    def test_readings_are_whole_counts_in_range(self) -> None:
        """Of each kind as many as its channels say; none of a kind that it lacks."""
        with self.opened() as (body, _):
            attend(body, *(one.name for one in body.channels))
            body.reset(MIDDLE)
            readings = OwnBody(body, type(body).__name__).sense()  # refuses what a user's robot is refused
            for kind in KINDS:
                assert (getattr(readings, kind) == np.round(getattr(readings, kind))).all()

    def test_it_goes_where_its_wheels_take_it(self) -> None:
        """Ahead is where it faces, and a faster right wheel turns it to the left."""
        with self.opened() as (body, clock):
            if not isinstance(body, Seen):
                raise SkipTest("this body does not know where it is")
            body.reset(MIDDLE)
            poses = [body.pose]
            assert 0 < poses[0].x < 2 * MIDDLE.x and 0 < poses[0].y < 2 * MIDDLE.y, "cm, from a corner"
            off = np.hypot(poses[0].x - MIDDLE.x, poses[0].y - MIDDLE.y)
            assert off < 1 or not isinstance(body, Placing), "it is where it was set down"
            for left, right in ((5, 5), (-3, 3)):
                body.act(self._command(left, right))
                clock.sleep_until(clock.now() + 0.6)
                poses.append(body.pose)
            body.stop()
        begin, there, turned = poses
        way = (there.x - begin.x) + 1j * (there.y - begin.y)
        assert abs(way) > 0 and (way * np.exp(-1j * begin.heading)).real > 0.9 * abs(way)
        assert np.sin(turned.heading - there.heading) > 0

    def test_wheels_turn_as_they_are_told(self) -> None:
        """Two units ahead on the left, three back on the right, for two seconds."""
        with self.opened() as (body, clock):
            body.reset(MIDDLE)
            left, right = _pace(body, clock, self._command(2, -3), 2.0)
        unit = self.pulses_per_unit or (left - right) / 5
        assert unit > 0 and abs(left - 2 * unit) < 0.4 * unit and abs(right + 3 * unit) < 0.6 * unit

    def test_a_stopped_body_stands(self) -> None:
        """Its counters no longer change, or its pose, of a body without any."""
        with self.opened() as (body, clock):
            body.reset(MIDDLE)
            body.act(self._command(4, -4))
            clock.sleep_until(clock.now() + 0.5)
            body.stop()
            clock.sleep_until(clock.now() + 0.3)
            body.sense()
            before = _place(body)
            clock.sleep_until(clock.now() + 0.5)
            body.sense()
            assert np.abs(_place(body) - before).max() <= 2

    def test_a_trial_is_repeatable_from_a_reset(self) -> None:
        """The same commands turn the wheels as fast, within 15 %."""
        gone = []
        with self.opened() as (body, clock):
            for _ in range(2):
                body.reset(MIDDLE)
                gone.append(_pace(body, clock, self._command(5, 5), 1.5))
        assert np.allclose(gone[0], gone[1], rtol=0.15)

    def _command(self, left: int, right: int) -> Command:
        return Command(left=self.scale * left, right=self.scale * right)


def _counters(body: Body) -> NDArray[np.int64]:
    """[2] pulses, as read with the last `sense`; the test is skipped where a body does not count."""
    counters = odometry_of(body).counters
    if counters is None:
        raise SkipTest("this body does not count its wheels' turns")
    return np.asarray(counters)


def _place(body: Body) -> NDArray[Any]:
    """Its counters; else its pose, of which 2 are 5 mm or 2°."""
    if odometry_of(body).counters is None and isinstance(body, Seen):
        at = body.pose
        return np.array([4 * at.x, 4 * at.y, 57 * np.cos(at.heading), 57 * np.sin(at.heading)])
    return _counters(body)


def _pace(body: Body, clock: Clock, command: Command, seconds: float) -> tuple[float, float]:
    """Pulses a second, left and right: the median, so that one late step of the computer does not count."""
    body.sense()
    _counters(body)
    recording = drive(body, Steady(command), seconds=seconds, clock=clock, inputs=lambda readings: [])
    taken = np.diff(recording.t)[:, None]
    left, right = np.median(np.diff(recording.counters, axis=0)[1:] / taken[1:], axis=0)
    return float(left), float(right)
