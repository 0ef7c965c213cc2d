"""A genotype's network drawn on its robot: neurons, links, weights, delays; as a picture, and for the player.

Positions are in cm in the robot's frame as drawn: the robot faces up, so a position (forward, left) is drawn
at (−left, forward).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from itertools import product
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Patch, Rectangle

from realitygap.control.genotype import Genotype
from realitygap.kernels.types import Robot
from realitygap.report import style
from realitygap.report.drawing import draw_robot
from realitygap.report.style import new_figure
from realitygap.tasks.task import Task
from realitygap.values import Floats
from realitygap.world.robot import Profile

__all__ = ["draw_network", "network_drawing", "network_figure", "read_wiring"]

SAMPLES = 18
OUTPUTS = 2
"""Left and right wheel."""
SIZES = {"input": 0.36, "output": 0.4, "hidden": 0.36}
"""Radius or half side of a neuron in units of drawing; one unit contains its text, whatever the robot's size.
"""
UNIT_INCHES = 0.55
INSIDE = 0.72
"""Relative distance of a proximity sensor's neuron from the robot's middle, beside an ambient sensor's."""


# What a genotype expresses, and where it stands


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

    wiring: Wiring
    places: dict[int, Floats]
    sizes: dict[int, float]
    curves: list[Floats]


def lay_out(genotype: Genotype, robot: Robot, feeds: str, sensors: Sequence[int], unit: float) -> Layout:
    """Where a network's parts stand on a robot: `sensors` are those of the inputs, and a unit of drawing is
    so many cm of robot. Of two fed sensors at one position, proximity is inside."""
    spots = {"proximity": robot.proximity.place, "ambient": robot.ambient.place}
    if "+" in feeds:
        spots["proximity"] = INSIDE * robot.proximity.place
    wiring = read_wiring(genotype)
    fed = np.concatenate([spots[kind] for kind in feeds.split("+")])
    places = place_neurons(wiring, robot, fed, sensors, unit)
    sizes = {n: unit * SIZES[wiring.kind(n)] for n in places}
    return Layout(wiring, places, sizes, bend_links(wiring, places, sizes, unit))


def width_inches(hidden: int) -> float:
    """Width that a picture needs for this many hidden neurons."""
    return 3.7 if hidden <= 3 else 4.6 if hidden <= 7 else 6.6


def place_neurons(
    wiring: Wiring, robot: Robot, sensor_places: Floats, sensors: Sequence[int], unit: float
) -> dict[int, Floats]:
    """Inputs at their sensors, outputs beside their wheels but clear of sensors, hidden neurons near their
    neighbours; `sensor_places` [S, 2] cm are in the robot's frame."""
    places: dict[int, Floats] = {}
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
    count, radius = len(wiring.hidden), robot.radius
    reach = range(-16, 17)

    def free_places(gap: float) -> list[Floats]:
        """A hexagonal grid of positions `gap` apart inside the body, clear of placed neurons."""
        comb = [np.array([(i + 0.5 * (j % 2)) * gap, (j - 0.3) * gap * 0.87]) for i in reach for j in reach]
        return [
            spot
            for spot in comb
            if np.hypot(*spot) < 0.8 * radius
            and all(np.hypot(*(spot - p)) > min(1.1 * unit, 1.2 * gap) for p in places.values())
        ]

    gap = min(1.9 * unit, 1.5 * radius / (0.5 + count) ** 0.5)
    while len(free := free_places(gap)) < count and gap > 0.3 * unit:
        gap *= 0.93
    joined = {
        h: [k.source if k.target == h else k.target for k in wiring.links if h in (k.source, k.target)]
        for h in wiring.hidden
    }
    for h in sorted(wiring.hidden, key=lambda h: (-len(joined[h]), h)):  # the best connected first
        near = [places[n] for n in joined[h] if n in places] or [np.zeros(2)]
        aim = np.mean(near, axis=0) * 0.8
        best = min(range(len(free)), key=lambda i: float(np.hypot(*(free[i] - aim))))
        places[h] = free.pop(best)
    return places


def bend_links(
    wiring: Wiring, places: dict[int, Floats], sizes: dict[int, float], unit: float
) -> list[Floats]:
    """The curve [SAMPLES, 2] of each link, ending at its neurons' rims, clear of other neurons; positions [2]
    and radii by neuron."""
    curves: list[Floats] = []
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
        radii = np.array([sizes[n] for n in places if n not in (link.source, link.target)])
        ends = (places[link.source], places[link.target], rim(link.source), rim(link.target))
        tries = [_bow(*ends, bend) for bend in (0.08, -0.08, 0.2, -0.2, 0.33, -0.33, 0.5, -0.5)]
        costs = [
            _crowding(c, others, radii, curves, unit)
            + 3.0 / unit * float(np.maximum(np.hypot(*c.T) - outside, 0).sum())
            + 0.05 * i
            for i, c in enumerate(tries)
        ]
        curves.append(tries[int(np.argmin(costs))])
    return curves


def _bow(
    start: Floats, end: Floats, start_rim: tuple[float, bool], end_rim: tuple[float, bool], bend: float
) -> Floats:
    """A quadratic Bézier curve bowed by `bend` of its length, cut at both neurons' rims."""
    across = np.array([-(end - start)[1], (end - start)[0]])
    control = (start + end) / 2 + 2 * bend * across
    first = (control - start) / np.hypot(*(control - start))
    last = (control - end) / np.hypot(*(control - end))
    a, b = start + first * _reach(first, *start_rim), end + last * 1.16 * _reach(last, *end_rim)
    t = np.linspace(0, 1, SAMPLES)[:, None]
    return np.asarray((1 - t) ** 2 * a + 2 * t * (1 - t) * control + t**2 * b)


def _reach(direction: Floats, size: float, square: bool) -> float:
    """Distance of a neuron's rim from its middle in a direction."""
    return size / float(np.abs(direction).max()) if square else size


def _loop(place: Floats, size: float, turn: int) -> Floats:
    """A recurrent self-link: a loop from a neuron back to it."""
    facing = -np.pi / 2 + turn * np.pi / 2.5 * (1 if place[0] >= 0 else -1)
    reach = size * 1.25
    middle = place + reach * np.array([np.cos(facing), np.sin(facing)])
    t = facing + np.linspace(-0.62 * np.pi, 0.62 * np.pi, SAMPLES)
    return np.asarray(middle + 0.72 * size * np.stack([np.cos(t), np.sin(t)], axis=1))


def _crowding(curve: Floats, others: Floats, radii: Floats, earlier: list[Floats], unit: float) -> float:
    """A penalty for a curve's overlap with neurons and earlier curves."""
    cost = 0.0
    if len(others):
        gaps = _distances(curve, others) - radii - 0.1 * unit
        cost += 6.0 / unit * float(np.maximum(-gaps, 0).sum())
    if earlier:
        points = np.concatenate([e[3:-3] for e in earlier])
        near = _distances(curve[3:-3], points).min(axis=1)
        cost += 0.8 / unit * float(np.maximum(0.2 * unit - near, 0).sum())
    return cost


def label_places(curves: list[Floats], neurons: Floats, sizes: Floats, unit: float) -> list[Floats]:
    """Position of each link's number: at its curve, away from neurons [n, 2] of those sizes [n], curves and
    other numbers."""
    placed: list[Floats] = []
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


def _distances(first: Floats, second: Floats) -> Floats:
    """Distances [n, m] between two sets of positions."""
    return np.asarray(np.hypot(*(first[:, None] - second[None]).transpose(2, 0, 1)))


# Drawn


def draw_network(
    ax: Axes, genotype: Genotype, profile: Profile, *, feeds: str, sensors: Sequence[int]
) -> None:
    """A genotype's network on its robot, which faces up.

    Excitatory links are dark and end in an arrow, inhibitory ones purple and end in a dot; width and
    number are the weight, "d2" is a delay of two network updates; what cannot reach a motor is pale.

    Args:
        ax: where to draw; its axes become cm.
        genotype: whose network it is.
        profile: the robot.
        feeds: "proximity", "ambient" or "proximity+ambient".
        sensors: which of their readings feeds each input.
    """
    robot, place = profile.to_kernel(), ax.get_position()
    width, height = ax.get_figure(root=True).get_size_inches()  # type: ignore[union-attr]
    inches = float(min(place.width * width, place.height * height))
    unit = UNIT_INCHES * (2 * robot.radius + 0.24) / inches
    laid = lay_out(genotype, robot, feeds, sensors, unit)
    wiring, where = laid.wiring, np.array(list(laid.places.values()))
    draw_robot(ax, robot, (0.0, 0.0, math.pi / 2), edge=style.CYLINDER)
    _draw_links(ax, wiring, laid.curves, unit)
    _draw_neurons(ax, laid, sensors, unit)
    working = [(k, c) for k, c in zip(wiring.links, laid.curves, strict=True) if wiring.works(k)]
    labels = label_places([c for _, c in working], where, np.array(list(laid.sizes.values())), unit)
    for (link, _), spot in zip(working, labels, strict=True):
        _label(ax, link, spot, unit)
    reach = np.maximum(robot.radius, np.abs(where).max(axis=0) + 0.4 * unit) + 0.12
    wide, high = reach.tolist()
    low = min(-robot.radius, float(where[:, 1].min()) - 0.4 * unit) - 0.12
    ax.set(xlim=(-wide, wide), ylim=(low, high), aspect="equal")
    ax.axis("off")


def _draw_links(ax: Axes, wiring: Wiring, curves: list[Floats], unit: float) -> None:
    """Curves with an arrow or a dot at their ends, widths by weight."""
    every = list(zip(wiring.links, curves, strict=True))
    for pale, excitatory in product((True, False), (True, False)):
        chosen = [(k, c) for k, c in every if (k.weight >= 0) == excitatory and wiring.works(k) != pale]
        if not chosen:
            continue
        colour, alpha = style.INK if excitatory else style.INHIBITORY, 0.18 if pale else 1.0
        wide = [0.6 if pale else 0.5 + 0.5 * abs(k.weight) for k, _ in chosen]
        lines = LineCollection(
            [c for _, c in chosen], colors=colour, linewidths=wide, linestyles=(0, (3, 2)) if pale else "-"
        )
        ax.add_collection(lines).set(alpha=alpha, zorder=7)
        if excitatory:
            heads = [_arrow(c, unit * (0.14 + 0.02 * abs(k.weight))) for k, c in chosen]
        else:
            heads = [_dot(c[-1], unit * (0.075 + 0.012 * abs(k.weight))) for k, c in chosen]
        ax.add_collection(PolyCollection(heads, facecolors=colour, edgecolors="none", alpha=alpha, zorder=8))


def _arrow(curve: Floats, size: float) -> Floats:
    along = curve[-1] - curve[-3]
    along = along / np.hypot(*along)
    across = np.array([-along[1], along[0]])
    tip = curve[-1] + 0.3 * size * along
    back = tip - 1.5 * size * along
    return np.array([tip, back + 0.62 * size * across, back - 0.62 * size * across])


def _dot(place: Floats, size: float) -> Floats:
    t = np.linspace(0, 2 * np.pi, 16, endpoint=False)
    return np.asarray(place + size * np.stack([np.cos(t), np.sin(t)], axis=1))


def _draw_neurons(ax: Axes, laid: Layout, sensors: Sequence[int], unit: float) -> None:
    """Inputs round and tinted, outputs square, hidden neurons round; number and threshold inside."""
    wiring = laid.wiring
    for n, (x, y) in laid.places.items():
        pale, size = 1.0 if n in wiring.useful else 0.4, laid.sizes[n]
        shape: Patch
        if wiring.kind(n) == "input":
            shape = Circle((x, y), size, facecolor=style.FLOOR, edgecolor=style.RAY, linewidth=1.2)
        elif wiring.kind(n) == "output":
            shape = Rectangle((x - size, y - size), 2 * size, 2 * size, facecolor=style.PAPER)
            shape.set(edgecolor=style.INK, linewidth=1.2)
        else:
            shape = Circle((x, y), size, facecolor=style.PAPER, edgecolor=style.INK, linewidth=1.0)
        ax.add_artist(shape)
        shape.set(zorder=9, alpha=pale if n >= wiring.inputs else None)
        text = partial(ax.text, x, ha="center", va="center", zorder=10, alpha=pale)
        threshold = n in wiring.thresholds
        text(y + 0.11 * unit * threshold, _name(n, wiring, sensors), fontsize=7.5, fontweight="bold")
        if threshold:
            text(y - 0.17 * unit, f"θ {_signed(wiring.thresholds[n])}", fontsize=6.2)


def _signed(number: int) -> str:
    return f"−{-number}" if number < 0 else str(number)


def _label(ax: Axes, link: Link, spot: Floats, unit: float) -> None:
    """Weight and delay of a link, on its curve."""
    words = ("+" if link.weight > 0 else "") + _signed(link.weight)
    words += f" d{link.delay}" if link.delay else ""
    wide, tall = (0.086 * len(words) + 0.03) * unit, 0.105 * unit
    plate = Rectangle((spot[0] - wide, spot[1] - tall), 2 * wide, 2 * tall, facecolor=style.BODY)
    ax.add_artist(plate).set(edgecolor="none", alpha=0.85, zorder=10.5)
    ax.text(spot[0], spot[1], words, ha="center", va="center_baseline", fontsize=6.6, zorder=11)


def network_figure(
    genotype: Genotype, profile: Profile, *, feeds: str, sensors: Sequence[int], title: str = ""
) -> Figure:
    """A network's picture with its legend, and a title above; other arguments as of `draw_network`."""
    hidden = len(genotype.neurons) - OUTPUTS
    wide = width_inches(hidden)
    tall = wide + 0.5
    figure = new_figure(wide, tall)
    ax = figure.add_axes((0.01, 0.33 / tall, 0.98, (wide - 0.06) / tall))
    draw_network(ax, genotype, profile, feeds=feeds, sensors=sensors)
    if title:
        figure.text(0.5, 1 - 0.05 / tall, title, ha="center", va="top", fontsize=8.5)
    legend = figure.add_axes((0.5 - 1.8 / wide, 0.0, 3.6 / wide, 0.33 / tall))
    legend.set(xlim=(0, 100), ylim=(0, 10))
    legend.axis("off")
    arrow = {"arrowstyle": "-|>", "color": style.INK, "lw": 1.4, "mutation_scale": 7}
    legend.annotate("", (9, 7), (1, 7), arrowprops=arrow)
    legend.plot([30, 37.4], [7, 7], color=style.INHIBITORY, linewidth=1.6)
    legend.plot([37.6], [7], "o", color=style.INHIBITORY, markersize=4)
    for x, y, words in (
        (10.5, 7, "excitatory"),
        (39.5, 7, "inhibitory"),
        (62, 7, "θ threshold (lower)"),
        (1, 2.3, f"+3 d2: weight +3, delay of 2 updates ({200 * profile.period_s:g} ms)"),
        (72, 2.3, "pale: no effect"),
    ):
        legend.text(x, y, words, va="center", fontsize=6)
    return figure


def network_drawing(genotype: Genotype, task: Task, profile: Profile) -> tuple[dict[str, object], list[int]]:
    """Neurons and links in cm on the robot, which faces up; y points down, as on a screen.

    Also the slots of the neurons, in the order of a track's outputs.
    """
    robot, wide = profile.to_kernel(), width_inches(len(genotype.neurons) - OUTPUTS)
    unit = UNIT_INCHES * (2 * float(robot.radius) + 0.24) / wide
    laid = lay_out(genotype, robot, task.feeds, task.sensors, unit)
    wiring, slots = laid.wiring, sorted(laid.places)
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
            "points": [[_short(x), _short(-y)] for x, y in [*curve[:-1:2], curve[-1]]],
        }
        for link, curve in zip(wiring.links, laid.curves, strict=True)
    ]  # fmt: skip
    return {"unit": round(unit, 3), "neurons": neurons, "links": links}, slots


def _name(slot: int, wiring: Wiring, sensors: Sequence[int]) -> str:
    """A sensor's number (a dash: none feeds it), the wheel, or the slot of a hidden neuron."""
    if slot < wiring.inputs:
        return str(sensors[slot]) if slot < len(sensors) and sensors[slot] >= 0 else "–"
    return "LR"[slot - wiring.inputs] if slot < wiring.inputs + OUTPUTS else str(slot)


def _short(value: float) -> float:
    return round(float(value), 2)
