"""What every body does, wherever its wheels are: run on the simulated, the twin's and a serial one."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from realitygap.robots.body import Body
from realitygap.robots.clock import Clock
from realitygap.robots.loop import drive
from realitygap.robots.recording import Recording
from realitygap.values import Command, Pose
from tests.robots.controllers import Constant, bands

MIDDLE = Pose.from_degrees(25, 25, 90)


def pace(recording: Recording) -> NDArray[np.float64]:
    """[2] pulses a second: of most steps, so that one at which the computer stood still does not count."""
    taken = np.diff(recording.t)[:, None]
    return np.asarray(np.median(np.diff(recording.counters, axis=0)[1:] / taken[1:], axis=0))


class BodyContract:
    """Subclass it with fixtures `body`, in an arena of 50 by 50 cm, free in the middle, and `clock`."""

    def test_a_reset_body_stands_with_counters_at_zero(self, body: Body, clock: Clock) -> None:
        """After a drive, too."""
        body.act(Command(left=5, right=5))
        clock.sleep_until(clock.now() + 0.3)
        body.reset(MIDDLE)
        body.sense()
        assert np.abs(body.odometry.counters or (0, 0)).max() <= 5

    def test_readings_are_eight_counts_of_ten_bits(self, body: Body, clock: Clock) -> None:
        """Of each kind that is fed; whole numbers."""
        body.reset(MIDDLE)
        readings = body.sense()
        for counts in (readings.proximity, readings.ambient):
            assert counts.shape in ((8,), (0,)) and counts.dtype == np.float64
            assert ((counts >= 0) & (counts <= 1023) & (counts == np.round(counts))).all()
        assert len(readings.proximity) + len(readings.ambient) > 0

    def test_wheels_turn_as_they_are_told(self, body: Body, clock: Clock) -> None:
        """Two units ahead on the left, three back on the right: 200 and −300 pulses in a second, about."""
        body.reset(MIDDLE)
        recording = drive(body, Constant(2, -3), seconds=2, clock=clock, inputs=bands)
        left, right = pace(recording)
        assert abs(left - 200) < 40 and abs(right + 300) < 60

    def test_a_stopped_body_stands(self, body: Body, clock: Clock) -> None:
        """Its counters do not change any more."""
        body.reset(MIDDLE)
        body.act(Command(left=4, right=-4))
        clock.sleep_until(clock.now() + 0.5)
        body.stop()
        clock.sleep_until(clock.now() + 0.3)
        body.sense()
        before = body.odometry.counters
        clock.sleep_until(clock.now() + 0.5)
        body.sense()
        assert np.abs(np.subtract(body.odometry.counters or 0, before or 0)).max() <= 2

    def test_a_trial_is_repeatable_from_a_reset(self, body: Body, clock: Clock) -> None:
        """The same commands turn the wheels as fast, within 15 %."""
        gone = []
        for _ in range(2):
            body.reset(MIDDLE)
            gone.append(pace(drive(body, Constant(5, 5), seconds=1.5, clock=clock, inputs=bands)))
        assert np.allclose(*gone, rtol=0.15)
