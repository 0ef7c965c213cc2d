"""The paper's encoding (§5.2): how genotypes of slots begin and change (§5.1) and what they stand for."""

from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import Literal, Self

import numpy as np

from realitygap.controller import breeding
from realitygap.controller.layout import Genes, Layout, check_layout
from realitygap.controller.network import decode
from realitygap.errors import GenotypeError, UsageError
from realitygap.kernels.params import Networks
from realitygap.values import as_stream, shown

__all__ = ["Variation"]


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
