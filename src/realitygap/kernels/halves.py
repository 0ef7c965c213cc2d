"""A step in two halves, sense and move, for controllers that are not kernels.

The wheels' commands are stored as the outputs of a network without neurons (`quiet`).
"""

import numpy as np

from realitygap.kernels.batch import sense_both
from realitygap.kernels.jit import kernel
from realitygap.kernels.params import Networks
from realitygap.kernels.trial import act, begin, draw_noise, move


def quiet() -> Networks:
    """One network without neurons; the caller writes its outputs, work.outputs[0] and [1]."""
    return Networks(
        inputs=np.zeros(1, np.int64), neurons=np.zeros(1, np.int64), thresholds=np.zeros((1, 2), np.int16),
        sensor_links=np.zeros((1, 1, 4), np.int16), sensor_count=np.zeros(1, np.int64),
        links=np.zeros((1, 1, 4), np.int16), link_start=np.zeros((1, 3), np.int16),
    )  # fmt: skip


@kernel
def set_down(nets, work):
    """Put the robot at rest at work.start, wheels without commands."""
    begin(nets, 0, work.start, work)
    work.outputs[0] = 0
    work.outputs[1] = 0


@kernel
def sense_now(world, stream, k, both, work, aside):
    """Readings in step `k`: the fed sensors' into work.readings, the others' into `aside`.

    A function of the trial's stream, the step and the pose: the same bits as record_trial.
    """
    draw_noise(world.level, stream, k, work.readings.shape[0], work)
    sense_both(world, stream, k, both, work, aside)


@kernel
def move_on(world, nets, stream, k, work):
    """Wheels and movement of step `k`, under the commands in work.outputs."""
    draw_noise(world.level, stream, k, work.readings.shape[0], work)
    act(world.robot, nets, 0, world.level, work)
    move(world.robot, world.arena, work)
