"""The descriptors of motion, on tracks made of stretches whose amounts are plain."""

import numpy as np
import pytest

from realitygap.correspondence.descriptors import describe_all
from realitygap.correspondence.trials import STEP_S, Trial
from tests.correspondence.tracks import mirrored


def drive(*stretches: tuple[float, float, float]) -> Trial:
    """A track of stretches (seconds, cm/s forward, deg/s leftward)."""
    pace = np.concatenate([np.tile(amounts, (round(seconds / STEP_S), 1)) for seconds, *amounts in stretches])
    heading = np.append(0.0, np.cumsum(np.radians(pace[:, 1]) * STEP_S))
    middle = (heading[1:] + heading[:-1]) / 2
    x, y = (np.append(0.0, np.cumsum(pace[:, 0] * STEP_S * f(middle))) for f in (np.cos, np.sin))
    return Trial(x=x + 25.0, y=y + 25.0, heading=heading)


def told(trial: Trial) -> dict[str, float]:
    """Its descriptors of motion alone."""
    return {name: float(values[0]) for name, values in describe_all([trial], None).items()}


def test_backward_is_a_share_of_time():
    """Three seconds of ten backward are 0.3, wherever the robot looks; one reversal there, one back."""
    made = told(drive((4, 3, 20), (3, -3, 20), (3, 3, 20)))
    assert made["backward"] == pytest.approx(0.3, abs=0.03)
    assert made["reversals"] == pytest.approx(2.0)


def test_a_robot_that_turns_on_the_spot_is_not_still():
    """Still is neither going nor turning: of ten seconds, five turned on the spot, three are still."""
    made = told(drive((2, 3, 0), (5, 0, 60), (3, 0, 0)))
    assert made["still"] == pytest.approx(0.3, abs=0.03)


def test_turns_have_a_side():
    """Three turns to the left are 1, to the right -1; one to each side are 0; a larger one tells more."""
    leftward = drive(*[(1, 3, 0), (1, 0, 60)] * 3, (1, 3, 0))
    assert told(leftward)["turns"] == pytest.approx(3 / 0.7)
    assert told(leftward)["side of turns"] == pytest.approx(1.0)
    assert told(*mirrored([leftward], 50.0))["side of turns"] == pytest.approx(-1.0)
    even = told(drive((1, 3, 0), (1, 0, 60), (1, 3, 0), (1, 0, -60), (1, 3, 0)))
    assert even["side of turns"] == pytest.approx(0.0, abs=1e-9) and even["one-sidedness"] < 1e-9
    more = told(drive((1, 3, 0), (1, 0, 60), (1, 3, 0), (2, 0, -60), (1, 3, 0)))
    assert more["side of turns"] == pytest.approx((60**2 - 120**2) / (60**2 + 120**2), abs=0.03)
