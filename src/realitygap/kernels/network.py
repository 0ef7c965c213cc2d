"""The recurrent delay network (§5.3) in integer arithmetic: ten updates of 10 ms a step.

y(t) = clip(Σ w · y(t − 1 − delay) − threshold, −10, 10), all neurons at once. Sensor neurons hold the step's
inputs, so their contribution is summed once and changes only while a delay still reaches into the previous
step; links between computing neurons are evaluated at every update.

Outputs lie in one flat array, a row per update: PAST rows of the previous step, then the ten of this step. A
link is then a weight and an offset back from the position being computed.
"""

import numpy as np

from realitygap.compiled import step
from realitygap.kernels.brain import decide, load
from realitygap.kernels.params import MAX_DELAY, UPDATES, Networks

LIMIT = 10
"""Outputs lie in ±10."""
PAST = MAX_DELAY + 1
"""Rows kept from the previous step: the longest delay, and the update before."""
ROWS = PAST + UPDATES
TARGET, SOURCE, WEIGHT, DELAY = 0, 1, 2, 3
"""Columns of a link in params.Networks, and rows of `Scratch.sensor_link`."""
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
