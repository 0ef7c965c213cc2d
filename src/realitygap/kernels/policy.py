"""Controllers with real-valued weights, and trials under them: for any optimiser.

A controller is a function decide(weights, memory, inputs, outputs): inputs −1 … 1 in tenths, as for the
paper's network; outputs −1 … 1 are rounded to tenths of the top command. It returns nothing. What it writes
is kept from step to step; when a trial begins, `weights` are the solution's, memory and outputs are 0.
"""

import math
from functools import partial
from typing import Any, NamedTuple

from realitygap.compiled import step
from realitygap.kernels.brain import decide, load
from realitygap.kernels.network import LIMIT
from realitygap.kernels.params import I64, F
from realitygap.kernels.trial import run_each


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


class Weights(NamedTuple):
    """N controllers with weights, and scratch arrays for the one that decides."""

    function: Any
    """decide(weights, memory, inputs, outputs), compiled."""
    weights: F
    """[N, W]."""
    mine: F
    memory: F
    inputs: F
    outputs: F
    """[W] what the weights have become in this trial, [M], [I], [2]."""
    wrong: I64
    """[1] outputs that were not finite."""


@load.register(Weights)
@step
def load_weights(brain, n, work):
    """It remembers nothing, and has learnt nothing."""
    for i in range(brain.mine.shape[0]):
        brain.mine[i] = brain.weights[n, i]
    brain.memory[:] = 0.0
    brain.outputs[:] = 0.0


@decide.register(Weights)
@partial(step, fastmath=False)  # whose flags would take every output for a finite one
def decide_by_weights(brain, n, work):
    """Its outputs, in tenths of the top command."""
    for i in range(brain.inputs.shape[0]):
        brain.inputs[i] = work.inputs[i] / LIMIT
    brain.function(brain.mine, brain.memory, brain.inputs, brain.outputs)
    for w in range(2):
        brain.wrong[0] += 0 if math.isfinite(brain.outputs[w]) else 1
    return command(brain.outputs[0]), command(brain.outputs[1])


def run(world, brain, which, streams, paths, record, work):
    """Trials under controllers with weights, to be compiled with their `function`: as of `run_each`."""
    weights, mine, memory, inputs, outputs, wrong = brain
    whole = Weights(function, weights, mine, memory, inputs, outputs, wrong)  # noqa: F821
    run_each(world, whole, which, streams, paths, record, work)
