"""The recurrent delay network (§5.3) in integer arithmetic: ten updates of 10 ms a step.

y(t) = clip(Σ w · y(t − 1 − delay) − threshold, −10, 10), all neurons at once. Sensor neurons hold the step's
inputs, so their contribution is summed once and changes only while a delay still reaches into the previous
step; links between computing neurons are evaluated at every update.

Outputs lie in one flat array, a row per update: PAST rows of the previous step, then the ten of this step. A
link is then a weight and an offset back from the position being computed.
"""

import numpy as np

from realitygap.compiled import kernel, step
from realitygap.kernels.brain import decide, load
from realitygap.kernels.params import MAX_DELAY, UPDATES, Networks

LIMIT = 10
"""Outputs lie in ±10."""
PAST = MAX_DELAY + 1
"""Rows kept from the previous step: the longest delay, and the update before."""
ROWS = PAST + UPDATES
TARGET, SOURCE, WEIGHT, DELAY = 0, 1, 2, 3
"""Columns of a link in params.Networks, and rows of `work.sensor_link`."""
NEVER = 127
"""The delay stored after the last sensor link: a sentinel."""


@step
def _link_fits(link, neurons, sources, weight):
    """Whether a link's ends exist, with a weight within ±`weight` and a valid delay."""
    fits = 0 <= link[TARGET] < neurons and 0 <= link[SOURCE] < sources
    return fits and -weight <= link[WEIGHT] <= weight and 0 <= link[DELAY] <= MAX_DELAY


@step
def _fits(nets, n, inputs, weight, threshold):
    """Whether network `n` is valid: its neurons, and its links in the order that `load_network` needs."""
    neurons, sensed = nets.neurons[n], nets.sensor_count[n]
    count = nets.links.shape[1]
    if not 2 <= neurons <= nets.thresholds.shape[1] or not 0 <= sensed <= count:
        return False
    end = 0
    for i in range(neurons):
        begin = nets.link_start[n, i]
        fits = end <= begin <= nets.link_start[n, i + 1] <= count
        if not fits or not -threshold <= nets.thresholds[n, i] <= threshold:
            return False
        end = nets.link_start[n, i + 1]
        for e in range(begin, end):
            if not _link_fits(nets.links[n, e], neurons, neurons, weight):
                return False
    delay = 0
    for e in range(sensed):
        link = nets.sensor_links[n, e]
        if not _link_fits(link, neurons, inputs, weight) or link[DELAY] < delay:
            return False
        delay = link[DELAY]
    return True


@kernel
def first_unfit(nets, inputs, weight, threshold):
    """The first network that is invalid for that many inputs, and why; −1: there is none.

    Reasons: 0 it has another number of inputs; 1 a neuron or link is out of range.
    """
    for n in range(nets.neurons.shape[0]):
        if nets.inputs[n] != inputs:
            return n, 0
        if not _fits(nets, n, inputs, weight, threshold):
            return n, 1
    return -1, 0


@load.register(Networks)
@step
def load_network(nets, n, work):
    """Load network `n`; all outputs before the trial are 0."""
    neurons = nets.neurons[n]
    for i in range(neurons):
        work.base[i] = -nets.thresholds[n, i]
        work.link_end[i] = nets.link_start[n, i + 1]
        for e in range(nets.link_start[n, i], nets.link_start[n, i + 1]):
            back = (nets.links[n, e, 3] + 1) * neurons
            work.link_back[e] = back + i - nets.links[n, e, 1]
            work.link_weight[e] = nets.links[n, e, 2]
    for e in range(nets.sensor_count[n]):
        for i in range(4):
            work.sensor_link[i, e] = nets.sensor_links[n, e, i]
    work.sensor_link[DELAY, nets.sensor_count[n]] = NEVER
    for i in range(PAST * neurons):
        work.outputs[i] = 0
    work.settled[0] = 0


@step
def deliver(update, link, work):
    """Add to `base` the changes of inputs that arrive with delay `update`.

    Links are sorted by delay; returns the first link that has not arrived yet.
    """
    links = work.sensor_link
    while links[DELAY, link] == update:
        work.base[links[TARGET, link]] += links[WEIGHT, link] * work.change[links[SOURCE, link]]
        link += 1
    return link


@step
def update_neurons(neurons, place, work):
    """One synchronous update into the row that begins at `place`."""
    e = np.uint64(0)
    one = np.uint64(1)
    for i in range(np.uint64(neurons)):
        total = work.base[i]
        here = place + i
        end = work.link_end[i]
        while e < end:
            total += work.link_weight[e] * work.outputs[here - work.link_back[e]]
            e += one
        work.outputs[here] = min(max(total, -LIMIT), LIMIT)


@step
def keep_past(neurons, work):
    """Move the last rows to the front; note whether they are all equal (the network has settled)."""
    settled = 1
    shift = UPDATES * neurons
    for i in range(PAST * neurons):
        value = work.outputs[shift + i]
        settled = settled if value == work.outputs[shift + i - neurons] else 0
        work.outputs[i] = value
    work.settled[0] = settled


@step
def is_still(work):
    """Whether a step would compute the same outputs again: a settled network whose inputs have not changed,
    for the longest delay reaches only PAST + 1 equal rows."""
    changed = False
    for i in range(work.change.shape[0]):
        changed = changed or work.change[i] != 0
    return work.settled[0] == 1 and not changed


@step
def update_network(nets, n, work):
    """One step: ten synchronous updates with work.inputs held."""
    neurons = nets.neurons[n]
    if is_still(work):
        return
    link = 0
    place = np.uint64(PAST * neurons)
    for update in range(UPDATES):
        if update <= MAX_DELAY:
            link = deliver(update, link, work)
        update_neurons(neurons, place, work)
        place += np.uint64(neurons)
    keep_past(neurons, work)


@step
def output(nets, n, work, i):
    """Output neuron `i`'s value after the last update."""
    return work.outputs[MAX_DELAY * nets.neurons[n] + i]


@decide.register(Networks)
@step
def decide_by_network(nets, n, work):
    """The output neurons' values after the step's updates."""
    update_network(nets, n, work)
    return output(nets, n, work, 0), output(nets, n, work, 1)
