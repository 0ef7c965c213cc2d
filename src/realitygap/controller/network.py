"""Genotype → network (§5.2, §5.3): for the kernels as dense arrays, for bodies as a controller.

A neuron's output is clip(Σ weight · output of the source, delay + 1 updates ago − threshold,
−10, 10); all neurons are updated together, ten times a step, from the updates before.
"""

from collections import deque
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from realitygap.controller.decoding import dense_networks, first_fault
from realitygap.controller.layout import (
    EXPRESSED,
    MAX_DELAY,
    MAX_THRESHOLD,
    MAX_WEIGHT,
    THRESHOLD,
    Genes,
    Layout,
    check_genes,
    check_layout,
    links_of,
)
from realitygap.errors import GenotypeError, UsageError
from realitygap.kernels.network import first_unfit
from realitygap.kernels.params import UPDATES, Networks
from realitygap.lazy import above
from realitygap.values import Command, shown

__all__ = ["Link", "NetworkController", "Neuron", "check_networks", "decode", "neurons"]

TOP = 10
"""Outputs are −10 .. 10 (§5.3)."""
RANKS = [1, 1, 2, 3, 1, 3, 2]
KINDS = tuple(map(np.dtype, ("int64", "int64", "int16", "int16", "int64", "int16", "int16")))
"""Dimensions and type of each array of `Networks`."""


class Link(NamedTuple):
    """A live link: from the neuron in slot `source`; delay in updates."""

    field: int
    source: int
    weight: int
    delay: int


class Neuron(NamedTuple):
    """A motor or hidden neuron and the live links into it."""

    slot: int
    threshold: int
    links: tuple[Link, ...]


def decode(genes: Genes, layout: Layout, *, prune: bool = True) -> Networks:
    """The networks of genotypes [N, slots, fields] (or of one, [slots, fields]).

    Args:
        genes: int8 genotypes of the layout's shape.
        layout: theirs; how many of the slots are sensors cannot be seen in an array.
        prune: leave out what can never change an output: links of weight 0, and hidden neurons
            from which no motor can be reached.

    Raises:
        GenotypeError: an array of another type or shape, or a value out of its range.
    """
    check_layout(layout)
    if isinstance(genes, np.ndarray) and genes.ndim == 2:
        genes = genes[np.newaxis]
    if not isinstance(genes, np.ndarray) or genes.dtype != np.int8 or genes.shape[1:] != layout.shape:
        expected = f"int8[N, {layout.shape[0]}, {layout.shape[1]}]"
        raise GenotypeError(f"genotypes: expected an array {expected}, got {shown(genes)}.")
    genes = np.ascontiguousarray(genes)
    fault = first_fault(genes, layout.inputs)
    if fault >= 0:
        check_genes(genes[fault], layout, source=f"genotype {fault}")
    networks: Networks = dense_networks(genes, layout.inputs, bool(prune))
    return networks


def check_networks(networks: Networks, inputs: int) -> int:
    """Refuse networks that the kernels cannot run on a number of inputs; return how many there are.

    Raises:
        UsageError: another number of inputs, an array of another type or shape, or a link out of range.
    """
    if not isinstance(networks, Networks) or [getattr(a, "ndim", 0) for a in networks] != RANKS:
        raise UsageError(f"networks: expected what `decode` makes of genotypes, got {shown(networks)}.")
    n, m, k = len(networks.neurons), networks.thresholds.shape[1], networks.links.shape[1]
    shapes = ((n,), (n,), (n, m), (n, k, 4), (n,), (n, k, 4), (n, m + 1))
    arrays: tuple[Any, ...] = networks
    for name, array, kind, shape in zip(Networks._fields, arrays, KINDS, shapes, strict=True):
        if not (array.dtype == kind and array.shape == shape and array.flags.c_contiguous):
            expected = f"a contiguous array {kind}{list(shape)}"
            raise UsageError(f"networks.{name}: expected {expected}, got {shown(array)}.")
    fault, what = first_unfit(networks, inputs, MAX_WEIGHT, MAX_THRESHOLD)
    if fault >= 0:
        made = f"inputs: expected networks of the task's {inputs}, got one of {networks.inputs[fault]}"
        wrong = made if what == 0 else f"links and neurons of network {fault} are out of range"
        raise UsageError(f"networks: {wrong}. Make them with `decode`, from genotypes of the task's layout.")
    return n


def neurons(genes: Genes, layout: Layout) -> tuple[Neuron, ...]:
    """The motor and hidden neurons of one genotype with their live links, in the order of slots."""
    expressed, links = genes[:, EXPRESSED].tolist(), links_of(genes).tolist()
    found = []
    for slot in range(layout.inputs, len(expressed)):
        if expressed[slot]:
            fields = [Link(k, *link) for k, (held, *link) in enumerate(links[slot]) if held]
            live = tuple(link for link in fields if expressed[link.source])
            found.append(Neuron(slot, int(genes[slot, THRESHOLD]), live))
    return tuple(found)


class NetworkController:
    """A genotype's network that drives any body: inputs −10 .. 10 in, wheel commands out.

    Plain integers, a step at a time; the kernels compute the same law for whole trials.
    """

    def __init__(self, genes: Genes, layout: Layout | None = None) -> None:
        self.layout = Layout.of(genes) if layout is None else layout
        check_genes(genes, self.layout)
        self.genes = genes.copy()
        self.neurons = neurons(genes, self.layout)
        self.reset()

    def _repr_html_(self) -> str:
        return str(above("report.notebook").network_html(self))

    def reset(self) -> None:
        """Before a trial: every value ever is 0."""
        silent = [0] * self.layout.slots
        self._past: deque[list[int]] = deque([silent] * (MAX_DELAY + 1), maxlen=MAX_DELAY + 1)

    @property
    def outputs(self) -> tuple[int, ...]:
        """What each slot's neuron puts out now, 0 where there is none."""
        return tuple(self._past[0])

    def decide(self, inputs: Sequence[int]) -> Command:
        """One step of 100 ms: ten updates with the inputs held, then the motors' outputs.

        Raises:
            UsageError: another number of inputs than the network has sensor neurons, or one beyond ±10.
        """
        try:
            held = [int(value) for value in inputs if -TOP <= value <= TOP and value == int(value)]
            wrong = len(held) < len(inputs)
        except TypeError:
            wrong = True
        if wrong:
            raise UsageError(f"inputs: expected whole numbers from -{TOP} to {TOP}, got {inputs!r}.")
        if len(held) != self.layout.inputs:
            raise UsageError(f"inputs: expected the {self.layout.inputs} of this network, got {len(held)}.")
        self._past[0] = held + self._past[0][len(held) :]
        empty = held + [0] * (self.layout.slots - len(held))
        for _ in range(UPDATES):
            now, past = empty.copy(), list(self._past)
            for slot, threshold, links in self.neurons:
                total = -threshold
                for _, source, weight, delay in links:
                    total += weight * past[delay][source]
                now[slot] = max(-TOP, min(TOP, total))
            self._past.appendleft(now)
            if past.count(now) == len(past):
                break  # settled: every further update is the same
        left, right = self._past[0][len(held) : len(held) + 2]
        return Command(left=left, right=right)
