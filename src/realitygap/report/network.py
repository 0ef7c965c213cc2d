"""A network drawn on its robot: neurons, links, weights, delays; as a picture, and for the player."""

import math
from collections.abc import Sequence
from functools import partial
from itertools import product

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Patch, Rectangle

from realitygap.control.genotype import Genotype
from realitygap.kernels.types import Robot
from realitygap.report import style
from realitygap.report.robots import draw_robot
from realitygap.report.style import new_figure
from realitygap.report.wiring import (
    OUTPUTS,
    UNIT_INCHES,
    Layout,
    Link,
    Wiring,
    label_places,
    lay_out,
    read_wiring,
    width_inches,
)
from realitygap.tasks.task import Task
from realitygap.world.robot import Profile

__all__ = ["draw_network", "network_drawing", "network_figure"]

EXCITATORY = style.INK
INSIDE = 0.72
"""Relative distance of a proximity sensor's neuron from the robot's middle, beside an ambient sensor's."""


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
    robot = profile.to_kernel()
    spots = _spots(robot, feeds)
    wiring = read_wiring(genotype)
    unit = _unit(ax, robot.radius)
    laid = lay_out(wiring, robot, spots, sensors, unit)
    draw_robot(ax, robot, (0.0, 0.0, math.pi / 2), edge=style.CYLINDER)
    _draw_links(ax, wiring, laid.curves, unit)
    _draw_neurons(ax, wiring, laid, sensors, unit)
    where = np.array(list(laid.places.values()))
    working = [(k, c) for k, c in zip(wiring.links, laid.curves, strict=True) if wiring.works(k)]
    labels = label_places([c for _, c in working], where, np.array(list(laid.sizes.values())), unit)
    for (link, _), spot in zip(working, labels, strict=True):
        _label(ax, link, spot, unit)
    reach = np.maximum(robot.radius, np.abs(where).max(axis=0) + 0.4 * unit) + 0.12
    wide, high = reach.tolist()
    low = min(-robot.radius, float(where[:, 1].min()) - 0.4 * unit) - 0.12
    ax.set(xlim=(-wide, wide), ylim=(low, high), aspect="equal")
    ax.axis("off")


def _spots(robot: Robot, feeds: str) -> np.ndarray:
    """Positions [S, 2] of the fed sensors; of two kinds at one position, proximity is inside."""
    both = {"proximity": robot.proximity.place, "ambient": robot.ambient.place}
    if "+" in feeds:
        both["proximity"] = INSIDE * robot.proximity.place
    return np.concatenate([both[kind] for kind in feeds.split("+")])


def _unit(ax: Axes, radius: float) -> float:
    """Size of a unit of drawing in these axes, cm of robot."""
    place = ax.get_position()
    width, height = ax.get_figure(root=True).get_size_inches()  # type: ignore[union-attr]
    inches = min(place.width * width, place.height * height)
    return UNIT_INCHES * (2 * radius + 0.24) / float(inches)


def _draw_links(ax: Axes, wiring: Wiring, curves: list[np.ndarray], unit: float) -> None:
    """Curves with an arrow or a dot at their ends, widths by weight."""
    every = list(zip(wiring.links, curves, strict=True))
    for pale, excitatory in product((True, False), (True, False)):
        chosen = [(k, c) for k, c in every if (k.weight >= 0) == excitatory and wiring.works(k) != pale]
        if not chosen:
            continue
        colour, alpha = EXCITATORY if excitatory else style.INHIBITORY, 0.18 if pale else 1.0
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


def _arrow(curve: np.ndarray, size: float) -> np.ndarray:
    along = curve[-1] - curve[-3]
    along = along / np.hypot(*along)
    across = np.array([-along[1], along[0]])
    tip = curve[-1] + 0.3 * size * along
    back = tip - 1.5 * size * along
    return np.array([tip, back + 0.62 * size * across, back - 0.62 * size * across])


def _dot(place: np.ndarray, size: float) -> np.ndarray:
    t = np.linspace(0, 2 * np.pi, 16, endpoint=False)
    return np.asarray(place + size * np.stack([np.cos(t), np.sin(t)], axis=1))


def _draw_neurons(ax: Axes, wiring: Wiring, laid: Layout, sensors: Sequence[int], unit: float) -> None:
    """Inputs round and tinted, outputs square, hidden neurons round; number and threshold inside."""
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


def _label(ax: Axes, link: Link, spot: np.ndarray, unit: float) -> None:
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
    arrow = {"arrowstyle": "-|>", "color": EXCITATORY, "lw": 1.4, "mutation_scale": 7}
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
    robot = profile.to_kernel()
    spots = _spots(robot, task.feeds)
    wiring = read_wiring(genotype)
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
