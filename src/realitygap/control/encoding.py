"""What an encoding is: how genes of some type and shape stand for networks.

The paper's is `Variation` (slots, §5.2). A user's own has genes of any kind; its networks are those of the
paper (integers, §5.3), so that every one of them can also be written as a genotype of slots: which is what
pictures, texts and robots use.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from realitygap.control import slots
from realitygap.control.genotype import Genotype
from realitygap.control.slots import FIRST_LINK, LINK_FIELDS, Genes, Rates, decode, random_genes
from realitygap.errors import GenotypeError, UsageError
from realitygap.kernels.types import MAX_DELAY, Networks
from realitygap.plugins import blamed_on, made
from realitygap.values import as_count, as_stream, shown

__all__ = [
    "SLOTS", "Encoding", "Variation", "check_networks", "count_networks", "facts_of", "genotype_of",
    "links_into", "make_encoding",
]  # fmt: skip


SLOTS = "slots"
"""Name of the paper's encoding."""


class Encoding(Protocol):
    """Genes that stand for networks. An algorithm may ask more of it: `evolution.algorithm.Variation`."""

    @property
    def shape(self) -> tuple[int, ...]:
        """Of one genotype."""

    @property
    def dtype(self) -> np.dtype[Any]:
        """Of its values."""

    def random(self, stream: np.uint64) -> NDArray[Any]:
        """A random genotype; the same for the same stream."""

    def decode(self, genes: NDArray[Any]) -> Networks:
        """The networks of genotypes `[N, *shape]`, for the number of inputs that it was made with."""


@dataclass(frozen=True, kw_only=True)
class Variation:
    """The encoding by slots, with its operators: random genotypes, offspring of two parents, networks.

    Attributes:
        inputs, slots, links: the size of a genotype: sensors, neurons with them, links into each (§5.2).
        crossover: probability of one cut between two slots; else the first parent is copied (§5.1).
        mutation: probability that a piece of stored information (a threshold; a link's source, its
            weight, its delay) is drawn anew, uniformly over its values (§5.1).
        add_neuron: probability that a neuron is added (§5.1); likewise the next three.
        start_neurons: probability that a hidden slot of a random genotype holds a neuron.
        start_links: probability that a link field of a new neuron is expressed.
        sources: a link's source is drawn among the slots "expressed" at that moment, or among "all".
    """

    inputs: int = 8
    slots: int = 30
    links: int = 8
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
        as_count(self.inputs, "inputs", 1, 126)
        as_count(self.slots, "slots, those of inputs and motors among them", self.inputs + 2, 128)
        as_count(self.links, "links", 1, 128)
        if self.sources not in ("expressed", "all"):
            raise UsageError(f'variation.sources: expected "expressed" or "all", got {self.sources!r}.')
        for name in self._chances():
            value = getattr(self, name)
            if isinstance(value, bool) or not isinstance(value, (int, float)) or not 0 <= value <= 1:
                raise UsageError(f"variation.{name}: expected a probability, 0 to 1, got {value!r}.")

    def _chances(self) -> list[str]:
        return [name for name in Rates._fields if name not in ("inputs", "any_source")]

    @cached_property
    def rates(self) -> Rates:
        """What the compiled operators are told."""
        chances = {name: float(getattr(self, name)) for name in self._chances()}
        any_source = int(self.sources == "all")
        return Rates(inputs=self.inputs, any_source=any_source, **chances)

    @property
    def shape(self) -> tuple[int, int]:
        """Of a genotype: [slots, 2 + 4·links]."""
        return self.slots, FIRST_LINK + LINK_FIELDS * self.links

    @property
    def dtype(self) -> np.dtype[np.int8]:
        """Of its values."""
        return np.dtype(np.int8)

    def decode(self, genes: Genes) -> Networks:
        """The networks of genotypes [N, slots, 2 + 4·links]."""
        return decode(genes, self.inputs)

    def random(self, stream: np.uint64) -> Genes:
        """A random genotype [slots, 2 + 4·links]; the same for the same stream."""
        genes: Genes = random_genes(self.slots, self.links, self.rates, as_stream(stream))
        return genes

    def crosses(self, stream: np.uint64) -> bool:
        """Whether `offspring` of this stream takes from both parents."""
        return bool(slots.crosses(self.rates.crossover, as_stream(stream)))

    def offspring(self, first: Genes, second: Genes, stream: np.uint64) -> Genes:
        """A new genotype from two parents, which stay as they are.

        Raises:
            GenotypeError: a parent that is not an int8 array of the layout's shape.
        """
        for parent in (first, second):
            if type(parent) is not np.ndarray or (parent.dtype, parent.shape) != (self.dtype, self.shape):
                expected = f"an array int8{list(self.shape)}"
                raise GenotypeError(f"a parent: expected {expected}, got {shown(parent)}.")
        genes: Genes = slots.offspring(first, second, self.rates, as_stream(stream))
        return genes


def make_encoding(kind: str, variation: Variation, settings: dict[str, Any], *, inputs: int) -> Encoding:
    """The encoding of a name: "slots" or a user's `FILE.py:NAME`, made by `NAME(inputs=…, **settings)`.

    Args:
        kind: its name; a user's file is run.
        variation: the rates of the slots' operators.
        settings: slots and links of the slots; a user's own.
        inputs: of each network: as many as the task has sensors.

    Raises:
        UsageError: no such encoding or setting, or one whose random genotypes make no networks.
    """
    if kind == SLOTS:
        return replace(variation, inputs=inputs, **settings)
    ways = ("shape", "dtype", "random", "decode")
    own: Encoding = made(kind, "encoding", ways, settings, inputs=inputs)
    file, _, _ = kind.rpartition(":")
    with blamed_on(Path(file).expanduser().resolve(), UsageError):
        one = own.random(np.uint64(0))
        if type(one) is not np.ndarray or (one.dtype, one.shape) != (np.dtype(own.dtype), tuple(own.shape)):
            expected = f"an array {np.dtype(own.dtype)}{list(own.shape)}, its dtype and shape"
            raise UsageError(f"random: expected {expected}, got {shown(one)}.")
        networks = own.decode(np.stack([one, one]))
        if count_networks(networks, inputs) != 2:
            raise UsageError("decode: expected as many networks as genotypes.")
        check_networks(networks, inputs)
        genotype_of(own, one)  # it has room
    return own


KINDS = tuple(map(np.dtype, ("int64", "int64", "int16", "int16", "int64", "int16", "int16")))
"""Of the arrays of `Networks`."""


def count_networks(networks: Networks, inputs: int) -> int:
    """How many networks there are, each of so many inputs.

    Raises:
        UsageError: an array of another type or shape, or another number of inputs.
    """
    if not isinstance(networks, Networks):
        raise UsageError(
            f"networks: expected what `decode` makes of genotypes, got {shown(networks)}. "
            "study.networks(run.task, run.champion) makes them."
        )
    n, (_, m), (_, k, _) = len(networks.inputs), networks.thresholds.shape, networks.links.shape
    shapes = ((n,), (n,), (n, m), (n, k, 4), (n,), (n, k, 4), (n, m + 1))
    arrays: tuple[Any, ...] = networks
    if tuple(one.shape for one in arrays) != shapes or tuple(one.dtype for one in arrays) != KINDS:
        expected = ", ".join(f"{kind}{list(shape)}" for kind, shape in zip(KINDS, shapes, strict=True))
        raise UsageError(f"networks: expected {expected}, got {', '.join(map(shown, arrays))}.")
    if others := set(networks.inputs.tolist()) - {inputs}:
        got = min(others)
        raise UsageError(f"networks: inputs: expected networks of the task's {inputs}, got one of {got}.")
    return n


def check_networks(networks: Networks, inputs: int) -> None:
    """Refuse a user's networks with a link out of range, which would lead compiled code out of its arrays.

    Raises:
        UsageError: also as of `count_networks`.
    """
    count_networks(networks, inputs)
    m, k = networks.thresholds.shape[1], networks.links.shape[1]
    last, sensed, links = networks.neurons, networks.sensor_links, networks.links
    limits = (
        (last, 2, m + 1), (networks.sensor_count, 0, k + 1), (networks.link_start, 0, k + 1),
        (sensed[:, :, 0], 0, last[:, None]), (sensed[:, :, 1], 0, inputs),
        (sensed[:, :, 3], 0, MAX_DELAY + 1),
        (links[:, :, :2], 0, last[:, None, None]), (links[:, :, 3], 0, MAX_DELAY + 1),
    )  # fmt: skip
    if not all(((low <= numbers) & (numbers < high)).all() for numbers, low, high in limits):
        raise UsageError("networks: expected links between their own neurons. Make them with `decode`.")


def facts_of(encoding: Encoding, settings: dict[str, Any]) -> dict[str, Any]:
    """What is kept with genotypes, ready for JSON: their type (with byte order) and shape."""
    kind = np.dtype(encoding.dtype).newbyteorder("<").str
    return {"dtype": kind, "shape": [int(size) for size in encoding.shape], **settings}


def genotype_of(encoding: Encoding, genes: NDArray[Any]) -> Genotype:
    """Genes as a genotype of slots with the same network.

    Raises:
        GenotypeError: more neurons than a genotype has room for, or a number that networks do not have.
    """
    if isinstance(encoding, Variation):
        return Genotype(genes, encoding.inputs)
    nets = encoding.decode(genes[np.newaxis])
    into = links_into(nets)
    return Genotype.written(int(nets.inputs[0]), zip(nets.thresholds[0].tolist(), into, strict=False))


def links_into(nets: Networks) -> list[list[tuple[int, int, int]]]:
    """Of each neuron of a batch's first network its links: the source's slot, weight, delay."""
    inputs, neurons = int(nets.inputs[0]), int(nets.neurons[0])
    into: list[list[tuple[int, int, int]]] = [[] for _ in range(neurons)]
    for target, source, weight, delay in nets.sensor_links[0, : nets.sensor_count[0]].tolist():
        into[target].append((source, weight, delay))
    for target, source, weight, delay in nets.links[0, : nets.link_start[0, neurons]].tolist():
        into[target].append((inputs + source, weight, delay))
    return into
