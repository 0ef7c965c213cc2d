"""A network as the page's player draws it: where its neurons stand and how its links run."""

from __future__ import annotations

from typing import Any

import numpy as np

from realitygap.controller.layout import Genes
from realitygap.report.network import HIDDEN, INPUT, OUTPUT, UNIT_INCHES
from realitygap.report.wiring import Wiring, bend_links, place_neurons, read_wiring

__all__ = ["network_drawing"]

OUTPUTS = 2
INCHES = ((3, 3.7), (7, 4.6), (99, 6.6))
"""So many hidden neurons have room in a picture so wide: as the report's pictures of networks."""


def network_drawing(genes: Genes, task: Any, profile: Any) -> dict[str, Any]:
    """Neurons and links in cm on the robot, which looks up; y points down, as on a screen.

    `slots` gives the order in which a track's outputs stand.
    """
    robot = profile.to_kernel()
    spots = robot.proximity_place if task.feeds == "proximity" else robot.ambient_place
    inputs = len(task.sensors)
    wiring = read_wiring(np.asarray(genes), inputs=inputs, outputs=OUTPUTS)
    wide = next(inches for most, inches in INCHES if len(wiring.hidden) <= most)
    unit = UNIT_INCHES * (2 * float(robot.radius) + 0.24) / wide
    places = place_neurons(wiring, robot, spots, task.sensors, unit)
    kinds = {n: "input" if n < inputs else "output" if n < inputs + OUTPUTS else "hidden" for n in places}
    sizes = {n: unit * {"input": INPUT, "output": OUTPUT, "hidden": HIDDEN}[kinds[n]] for n in places}
    curves = bend_links(wiring, places, sizes, unit)
    slots = sorted(places)
    return {
        "unit": round(unit, 3),
        "neurons": [
            {
                "x": _short(places[n][0]),
                "y": _short(-places[n][1]),
                "r": _short(sizes[n]),
                "kind": kinds[n],
                "name": _name(n, wiring, task),
                "threshold": wiring.thresholds.get(n, 0),
                "useful": n in wiring.useful,
            }
            for n in slots
        ],
        "links": [
            {
                "from": slots.index(link.source),
                "to": slots.index(link.target),
                "weight": link.weight,
                "delay": link.delay,
                "works": wiring.works(link),
                "points": [[_short(x), _short(-y)] for x, y in _thinned(curve)],
            }
            for link, curve in zip(wiring.links, curves, strict=True)
        ],
        "slots": slots,
    }


def _name(slot: int, wiring: Wiring, task: Any) -> str:
    """A sensor's number, the wheel, or the slot of a hidden neuron."""
    if slot < wiring.inputs:
        return str(task.sensors[slot])
    return "LR"[slot - wiring.inputs] if slot < wiring.inputs + OUTPUTS else str(slot)


def _thinned(curve: np.ndarray) -> np.ndarray:
    """Every other point of a curve, its ends kept."""
    return np.concatenate([curve[:-1:2], curve[-1:]])


def _short(value: float) -> float:
    return round(float(value), 2)
