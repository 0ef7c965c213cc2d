"""A network as the page's player draws it: where its neurons stand and how its links run."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from realitygap.controller.layout import Genes
from realitygap.report.wiring import OUTPUTS, UNIT_INCHES, Wiring, lay_out, read_wiring, width_inches
from realitygap.tasks.task import Task
from realitygap.world.profile import Profile

__all__ = ["network_drawing"]


def network_drawing(genes: Genes, task: Task, profile: Profile) -> tuple[dict[str, object], list[int]]:
    """Neurons and links in cm on the robot, which looks up; y points down, as on a screen.

    Beside them the slots of the neurons, in the order in which a track's outputs stand.
    """
    robot = profile.to_kernel()
    spots = robot.proximity_place if task.feeds == "proximity" else robot.ambient_place
    wiring = read_wiring(genes, inputs=len(task.sensors), outputs=OUTPUTS)
    unit = UNIT_INCHES * (2 * float(robot.radius) + 0.24) / width_inches(len(wiring.hidden))
    laid = lay_out(wiring, robot, spots, task.sensors, unit)
    slots = sorted(laid.places)
    neurons = [
        {
            "x": _short(laid.places[n][0]), "y": _short(-laid.places[n][1]), "r": _short(laid.sizes[n]),
            "kind": wiring.kind(n), "name": _name(n, wiring, task.sensors),
            "threshold": wiring.thresholds.get(n, 0), "useful": n in wiring.useful,
        }
        for n in slots
    ]  # fmt: skip
    links = [
        {
            "from": slots.index(link.source), "to": slots.index(link.target), "weight": link.weight,
            "delay": link.delay, "works": wiring.works(link),
            "points": [[_short(x), _short(-y)] for x, y in _thinned(curve)],
        }
        for link, curve in zip(wiring.links, laid.curves, strict=True)
    ]  # fmt: skip
    return {"unit": round(unit, 3), "neurons": neurons, "links": links}, slots


def _name(slot: int, wiring: Wiring, sensors: Sequence[int]) -> str:
    """A sensor's number, the wheel, or the slot of a hidden neuron."""
    if slot < wiring.inputs:
        return str(sensors[slot])
    return "LR"[slot - wiring.inputs] if slot < wiring.inputs + OUTPUTS else str(slot)


def _thinned(curve: np.ndarray) -> np.ndarray:
    """Every other point of a curve, its ends kept."""
    return np.concatenate([curve[:-1:2], curve[-1:]])


def _short(value: float) -> float:
    return round(float(value), 2)
