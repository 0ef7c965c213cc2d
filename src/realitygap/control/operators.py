"""The genetic operators (§5.2)."""

from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import Literal, NamedTuple, Self

import numpy as np

from realitygap.compiled import routine, step
from realitygap.control import operators as breeding
from realitygap.control.genotype import (
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
    Genes,
    Layout,
    check_layout,
)
from realitygap.control.network import decode
from realitygap.errors import GenotypeError, UsageError
from realitygap.kernels.params import Networks
from realitygap.kernels.rng import below, substream, uniform
from realitygap.streams import (
    ADD_LINK,
    ADD_NEURON,
    CROSSOVER,
    DELETE_LINK,
    DELETE_NEURON,
    MUTATION,
    START,
)
from realitygap.values import as_stream, shown

__all__ = ["Rates", "Variation", "crosses", "offspring", "random_genes", "random_genotype"]


# mypy: allow-untyped-defs, no-check-untyped-defs


class Rates(NamedTuple):
    """What the operators are told; probabilities, except for the first two."""

    inputs: int
    any_source: int
    """1: a link's source is drawn among all slots; 0: among those expressed at that moment."""
    crossover: float
    mutation: float
    add_neuron: float
    delete_neuron: float
    add_link: float
    delete_link: float
    start_neurons: float
    start_links: float


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
    """A random genotype of slots, and links in each: first which slots hold a neuron, then what each is.

    Args:
        slots: how many neurons there is room for.
        links: how many each has room for.
        rates: how many inputs there are, and how likely neurons and links are.
        stream: random numbers.
    """
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
    """One offspring: crossover, point mutation, neuron added, deleted, link added, deleted (§5.1).

    Args:
        first, second: parents, int8 [slots, fields].
        rates: of every operator.
        stream: random numbers.
    """
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


@dataclass(frozen=True, kw_only=True)
class Variation:
    """The encoding by slots, with its operators: random genotypes, offspring of two parents, networks.

    Attributes:
        layout: the size of a genotype.
        crossover: probability of one cut between two slots; else the first parent is copied (§5.1).
        mutation: probability that a piece of stored information (a threshold; a link's source, its
            weight, its delay) is drawn anew, uniformly over its values (§5.1).
        add_neuron: probability that a neuron is added (§5.1); likewise the next three.
        start_neurons: probability that a hidden slot of a random genotype holds a neuron.
        start_links: probability that a link field of a new neuron is expressed.
        sources: a link's source is drawn among the slots "expressed" at that moment, or among "all".
    """

    layout: Layout = field(default_factory=Layout)
    crossover: float = 0.8
    mutation: float = 0.05
    add_neuron: float = 0.05
    delete_neuron: float = 0.05
    add_link: float = 0.1
    delete_link: float = 0.1
    start_neurons: float = 0.05
    start_links: float = 0.5
    sources: Literal["expressed", "all"] = "expressed"

    def __post_init__(self) -> None:
        check_layout(self.layout)
        if self.sources not in ("expressed", "all"):
            raise UsageError(f'variation.sources: expected "expressed" or "all", got {self.sources!r}.')
        for name in self._chances():
            value = getattr(self, name)
            if isinstance(value, bool) or not isinstance(value, (int, float)) or not 0 <= value <= 1:
                raise UsageError(f"variation.{name}: expected a probability, 0 to 1, got {value!r}.")

    def _chances(self) -> list[str]:
        return [f.name for f in fields(self) if f.name in breeding.Rates._fields]

    @cached_property
    def rates(self) -> breeding.Rates:
        """What the compiled operators are told."""
        chances = {name: float(getattr(self, name)) for name in self._chances()}
        any_source = int(self.sources == "all")
        return breeding.Rates(inputs=self.layout.inputs, any_source=any_source, **chances)

    @property
    def shape(self) -> tuple[int, int]:
        """Of a genotype: [slots, 2 + 4·links]."""
        return self.layout.shape

    @property
    def dtype(self) -> np.dtype[np.int8]:
        """Of its values."""
        return np.dtype(np.int8)

    def sized(self, layout: Layout) -> Self:
        """The same rates for genotypes of another size."""
        return replace(self, layout=layout)

    def decode(self, genes: Genes) -> Networks:
        """The networks of genotypes [N, slots, 2 + 4·links]."""
        return decode(genes, self.layout)

    def random(self, stream: np.uint64) -> Genes:
        """A random genotype [slots, 2 + 4·links]; the same for the same stream."""
        layout = self.layout
        genes: Genes = breeding.random_genes(layout.slots, layout.links, self.rates, as_stream(stream))
        return genes

    def crosses(self, stream: np.uint64) -> bool:
        """Whether `offspring` of this stream takes from both parents."""
        return bool(breeding.crosses(self.rates.crossover, as_stream(stream)))

    def offspring(self, first: Genes, second: Genes, stream: np.uint64) -> Genes:
        """A new genotype from two parents, which stay as they are.

        Raises:
            GenotypeError: a parent that is not an int8 array of the layout's shape.
        """
        for parent in (first, second):
            fits = isinstance(parent, np.ndarray) and parent.dtype == np.int8
            if not fits or parent.shape != self.layout.shape:
                expected = f"an array int8{list(self.layout.shape)}"
                raise GenotypeError(f"a parent: expected {expected}, got {shown(parent)}.")
        genes: Genes = breeding.offspring(first, second, self.rates, as_stream(stream))
        return genes


def random_genotype(layout: Layout, stream: np.uint64, **rates: float) -> Genes:
    """A random genotype; `rates` are `start_neurons` and `start_links` of `Variation`."""
    return Variation(layout=layout, **rates).random(stream)  # type: ignore[arg-type]
