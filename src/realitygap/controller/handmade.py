"""Controllers made by hand, as genotypes of the same encoding: they run wherever evolved ones do.

The Braitenberg vehicles (V. Braitenberg, "Vehicles", 1984) are for eight sensors in the Khepera's
order: left 90°, left 45°, front left, front right, right 45°, right 90°, back right, back left.

A person writes networks in TOML: neurons by name, links with weights and delays (docs/formats.md).
"""

import os
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from realitygap.controller.genotype import load_genotype
from realitygap.controller.layout import (
    MAX_DELAY,
    MAX_THRESHOLD,
    MAX_WEIGHT,
    Genes,
    Layout,
    bare,
    check_layout,
    genes_of,
    write_neuron,
)
from realitygap.errors import GenotypeError, UsageError
from realitygap.text import refuse_unknown
from realitygap.toml import read_toml
from realitygap.values import as_count

__all__ = ["braitenberg", "constant", "controller_genes", "load_network"]

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
