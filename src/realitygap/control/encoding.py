"""What an encoding is: how genes of some type and shape stand for networks.

The paper's is `controller.operators.Variation` (slots, §5.2). A user's own has genes of any kind;
its networks are those of the paper (integers, §5.3), so that every one of them can also be written as a
genotype of slots: which is what pictures, texts and robots use.
"""

from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from realitygap.control.genotype import Genes, Layout, genes_of
from realitygap.control.network import NetworkController, check_networks
from realitygap.control.operators import Variation
from realitygap.errors import UsageError
from realitygap.kernels.params import Networks
from realitygap.plugins import blamed_on, made
from realitygap.values import shown

__all__ = ["SLOTS", "Encoding", "as_slots", "controller_of", "facts_of", "links_into", "make_encoding"]


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
        return variation.sized(Layout(inputs=inputs, **settings))
    ways = ("shape", "dtype", "random", "decode")
    own: Encoding = made(kind, "encoding", ways, settings, inputs=inputs)
    file, _, _ = kind.rpartition(":")
    with blamed_on(Path(file).expanduser().resolve(), UsageError):
        _check(own, inputs)
        one = own.random(np.uint64(0))
        as_slots(own, one)  # it has room
    return own


def _check(own: Encoding, inputs: int) -> None:
    """Refuse what does not do as `Encoding` says with random genotypes."""
    shape = own.shape
    if not isinstance(shape, tuple):
        raise UsageError(f"shape: expected a tuple of whole numbers, such as (40,), got {shape!r}.")
    one, again, other = (own.random(np.uint64(stream)) for stream in (0, 0, 1))
    if not isinstance(one, np.ndarray) or (one.dtype, one.shape) != (np.dtype(own.dtype), shape):
        expected = f"{np.dtype(own.dtype)}{list(shape)}, its dtype and shape"
        raise UsageError(f"random: expected an array {expected}, got {shown(one)}.")
    if one.tobytes() != again.tobytes():
        raise UsageError(
            "random: expected the same genotype from the same stream. Draw it from the stream alone."
        )
    batches = ([one, one], [one, one], [one, other])
    nets, twice, mixed = (own.decode(np.stack(genes)) for genes in batches)
    if any(check_networks(each, inputs) != 2 for each in (nets, twice, mixed)):
        raise UsageError("decode: expected as many networks as genotypes.")
    once, later = ([np.asarray(array).tolist() for array in each] for each in (nets, twice))
    if once != later or any(first != second for first, second in once):
        raise UsageError("decode: expected the same network from the same genes each time, got others.")
    if _first(nets) != _first(mixed):
        raise UsageError("decode: expected a network that does not depend on the other genes.")


def _first(nets: Networks) -> Any:
    """The first network of a batch, however wide the arrays are."""
    into = links_into(nets)
    return into, nets.thresholds[0, : len(into)].tolist()


def facts_of(encoding: Encoding, settings: dict[str, Any]) -> dict[str, Any]:
    """What is kept with genotypes, ready for JSON: their type (with byte order) and shape."""
    kind = np.dtype(encoding.dtype).newbyteorder("<").str
    return {"dtype": kind, "shape": [int(size) for size in encoding.shape], **settings}


def as_slots(encoding: Encoding, genes: NDArray[Any]) -> tuple[Genes, Layout]:
    """A genotype as one of slots with the same network, and the layout of that."""
    if isinstance(encoding, Variation):
        return genes, encoding.layout
    nets = encoding.decode(genes[np.newaxis])
    inputs, into = int(nets.inputs[0]), links_into(nets)
    return genes_of(inputs, nets.thresholds[0, : len(into)], into)


def links_into(nets: Networks) -> list[list[tuple[int, int, int]]]:
    """Of each neuron of a batch's first network its links: the source's slot, weight, delay."""
    inputs, neurons = int(nets.inputs[0]), int(nets.neurons[0])
    into: list[list[tuple[int, int, int]]] = [[] for _ in range(neurons)]
    for target, source, weight, delay in nets.sensor_links[0, : nets.sensor_count[0]].tolist():
        into[target].append((source, weight, delay))
    for target, source, weight, delay in nets.links[0, : nets.link_start[0, neurons]].tolist():
        into[target].append((inputs + source, weight, delay))
    return into


def controller_of(encoding: Encoding, genes: NDArray[Any]) -> NetworkController:
    """What drives a body as a genotype's network does."""
    return NetworkController(*as_slots(encoding, genes))
