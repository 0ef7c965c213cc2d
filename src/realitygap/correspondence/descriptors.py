"""The numbers that describe a trial, each with its just-noticeable difference.

These differences are physical and fixed: what a person can just notice when watching two films side by side.
They were chosen from the size and speed of a Khepera (5.8 cm, up to 8 cm/s); changes after a look at
exemplars are listed with the validation of the score (studies/correspondence). They never depend on the
compared sets.
"""

from collections.abc import Sequence
from os import PathLike
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from realitygap.correspondence.setting import Around, around, fits
from realitygap.correspondence.trials import STEP_S, Trial, resampled
from realitygap.errors import TrackError
from realitygap.kernels.types import Path
from realitygap.tasks.load import load_task
from realitygap.tasks.task import Task
from realitygap.track import Track
from realitygap.values import Floats
from realitygap.world.arena import Arena
from realitygap.world.robot import Profile, load_profile

__all__ = [
    "DESCRIPTORS", "FOR_LARGE", "FOR_NAMES", "Descriptor", "chosen", "describe", "describe_all", "in_units",
    "jitter", "mirrored",
]  # fmt: skip


class Descriptor(NamedTuple):
    """A number that describes a trial."""

    name: str
    unit: str
    noticeable: float
    """The just-noticeable difference, in that unit."""
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

FOR_NAMES = (
    Descriptor("free bend", "deg/cm", 2.0, "walls", handed=True),
    Descriptor("free straight", "share of time", 0.1, "walls"),
    Descriptor("turning away", "share of turning", 0.15, "walls"),
    Descriptor("side near", "share of turning", 0.15, "walls", handed=True),
    Descriptor("wall side", "share of time", 0.15, "walls", handed=True),
)
"""Descriptors that distinguish kinds of behaviour and are not part of a score: movement far from everything;
whether it turns away from what is ahead, and always to one side; on which side it has walls."""
FOR_LARGE = (
    Descriptor("bend to wall", "deg/cm", 1.0, "walls"),
    Descriptor("wall distance spread", "cm", 1.0, "walls"),
    Descriptor("turning in touch", "share of turning", 0.15, "walls"),
)
"""Descriptors for robots that see little to their sides: whether it bends back to a wall beside it, how
evenly it keeps its distance, and how much of its turning is due to a wall."""


def chosen(arena: Arena | None) -> tuple[Descriptor, ...]:
    """The descriptors that are defined in an arena; without one those of motion alone."""
    needs = {"motion"} | ({"walls"} if arena else set()) | ({"light"} if arena and arena.lamps else set())
    return tuple(d for d in DESCRIPTORS if d.needs in needs)


def mirrored(descriptors: Sequence[Descriptor]) -> Floats:
    """Signs [d] that turn a row of descriptors into that of its mirror image."""
    return np.array([-1.0 if d.handed else 1.0 for d in descriptors])


# Of trials

SLOW_CM_S, STILL_DEG_S = 0.5, 10.0
"""Below these a robot does not appear to move; to turn."""
TURN_DEG_S, TURN_DEG = 25.0, 20.0
"""A turn event is one-sided, faster than this, and larger than this in all."""
NEAR_CM, TOUCH_CM, FEEL_CM = 2.5, 0.3, 6.0
"""Clearances: near a surface, touching it, within range of infrared."""


def in_units(described: dict[str, Floats], descriptors: Sequence[Descriptor]) -> Floats:
    """Descriptors of trials, as by `describe_all`, in just-noticeable amounts: [n, d], a row a trial."""
    return np.stack([described[d.name] / d.noticeable for d in descriptors], axis=1)


def describe_all(trials: Sequence[Trial], arena: Arena | None) -> dict[str, Floats]:
    """Descriptors by name, in their own units, [n] each; trials of one length are computed together."""
    every = (*chosen(arena), *((*FOR_NAMES, *FOR_LARGE) if arena else ()))
    made = {d.name: np.empty(len(trials)) for d in every}
    sizes = np.array([len(t) for t in trials])
    for size in np.unique(sizes):
        rows = [int(i) for i in np.flatnonzero(sizes == size)]
        x, y, heading = np.stack([(trials[i].x, trials[i].y, trials[i].heading) for i in rows], axis=1)
        radius = np.array([[trials[i].radius_cm] for i in rows])
        for name, values in _of_one_length(x, y, heading, radius, arena).items():
            made[name][rows] = values
    return made


def describe(
    path: Path, task: Task | str | PathLike[str], profile: Profile | str | PathLike[str]
) -> dict[str, Floats]:
    """Descriptors of a batch of simulated trials, by name: of each trial, in their own units.

    Args:
        path: as from `Simulation.tracks`: arrays [..., steps], after each step.
        task: whose arena is used; a Task, a name or a file.
        profile: the robot's; a Profile, a name or a file.

    Returns:
        Arrays [...] by name, of all descriptors that this arena allows.

    Raises:
        TrackError: trials shorter than two seconds, or outside the task's arena.
    """
    made = np.array((path.x, path.y, path.heading), np.float64)
    (x, y), steps = made[:2], made.shape[-1]
    task, profile, seen = load_task(task), load_profile(profile), np.isfinite(x) & np.isfinite(y)
    if not fits(task.arena, x[seen], y[seen], 0.0):
        raise TrackError(
            f"path: expected one inside the arena of task {task.name!r}, got one that leaves it. Give the "
            "task of the simulation that made it: simulation.task."
        )
    rows = (np.reshape(one, (-1, steps)) for one in made)
    t, radius_cm = np.arange(steps, dtype=np.float64) * profile.period_s, profile.body.radius_cm
    tracks = (Track(t=t, x=x, y=y, heading=h, seen_by="simulation") for x, y, h in zip(*rows, strict=True))
    described = describe_all([resampled(track, radius_cm=radius_cm) for track in tracks], task.arena)
    return {name: values.reshape(x.shape[:-1]) for name, values in described.items()}


def _of_one_length(
    x: Floats, y: Floats, heading: Floats, radius: Floats, arena: Arena | None
) -> dict[str, Floats]:
    """Descriptors of tracks [n, t] of bodies [n, 1]."""
    turn = np.degrees(np.diff(heading)) / STEP_S
    middle = (heading[:, :-1] + heading[:, 1:]) / 2
    dx, dy = np.diff(x) / STEP_S, np.diff(y) / STEP_S
    forward = dx * np.cos(middle) + dy * np.sin(middle)
    described = {**_movement(forward, turn), **_turning(forward, turn), **_ground(x, y)}
    if arena is not None:
        every = np.broadcast_to(radius, turn.shape).ravel()
        flat = around(arena, x[:, :-1].ravel(), y[:, :-1].ravel(), heading[:, :-1].ravel(), every)
        described |= _surroundings(flat, turn, forward)
    return described


def jitter(turn: Floats) -> Floats:
    """Unsteadiness of turn rates [n, t], deg/s: from the quieter three quarters of their second differences.

    Second differences exclude steady turns; the trimming excludes beginnings and ends of turns.
    """
    rough = np.sort(np.abs(np.diff(turn, 2))) / np.sqrt(6.0)
    return np.asarray(rough[:, : max(1, 3 * rough.shape[1] // 4)].mean(axis=1) * 1.25)


def _movement(forward: Floats, turn: Floats) -> dict[str, Floats]:
    calm = _smooth(forward)
    way = np.sign(calm) * (np.abs(calm) > SLOW_CM_S)
    latest = np.maximum.accumulate(np.where(way != 0, np.arange(way.shape[1]), 0), axis=1)
    held = np.take_along_axis(way, latest, axis=1)  # the direction in which it last moved
    seconds = forward.shape[1] * STEP_S
    return {
        "speed": np.abs(forward).mean(axis=1),
        "speed spread": calm.std(axis=1),
        "backward": (way < 0).mean(axis=1),
        "reversals": (held[:, 1:] * held[:, :-1] < 0).sum(axis=1) / seconds * 10,
        "still": ((way == 0) & (np.abs(_smooth(turn)) < STILL_DEG_S)).mean(axis=1),
    }


def _turning(forward: Floats, turn: Floats) -> dict[str, Floats]:
    calm, slow = _smooth(turn), np.abs(_smooth(turn, 7))
    moving = np.abs(_smooth(forward)) > SLOW_CM_S
    window = round(5.0 / STEP_S)
    sums = np.cumsum(np.pad(turn, ((0, 0), (1, 0))), axis=1) * STEP_S
    far = np.abs(sums[:, window:] - sums[:, :-window] if sums.shape[1] > window else sums[:, -1:])
    return {
        "turn rate": np.abs(calm).mean(axis=1),
        "net turn": turn.mean(axis=1),
        "usual turn": np.median(slow, axis=1),
        "straight": (moving & (slow < STILL_DEG_S)).mean(axis=1),
        "looping": (far > 150).mean(axis=1),
        "jitter": jitter(turn),
        **_turn_events(calm),
    }


def _turn_events(calm: Floats) -> dict[str, Floats]:
    """Number, size and side of each trial's turns; left is positive."""
    n, steps = calm.shape
    padded = np.pad(calm, ((0, 0), (1, 1))).ravel()  # a still step at both ends separates the trials
    way = np.sign(padded) * (np.abs(padded) > TURN_DEG_S)
    edges = np.flatnonzero(np.diff(way)) + 1
    whole = np.add.reduceat(padded, edges) * STEP_S if len(edges) else np.empty(0)
    kept = (way[edges] != 0) & (np.abs(whole) > TURN_DEG)
    sizes, owner = whole[kept], edges[kept] // (steps + 2)

    def total(values: Floats) -> Floats:
        return np.asarray(np.bincount(owner, values, minlength=n), np.float64)

    count = np.bincount(owner, minlength=n)
    counted = np.clip(sizes, -180, 180)
    square = total(counted**2)  # large turns show the side; those by noise are small
    side = total(counted * np.abs(counted)) / np.where(square > 0, square, 1.0)
    return {
        "turns": count / (steps * STEP_S) * 10,
        "turn size": total(np.abs(counted)) / np.maximum(count, 1),
        "side of turns": side,
        "one-sidedness": np.abs(side),
    }


def _ground(x: Floats, y: Floats) -> dict[str, Floats]:
    """Area that robots covered; a place counts as new if it is 4 cm from all others."""
    px, py = x[:, ::3], y[:, ::3]
    left, places, every = np.ones(px.shape, bool), np.zeros(len(px)), np.arange(len(px))
    while left.any():
        places += left.any(axis=1)
        first = left.argmax(axis=1)
        far = np.hypot(px - px[every, first][:, None], py - py[every, first][:, None])
        left &= far > 4.0
    spread = np.hypot(x.std(axis=1), y.std(axis=1))
    return {"spread": spread, "ground": places / ((x.shape[1] - 1) * STEP_S) * 20.0}


def _surroundings(flat: Around, turn: Floats, forward: Floats) -> dict[str, Floats]:
    """Descriptors of the surroundings; `flat` has rows [n · t], turn and forward [n, t]."""
    clearance, surface = flat.clearance.reshape(turn.shape), flat.surface.reshape(turn.shape)
    near = clearance < NEAR_CM
    going = np.where(forward < 0, np.pi, 0.0)
    aside = np.abs(np.sin(surface))
    ahead = (clearance < FEEL_CM) & (np.cos(surface - going) > 0.3)
    turning = ahead & (np.abs(_smooth(turn)) > TURN_DEG_S)
    described = {
        "clearance": clearance.mean(axis=1),
        "near": near.mean(axis=1),
        "touching": (clearance < TOUCH_CM).mean(axis=1),
        "along": (near & (aside > 0.8) & (np.abs(forward) > SLOW_CM_S)).mean(axis=1),
        "turning clearance": (np.maximum(clearance, 0) * turning).sum(axis=1) / (turning.sum(axis=1) + 1.0),
        **_for_names(clearance, surface, turn, np.abs(forward)),
    }
    if flat.lamp is not None and flat.lamp_distance is not None:
        lamp, distance = flat.lamp.reshape(turn.shape), flat.lamp_distance.reshape(turn.shape)
        off = np.abs(lamp) > np.radians(20)
        toward = _smooth(turn) * np.sign(lamp) * off
        described |= {
            "light distance": distance.mean(axis=1),
            "light reached": distance[:, -10:].mean(axis=1),
            "light bearing": np.degrees(np.abs(lamp)).mean(axis=1),
            "light response": toward.sum(axis=1) / (off.sum(axis=1) + 3.0),
        }
    return described


def _for_names(clearance: Floats, surface: Floats, turn: Floats, pace: Floats) -> dict[str, Floats]:
    """Descriptors for names, from clearances, bearings of the nearest surface, turn rates and paces [n, t].

    A constant is added to the denominators of shares, so that rare events give shares near 0.
    """

    def share(part: NDArray[Any], whole: NDArray[Any], more: float) -> Floats:
        return np.asarray(part.sum(axis=1) / (whole.sum(axis=1) + more))

    slow, turn = _smooth(turn, 7), _smooth(turn)
    moving, side, rate = pace > SLOW_CM_S, np.sign(np.sin(surface)), np.abs(turn)
    free = moving & ((clearance > 3.5) | (np.cos(surface) < 0))
    faced = rate * ((clearance < 5.0) & (np.cos(surface) > 0.2) & (np.abs(np.sin(surface)) > 0.3))
    close = rate * ((clearance < FEEL_CM) & (np.cos(surface) > -0.3))
    beside = moving & (clearance < 4.0) & (np.abs(np.sin(surface)) > 0.6)
    spread = np.sqrt(
        share(beside * (clearance - share(clearance * beside, beside, 1e-9)[:, None]) ** 2, beside, 1e-9)
    )
    return {
        "free bend": np.clip(share(turn * free, pace * free, 20.0), -20, 20),
        "free straight": share(free * (rate < 12.0), free, 3.0),
        "turning away": share(-np.sign(turn) * side * faced, faced, 30.0),
        "side near": share(np.sign(turn) * close, close, 30.0),
        "wall side": share(side * beside, beside, 5.0),
        "bend to wall": share(np.maximum(slow * side, 0) * beside, pace * beside, 10.0),
        "wall distance spread": spread * (beside.sum(axis=1) > 5),
        "turning in touch": share(rate * moving * (clearance < TOUCH_CM), rate * moving, 30.0),
    }


def _smooth(values: Floats, width: int = 3) -> Floats:
    """A running mean along the rows of [n, t]; end values are repeated."""
    half = width // 2
    padded = np.pad(values, ((0, 0), (half, half)), mode="edge")
    steps = values.shape[1]
    return np.asarray(sum(padded[:, k : k + steps] for k in range(width)) / width)
