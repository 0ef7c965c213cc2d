"""Networks (§5.3): decoded from genotypes, as controllers of robots, and controllers of one's own."""

from collections import deque
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from realitygap.compiled import kernel, routine, step
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
    check_genes,
    check_layout,
    controller_genes,
    links_of,
)
from realitygap.errors import GenotypeError, UsageError
from realitygap.kernels.network import first_unfit
from realitygap.kernels.params import UPDATES, Networks
from realitygap.lazy import above
from realitygap.plugins import blamed_on, named_object
from realitygap.values import Command, shown

__all__ = [
    "Link", "NetworkController", "Neuron", "OwnController", "as_controller", "check_networks", "decode",
    "dense_networks", "first_fault", "named_controller", "neurons", "own_controller",
]  # fmt: skip


# mypy: allow-untyped-defs, no-check-untyped-defs


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


class OwnController:
    """What drives a body as `decide(inputs) → (left, right)` says: whole numbers −10 … 10 in and out.

    Args:
        decide: the user's.
        reset: called before each trial.
        place: its file or module; an error in it names the line there.
    """

    def __init__(
        self, decide: Callable[..., Any], reset: Callable[[], Any] | None = None, place: str = "controller"
    ) -> None:
        self._decide, self._reset, self._place = decide, reset, place

    def reset(self) -> None:
        """Before a trial."""
        if self._reset is not None:
            with blamed_on(self._place, UsageError, "reset fails"):
                self._reset()

    def decide(self, inputs: Sequence[int]) -> Command:
        """One step.

        Raises:
            UsageError: it fails, or does not return two whole numbers −10 … 10.
        """
        with blamed_on(self._place, UsageError, "decide fails"):
            given = self._decide(list(inputs))
        pair = (given.left, given.right) if isinstance(given, Command) else given
        try:
            left, right = (int(value) for value in pair)
            whole = (left, right) == tuple(pair) and max(abs(left), abs(right)) <= TOP
            whole = whole and not isinstance(pair, set | frozenset | dict)
            whole = whole and not any(isinstance(value, bool | np.bool_) for value in pair)
        except (TypeError, ValueError, OverflowError):
            whole = False
        if not whole:
            expected = f"(left, right), whole numbers from -{TOP} to {TOP}"
            raise UsageError(f"{self._place}: decide: expected {expected}, got {given!r}.")
        return Command(left=left, right=right)


def own_controller(named: object) -> OwnController:
    """A controller of `file.py:name`, of a function decide(inputs), or of an object that has `decide`.

    A class is called without arguments.

    Raises:
        UsageError: no such file or name, or nothing that decides.
    """
    place = "controller"
    if isinstance(named, str):
        text, place = named, named.rpartition(":")[0]
        place = str(Path(place).expanduser().resolve()) if place.endswith(".py") else place
        named = named_object(text, UsageError, "controller")
    if isinstance(named, type):
        with blamed_on(place, UsageError, f"{named.__name__}() fails"):
            named = named()
    decide = getattr(named, "decide", named)
    if not callable(decide):
        expected = "a function decide(inputs), or a class that has one"
        raise UsageError(f"controller: expected {expected}, got {shown(named)}.")
    if place == "controller":
        place = getattr(getattr(decide, "__code__", None), "co_filename", place)
    return OwnController(decide, getattr(named, "reset", None), place)


def as_controller(given: Any) -> Any:
    """One of this package as it is; else as of `own_controller`, whose commands are checked."""
    ready = hasattr(given, "reset") and type(given).__module__.startswith("realitygap.")
    return given if ready else own_controller(given)


def named_controller(spec: str, feeds: str, layout: Layout) -> OwnController | NetworkController:
    """The controller that a person names: `file.py:name`, or as of `controller_genes`.

    Raises:
        UsageError: it is none of these; says why.
    """
    place, _, name = spec.rpartition(":")
    if place and name.isidentifier() and place != "constant":
        return own_controller(spec)
    genes = controller_genes(spec, feeds, layout)
    return NetworkController(genes, Layout.of(genes, inputs=layout.inputs))
