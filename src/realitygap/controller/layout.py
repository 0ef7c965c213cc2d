"""How a genotype is laid out: slots, and the fields of a slot (§5.2, §5.3).

A genotype is an int8 array [slots, 2 + 4·links]. Slots 0 .. inputs − 1 are the sensor neurons,
the next two the motor neurons (left, right), the others may each hold a hidden neuron.
What is not expressed carries no information: the operators keep it blank (zeros).
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields
from typing import Self

import numpy as np
from numpy.typing import NDArray

from realitygap.errors import GenotypeError, UsageError
from realitygap.kernels.params import MAX_DELAY
from realitygap.values import shown

__all__ = [
    "MAX_DELAY", "MAX_THRESHOLD", "MAX_WEIGHT", "Genes", "Layout", "bare", "check_genes", "check_layout",
    "genes_of", "links_of", "write_neuron",
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


@dataclass(frozen=True, kw_only=True)
class Layout:
    """The size of a genotype: 8 sensor neurons, 2 motors, 30 slots, 8 link fields a slot (§5.2)."""

    inputs: int = 8
    outputs: int = 2
    slots: int = 30
    links: int = 8

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if isinstance(value, bool) or not isinstance(value, int):
                raise UsageError(f"layout.{field.name}: expected a whole number, got {value!r}.")
        if self.inputs < 1:
            raise UsageError(f"layout.inputs: expected 1 or more, got {self.inputs}.")
        if self.outputs != 2:
            raise UsageError(f"layout.outputs: expected 2 (left and right wheel), got {self.outputs}.")
        least = self.inputs + self.outputs
        if not least <= self.slots <= 128:
            raise UsageError(
                f"layout.slots: expected {least} (inputs + outputs) to 128 (addresses are one byte), "
                f"got {self.slots}."
            )
        if not 1 <= self.links <= 128:
            raise UsageError(f"layout.links: expected 1 to 128 link fields a slot, got {self.links}.")

    @property
    def shape(self) -> tuple[int, int]:
        """Shape of a genotype: [slots, 2 + 4·links]."""
        return self.slots, FIRST_LINK + LINK_FIELDS * self.links

    @property
    def first_hidden(self) -> int:
        """The first slot that may hold a hidden neuron."""
        return self.inputs + self.outputs

    def role(self, slot: int) -> str:
        """What the neuron in a slot is, in words."""
        if slot < self.inputs:
            return f"sensor {slot}"
        return ("left motor", "right motor", "hidden")[min(slot - self.inputs, 2)]

    @classmethod
    def of(cls, genes: Genes, *, inputs: int | None = None) -> Self:
        """The layout of a genotype that has `inputs` sensor neurons; eight, unless they are given.

        Raises:
            GenotypeError: no genotype; or `inputs` is not given, and eight cannot be right.
        """
        if not isinstance(genes, np.ndarray) or genes.ndim != 2:
            raise GenotypeError(f"the genotype: expected an array int8[slots, fields], got {shown(genes)}")
        slots, columns = genes.shape
        if inputs is None:
            inputs = cls.inputs
            motors, others = np.split(genes[inputs:, THRESHOLD:], [cls.outputs])
            if others.any() and not motors.any():
                raise GenotypeError(
                    f"the genotype: expected one of {inputs} inputs, as no layout is given, got one whose "
                    f"slots {inputs} and {inputs + 1} are blank, which would be the motors. Give its layout."
                )
        return cls(inputs=inputs, slots=slots, links=(columns - FIRST_LINK) // LINK_FIELDS)


def bare(layout: Layout) -> Genes:
    """A genotype of sensor and motor neurons, thresholds 0 and no links."""
    genes: Genes = np.zeros(layout.shape, np.int8)
    genes[: layout.first_hidden, EXPRESSED] = 1
    return genes


def links_of(genes: Genes) -> Genes:
    """The link fields of a genotype, [slots, links, LINK_FIELDS]: the same memory."""
    return genes[:, FIRST_LINK:].reshape(len(genes), -1, LINK_FIELDS)


def write_neuron(genes: Genes, slot: int, threshold: int, links: Iterable[Iterable[int]]) -> None:
    """Put a neuron into a slot: its threshold, and its first links: source slot, weight and delay of each.

    Args:
        genes: of one genotype, changed in place.
        slot: its number.
        threshold: in the network's units.
        links: source slot, weight and delay of each.
    """
    genes[slot, EXPRESSED], genes[slot, THRESHOLD] = 1, threshold
    for k, link in enumerate(links):
        links_of(genes)[slot, k] = (1, *link)


def genes_of(
    inputs: int, thresholds: Iterable[int], links: Sequence[Sequence[Iterable[int]]]
) -> tuple[Genes, Layout]:
    """The smallest genotype of motor and hidden neurons, and its layout; links as of `write_neuron`."""
    layout = Layout(inputs=inputs, slots=inputs + len(links), links=max(1, *map(len, links)))
    genes = bare(layout)
    for slot, (threshold, into) in enumerate(zip(thresholds, links, strict=False), inputs):
        write_neuron(genes, slot, threshold, into)
    return genes, layout


def check_layout(layout: object) -> None:
    """Refuse what is not a layout.

    Raises:
        UsageError: says what came.
    """
    if not isinstance(layout, Layout):
        raise UsageError(f"layout: expected a Layout, got {shown(layout)}. Try study.layout(task).")


def check_genes(genes: Genes, layout: Layout, *, source: str = "the genotype") -> None:
    """Refuses a genotype that does not fit its layout or holds values out of range.

    Raises:
        GenotypeError: names the slot and the field.
    """
    check_layout(layout)
    if not isinstance(genes, np.ndarray) or genes.dtype != np.int8 or genes.shape != layout.shape:
        raise GenotypeError(f"{source}: expected an array int8{list(layout.shape)}, got {shown(genes)}")
    links = links_of(genes)
    for name, values, low, high in (
        ("an expressed flag", genes[:, EXPRESSED], 0, 1),
        ("a threshold", genes[:, THRESHOLD], -MAX_THRESHOLD, MAX_THRESHOLD),
        ("a link's expressed flag", links[:, :, 0], 0, 1),
        ("a link's source slot", links[:, :, SOURCE], 0, layout.slots - 1),
        ("a link's weight", links[:, :, WEIGHT], -MAX_WEIGHT, MAX_WEIGHT),
        ("a link's delay", links[:, :, DELAY], 0, MAX_DELAY),
    ):
        wrong = np.argwhere((values < low) | (values > high))
        if len(wrong):
            slot, value = int(wrong[0][0]), int(values[tuple(wrong[0])])
            raise GenotypeError(f"{source}: slot {slot}: {name}: expected {low} to {high}, got {value}.")
    missing = np.flatnonzero(genes[: layout.first_hidden, EXPRESSED] == 0)
    if len(missing):
        slot = int(missing[0])
        raise GenotypeError(f"{source}: slot {slot} ({layout.role(slot)}) must always be expressed.")
