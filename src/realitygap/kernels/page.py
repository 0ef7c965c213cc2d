"""What a page calls (simulation/wasm.py): trials of network `n`, as many steps at a time as it shows.

All have the same arguments; `start` and `stand` begin at step 0, `step` goes on from step `k`.
"""

from realitygap.kernels.motion import body_clear
from realitygap.kernels.trial import NO_RECORD, begin, draw_start, live_step, store


def start(world, nets, n, stream, k, many, path, scratch):
    """Stand at a start of the task, drawn as in a trial on `stream`."""
    draw_start(world.task, stream, scratch.start)
    begin(nets, n, scratch)


def stand(world, nets, n, stream, k, many, path, scratch):
    """Stand at scratch.start; path.contact[0] is 1 if the body does not fit there."""
    begin(nets, n, scratch)
    x, y, heading = scratch.start[0], scratch.start[1], scratch.start[2]
    path.contact[0] = 0.0 if body_clear(world.robot, world.arena, x, y, heading) else 1.0


def step(world, nets, n, stream, k, many, path, scratch):
    """Steps k .. k + many − 1, stored in the first rows of `path`."""
    for i in range(many):
        live_step(world, nets, n, stream, k + i, NO_RECORD, scratch)
        store(path, i, scratch.state)
