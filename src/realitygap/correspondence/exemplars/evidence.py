"""The mark of each kind: what a trial must hold to show its kind at all.

A two way turner that happens to meet everything at its left turns to the right only; nothing in that
trial tells it from a one way turner, and no judge could. So an exemplar's trial counts where the robot
did, for half a second in all, each thing that its kind's definition names. That is asked of the
controller's own commands, never of the track, and says nothing of how a trial is named; it is the same
for the exemplars that names are learnt from and for those that they are tried on.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from realitygap.values import Command

__all__ = ["MARKS", "MARK_STEPS", "shows"]

MARK_STEPS = 5
"""Half a second of commands."""

MARKS: dict[str, dict[str, tuple[str, ...]]] = {
    "obstacle-avoidance": {
        "one way turner": ("straight", "turn"),
        "two way turner": ("straight", "left", "right"),
        "wall follower": ("forward", "turn"),
        "one way looper": ("turn",),
    },
    "light-seeking": {
        "three point turner": ("straight", "back", "forward"),
        "straight looper": ("straight", "turn"),
        "two way turner": ("forward", "left", "right"),
        "bobber": ("forward", "back"),
    },
}
"""By task and kind, what its definition names; a kind that is not here shows itself in any trial."""


def shows(task: str, kind: str, commands: Sequence[Command]) -> bool:
    """Whether a trial's commands hold all that makes its kind."""
    wheels = np.array([(c.left, c.right) for c in commands], np.float64).reshape(-1, 2)
    done = _done(wheels[:, 0], wheels[:, 1])
    return all(int(done[thing].sum()) >= MARK_STEPS for thing in MARKS[task].get(kind, ()))


def _done(left: NDArray[np.float64], right: NDArray[np.float64]) -> dict[str, NDArray[np.bool_]]:
    """Which steps do what, by name, [n] each."""
    ahead = left + right
    return {
        "forward": ahead > 0,
        "back": ahead < 0,
        "straight": (left == right) & (ahead > 0),
        "turn": left != right,
        "left": right > left,
        "right": left > right,
    }
