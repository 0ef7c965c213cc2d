"""Wheels: nonsense is refused by the file's name, intervals hold the truth, what is not told is said."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from realitygap.calibration.calibrate import calibrate
from realitygap.errors import CalibrationError
from realitygap.world.profile import load_profile

PAPER = load_profile("paper")


@pytest.fixture(scope="module")
def sound(driven):
    """A recording that nothing is wrong with."""
    return driven(friction_cm_s2=0.0)


def _posed(scale):
    return lambda r: replace(r, pose=r.pose * scale)


def _blind(r, counters):
    return replace(r, pose=None, counters=counters)


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (_posed([10, 10, 1]), "camera's poses fit no wheels .* cm"),
        (_posed([1, 1, np.pi / 180]), "track: expected 3.7 to 6.9 cm"),
        (lambda r: replace(r, counters=r.counters * [-1, 1]), "counter_left runs against command_left"),
        (lambda r: _blind(r, r.counters * [1, -1]), "counter_right runs against command_right"),
        (lambda r: replace(r, counters=r.counters[:, ::-1]), "columns swapped"),
        (lambda r: _blind(r, np.random.default_rng(1).integers(-2000, 2000, r.counters.shape)), "explains only"),
        (lambda r: _blind(r, r.counters / 40), "speed_left: 0.05 cm/s per unit, the utmost"),
        (lambda r: replace(r, t_s=r.t_s * 2), "expected 30 steps"),
    ],
)
def test_nonsense_of_wheels_is_refused(sound, spoil, words):
    """No profile is made of another unit's poses, or of counters that are not the commands'."""
    with pytest.raises(CalibrationError, match=f"made: .*{words}"):
        calibrate([spoil(sound)], PAPER)


@pytest.mark.parametrize(("pose", "words"), [(None, "no camera saw"), ("few", "a camera saw too little")])
def test_a_warning_says_what_a_camera_lacks(sound, pose, words):
    """No camera at all is not a camera that saw too little."""
    if pose:
        pose = np.where(np.arange(len(sound.t_s))[:, None] < 30, sound.pose, np.nan)
    made = calibrate([replace(sound, pose=pose)], PAPER, form="paper")
    assert any(words in warning for warning in made.warnings)
