"""Whether a track contains what the definition of a kind requires: one rule for robots of every size and
make.

The rule does not use a trial's name. It was fixed after a look at tracks of a Thymio, and before the later
vehicles that names were tested on (studies/correspondence/vehicles_later.py) were named.
"""

import numpy as np

from realitygap.correspondence.setting import around
from realitygap.correspondence.trials import RADIUS_CM, STEP_S, Trial
from realitygap.world.arena import Arena

__all__ = ["tells"]

TURNING_DEG_S, TURN_DEG, TURNS = 10.0, 20.0, 3
"""A turn is one-sided, faster and larger than this; a robot that turns from obstacles does so three times."""
STRAIGHT_S, MOVING, BESIDE = 2.0, 0.5, 0.25
"""Seconds straight on; shares of the time in motion, and with a surface at one side."""
SLOW_CM_S, BESIDE_CM = 0.5, 4.0
"""For a Khepera; scaled with the robot's size."""


def tells(trial: Trial, arena: Arena) -> dict[str, bool]:
    """By kind of obstacle avoidance, whether a judge could recognise it in this track.

    All are in motion for half of the time. One way and two way turners go straight for two seconds and turn
    three times, the latter to either side; a looper goes once round; a wall follower has a wall at the same
    side, while moving, for a quarter of the time, and turns towards it.
    """
    size, mean = trial.radius_cm / RADIUS_CM, (trial.heading[:-1] + trial.heading[1:]) / 2
    forward = (np.diff(trial.x) * np.cos(mean) + np.diff(trial.y) * np.sin(mean)) / STEP_S
    moving = np.abs(np.convolve(forward, np.ones(3) / 3, "same")) > SLOW_CM_S * size
    rate = np.convolve(np.degrees(np.diff(trial.heading)) / STEP_S, np.ones(7) / 7, "same")
    way = np.sign(rate) * (np.abs(rate) > TURNING_DEG_S)
    parts = np.split(rate * (way != 0) * STEP_S, np.flatnonzero(np.diff(way)) + 1)
    turns = np.array([part.sum() for part in parts if abs(part.sum()) > TURN_DEG])
    straight = STEP_S * (moving & (way == 0) & (forward > 0)).sum() >= STRAIGHT_S
    clearance, surface, *_ = around(arena, trial.x[:-1], trial.y[:-1], trial.heading[:-1], trial.radius_cm)
    side = np.sin(surface) * (moving & (clearance < BESIDE_CM * size))
    back = [(np.maximum(w * rate, 0.0) * (way == w) * (w * side > 0.6)).sum() * STEP_S for w in (1, -1)]
    turner = straight and len(turns) >= TURNS
    held = {
        "one way turner": turner,
        "two way turner": turner and turns.min() < 0 < turns.max(),
        "wall follower": any(
            (w * side > 0.6).mean() >= BESIDE and to > TURN_DEG for w, to in zip((1, -1), back, strict=True)
        ),
        "one way looper": abs(np.degrees(trial.heading[-1] - trial.heading[0])) >= 360,
    }
    return {kind: bool(yes and moving.mean() >= MOVING) for kind, yes in held.items()}
