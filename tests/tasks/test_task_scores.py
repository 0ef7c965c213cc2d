"""The paper's scores by hand, and compiled against plain Python."""

import math
from dataclasses import replace

import numpy as np
import pytest

from realitygap.kernels.types import Path, Room
from realitygap.tasks import TASKS, load_task
from realitygap.world.robot import load_profile

PAPER = load_profile("paper")


def path(left, right, x=None, y=None) -> Path:
    """A path of given wheel speeds (and places)."""
    left, right = np.broadcast_arrays(np.asarray(left, float), np.asarray(right, float))
    left, right = np.ascontiguousarray(left), np.ascontiguousarray(right)
    zero = np.zeros_like(left)
    return Path(
        x=zero if x is None else x,
        y=zero if y is None else y,
        heading=zero,
        left=left,
        right=right,
        contact=zero,
    )


def room(name: str) -> Room:
    """The room of a task."""
    return load_task(name).room(PAPER)


@pytest.mark.parametrize(
    ("left", "right", "expected"),
    [
        (8, 8, 1.0),  # straight at top speed
        (4, 4, 0.5),
        (-8, -8, 0.0),  # backwards counts for nothing
        (8, -8, 0.0),  # turning on the spot
        (0, 0, 0.0),
        (8, 4, 0.75 * (1 - math.sqrt(0.25))),
    ],
)
def test_avoidance_by_hand(left, right, expected):
    """F = V(1 − √D), equation 2."""
    score = load_task("avoidance").score
    assert score(path([left] * 200, [right] * 200), room("avoidance")) == pytest.approx(expected)


def test_light_by_hand():
    """F = 1/Σ D², equation 3: standing at the start gives 5.5·10⁻⁷."""
    score = load_task("light").score
    still = path([0] * 200, [0] * 200, x=np.full(200, 15.0), y=np.full(200, 35.0))
    assert score(still, room("light")) == pytest.approx(1 / (200 * 95.0**2))
    two = room("light")._replace(lamps=np.array([[110.0, 35.0], [15.0, 45.0]]))
    assert score(still, two) == pytest.approx(1 / (200 * 10.0**2))


@pytest.mark.parametrize("name", TASKS)
def test_compiled_scores_have_the_same_bits(name):
    """The compiled score gives, to the last bit, what plain Python gives."""
    task, random = load_task(name), np.random.default_rng(7)
    for _ in range(20):
        wheels = random.normal(3, 4, (2, 200))
        trial = path(*wheels, x=random.uniform(3, 100, 200), y=random.uniform(3, 60, 200))
        assert task.compiled_score()(trial, task.room(PAPER)) == task.score(trial, task.room(PAPER))


WEIGHT = 1.0


def weighted(path, room):
    """A score with a number from outside."""
    return WEIGHT * path.x.size


def test_a_number_that_a_score_uses_may_change(monkeypatch):
    """A new task compiles it anew."""
    task = replace(load_task("avoidance"), name="weighted", score=weighted)
    rows = np.zeros(5)
    path = Path(x=rows, y=rows, heading=rows, left=rows, right=rows, contact=rows)
    room = task.room(load_profile("paper"))
    assert task.compiled_score()(path, room) == 5
    monkeypatch.setattr(f"{__name__}.WEIGHT", 2.0)
    assert replace(task, name="again").compiled_score()(path, room) == 10
