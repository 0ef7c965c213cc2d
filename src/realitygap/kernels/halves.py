"""A step in two halves, sense and move, for a body whose controller is not a kernel.

The wheels' commands lie where a network of no neurons would have its outputs (`quiet`).
"""

import numpy as np

from realitygap.kernels.batch import sense_both
from realitygap.kernels.jit import kernel
from realitygap.kernels.params import Networks
from realitygap.kernels.trial import act, begin, draw_noise, move


def quiet() -> Networks:
    """One network of no neurons; whoever drives the robot writes its outputs, work.outputs[0] and [1]."""
    return Networks(
        inputs=np.zeros(1, np.int64), neurons=np.zeros(1, np.int64), thresholds=np.zeros((1, 2), np.int16),
        sensor_links=np.zeros((1, 1, 4), np.int16), sensor_count=np.zeros(1, np.int64),
        links=np.zeros((1, 1, 4), np.int16), link_start=np.zeros((1, 3), np.int16),
    )  # fmt: skip


@kernel
def set_down(nets, work):
    """The robot at rest at work.start, wheels not commanded."""
    begin(nets, 0, work.start, work)
    work.outputs[0] = 0
    work.outputs[1] = 0


@kernel
def sense_now(world, stream, k, both, work, aside):
    """What the sensors read in step `k`: the fed ones into work.readings, the others into `aside`.

    A function of the trial's stream, the step and where the robot is: the bits of record_trial.
    """
    draw_noise(world.level, stream, k, work.readings.shape[0], work)
    sense_both(world, stream, k, both, work, aside)


@kernel
def move_on(world, nets, stream, k, work):
    """Step `k`'s wheels and movement, under the commands in work.outputs."""
    draw_noise(world.level, stream, k, work.readings.shape[0], work)
    act(world.robot, nets, 0, world.level, work)
    move(world.robot, world.arena, work)
