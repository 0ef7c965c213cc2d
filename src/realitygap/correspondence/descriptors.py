"""What a trial looks like in numbers, each in units of its own just-noticeable amount.

The amounts are physical and fixed: what a person who watches two films side by side can just tell
apart. They were written down from the size and speed of a Khepera (5.8 cm, up to 8 cm/s); what was
changed after a look at exemplars is told in docs/correspondence.md. They never depend on the sets
that are compared.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from realitygap.correspondence.surroundings import around
from realitygap.correspondence.trials import STEP_S, Trial
from realitygap.world.arena import Arena

__all__ = ["DESCRIPTORS", "Descriptor", "chosen", "describe", "jitter", "mirrored", "table"]

Floats = NDArray[np.float64]

SLOW_CM_S, STILL_DEG_S = 0.5, 10.0
"""Below these a robot does not seem to move; to turn."""
TURN_DEG_S, TURN_DEG = 25.0, 20.0
"""A turn event turns faster than this, one way, and by more than this in all."""
NEAR_CM, TOUCH_CM, FEEL_CM = 2.5, 0.3, 6.0
"""Clearances: near a surface, touching it, where infrared feels it."""


class Descriptor(NamedTuple):
    """A number that describes a trial."""

    name: str
    unit: str
    noticeable: float
    """What can just be noticed, in that unit."""
    needs: str = "motion"
    """motion: the track alone; walls: an arena; light: a lamp in it."""
    handed: bool = False
    """Changes sign in a mirror."""


DESCRIPTORS = (
    Descriptor("speed", "cm/s", 0.5),
    Descriptor("speed spread", "cm/s", 0.5),
    Descriptor("backward", "share of time", 0.1),
    Descriptor("reversals", "in 10 s", 1.0),
    Descriptor("still", "share of time", 0.1),
    Descriptor("turn rate", "deg/s", 8.0),
    Descriptor("net turn", "deg/s", 8.0, handed=True),
    Descriptor("usual turn", "deg/s", 5.0),
    Descriptor("straight", "share of time", 0.1),
    Descriptor("turns", "in 10 s", 1.0),
    Descriptor("turn size", "deg", 20.0),
    Descriptor("side of turns", "share of turning", 0.4, handed=True),
    Descriptor("one-sidedness", "share of turning", 0.15),
    Descriptor("looping", "share of time", 0.15),
    Descriptor("jitter", "deg/s", 4.0),
    Descriptor("spread", "cm", 3.0),
    Descriptor("ground", "places", 3.0),
    Descriptor("clearance", "cm", 1.0, "walls"),
    Descriptor("near", "share of time", 0.1, "walls"),
    Descriptor("touching", "share of time", 0.1, "walls"),
    Descriptor("along", "share of time", 0.1, "walls"),
    Descriptor("turning clearance", "cm", 0.5, "walls"),
    Descriptor("light distance", "cm", 5.0, "light"),
    Descriptor("light reached", "cm", 5.0, "light"),
    Descriptor("light bearing", "deg", 10.0, "light"),
    Descriptor("light response", "deg/s", 5.0, "light"),
)


def chosen(arena: Arena | None) -> tuple[Descriptor, ...]:
    """The descriptors that can be told in an arena; of the motion alone where there is none."""
    told = {"motion"} | ({"walls"} if arena else set()) | ({"light"} if arena and arena.lamps else set())
    return tuple(d for d in DESCRIPTORS if d.needs in told)


def table(trials: Iterable[Trial], arena: Arena | None) -> Floats:
    """Descriptors of trials, a row a trial, in units of what can just be noticed: [n, d]."""
    which = chosen(arena)
    scale = np.array([d.noticeable for d in which])
    rows = [describe(trial, arena) for trial in trials]
    made = np.array([[row[d.name] for d in which] for row in rows], np.float64).reshape(-1, len(which))
    return np.asarray(made / scale, np.float64)


def describe(trial: Trial, arena: Arena | None) -> dict[str, float]:
    """A trial's descriptors by name, in their own units."""
    turn = np.degrees(np.diff(trial.heading)) / STEP_S
    middle = (trial.heading[:-1] + trial.heading[1:]) / 2
    dx, dy = np.diff(trial.x) / STEP_S, np.diff(trial.y) / STEP_S
    forward = dx * np.cos(middle) + dy * np.sin(middle)
    told = {**_movement(forward, turn), **_turning(forward, turn), **_ground(trial)}
    if arena is not None:
        told |= _surroundings(trial, turn, forward, arena)
    return told


def jitter(turn: Floats) -> float:
    """How unsteady the turn rate is, deg/s: the quieter three quarters of its second differences.

    Second differences leave a steady turn out; the trimming leaves out where turns begin and end.
    """
    rough = np.sort(np.abs(np.diff(turn, 2))) / np.sqrt(6.0)
    return float(rough[: max(1, 3 * len(rough) // 4)].mean()) * 1.25


def _movement(forward: Floats, turn: Floats) -> dict[str, float]:
    calm = _smooth(forward)
    way = np.sign(calm) * (np.abs(calm) > SLOW_CM_S)
    moving = way[way != 0]
    seconds = len(forward) * STEP_S
    return {
        "speed": float(np.abs(forward).mean()),
        "speed spread": float(calm.std()),
        "backward": float((way < 0).mean()),
        "reversals": float((np.diff(moving) != 0).sum() / seconds * 10),
        "still": float(((way == 0) & (np.abs(_smooth(turn)) < STILL_DEG_S)).mean()),
    }


def _turning(forward: Floats, turn: Floats) -> dict[str, float]:
    calm = _smooth(turn)
    sizes = np.array(_turn_events(calm))
    counted = np.clip(sizes, -180, 180)
    square = float((counted**2).sum())  # large turns tell the side, what noise does is small
    side = float((counted * np.abs(counted)).sum()) / square if square > 0 else 0.0
    moving = np.abs(_smooth(forward)) > SLOW_CM_S
    window = round(5.0 / STEP_S)
    sums = np.cumsum(np.append(0.0, turn)) * STEP_S
    far = np.abs(sums[window:] - sums[:-window]) if len(sums) > window else np.abs(sums[-1:])
    return {
        "turn rate": float(np.abs(calm).mean()),
        "net turn": float(turn.mean()),
        "usual turn": float(np.median(np.abs(_smooth(turn, 7)))),
        "straight": float((moving & (np.abs(_smooth(turn, 7)) < STILL_DEG_S)).mean()),
        "turns": len(sizes) / (len(turn) * STEP_S) * 10,
        "turn size": float(np.minimum(np.abs(sizes), 360).mean()) if len(sizes) else 0.0,
        "side of turns": side,
        "one-sidedness": abs(side),
        "looping": float((far > 150).mean()),
        "jitter": jitter(turn),
    }


def _turn_events(calm: Floats) -> list[float]:
    """The angles of a trial's turns, deg, left positive."""
    way = np.sign(calm) * (np.abs(calm) > TURN_DEG_S)
    edges = np.flatnonzero(np.diff(np.concatenate([[0.0], way, [0.0]])))
    sizes = [float(calm[a:b].sum()) * STEP_S for a, b in pairwise(edges) if way[a] != 0]
    return [size for size in sizes if abs(size) > TURN_DEG]


def _ground(trial: Trial) -> dict[str, float]:
    """How far the robot came about; a place is new 4 cm from all others."""
    xy = np.column_stack([trial.x, trial.y])[::3]
    places = np.empty((0, 2))
    while len(xy):
        places = np.vstack([places, xy[:1]])
        xy = xy[np.hypot(*(xy - xy[0]).T) > 4.0]
    spread = float(np.hypot(trial.x.std(), trial.y.std()))
    return {"spread": spread, "ground": len(places) / trial.seconds * 20.0}


def _surroundings(trial: Trial, turn: Floats, forward: Floats, arena: Arena) -> dict[str, float]:
    here = around(arena, trial.x[:-1], trial.y[:-1], trial.heading[:-1])
    near = here.clearance < NEAR_CM
    going = np.where(forward < 0, np.pi, 0.0)
    aside = np.abs(np.sin(here.surface))
    ahead = (here.clearance < FEEL_CM) & (np.cos(here.surface - going) > 0.3)
    turning = ahead & (np.abs(_smooth(turn)) > TURN_DEG_S)
    told = {
        "clearance": float(here.clearance.mean()),
        "near": float(near.mean()),
        "touching": float((here.clearance < TOUCH_CM).mean()),
        "along": float((near & (aside > 0.8) & (np.abs(forward) > SLOW_CM_S)).mean()),
        "turning clearance": float(np.maximum(here.clearance, 0)[turning].sum() / (turning.sum() + 1.0)),
    }
    if here.lamp is not None and here.lamp_distance is not None:
        off = np.abs(here.lamp) > np.radians(20)
        toward = _smooth(turn) * np.sign(here.lamp) * off
        told |= {
            "light distance": float(here.lamp_distance.mean()),
            "light reached": float(here.lamp_distance[-10:].mean()),
            "light bearing": float(np.degrees(np.abs(here.lamp)).mean()),
            "light response": float(toward.sum() / (off.sum() + 3.0)),
        }
    return told


def _smooth(values: Floats, width: int = 3) -> Floats:
    """A running mean; ends repeat."""
    half = width // 2
    padded = np.concatenate([np.repeat(values[:1], half), values, np.repeat(values[-1:], half)])
    return np.convolve(padded, np.full(width, 1 / width), "valid")


def mirrored(descriptors: Sequence[Descriptor]) -> Floats:
    """Signs [d] that turn a row of descriptors into its mirror image's."""
    return np.array([-1.0 if d.handed else 1.0 for d in descriptors])
