"""Many robots, each at its own step, advanced by one step from Python: for learners.

The same steps as in a trial (§3.2), in halves: actions are decided outside. With the commands of a network
the bits are those of that network's trial.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from realitygap.kernels.jit import kernel, step
from realitygap.kernels.params import I64, F, Path
from realitygap.kernels.trial import act, begin, draw_noise, move, note, sense, stand


class Crowd(NamedTuple):
    """N robots between two steps."""

    pose: F
    """[N, 3] x, y (cm), heading (rad)."""
    wheel: F
    """[N, 2, 9] see wheels.py."""
    step: I64
    """[N] steps done."""
    stream: NDArray[np.uint64]
    """[N] of each robot's noise."""
    path: F
    """[N, 6, steps] the rows of params.Path."""
    readings: F
    """[N, P or A] readings of the fed sensors."""


@step
def pick_up(crowd, r, work):
    """Copy robot `r` into the scratch arrays."""
    stand(crowd.pose[r], work)
    for i in range(2):
        for j in range(work.wheel.shape[1]):
            work.wheel[i, j] = crowd.wheel[r, i, j]


@step
def lay_down(crowd, r, work):
    """Copy the scratch arrays back into robot `r`, with its readings."""
    for i in range(work.readings.shape[0]):
        crowd.readings[r, i] = work.readings[i]
    for i in range(3):
        crowd.pose[r, i] = work.pose[i]
    for i in range(2):
        for j in range(work.wheel.shape[1]):
            crowd.wheel[r, i, j] = work.wheel[i, j]


@step
def drive(world, nobody, crowd, r, command, work):
    """Robot `r`'s step under a command (left, right; −10 … 10), noted in its path."""
    pick_up(crowd, r, work)
    work.outputs[0] = command[0]
    work.outputs[1] = command[1]
    draw_noise(world.level, crowd.stream[r], crowd.step[r], work.readings.shape[0], work)
    act(world.robot, nobody, 0, world.level, work)
    move(world.robot, world.arena, work)
    p = crowd.path[r]
    note(Path(p[0], p[1], p[2], p[3], p[4], p[5]), crowd.step[r], work)
    crowd.step[r] += 1


@kernel
def go_on(world, nobody, crowd, which, starts, commands, work):
    """Advance robots `which`: the first ones, as many as there are starts, begin a trial at rest at starts[i]
    (x, y, heading); the others do a step under commands[i] (left, right). All then read their sensors for the
    next step.

    One kernel for both, since reading the sensors is most of it.
    """
    for i in range(which.shape[0]):
        r = which[i]
        if i < starts.shape[0]:
            begin(nobody, 0, starts[i], work)
            crowd.step[r] = 0
        else:
            drive(world, nobody, crowd, r, commands[i], work)
        draw_noise(world.level, crowd.stream[r], crowd.step[r], work.readings.shape[0], work)
        sense(world.robot, world.arena, world.task.feed, world.level, work)
        lay_down(crowd, r, work)
