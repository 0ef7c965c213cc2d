"""A genotype of slots (§5.2) as a value: its text, networks written by hand, and what drives robots by it."""

import re
from collections import deque
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple, Self

import numpy as np

from realitygap import lazy
from realitygap.control.slots import (
    EXPRESSED,
    LINK,
    MAX_THRESHOLD,
    MAX_WEIGHT,
    THRESHOLD,
    Genes,
    Rates,
    bounds,
    decode,
    links_of,
    random_genes,
    refuse_wrong,
)
from realitygap.errors import GenotypeError, UsageError
from realitygap.files import as_path, atomic_write, read_text, read_toml, refuse_unknown
from realitygap.kernels.network import LIMIT
from realitygap.kernels.types import MAX_DELAY, UPDATES, Networks
from realitygap.values import Command, as_count, as_stream

__all__ = ["Genotype", "Link", "NetworkController", "Neuron"]

SLOTS, LINKS = 30, 8
"""Slots of a genotype, and link fields of each, unless it says otherwise."""
HEADER = "realitygap genotype 1"
LINES = {
    "layout": "layout inputs N outputs 2 slots N links N",
    "slot": "slot N [off] threshold N",
    "link": "link N [off] from N weight N delay N",
}
"""Of the text form."""
FORMS = {
    kind: (re.compile(form.replace(" [off]", "( off)?").replace("N", r"(-?\d{1,9})")), form)
    for kind, form in LINES.items()
}
FIELDS = {
    "slot": ("off only beyond the motors:", "a threshold of"),
    "link": tuple(map("a {} of".format, LINK)),
}
MOTORS = ("left", "right")

VEHICLES = {
    "proximity": ((2, (0, 1, 1, -2, -1, 0, 0, 0)), (-8, (0, -1, -2, 2, 1, 0, 0, 0))),
    "ambient": ((0, (-1, -1, 1, 1, 1, 1, 0, 0)), (-8, (1, 1, 0, 0, -1, -1, 0, 0))),
}
"""Of the left and the right motor: a threshold, and the weight of each of the eight sensors.

A motor's speed is Σ weight · input − threshold. In the open all inputs are −10 and both avoiding motors run
at 8. A sensor that feels a wall drives its own side's wheel and brakes the other one. Walls on both sides
brake the left wheel only, so that a robot head-on to a wall turns left and never stands.

A sensor lit by the lamp (9, by reflections about 1) brakes its own side's wheel and drives the other one. The
left wheel lives on the light in front: where it is dark, the robot turns left.
"""


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


@dataclass(frozen=True, eq=False)
class Genotype:
    """A genotype of slots: sensor neurons, two motors, hidden neurons; what is not expressed stays in it.

    Attributes:
        genes: int8[slots, 2 + 4 · links] as in `slots`; a copy that cannot be changed.
        inputs: how many slots are sensors.

    Raises:
        GenotypeError: an array of another type or shape, or a value out of its range.
    """

    genes: Genes
    inputs: int

    def __post_init__(self) -> None:
        genes = np.array(self.genes)
        refuse_wrong(genes[np.newaxis], self.inputs)
        genes.setflags(write=False)
        object.__setattr__(self, "genes", genes)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Genotype):
            return NotImplemented
        return self.inputs == other.inputs and np.array_equal(self.genes, other.genes)

    __hash__ = None  # type: ignore[assignment]

    def __str__(self) -> str:
        """The text form."""
        return "\n".join([HEADER, *self._lines(), "end", ""])

    def _repr_html_(self) -> str:
        return str(lazy.notebook().network_html(self))

    @property
    def slots(self) -> int:
        """How many neurons there is room for, the sensors' included."""
        return len(self.genes)

    @property
    def links(self) -> int:
        """How many links into each there is room for."""
        return int(links_of(self.genes).shape[1])

    def role(self, slot: int) -> str:
        """What the neuron in a slot is, in words."""
        if slot < self.inputs:
            return f"sensor {slot}"
        return ("left motor", "right motor", "hidden")[min(slot - self.inputs, 2)]

    @cached_property
    def neurons(self) -> tuple[Neuron, ...]:
        """The motor and hidden neurons with their live links, in the order of slots."""
        expressed, links = self.genes[:, EXPRESSED].tolist(), links_of(self.genes).tolist()
        found = []
        for slot in range(self.inputs, len(expressed)):
            if expressed[slot]:
                fields = [Link(k, *link) for k, (held, *link) in enumerate(links[slot]) if held]
                live = tuple(link for link in fields if expressed[link.source])
                found.append(Neuron(slot, int(self.genes[slot, THRESHOLD]), live))
        return tuple(found)

    def networks(self, *, prune: bool = True) -> Networks:
        """Its network, for a simulation; `prune` as of `decode`."""
        return decode(self.genes, self.inputs, prune=prune)

    def controller(self) -> "NetworkController":
        """What drives any body as its network does."""
        return NetworkController(self)

    decode = staticmethod(decode)
    """The networks of many genotypes at once."""

    @classmethod
    def random(
        cls,
        stream: int | np.uint64,
        *,
        inputs: int = 8,
        slots: int = SLOTS,
        links: int = LINKS,
        start_neurons: float = 0.05,
        start_links: float = 0.5,
    ) -> Self:
        """A random genotype; the same for the same stream.

        Args:
            stream: 0 to 2⁶⁴ − 1.
            inputs, slots, links: its size.
            start_neurons: probability that a hidden slot holds a neuron; start_links: that a link field of a
                neuron is expressed.
        """
        rates = Rates(inputs=inputs, start_neurons=float(start_neurons), start_links=float(start_links))
        return cls(random_genes(slots, links, rates, as_stream(stream)), inputs)

    @classmethod
    def written(
        cls,
        inputs: int,
        neurons: Iterable[tuple[int, Sequence[tuple[int, int, int]]]],
        slots: int = 0,
        links: int = 1,
    ) -> Self:
        """A genotype of neurons, the two motors first.

        Args:
            inputs: how many sensors there are.
            neurons: threshold of each, and source slot, weight and delay of the links into it.
            slots, links: its size; more where the neurons need it.
        """
        listed = list(neurons)
        slots = max(slots, inputs + len(listed))
        links = max(links, *(len(into) for _, into in listed))
        genes = np.zeros((slots, 2 + 4 * links), np.int8)
        genes[: inputs + len(listed), EXPRESSED] = 1
        for slot, (threshold, into) in enumerate(listed, inputs):
            genes[slot, THRESHOLD] = threshold
            for k, link in enumerate(into):
                links_of(genes)[slot, k] = (1, *link)
        return cls(genes, inputs)

    @classmethod
    def constant(cls, left: int, right: int, inputs: int = 8) -> Self:
        """No links: the same wheel commands (−10 to 10) at every step.

        Raises:
            UsageError: a command that is not a whole number from −10 to 10.
        """
        motors = [
            (-as_count(value, f"the {name} command of a constant controller", -LIMIT, LIMIT), ())
            for name, value in (("left", left), ("right", right))
        ]
        return cls.written(inputs, motors, max(SLOTS, inputs + 2), LINKS)

    @classmethod
    def braitenberg(cls, feeds: str) -> Self:
        """A vehicle of eight sensors that avoids obstacles ("proximity") or seeks light ("ambient").

        Raises:
            UsageError: other feeds.
        """
        if feeds not in VEHICLES:
            expected = " or ".join(f'"{one}"' for one in VEHICLES)
            raise UsageError(f"a Braitenberg controller: feeds: expected {expected}, got {feeds!r}.")
        return cls.written(8, (
            (threshold, [(source, weight, 0) for source, weight in enumerate(weights) if weight])
            for threshold, weights in VEHICLES[feeds]
        ), SLOTS, LINKS)  # fmt: skip

    @classmethod
    def load(cls, path: str | Path, inputs: int | None = None) -> Self:
        """The genotype in a file: of its text form, or of a network written by hand (.toml).

        Args:
            path: the file.
            inputs: how many the task has; a text may have others only if this is None. A network written by
                hand has 8 unless it says otherwise.

        Raises:
            GenotypeError: names the file, the line or the key, what was expected and what came.
        """
        path = as_path(path, "genotype")
        if path.suffix == ".toml":
            table = read_toml(path, GenotypeError, "Give the path of a network's TOML file.")
            try:
                return cls._of_table(table, inputs)
            except UsageError as error:
                raise GenotypeError(f"{path}: {error}") from None
        made = cls.parse(read_text(path, GenotypeError, "Give the path of a genotype's file."), str(path))
        if inputs not in (None, made.inputs):
            raise GenotypeError(f"{path}: expected a genotype of {inputs} inputs, got {made.inputs}")
        return made

    def save(self, path: str | Path) -> None:
        """Write the text form into a file."""
        atomic_write(path, str(self))

    def _lines(self) -> Iterator[str]:
        yield f"layout inputs {self.inputs} outputs 2 slots {self.slots} links {self.links}"
        yield ""
        for slot, row in enumerate(self.genes):
            held, sensor = bool(row[EXPRESSED]), slot < self.inputs
            if not row[THRESHOLD:].any() and (sensor or not held):
                continue
            yield f"slot {slot}{'' if held else ' off'} threshold {row[THRESHOLD]}  # {self.role(slot)}"
            for k, (on, source, weight, delay) in enumerate(links_of(self.genes)[slot].tolist()):
                if on or source or weight or delay:
                    dormant = held and not sensor and on and not self.genes[source, EXPRESSED]
                    link = f"  link {k}{'' if on else ' off'} from {source} weight {weight} delay {delay}"
                    yield link + ("  # dormant" if dormant else "")

    @classmethod
    def parse(cls, text: str, source: str = "genotype") -> Self:
        """The genotype of a text form; `source` names the text in errors.

        Raises:
            GenotypeError: names the line, what was expected there and what came.
        """
        stripped = (" ".join(line.split("#", 1)[0].split()) for line in text.splitlines())
        lines = [(number, line) for number, line in enumerate(stripped, 1) if line]
        if len(lines) < 3 or lines[0][1] != HEADER or lines[-1][1] != "end":
            raise GenotypeError(f'{source}: expected lines from "{HEADER}" to "end", got others.')
        genes, inputs, slot, seen = np.zeros((0, 6), np.int8), 0, -1, set[tuple[int, int]]()
        for number, line in lines[1:-1]:
            kind = "layout" if not inputs else "link" if slot >= 0 and line.startswith("link") else "slot"
            pattern, form = FORMS[kind]
            match, told = pattern.fullmatch(line), f"{source}, line {number}: expected"
            if match is None:
                raise GenotypeError(f'{told} "{form}", got "{line:.80}".')
            if kind == "layout":
                inputs, size, links = map(int, match.groups())
                if not (inputs and links and inputs + 2 <= size <= 128):
                    raise GenotypeError(f"{told} inputs, links, and inputs + 2 to 128 slots, got {line!r}.")
                genes = np.zeros((size, 2 + 4 * links), np.int8)
                genes[: inputs + 2, EXPRESSED] = 1
                low, high = bounds(inputs, size, links)
                continue
            count = size if kind == "slot" else links
            at, off, values = int(match[1]), match[2], [*map(int, match.groups()[2:])]
            owner, slot = (-1, at) if kind == "slot" else (slot, slot)
            if at >= count or (owner, at) in seen:
                raise GenotypeError(f"{told} a {kind} of 0 to {count - 1}, and each once, got {line!r}.")
            seen.add((owner, at))
            place = (at, slice(0, 2)) if kind == "slot" else (slot, slice(2 + 4 * at, 6 + 4 * at))
            for name, value, least, most in zip(
                FIELDS[kind], (not off, *values), low[place], high[place], strict=True
            ):
                if not least <= value <= most:
                    raise GenotypeError(f"{told} {name} {least} to {most}, got {line!r}.")
            genes[place] = not off, *values
        return cls(genes, inputs)

    @classmethod
    def _of_table(cls, table: Mapping[str, Any], inputs: int | None) -> Self:
        """A network written by hand, for a task with so many inputs."""
        refuse_unknown(table, ("inputs", *MOTORS, "hidden"), GenotypeError)
        count = table.get("inputs", 8 if inputs is None else inputs)
        if inputs not in (None, count):
            raise GenotypeError(f"inputs: expected the task's {inputs}, got {count!r}.")
        hidden = _table("hidden", table.get("hidden", {}))
        if set(MOTORS) & set(hidden):
            raise GenotypeError(f"hidden: expected other names than the motors', {' and '.join(MOTORS)}.")
        parts = {**{name: table.get(name, {}) for name in MOTORS}, **hidden}
        sources: dict[int | str, int] = {i: i for i in range(count)}
        sources |= {name: count + i for i, name in enumerate(parts)}
        return cls.written(count, [_neuron(name, part, sources) for name, part in parts.items()])


def _neuron(
    name: str, part: object, sources: Mapping[int | str, int]
) -> tuple[int, list[tuple[int, int, int]]]:
    """Threshold and links of a neuron written by hand; `sources` are the slots by number or name."""
    table = _table(name, part)
    refuse_unknown(table, ("threshold", "links"), GenotypeError)
    links = []
    for i, one in enumerate(table.get("links", ())):
        where = f"{name}.links[{i}]"
        refuse_unknown(_table(where, one), ("from", "weight", "delay"), GenotypeError)
        source = one.get("from")
        if isinstance(source, bool | list | dict) or source not in sources:
            expected = f"an input or a neuron: {', '.join(map(str, sources))}"
            raise GenotypeError(f"{where}.from: expected {expected}; got {source!r}.")
        weight = as_count(one.get("weight"), f"{where}.weight", -MAX_WEIGHT, MAX_WEIGHT)
        links.append((sources[source], weight, as_count(one.get("delay", 0), f"{where}.delay", 0, MAX_DELAY)))
    return as_count(table.get("threshold", 0), f"{name}.threshold", -MAX_THRESHOLD, MAX_THRESHOLD), links


def _table(name: str, value: object) -> Mapping[str, Any]:
    if not isinstance(value, Mapping):
        raise GenotypeError(f"{name}: expected a table, got {value!r}.")
    return value


class NetworkController:
    """A genotype's network that drives any body: inputs −10 to 10 in, wheel commands out.

    Plain integers, a step at a time; the kernels compute the same law for whole trials.
    """

    def __init__(self, genotype: Genotype) -> None:
        self.genotype = genotype
        self.reset()

    def _repr_html_(self) -> str:
        return self.genotype._repr_html_()

    def reset(self) -> None:
        """Before a trial: every value ever is 0."""
        silent = [0] * self.genotype.slots
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
        count = self.genotype.inputs
        try:
            held = [int(value) for value in inputs if -LIMIT <= value <= LIMIT and value == int(value)]
        except TypeError:
            held = []
        if not len(held) == len(inputs) == count:
            expected = f"{count} whole numbers from -{LIMIT} to {LIMIT}"
            raise UsageError(f"inputs: expected {expected}, got {inputs!r}.")
        self._past[0] = held + self._past[0][count:]
        empty = held + [0] * (self.genotype.slots - count)
        for _ in range(UPDATES):
            now, past = empty.copy(), list(self._past)
            for slot, threshold, links in self.genotype.neurons:
                total = -threshold
                for _, source, weight, delay in links:
                    total += weight * past[delay][source]
                now[slot] = max(-LIMIT, min(LIMIT, total))
            self._past.appendleft(now)
            if past.count(now) == len(past):
                break  # settled: every further update is the same
        left, right = self._past[0][count : count + 2]
        return Command(left=left, right=right)
