"""Genotypes (§5.2): their layout, their text form, and those made by hand."""

import os
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, NoReturn, Self

import numpy as np
from numpy.typing import NDArray

from realitygap.errors import GenotypeError, UsageError
from realitygap.files import as_path, atomic_write, read_toml, refuse_unknown
from realitygap.kernels.params import MAX_DELAY
from realitygap.values import as_count, shown

__all__ = [
    "MAX_DELAY", "MAX_THRESHOLD", "MAX_WEIGHT", "Genes", "Layout", "bare", "braitenberg", "check_genes",
    "check_layout", "constant", "controller_genes", "from_text", "genes_of", "links_of", "load_genotype",
    "load_network", "parse_text", "save_genotype", "to_text", "write_neuron",
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


HEADER = "realitygap genotype 1"
_LAYOUT = re.compile(r"layout inputs (\d{1,9}) outputs (\d{1,9}) slots (\d{1,9}) links (\d{1,9})")
_SLOT = re.compile(r"slot (\d{1,9})( off)? threshold (-?\d{1,9})")
_LINK = re.compile(r"link (\d{1,9})( off)? from (\d{1,9}) weight (-?\d{1,9}) delay (\d{1,9})")


def to_text(genes: Genes, layout: Layout | None = None) -> str:
    """The text form of a genotype (layout: of eight inputs if it is not given).

    Raises:
        GenotypeError: genes that do not fit the layout.
    """
    layout = Layout.of(genes) if layout is None else layout
    check_genes(genes, layout)
    lines = [
        HEADER,
        f"layout inputs {layout.inputs} outputs {layout.outputs} slots {layout.slots} links {layout.links}",
        "",
    ]
    for slot in range(layout.slots):
        lines += _slot_lines(genes, slot, layout)
    return "\n".join([*lines, "end", ""])


def _slot_lines(genes: Genes, slot: int, layout: Layout) -> Iterator[str]:
    row = genes[slot]
    held = bool(row[EXPRESSED])
    sensor = slot < layout.inputs
    if not row[THRESHOLD:].any() and (sensor or not held):
        return
    off = "" if held else " off"
    yield f"slot {slot}{off} threshold {row[THRESHOLD]}  # {layout.role(slot)}"
    for k, link in enumerate(links_of(genes)[slot].tolist()):
        if any(link):
            expressed, source, weight, delay = link
            off = "" if expressed else " off"
            dormant = held and not sensor and expressed and not genes[source, EXPRESSED]
            remark = "  # dormant" if dormant else ""
            yield f"  link {k}{off} from {source} weight {weight} delay {delay}{remark}"


def from_text(text: str, source: str = "genotype") -> Genes:
    """The genotype of a text form; `source` names the text in errors (a file's path).

    Raises:
        GenotypeError: names the line, what was expected there and what came.
    """
    return parse_text(text, source)[0]


def parse_text(text: str, source: str = "genotype") -> tuple[Genes, Layout]:
    """The genotype of a text form, and its layout (see `from_text`)."""
    return _Reader(text, source).read()


class _Reader:
    """Reads a text form line by line, and knows where it is."""

    def __init__(self, text: str, source: str) -> None:
        stripped = (line.split("#", 1)[0].split() for line in text.splitlines())
        self.lines = [(number, " ".join(words)) for number, words in enumerate(stripped, 1) if words]
        self.source = source
        self.number = 0
        self.line = ""
        self.links: set[int] = set()
        self.slots: set[int] = set()

    def read(self) -> tuple[Genes, Layout]:
        if self.advance() != HEADER:
            self.refuse(f'"{HEADER}"')
        self.layout = self.read_layout()
        self.genes = bare(self.layout)
        slot = -1
        while self.advance() != "end":
            if self.line.startswith("slot"):
                slot = self.read_slot()
            elif self.line.startswith("link") and slot >= 0:
                self.read_link(slot)
            else:
                self.refuse('"slot …"' if slot < 0 else '"slot …", "link …" or "end"')
        if self.lines:
            self.advance()
            self.refuse('nothing after "end"')
        return self.genes, self.layout

    def advance(self) -> str:
        """The next line that is not empty; a text that stops early is refused."""
        if self.lines:
            self.number, self.line = self.lines.pop(0)
        else:
            self.number, self.line = self.number + 1, "the end of the text"
        return self.line

    def refuse(self, expected: str) -> NoReturn:
        came = self.line if self.line == "the end of the text" else f'"{self.line}"'
        raise GenotypeError(f"{self.source}, line {self.number}: expected {expected}, got {came}")

    def matched(self, pattern: re.Pattern[str], form: str) -> re.Match[str]:
        return pattern.fullmatch(self.line) or self.refuse(f'"{form}"')

    def whole(self, name: str, text: str, low: int, high: int) -> int:
        if not low <= int(text) <= high:
            self.refuse(f"a {name} of {low} to {high}")
        return int(text)

    def read_layout(self) -> Layout:
        self.advance()
        match = self.matched(_LAYOUT, "layout inputs N outputs 2 slots N links N")
        inputs, outputs, slots, links = map(int, match.groups())
        try:
            return Layout(inputs=inputs, outputs=outputs, slots=slots, links=links)
        except UsageError as error:
            raise GenotypeError(f"{self.source}, line {self.number}: {error}") from None

    def read_slot(self) -> int:
        match = self.matched(_SLOT, "slot N [off] threshold N")
        slot = self.whole("slot", match[1], 0, self.layout.slots - 1)
        if slot in self.slots:
            self.refuse(f"slot {slot} only once")
        if match[2] and slot < self.layout.first_hidden:
            self.refuse(f"slot {slot} ({self.layout.role(slot)}) without off, as it is always expressed")
        self.slots.add(slot)
        self.links = set()
        self.genes[slot, EXPRESSED] = not match[2]
        self.genes[slot, THRESHOLD] = self.whole("threshold", match[3], -MAX_THRESHOLD, MAX_THRESHOLD)
        return slot

    def read_link(self, slot: int) -> None:
        match = self.matched(_LINK, "link N [off] from SLOT weight N delay N")
        k = self.whole("link field", match[1], 0, self.layout.links - 1)
        if k in self.links:
            self.refuse(f"link {k} only once in slot {slot}")
        self.links.add(k)
        links_of(self.genes)[slot, k] = (
            not match[2],
            self.whole("source slot", match[3], 0, self.layout.slots - 1),
            self.whole("weight", match[4], -MAX_WEIGHT, MAX_WEIGHT),
            self.whole("delay", match[5], 0, MAX_DELAY),
        )


def load_genotype(path: str | Path, layout: Layout | None = None) -> Genes:
    """The genotype in a file; its inputs and outputs must be those of `layout`, if one is given.

    Raises:
        GenotypeError: names the file and the line.
    """
    path = as_path(path, "genotype")
    if layout is not None:
        check_layout(layout)
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else "it is not a text in UTF-8"
        raise GenotypeError(f"cannot read the genotype {path}: {reason}") from None
    genes, own = parse_text(text, str(path))
    if layout and own.inputs != layout.inputs:
        raise GenotypeError(f"{path}: expected a genotype of {layout.inputs} inputs, got {own.inputs}")
    return genes


def save_genotype(path: str | Path, genes: Genes, layout: Layout | None = None) -> None:
    """Writes the text form of a genotype.

    Raises:
        GenotypeError: genes that do not fit the layout, or a place that cannot be written.
    """
    text = to_text(genes, layout)
    try:
        atomic_write(as_path(path, "genotype"), text)
    except OSError as error:
        raise GenotypeError(f"cannot write the genotype {path}: {error.strerror}") from None


MOTORS = ("left", "right")


def load_network(path: str | Path, inputs: int) -> Genes:
    """The genotype of a network that a person wrote for a task with this many inputs.

    Raises:
        GenotypeError: names the file and the key, what was expected and what came.
    """
    table = read_toml(path, GenotypeError, "Give the path of a network's TOML file.")
    try:
        return _genes(table, inputs)
    except UsageError as error:
        raise GenotypeError(f"{path}: {error}") from None


def _genes(table: Mapping[str, Any], inputs: int) -> Genes:
    refuse_unknown(table, ("inputs", *MOTORS, "hidden"), GenotypeError)
    if table.get("inputs", inputs) != inputs:
        raise GenotypeError(f"inputs: expected the task's {inputs}, got {table['inputs']!r}.")
    hidden = _table("hidden", table.get("hidden", {}))
    parts = {name: _table(name, table.get(name, {})) for name in MOTORS}
    for name, part in hidden.items():
        if name in MOTORS:
            raise GenotypeError(f"hidden.{name}: expected another name: the motor neuron has this one.")
        parts[name] = _table(f"hidden.{name}", part)
    slots = {name: inputs + i for i, name in enumerate(parts)}
    links = [_links(name, part, inputs, slots) for name, part in parts.items()]
    thresholds = (
        as_count(part.get("threshold", 0), f"{name}.threshold", -MAX_THRESHOLD, MAX_THRESHOLD)
        for name, part in parts.items()
    )
    return genes_of(inputs, thresholds, links)[0]


def _links(name: str, part: Mapping[str, Any], inputs: int, slots: Mapping[str, int]) -> list[list[int]]:
    """Source slot, weight and delay of each of a neuron's links."""
    refuse_unknown(part, ("threshold", "links"), GenotypeError)
    listed, made = part.get("links", []), []
    if not isinstance(listed, list):
        raise GenotypeError(f"{name}.links: expected a list of {{from = …, weight = …}}, got {listed!r}.")
    for i, one in enumerate(listed):
        where = f"{name}.links[{i}]"
        refuse_unknown(_table(where, one), ("from", "weight", "delay"), GenotypeError)
        source = one.get("from")
        number = isinstance(source, int) and not isinstance(source, bool) and 0 <= source < inputs
        if not number and not (isinstance(source, str) and source in slots):
            expected = f"an input, 0 to {inputs - 1}, or a neuron: {', '.join(slots)}"
            raise GenotypeError(f"{where}.from: expected {expected}; got {source!r}.")
        weight = as_count(one.get("weight"), f"{where}.weight", -MAX_WEIGHT, MAX_WEIGHT)
        delay = as_count(one.get("delay", 0), f"{where}.delay", 0, MAX_DELAY)
        made.append([source if number else slots[source], weight, delay])
    return made


def _table(name: str, value: object) -> Mapping[str, Any]:
    if not isinstance(value, Mapping):
        raise GenotypeError(f"{name}: expected a table, got {value!r}.")
    return value


# Of the left and the right motor: a threshold, and the weight of each of the eight sensors.
# A motor's speed is Σ weight · input − threshold. In the open all inputs are −10 and both run at 8.
# A sensor that feels a wall drives its own side's wheel and brakes the other one. Walls on both
# sides brake the left wheel only, so that a robot head-on to a wall turns left and never stands.
_AVOIDS = (2, (0, 1, 1, -2, -1, 0, 0, 0)), (-8, (0, -1, -2, 2, 1, 0, 0, 0))
# A sensor lit by the lamp (9, by reflections about 1) brakes its own side's wheel and drives the
# other one. The left wheel lives on the light in front: where it is dark, the robot turns left.
_SEEKS = (0, (-1, -1, 1, 1, 1, 1, 0, 0)), (-8, (1, 1, 0, 0, -1, -1, 0, 0))


def constant(left: int, right: int, layout: Layout) -> Genes:
    """Two motors and no links: the same wheel commands (−10 .. 10) at every step.

    Raises:
        UsageError: a command that is not a whole number from −10 to 10.
    """
    check_layout(layout)
    genes = bare(layout)
    for name, slot, value in (("left", layout.inputs, left), ("right", layout.inputs + 1, right)):
        command = f"the {name} command of a constant controller"
        write_neuron(genes, slot, -as_count(value, command, -MAX_THRESHOLD, MAX_THRESHOLD), ())
    return genes


def braitenberg(feeds: str, layout: Layout) -> Genes:
    """A vehicle that avoids obstacles ("proximity") or seeks light ("ambient").

    Raises:
        UsageError: other feeds, or a layout without eight inputs or room for the links.
    """
    if feeds not in ("proximity", "ambient"):
        raise UsageError(
            f'a Braitenberg controller: feeds: expected "proximity" or "ambient", got {feeds!r}.'
        )
    check_layout(layout)
    if layout.inputs != 8:
        raise UsageError(
            f"the Braitenberg controller is made for the Khepera's eight sensors; this task feeds "
            f"{layout.inputs}: name another controller"
        )
    genes = bare(layout)
    for slot, (threshold, weights) in enumerate(_AVOIDS if feeds == "proximity" else _SEEKS, layout.inputs):
        links = [(source, weight, 0) for source, weight in enumerate(weights) if weight]
        if len(links) > layout.links:
            raise UsageError(
                f"the Braitenberg controller needs {len(links)} link fields a slot; the layout has "
                f"{layout.links}"
            )
        write_neuron(genes, slot, threshold, links)
    return genes


def controller_genes(spec: str, feeds: str, layout: Layout) -> Genes:
    """The genotype that a person names: "constant:L,R", "braitenberg", or the file of a genotype or of a
    network written by hand (.toml).

    A file's genotype must have the layout's inputs; slots and link fields are its own.

    Raises:
        UsageError: says which of the three is wrong, and how.
    """
    name, _, rest = spec.partition(":")
    if name == "constant":
        match = re.fullmatch(r"\s*([-+]?\d+)\s*,\s*([-+]?\d+)\s*", rest)
        if not match:
            raise UsageError(f"a constant controller: expected constant:L,R, as in constant:5,5, got {spec}.")
        return constant(int(match[1]), int(match[2]), layout)
    if spec == "braitenberg":
        return braitenberg(feeds, layout)
    if not os.path.exists(spec):
        raise UsageError(
            f"the controller: expected constant:L,R, braitenberg, FILE.py:NAME, or a file with a genotype or "
            f"a network (.toml); there is no file {spec!r}."
        )
    if spec.endswith(".toml"):
        return load_network(spec, layout.inputs)
    return load_genotype(spec, layout)
