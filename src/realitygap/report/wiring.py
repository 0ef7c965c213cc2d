"""The parts of a genotype's network, and their positions in a picture.

Positions are in cm in the robot's frame as drawn: the robot faces up, so a position (forward, left) is drawn
at (−left, forward).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from realitygap.control.genotype import Genotype
from realitygap.kernels.types import Robot

__all__ = [
    "HIDDEN", "INPUT", "OUTPUT", "OUTPUTS", "UNIT_INCHES", "Layout", "Link", "Wiring", "label_places",
    "lay_out", "read_wiring", "width_inches",
]  # fmt: skip

F = NDArray[np.float64]
SAMPLES = 18
OUTPUTS = 2
"""Left and right wheel."""
INPUT, OUTPUT, HIDDEN = 0.36, 0.4, 0.36
"""Radius or half side of a neuron in units of drawing; one unit contains its text, whatever the robot's size.
"""
UNIT_INCHES = 0.55


@dataclass(frozen=True, kw_only=True)
class Link:
    """An expressed link between two expressed slots."""

    source: int
    target: int
    weight: int
    delay: int


@dataclass(frozen=True, kw_only=True)
class Wiring:
    """The expressed part of a genotype: inputs 0 .. inputs − 1, then outputs, then hidden slots."""

    inputs: int
    hidden: tuple[int, ...]
    thresholds: dict[int, int]
    links: tuple[Link, ...]
    useful: frozenset[int]
    """Slots from which an output can be reached over links of non-zero weight."""

    def kind(self, slot: int) -> str:
        """The kind of a slot: "input", "output" or "hidden"."""
        return "input" if slot < self.inputs else "output" if slot < self.inputs + OUTPUTS else "hidden"

    def works(self, link: Link) -> bool:
        """Whether a link affects an output."""
        return bool(link.weight) and link.target in self.useful


def read_wiring(genotype: Genotype) -> Wiring:
    """The neurons and links that a genotype expresses."""
    neurons = genotype.neurons
    links = [
        Link(source=link.source, target=neuron.slot, weight=link.weight, delay=link.delay)
        for neuron in neurons
        for link in neuron.links
    ]
    useful = {neuron.slot for neuron in neurons[:OUTPUTS]}
    while more := {k.source for k in links if k.weight and k.target in useful} - useful:
        useful |= more
    return Wiring(
        inputs=genotype.inputs, hidden=tuple(neuron.slot for neuron in neurons[OUTPUTS:]), links=tuple(links),
        thresholds={neuron.slot: neuron.threshold for neuron in neurons}, useful=frozenset(useful),
    )  # fmt: skip


class Layout(NamedTuple):
    """A network's picture: positions and sizes (radius or half side) of neurons, curves of links; cm."""

    places: dict[int, F]
    sizes: dict[int, float]
    curves: list[F]


def lay_out(wiring: Wiring, robot: Robot, sensor_places: F, sensors: Sequence[int], unit: float) -> Layout:
    """The picture of a network.

    Args:
        wiring: the network.
        robot: to draw on.
        sensor_places: [S, 2] cm, of the fed sensors, in the robot's frame.
        sensors: the sensor of each input.
        unit: size of a unit of drawing, cm of robot: a neuron's radius is 0.36 of it.
    """
    places = place_neurons(wiring, robot, sensor_places, sensors, unit)
    kinds = {"input": INPUT, "output": OUTPUT, "hidden": HIDDEN}
    sizes = {n: unit * kinds[wiring.kind(n)] for n in places}
    return Layout(places, sizes, bend_links(wiring, places, sizes, unit))


def width_inches(hidden: int) -> float:
    """Width that a picture needs for this many hidden neurons."""
    return 3.7 if hidden <= 3 else 4.6 if hidden <= 7 else 6.6


def place_neurons(
    wiring: Wiring, robot: Robot, sensor_places: F, sensors: Sequence[int], unit: float
) -> dict[int, F]:
    """Inputs at their sensors, outputs beside their wheels but clear of sensors, hidden neurons near their
    neighbours; arguments as of `lay_out`."""
    places: dict[int, F] = {}
    for i in range(wiring.inputs):
        sensor = sensors[i] if i < len(sensors) else -1
        if 0 <= sensor < len(sensor_places):
            forward, left = sensor_places[sensor]
            places[i] = np.array([-left, forward])
        else:
            places[i] = np.array([0.8 * unit * (i - (wiring.inputs - 1) / 2), -robot.radius - 0.5 * unit])
    for k, side in enumerate((-1, 1)):
        wheel = np.array([side * (robot.wheels.track / 2 - 0.3 - 0.42 * unit), -0.28 * unit])
        while any(np.hypot(*(wheel - p)) < 0.95 * unit for p in places.values()) and abs(wheel[0]) > unit:
            wheel[0] *= 0.95
        places[wiring.inputs + k] = wheel
    _place_hidden(wiring, robot.radius, places, unit)
    return places


def _place_hidden(wiring: Wiring, radius: float, places: dict[int, F], unit: float) -> None:
    """Put each hidden neuron at the free position nearest to its neighbours, the best connected first."""
    count = len(wiring.hidden)
    gap = min(1.9 * unit, 1.5 * radius / (0.5 + count) ** 0.5)
    free = _free_places(gap, radius, places, unit)
    while len(free) < count and gap > 0.3 * unit:
        gap *= 0.93
        free = _free_places(gap, radius, places, unit)
    joined = {
        h: [k.source if k.target == h else k.target for k in wiring.links if h in (k.source, k.target)]
        for h in wiring.hidden
    }
    for h in sorted(wiring.hidden, key=lambda h: (-len(joined[h]), h)):
        near = [places[n] for n in joined[h] if n in places] or [np.zeros(2)]
        aim = np.mean(near, axis=0) * 0.8
        best = min(range(len(free)), key=lambda i: float(np.hypot(*(free[i] - aim))))
        places[h] = free.pop(best)


def _free_places(gap: float, radius: float, places: dict[int, F], unit: float) -> list[F]:
    """A hexagonal grid of positions `gap` apart inside the body, clear of placed neurons."""
    reach = range(-16, 17)
    honeycomb = [np.array([(i + 0.5 * (j % 2)) * gap, (j - 0.3) * gap * 0.87]) for i in reach for j in reach]
    return [
        spot
        for spot in honeycomb
        if np.hypot(*spot) < 0.8 * radius
        and all(np.hypot(*(spot - p)) > min(1.1 * unit, 1.2 * gap) for p in places.values())
    ]


def bend_links(wiring: Wiring, places: dict[int, F], sizes: dict[int, float], unit: float) -> list[F]:
    """The curve [SAMPLES, 2] of each link, ending at its neurons' rims, clear of other neurons; positions [2]
    and radii by neuron."""
    curves: list[F] = []
    loops: dict[int, int] = {}
    outside = max(float(np.hypot(*place)) for place in places.values()) + 0.45 * unit

    def rim(neuron: int) -> tuple[float, bool]:
        return sizes[neuron], wiring.kind(neuron) == "output"

    for link in wiring.links:
        if link.source == link.target:
            turn = loops.get(link.source, 0)
            loops[link.source] = turn + 1
            curves.append(_loop(places[link.source], sizes[link.source], turn))
            continue
        others = np.array([p for n, p in places.items() if n not in (link.source, link.target)])
        room = np.array([sizes[n] for n in places if n not in (link.source, link.target)])
        ends = (places[link.source], places[link.target], rim(link.source), rim(link.target))
        tries = [_bow(*ends, bend) for bend in (0.08, -0.08, 0.2, -0.2, 0.33, -0.33, 0.5, -0.5)]
        costs = [
            _crowding(c, others, room, curves, unit)
            + 3.0 / unit * float(np.maximum(np.hypot(*c.T) - outside, 0).sum())
            + 0.05 * i
            for i, c in enumerate(tries)
        ]
        curves.append(tries[int(np.argmin(costs))])
    return curves


def _bow(start: F, end: F, start_rim: tuple[float, bool], end_rim: tuple[float, bool], bend: float) -> F:
    """A quadratic Bézier curve bowed by `bend` of its length, cut at both neurons' rims."""
    across = np.array([-(end - start)[1], (end - start)[0]])
    control = (start + end) / 2 + 2 * bend * across
    first = (control - start) / np.hypot(*(control - start))
    last = (control - end) / np.hypot(*(control - end))
    a, b = start + first * _reach(first, *start_rim), end + last * 1.16 * _reach(last, *end_rim)
    t = np.linspace(0, 1, SAMPLES)[:, None]
    return np.asarray((1 - t) ** 2 * a + 2 * t * (1 - t) * control + t**2 * b)


def _reach(direction: F, size: float, square: bool) -> float:
    """Distance of a neuron's rim from its middle in a direction."""
    return size / float(np.abs(direction).max()) if square else size


def _loop(place: F, size: float, turn: int) -> F:
    """A recurrent self-link: a loop from a neuron back to it."""
    facing = -np.pi / 2 + turn * np.pi / 2.5 * (1 if place[0] >= 0 else -1)
    reach = size * 1.25
    middle = place + reach * np.array([np.cos(facing), np.sin(facing)])
    t = facing + np.linspace(-0.62 * np.pi, 0.62 * np.pi, SAMPLES)
    return np.asarray(middle + 0.72 * size * np.stack([np.cos(t), np.sin(t)], axis=1))


def _crowding(curve: F, others: F, room: F, earlier: list[F], unit: float) -> float:
    """A penalty for a curve's overlap with neurons and earlier curves."""
    cost = 0.0
    if len(others):
        gaps = _distances(curve, others) - room - 0.1 * unit
        cost += 6.0 / unit * float(np.maximum(-gaps, 0).sum())
    if earlier:
        points = np.concatenate([e[3:-3] for e in earlier])
        near = _distances(curve[3:-3], points).min(axis=1)
        cost += 0.8 / unit * float(np.maximum(0.2 * unit - near, 0).sum())
    return cost


def label_places(curves: list[F], neurons: F, sizes: F, unit: float) -> list[F]:
    """Position of each link's number: at its curve, away from neurons, curves and other numbers.

    Args:
        curves: [SAMPLES, 2] of each link.
        neurons: [n, 2] their positions.
        sizes: [n] their radii.
        unit: of drawing.
    """
    placed: list[F] = []
    for i, curve in enumerate(curves):
        along = curve[5:-2] - curve[3:-4]
        across = np.stack([-along[:, 1], along[:, 0]], axis=1) / np.maximum(np.hypot(*along.T), 1e-9)[:, None]
        spots = np.concatenate([curve[4:-3] + side * unit * across for side in (0.0, 0.24, -0.24)])
        score = np.repeat([0.0, -0.25, -0.25], len(along))
        gaps = (_distances(spots, neurons) - sizes).min(axis=1) / unit
        score = score + 4 * np.minimum(gaps, 0.25) + np.minimum(gaps, 0.6)
        rest = [c[2:-2] for j, c in enumerate(curves) if j != i]
        if rest:
            score = score + np.minimum(_distances(spots, np.concatenate(rest)).min(axis=1) / unit, 0.35)
        if placed:
            others = _distances(spots * (1.0, 1.9), np.array(placed) * (1.0, 1.9)).min(axis=1) / unit
            score = score + 3 * np.minimum(others, 0.7)
        placed.append(spots[int(np.argmax(score))])
    return placed


def _distances(first: F, second: F) -> F:
    """Distances [n, m] between two sets of positions."""
    return np.asarray(np.hypot(*(first[:, None] - second[None]).transpose(2, 0, 1)))
