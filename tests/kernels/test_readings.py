"""What becomes of a reading: noise, whole counts, clipping, network input."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from realitygap.kernels.trial import AMBIENT, PROXIMITY, read, scale_input
from tests.kernels.reference.trial import counts
from tests.kernels.scenes import MOTOR_NOISE, PAPER

ROBOT = PAPER.to_kernel()


def read_one(value: float, *, feed: int = PROXIMITY, level: float = 0.0, z: float = 0.0) -> float:
    """One noise-free reading through the converter."""
    noise, readings = np.zeros(16), np.array([value])
    noise[MOTOR_NOISE] = z
    read(ROBOT, feed, level, 0.0, noise, readings)
    return float(readings[0])


@pytest.mark.parametrize(
    ("value", "expected"),
    [(0.0, 0), (0.49, 0), (0.5, 1), (1.5, 2), (2.5, 3), (99.5, 100), (1022.5, 1023), (1023.0, 1023)],
)
def test_readings_are_rounded_half_up(value, expected):
    """Readings are whole counts, halves upwards (not to even)."""
    assert read_one(value) == expected


@pytest.mark.parametrize("feed", [PROXIMITY, AMBIENT])
@pytest.mark.parametrize(("z", "expected"), [(-1000.0, 0.0), (1000.0, 1023.0)])
def test_readings_are_clipped(feed, z, expected):
    """Noise takes a reading to 0 … 1023 and no further: ambient beyond 55 and 484 too."""
    assert read_one(300.0, feed=feed, level=1.0, z=z) == expected


def test_noise_may_take_ambient_beyond_dark_and_floor():
    """Ambient noise is added after the clipping at 484, and may pass it or fall below 55."""
    assert read_one(484.0, feed=AMBIENT, level=1.0, z=2.0) == 493
    assert read_one(55.0, feed=AMBIENT, level=1.0, z=-2.0) == 46


@given(
    st.floats(0, 1023), st.sampled_from([PROXIMITY, AMBIENT]), st.floats(0, 5), st.floats(-6, 6)
)  # fmt: skip
def test_agrees_with_the_reference(value, feed, level, z):
    """Deviation 21 counts where the noise-free reading is above 0, 3.3 where it is 0, ambient 4.5."""
    deviation = 4.5 if feed == AMBIENT else 21.0 if value > 0 else 3.3
    assert read_one(value, feed=feed, level=level, z=z) == counts(value, level * deviation * z, 1023)


def test_bands():
    """0 becomes −10 and 1023 +10: twenty-one bands, each 51.15 wide, the ends half as wide."""
    inputs = [scale_input(0.0, 1023.0, float(v)) for v in range(1024)]
    assert inputs[0] == -10 and inputs[1023] == 10
    assert np.diff(inputs).min() >= 0 and set(inputs) == set(range(-10, 11))
    widths = np.bincount(np.array(inputs) + 10)
    assert widths[1:-1].tolist() == pytest.approx([51.15] * 19, abs=1) and widths[0] == 26
    # Half up: the border of a band belongs to the upper one.
    assert scale_input(0.0, 20.0, 10.5) == 1 and scale_input(0.0, 20.0, 9.5) == 0


def test_ambient_bands_go_the_other_way():
    """The dark value 484 becomes −10, full light 55 becomes +10, and what lies beyond is clipped."""
    assert [scale_input(484.0, 55.0, v) for v in (1023.0, 484.0, 55.0, 0.0)] == [-10, -10, 10, 10]
    assert scale_input(484.0, 55.0, (484 + 55) / 2) == 0
