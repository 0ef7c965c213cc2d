"""The compiled way from genotypes to the dense arrays that the kernels work on."""

# mypy: allow-untyped-defs, no-check-untyped-defs
import numpy as np

from realitygap.controller.layout import (
    DELAY,
    EXPRESSED,
    FIRST_LINK,
    LINK_FIELDS,
    MAX_DELAY,
    MAX_THRESHOLD,
    MAX_WEIGHT,
    SOURCE,
    THRESHOLD,
    WEIGHT,
)
from realitygap.kernels.jit import kernel, routine, step
from realitygap.kernels.params import Networks

__all__ = ["dense_networks", "first_fault"]


@step
def _slot_is_right(row, slots, inputs, slot):
    """Whether a slot's content is in its ranges."""
    right = 0 <= row[EXPRESSED] <= 1 and (row[EXPRESSED] == 1 or slot >= inputs + 2)
    right = right and -MAX_THRESHOLD <= row[THRESHOLD] <= MAX_THRESHOLD
    for at in range(FIRST_LINK, row.shape[0], LINK_FIELDS):
        right = right and 0 <= row[at] <= 1 and 0 <= row[at + SOURCE] < slots
        right = right and -MAX_WEIGHT <= row[at + WEIGHT] <= MAX_WEIGHT and 0 <= row[at + DELAY] <= MAX_DELAY
    return right


@kernel
def first_fault(genes, inputs):
    """The first of genotypes [N, slots, fields] with a value out of its range; −1: there is none."""
    for i in range(genes.shape[0]):
        for slot in range(genes.shape[1]):
            if not _slot_is_right(genes[i, slot], genes.shape[1], inputs, slot):
                return i
    return -1


@step
def _mark_used(genes, inputs, prune, used, waiting):
    """Marks the neurons that compute; when pruning, only those from which a motor can be reached."""
    slots, columns = genes.shape
    if not prune:
        for slot in range(inputs, slots):
            used[slot] = genes[slot, EXPRESSED]
        return
    used[inputs] = 1
    used[inputs + 1] = 1
    waiting[0] = inputs
    waiting[1] = inputs + 1
    n = 2
    while n > 0:
        n -= 1
        slot = waiting[n]
        for at in range(FIRST_LINK, columns, LINK_FIELDS):
            source = genes[slot, at + SOURCE]
            linked = genes[slot, at] and genes[slot, at + WEIGHT] and source >= inputs
            if linked and genes[source, EXPRESSED] and not used[source]:
                used[source] = 1
                waiting[n] = source
                n += 1


@step
def _number(genes, inputs, used, net, i, number):
    """Numbers the used neurons of network i densely, in the order of slots; how many there are."""
    m = 0
    for slot in range(inputs, genes.shape[0]):
        number[slot] = -1
        if used[slot]:
            number[slot] = m
            net.thresholds[i, m] = genes[slot, THRESHOLD]
            m += 1
    return m


@step
def _write(links, i, k, target, source, gene):
    """Link k of network i: target, source, weight, delay; `gene` is its field in the genotype."""
    links[i, k, 0] = target
    links[i, k, 1] = source
    links[i, k, 2] = gene[WEIGHT]
    links[i, k, 3] = gene[DELAY]


@step
def _fill_links(genes, inputs, prune, net, i, number):
    """Links between computing neurons, grouped by target."""
    k = 0
    for slot in range(inputs, genes.shape[0]):
        if number[slot] < 0:
            continue
        net.link_start[i, number[slot]] = k
        for at in range(FIRST_LINK, genes.shape[1], LINK_FIELDS):
            gene = genes[slot, at : at + LINK_FIELDS]
            source = gene[SOURCE]
            live = gene[0] and source >= inputs and number[source] >= 0
            if live and not (prune and gene[WEIGHT] == 0):
                _write(net.links, i, k, number[slot], number[source], gene)
                k += 1
    net.link_start[i, net.neurons[i] :] = k


@step
def _fill_sensor_links(genes, inputs, prune, net, i, number):
    """Links from sensors, sorted by delay; within a delay in the order of slots and fields."""
    k = 0
    for delay in range(MAX_DELAY + 1):
        for slot in range(inputs, genes.shape[0]):
            if number[slot] < 0:
                continue
            for at in range(FIRST_LINK, genes.shape[1], LINK_FIELDS):
                gene = genes[slot, at : at + LINK_FIELDS]
                live = gene[0] and gene[SOURCE] < inputs and gene[DELAY] == delay
                if live and not (prune and gene[WEIGHT] == 0):
                    _write(net.sensor_links, i, k, number[slot], gene[SOURCE], gene)
                    k += 1
    net.sensor_count[i] = k


@routine
def dense_networks(genes, inputs, prune):
    """The networks of genotypes [N, slots, fields]."""
    n, slots, columns = genes.shape
    m = slots - inputs
    k = m * ((columns - FIRST_LINK) // LINK_FIELDS)
    net = Networks(
        np.full(n, inputs, np.int64),
        np.zeros(n, np.int64),
        np.zeros((n, m), np.int16),
        np.zeros((n, k, 4), np.int16),
        np.zeros(n, np.int64),
        np.zeros((n, k, 4), np.int16),
        np.zeros((n, m + 1), np.int16),
    )
    used = np.zeros(slots, np.int8)
    number = np.zeros(slots, np.int64)
    for i in range(n):
        used[:] = 0
        _mark_used(genes[i], inputs, prune, used, number)
        net.neurons[i] = _number(genes[i], inputs, used, net, i, number)
        _fill_links(genes[i], inputs, prune, net, i, number)
        _fill_sensor_links(genes[i], inputs, prune, net, i, number)
    return net
