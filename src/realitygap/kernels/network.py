"""What decides in a trial, by its type: a delay network (below), a controller with weights (weights.py).

A brain stands for N controllers; of each, `load` and `decide` are registered for the brain's type.
"""

from collections.abc import Callable
from functools import singledispatch
from typing import Any

import numpy as np
from numba.extending import overload

from realitygap.compiled import step
from realitygap.kernels.types import MAX_DELAY, UPDATES, Networks


def by_type(stub: Callable[..., Any]) -> Any:
    """A function of (brain, n, state, scratch), another one for each type of brain, compiled or not."""
    chosen = singledispatch(stub)

    @overload(chosen, inline="always", strict=False)
    def choose(brain: Any, n: Any, state: Any, scratch: Any) -> Any:
        step = chosen.dispatch(brain.instance_class)
        return lambda brain, n, state, scratch: step(brain, n, state, scratch)

    return chosen


@by_type
def load(brain, n, state, scratch):
    """Make controller `n` ready for a trial: it has no past."""
    raise NotImplementedError


@by_type
def decide(brain, n, state, scratch):
    """Controller `n`'s commands (left, right), −10 … 10, for state.inputs."""
    raise NotImplementedError


LIMIT = 10
"""Outputs lie in ±10."""
PAST = MAX_DELAY + 1
"""Rows kept from the previous step: the longest delay, and the update before."""
ROWS = PAST + UPDATES
TARGET, SOURCE, WEIGHT, DELAY = 0, 1, 2, 3
"""Columns of a link in types.Networks, and rows of `Scratch.sensor_link`."""
NEVER = 127
"""The delay stored after the last sensor link: a sentinel."""


@load.register(Networks)
@step
def load_network(nets, n, state, scratch):
    """Load network `n`; all outputs before the trial are 0."""
    neurons = nets.neurons[n]
    for i in range(neurons):
        state.base[i] = -nets.thresholds[n, i]
        scratch.link_end[i] = nets.link_start[n, i + 1]
        for e in range(nets.link_start[n, i], nets.link_start[n, i + 1]):
            back = (nets.links[n, e, 3] + 1) * neurons
            scratch.link_back[e] = back + i - nets.links[n, e, 1]
            scratch.link_weight[e] = nets.links[n, e, 2]
    for e in range(nets.sensor_count[n]):
        for i in range(4):
            scratch.sensor_link[i, e] = nets.sensor_links[n, e, i]
    scratch.sensor_link[DELAY, nets.sensor_count[n]] = NEVER
    for i in range(PAST * neurons):
        state.outputs[i] = 0
    state.settled[0] = 0


@step
def deliver(update, link, state, scratch):
    """Add to `base` the changes of inputs that arrive with delay `update`.

    Links are sorted by delay; returns the first link that has not arrived yet.
    """
    links = scratch.sensor_link
    while links[DELAY, link] == update:
        state.base[links[TARGET, link]] += links[WEIGHT, link] * state.change[links[SOURCE, link]]
        link += 1
    return link


@step
def update_neurons(neurons, place, state, scratch):
    """One synchronous update into the row that begins at `place`."""
    e = np.uint64(0)
    one = np.uint64(1)
    for i in range(np.uint64(neurons)):
        total = state.base[i]
        here = place + i
        end = scratch.link_end[i]
        while e < end:
            total += scratch.link_weight[e] * state.outputs[here - scratch.link_back[e]]
            e += one
        state.outputs[here] = min(max(total, -LIMIT), LIMIT)


@step
def keep_past(neurons, state):
    """Move the last rows to the front; note whether they are all equal (the network has settled)."""
    settled = 1
    shift = UPDATES * neurons
    for i in range(PAST * neurons):
        value = state.outputs[shift + i]
        settled = settled if value == state.outputs[shift + i - neurons] else 0
        state.outputs[i] = value
    state.settled[0] = settled


@step
def is_still(state):
    """Whether a step would compute the same outputs again: a settled network whose inputs have not changed,
    for the longest delay reaches only PAST + 1 equal rows."""
    changed = False
    for i in range(state.change.shape[0]):
        changed = changed or state.change[i] != 0
    return state.settled[0] == 1 and not changed


@step
def update_network(nets, n, state, scratch):
    """One step: ten synchronous updates with state.inputs held."""
    neurons = nets.neurons[n]
    if is_still(state):
        return
    link = 0
    place = np.uint64(PAST * neurons)
    for update in range(UPDATES):
        if update <= MAX_DELAY:
            link = deliver(update, link, state, scratch)
        update_neurons(neurons, place, state, scratch)
        place += np.uint64(neurons)
    keep_past(neurons, state)


@step
def output(nets, n, state, i):
    """Output neuron `i`'s value after the last update."""
    return state.outputs[MAX_DELAY * nets.neurons[n] + i]


@decide.register(Networks)
@step
def decide_by_network(nets, n, state, scratch):
    """The output neurons' values after the step's updates."""
    update_network(nets, n, state, scratch)
    return output(nets, n, state, 0), output(nets, n, state, 1)
