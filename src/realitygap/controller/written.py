"""Networks as a person writes them, in TOML: neurons by name, links with weights and delays.

    inputs = 8                      # the task's sensors, numbered from 0
    [left]                          # a motor neuron; `right` is the other
    threshold = -6
    links = [{from = 2, weight = -1}, {from = "shy", weight = 2, delay = 1}]
    [right]
    threshold = -6
    [hidden.shy]                    # as many as there are
    links = [{from = 5, weight = 4}]

What is left out is 0; a `from` is an input's number or a neuron's name.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from realitygap.controller.layout import (
    EXPRESSED,
    FIRST_LINK,
    LINK_FIELDS,
    MAX_DELAY,
    MAX_THRESHOLD,
    MAX_WEIGHT,
    THRESHOLD,
    Genes,
    Layout,
)
from realitygap.errors import GenotypeError
from realitygap.text import refuse_unknown
from realitygap.toml import read_toml

__all__ = ["load_network"]

MOTORS = ("left", "right")


def load_network(path: str | Path, inputs: int) -> Genes:
    """The genotype of a network that a person wrote for a task of so many inputs.

    Raises:
        GenotypeError: names the file and the key, what was expected and what came.
    """
    table = read_toml(path, GenotypeError, "Give the path of a network's TOML file.")
    try:
        return _genes(table, inputs)
    except GenotypeError as error:
        raise GenotypeError(f"{path}: {error}") from None


def _genes(table: Mapping[str, Any], inputs: int) -> Genes:
    refuse_unknown(table, ("inputs", *MOTORS, "hidden"), GenotypeError)
    if table.get("inputs", inputs) != inputs:
        raise GenotypeError(f"inputs: expected {inputs}, as the task feeds, got {table['inputs']!r}.")
    hidden = _table("hidden", table.get("hidden", {}))
    parts = {name: _table(name, table.get(name, {})) for name in MOTORS}
    for name, part in hidden.items():
        if name in MOTORS:
            raise GenotypeError(f"hidden.{name}: expected another name: the motor neuron has this one.")
        parts[name] = _table(f"hidden.{name}", part)
    slots = {name: inputs + i for i, name in enumerate(parts)}
    links = [_links(name, part, inputs, slots) for name, part in parts.items()]
    layout = Layout(inputs=inputs, slots=inputs + len(parts), links=max(1, *map(len, links)))
    genes: Genes = np.zeros(layout.shape, np.int8)
    genes[:, EXPRESSED] = 1
    for (name, part), into in zip(parts.items(), links, strict=True):
        slot = slots[name]
        genes[slot, THRESHOLD] = _whole(f"{name}.threshold", part.get("threshold", 0), MAX_THRESHOLD)
        for k, link in enumerate(into):
            genes[slot, FIRST_LINK + LINK_FIELDS * k :][:LINK_FIELDS] = (1, *link)
    return genes


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
        weight = _whole(f"{where}.weight", one.get("weight"), MAX_WEIGHT)
        delay = _whole(f"{where}.delay", one.get("delay", 0), MAX_DELAY, 0)
        made.append([source if number else slots[source], weight, delay])
    return made


def _table(name: str, value: object) -> Mapping[str, Any]:
    if not isinstance(value, Mapping):
        raise GenotypeError(f"{name}: expected a table, got {value!r}.")
    return value


def _whole(name: str, value: object, most: int, least: int | None = None) -> int:
    low = -most if least is None else least
    if isinstance(value, bool) or not isinstance(value, int) or not low <= value <= most:
        raise GenotypeError(f"{name}: expected a whole number from {low} to {most}, got {value!r}.")
    return value
