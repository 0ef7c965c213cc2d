"""Genotypes as arrays of slots (§5.2): columns and ranges, decoding to networks, the genetic operators.

A genotype is int8[slots, 2 + 4 · links]: a row for each slot, the sensor neurons first, then the two motors,
then hidden neurons. A row says whether its slot holds a neuron, its threshold, and its link fields.
"""

# mypy: allow-untyped-defs, no-check-untyped-defs
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from realitygap.compiled import routine, step
from realitygap.errors import GenotypeError
from realitygap.kernels.rng import below, substream, uniform
from realitygap.kernels.types import MAX_DELAY, Networks
from realitygap.streams import (
    ADD_LINK,
    ADD_NEURON,
    CROSSOVER,
    DELETE_LINK,
    DELETE_NEURON,
    MUTATION,
    START,
)
from realitygap.values import shown

__all__ = [
    "EXPRESSED", "FIRST_LINK", "LINK", "LINK_FIELDS", "MAX_THRESHOLD", "MAX_WEIGHT", "THRESHOLD", "Genes",
    "Rates", "bounds", "crosses", "decode", "links_of", "offspring", "random_genes", "refuse_wrong",
]  # fmt: skip

Genes = NDArray[np.int8]

MAX_THRESHOLD = 10
"""Thresholds are −10 .. 10 (§5.3)."""
MAX_WEIGHT = 4
"""Weights are −4 .. 4 (§5.3)."""

EXPRESSED, THRESHOLD, FIRST_LINK = 0, 1, 2
"""Columns of a slot: does it hold a neuron, its threshold, its first link field."""
LINK_FIELDS = 4
"""Columns of a link field: expressed, source slot, weight, delay; in this order."""
SOURCE, WEIGHT, DELAY = 1, 2, 3
LINK = ("expressed", "source slot", "weight", "delay")


def links_of(genes: Genes) -> Genes:
    """The link fields of a genotype, [slots, links, LINK_FIELDS]: the same memory."""
    return genes[:, FIRST_LINK:].reshape(len(genes), -1, LINK_FIELDS)


@lru_cache(maxsize=64)
def bounds(inputs: int, slots: int, links: int) -> NDArray[np.int8]:
    """[2, slots, 2 + 4 · links]: lowest and highest value of everything in a genotype (§5.2, §5.3)."""
    low, high = found = np.zeros((2, slots, FIRST_LINK + LINK_FIELDS * links), np.int8)
    low[: inputs + 2, EXPRESSED], high[:, EXPRESSED] = 1, 1
    low[:, THRESHOLD], high[:, THRESHOLD] = -MAX_THRESHOLD, MAX_THRESHOLD
    links_of(low)[:], links_of(high)[:] = (0, 0, -MAX_WEIGHT, 0), (1, slots - 1, MAX_WEIGHT, MAX_DELAY)
    found.setflags(write=False)
    return found


def refuse_wrong(genes: NDArray[Any], inputs: int) -> None:
    """Refuse what is no array of genotypes [N, slots, 2 + 4 · links] with this many inputs.

    Raises:
        GenotypeError: names the genotype, the slot and the column.
    """
    shape: tuple[int, ...] = getattr(genes, "shape", ())
    fits = type(genes) is np.ndarray and genes.dtype == np.int8 and len(shape) == 3
    if not fits or not inputs + 2 <= shape[1] <= 128 or shape[2] < 6 or (shape[2] - FIRST_LINK) % LINK_FIELDS:
        expected = f"int8[N, {inputs} inputs + 2 or more slots, 2 + 4 · links]"
        raise GenotypeError(f"genotypes: expected an array {expected}, got {shown(genes)}.")
    low, high = bounds(inputs, shape[1], (shape[2] - FIRST_LINK) // LINK_FIELDS)
    wrong = (genes < low) | (genes > high)
    if wrong.any():
        which, slot, column = np.argwhere(wrong)[0].tolist()
        k, field = divmod(column - FIRST_LINK, LINK_FIELDS)
        part = ("expressed", "threshold")[column] if column < FIRST_LINK else f"link {k}, {LINK[field]}"
        expected = f"{low[slot, column]} to {high[slot, column]}"
        raise GenotypeError(
            f"genotype {which}, slot {slot}, {part}: expected {expected}, got {genes[which, slot, column]}."
        )


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


def decode(genes: Genes, inputs: int, *, prune: bool = True) -> Networks:
    """The networks of genotypes.

    Args:
        genes: int8[N, slots, 2 + 4 · links], or of one.
        inputs: how many of the slots are sensors.
        prune: leave out what can never change an output: links of weight 0, and hidden neurons
            from which no motor can be reached.

    Raises:
        GenotypeError: an array of another type or shape, or a value out of its range.
    """
    genes = genes[np.newaxis] if np.ndim(genes) == 2 else genes
    refuse_wrong(genes, inputs)
    networks: Networks = dense_networks(np.array(genes, order="C"), inputs, bool(prune))
    return networks


class Rates(NamedTuple):
    """What the operators are told; probabilities, except for the first two."""

    inputs: int
    any_source: int = 0
    """1: a link's source is drawn among all slots; 0: among those expressed at that moment."""
    crossover: float = 0.0
    mutation: float = 0.0
    add_neuron: float = 0.0
    delete_neuron: float = 0.0
    add_link: float = 0.0
    delete_link: float = 0.0
    start_neurons: float = 0.0
    start_links: float = 0.0


@step
def _draw_source(genes, rates, stream, draw):
    """A link's source slot, drawn uniformly among the slots that may be one."""
    slots = genes.shape[0]
    if rates.any_source:
        return below(stream, draw, slots)
    n = 0
    for slot in range(slots):
        if genes[slot, EXPRESSED]:
            n += 1
    k = below(stream, draw, n)
    for slot in range(slots):
        if genes[slot, EXPRESSED]:
            if k == 0:
                return slot
            k -= 1
    return slots - 1


@step
def _fresh_link(genes, slot, at, rates, stream):
    """A new link in the field that begins at column `at`: source, weight and delay at random."""
    genes[slot, at] = 1
    genes[slot, at + SOURCE] = _draw_source(genes, rates, stream, 0)
    genes[slot, at + WEIGHT] = below(stream, 1, 2 * MAX_WEIGHT + 1) - MAX_WEIGHT
    genes[slot, at + DELAY] = below(stream, 2, MAX_DELAY + 1)


@step
def _fresh_neuron(genes, slot, rates, stream):
    """New content for an expressed slot: a threshold, and links."""
    genes[slot, THRESHOLD] = below(stream, 0, 2 * MAX_THRESHOLD + 1) - MAX_THRESHOLD
    for k in range((genes.shape[1] - FIRST_LINK) // LINK_FIELDS):
        at = FIRST_LINK + LINK_FIELDS * k
        if uniform(stream, 1 + k) < rates.start_links:
            _fresh_link(genes, slot, at, rates, substream(stream, k))
        else:
            genes[slot, at : at + LINK_FIELDS] = 0


@routine
def random_genes(slots, links, rates, stream):
    """A random genotype of slots, and links in each: first which slots hold a neuron, then what each is."""
    genes = np.zeros((slots, FIRST_LINK + LINK_FIELDS * links), np.int8)
    stream = substream(stream, START)
    first_hidden = rates.inputs + 2
    genes[:first_hidden, EXPRESSED] = 1
    for slot in range(first_hidden, slots):
        if uniform(stream, slot) < rates.start_neurons:
            genes[slot, EXPRESSED] = 1
    for slot in range(rates.inputs, slots):
        if genes[slot, EXPRESSED]:
            _fresh_neuron(genes, slot, rates, substream(stream, slot))
    return genes


@step
def _happens(chance, stream):
    return uniform(stream, 0) < chance


@step
def _mutate(genes, rates, stream):
    """Each piece of information is drawn anew with probability `mutation` (§5.1)."""
    slots, columns = genes.shape
    for slot in range(rates.inputs, slots):
        if not genes[slot, EXPRESSED]:
            continue
        g = 2 * (slot * columns + THRESHOLD)
        if uniform(stream, g) < rates.mutation:
            genes[slot, THRESHOLD] = below(stream, g + 1, 2 * MAX_THRESHOLD + 1) - MAX_THRESHOLD
        for at in range(FIRST_LINK, columns, LINK_FIELDS):
            if not genes[slot, at]:
                continue
            g = 2 * (slot * columns + at + SOURCE)
            if uniform(stream, g) < rates.mutation:
                genes[slot, at + SOURCE] = _draw_source(genes, rates, stream, g + 1)
            g = 2 * (slot * columns + at + WEIGHT)
            if uniform(stream, g) < rates.mutation:
                genes[slot, at + WEIGHT] = below(stream, g + 1, 2 * MAX_WEIGHT + 1) - MAX_WEIGHT
            g = 2 * (slot * columns + at + DELAY)
            if uniform(stream, g) < rates.mutation:
                genes[slot, at + DELAY] = below(stream, g + 1, MAX_DELAY + 1)


@step
def _nth_hidden(genes, first_hidden, expressed, n):
    """(The nth hidden slot that is or is not expressed, how many there are); n < 0 only counts."""
    found = -1
    count = 0
    for slot in range(first_hidden, genes.shape[0]):
        if genes[slot, EXPRESSED] == expressed:
            if count == n:
                found = slot
            count += 1
    return found, count


@step
def _add_neuron(genes, rates, stream):
    """A neuron with fresh content in one of the free slots, if there is one."""
    _, free = _nth_hidden(genes, rates.inputs + 2, 0, -1)
    if free:
        slot, _ = _nth_hidden(genes, rates.inputs + 2, 0, below(stream, 1, free))
        genes[slot, EXPRESSED] = 1
        _fresh_neuron(genes, slot, rates, substream(stream, 0))


@step
def _delete_neuron(genes, rates, stream):
    """One of the hidden neurons goes, if there is one; links from it stay, dormant."""
    _, held = _nth_hidden(genes, rates.inputs + 2, 1, -1)
    if held:
        slot, _ = _nth_hidden(genes, rates.inputs + 2, 1, below(stream, 1, held))
        genes[slot, :] = 0


@step
def _nth_field(genes, inputs, expressed, n):
    """(slot, column, count) of the nth link field, expressed or free, of motor and hidden neurons."""
    found_slot = -1
    found_at = -1
    count = 0
    for slot in range(inputs, genes.shape[0]):
        if genes[slot, EXPRESSED]:
            for at in range(FIRST_LINK, genes.shape[1], LINK_FIELDS):
                if genes[slot, at] == expressed:
                    if count == n:
                        found_slot = slot
                        found_at = at
                    count += 1
    return found_slot, found_at, count


@step
def _add_link(genes, rates, stream):
    """A fresh link in one of the free fields of motor and hidden neurons, if there is one."""
    _, _, free = _nth_field(genes, rates.inputs, 0, -1)
    if free:
        slot, at, _ = _nth_field(genes, rates.inputs, 0, below(stream, 1, free))
        _fresh_link(genes, slot, at, rates, substream(stream, 0))


@step
def _delete_link(genes, rates, stream):
    """One of the links, live or dormant, of motor and hidden neurons goes, if there is one."""
    _, _, held = _nth_field(genes, rates.inputs, 1, -1)
    if held:
        slot, at, _ = _nth_field(genes, rates.inputs, 1, below(stream, 1, held))
        genes[slot, at : at + LINK_FIELDS] = 0


@routine
def crosses(crossover, stream):
    """Whether the offspring of this stream has two parents."""
    return _happens(crossover, substream(stream, CROSSOVER))


@routine
def offspring(first, second, rates, stream):
    """One offspring: crossover, point mutation, neuron added, deleted, link added, deleted (§5.1)."""
    genes = first.copy()
    purpose = substream(stream, CROSSOVER)
    if _happens(rates.crossover, purpose):
        cut = 1 + below(purpose, 1, genes.shape[0] - 1)
        for slot in range(cut, genes.shape[0]):  # as one slice it takes two seconds more to compile
            for column in range(genes.shape[1]):
                genes[slot, column] = second[slot, column]
    _mutate(genes, rates, substream(stream, MUTATION))
    purpose = substream(stream, ADD_NEURON)
    if _happens(rates.add_neuron, purpose):
        _add_neuron(genes, rates, purpose)
    purpose = substream(stream, DELETE_NEURON)
    if _happens(rates.delete_neuron, purpose):
        _delete_neuron(genes, rates, purpose)
    purpose = substream(stream, ADD_LINK)
    if _happens(rates.add_link, purpose):
        _add_link(genes, rates, purpose)
    purpose = substream(stream, DELETE_LINK)
    if _happens(rates.delete_link, purpose):
        _delete_link(genes, rates, purpose)
    return genes
