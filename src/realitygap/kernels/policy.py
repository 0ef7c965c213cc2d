"""Controllers with real-valued weights, and trials under them: for any optimiser.

A controller is a function decide(weights, memory, inputs, outputs): inputs −1 … 1 in tenths, as for the
paper's network; outputs −1 … 1 are rounded to tenths of the top command. It returns nothing. What it writes
is kept from step to step; when a trial begins, `weights` are the solution's, memory and outputs are 0.
"""

import math

from realitygap.kernels.jit import step
from realitygap.kernels.network import LIMIT
from realitygap.kernels.params import Path
from realitygap.kernels.trial import act, begin, draw_noise, draw_start, feed_network, move, note, sense


@step
def put_out(weights, memory, hidden, outputs):
    """The output layer: weights [2, H + 1], biases last, applied to the first H of `memory`."""
    at = 0
    for o in range(2):
        total = weights[at + hidden]
        for j in range(hidden):
            total += weights[at + j] * memory[j]
        outputs[o] = math.tanh(total)
        at += hidden + 1


@step
def feed_forward(weights, memory, inputs, outputs):
    """One hidden layer of tanh: weights [H, I + 1] into it and [2, H + 1] out of it, biases last.

    H follows from the number of weights; the hidden layer's values are kept in `memory`.
    """
    n = inputs.shape[0]
    hidden = (weights.shape[0] - 2) // (n + 3)
    at = 0
    for j in range(hidden):
        total = weights[at + n]
        for i in range(n):
            total += weights[at + i] * inputs[i]
        memory[j] = math.tanh(total)
        at += n + 1
    put_out(weights[at:], memory, hidden, outputs)


@step
def recurrent(weights, memory, inputs, outputs):
    """An Elman network: weights [H, I + H + 1] into its hidden layer and [2, H + 1] out of it, biases last.

    memory [2H]: the layer's values now and a step ago.
    """
    n = inputs.shape[0]
    hidden = memory.shape[0] // 2
    for j in range(hidden):
        memory[hidden + j] = memory[j]
    at = 0
    for j in range(hidden):
        total = weights[at + n + hidden]
        for i in range(n):
            total += weights[at + i] * inputs[i]
        for i in range(hidden):
            total += weights[at + n + i] * memory[hidden + i]
        memory[j] = math.tanh(total)
        at += n + hidden + 1
    put_out(weights[at:], memory, hidden, outputs)


@step
def command(value):
    """An output −1 … 1 as an integer −10 … 10."""
    return math.floor(min(max(value, -1.0), 1.0) * LIMIT + 0.5)


def trials_under(decide):
    """The loop over trials for a compiled `decide`, to be compiled with it."""

    def run(world, nobody, weights, which, streams, paths, work, own):
        """Trial t runs controller which[t] on streams[t], into paths[t]; returns the number of non-finite
        outputs.

        own: scratch arrays (weights, memory, inputs, outputs).
        """
        mine, memory, inputs, outputs = own
        wrong = 0
        for t in range(which.shape[0]):
            draw_start(world.task, streams[t], work.start)
            begin(nobody, 0, work.start, work)
            p = paths[t]
            path = Path(p[0], p[1], p[2], p[3], p[4], p[5])
            for i in range(mine.shape[0]):
                mine[i] = weights[which[t], i]
            memory[:] = 0.0
            outputs[:] = 0.0
            for k in range(world.task.steps):
                draw_noise(world.level, streams[t], k, work.readings.shape[0], work)
                sense(world.robot, world.arena, world.task.feed, world.level, work)
                feed_network(world.robot, world.task, work)
                for i in range(inputs.shape[0]):
                    inputs[i] = work.inputs[i] / LIMIT
                decide(mine, memory, inputs, outputs)
                for w in range(2):
                    wrong += 0 if math.isfinite(outputs[w]) else 1
                    work.outputs[w] = command(outputs[w])
                act(world.robot, nobody, 0, world.level, work)
                move(world.robot, world.arena, work)
                note(path, k, work)
        return wrong

    return run
