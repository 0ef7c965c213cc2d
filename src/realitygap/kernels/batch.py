"""What is called from Python: many trials, one trial in full, readings at a place."""

import numpy as np

from realitygap.kernels.ambient import ambient
from realitygap.kernels.geometry import stands_clear
from realitygap.kernels.infrared import infrared
from realitygap.kernels.jit import kernel
from realitygap.kernels.params import Path
from realitygap.kernels.rng import normals, sin_cos
from realitygap.kernels.trial import (
    AMBIENT,
    PROXIMITY,
    act,
    begin,
    draw_noise,
    draw_start,
    feed_network,
    move,
    note,
    read,
    run_trial,
    sense,
)
from realitygap.kernels.network import think
from realitygap.kernels.work import DRAWS, noise_blocks, new_work
from realitygap.kernels.rng import substream

ASIDE = 1
"""Name of the stream that noise for sensors which feed nobody is drawn from."""


@kernel
def run_trials(robot, arena, task, nets, which, level, streams, paths, work):
    """Trial t is network which[t] on streams[t] from a start drawn there, into paths[t].

    `paths` is [trials, 6, steps]: the rows of params.Path.
    """
    for t in range(which.shape[0]):
        draw_start(task, streams[t], work.start)
        p = paths[t]
        path = Path(p[0], p[1], p[2], p[3], p[4], p[5])
        run_trial(robot, arena, task, nets, which[t], level, streams[t], work.start, work, path)
