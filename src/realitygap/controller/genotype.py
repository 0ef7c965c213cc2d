"""Genotypes for people: a random one, and their text form.

The text (docs/formats.md) has a line a neuron and a line a link, so that two genotypes can be compared by
`diff`. What is omitted is blank. The same genotype always gives the same text, and the text the same
genotype.
"""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import NoReturn

import numpy as np

from realitygap import whole
from realitygap.controller.layout import (
    EXPRESSED,
    MAX_DELAY,
    MAX_THRESHOLD,
    MAX_WEIGHT,
    THRESHOLD,
    Genes,
    Layout,
    bare,
    check_genes,
    check_layout,
    links_of,
)
from realitygap.controller.operators import Variation
from realitygap.errors import GenotypeError, UsageError
from realitygap.text import as_path

__all__ = [
    "Layout", "from_text", "load_genotype", "parse_text", "random_genotype", "save_genotype", "to_text",
]  # fmt: skip

HEADER = "realitygap genotype 1"
_LAYOUT = re.compile(r"layout inputs (\d{1,9}) outputs (\d{1,9}) slots (\d{1,9}) links (\d{1,9})")
_SLOT = re.compile(r"slot (\d{1,9})( off)? threshold (-?\d{1,9})")
_LINK = re.compile(r"link (\d{1,9})( off)? from (\d{1,9}) weight (-?\d{1,9}) delay (\d{1,9})")


def random_genotype(layout: Layout, stream: np.uint64, **rates: float) -> Genes:
    """A random genotype; `rates` are `start_neurons` and `start_links` of `Variation`."""
    return Variation(layout=layout, **rates).random(stream)  # type: ignore[arg-type]


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
        whole.write(as_path(path, "genotype"), text)
    except OSError as error:
        raise GenotypeError(f"cannot write the genotype {path}: {error.strerror}") from None
