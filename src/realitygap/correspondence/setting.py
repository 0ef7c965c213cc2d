"""Where trials took place: the arena, the surroundings of a robot in it, and the exemplars that apply."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from os import PathLike
from typing import NamedTuple

import numpy as np

from realitygap.correspondence.trials import RADIUS_CM, Trial
from realitygap.errors import TrackError
from realitygap.tasks.load import TASKS, load_task
from realitygap.tasks.task import Task
from realitygap.values import Floats
from realitygap.world.arena import Arena

__all__ = ["Around", "Setting", "around", "fits", "setting_of"]

NEARLY_CM = 0.25
"""A body nearly as wide as the exemplars' is described with theirs: a quarter of the just noticeable
difference, and scores stay comparable with earlier ones."""
OUTSIDE_CM = 1.0
"""How far a track's centre may appear inside an obstacle: a camera's error."""


@dataclass(frozen=True, kw_only=True)
class Setting:
    """An arena and the most similar task of the paper.

    Attributes:
        name: for display.
        arena: None: unknown, only the tracks' own motion is compared.
        exemplars: a task of the paper: obstacle avoidance without a lamp, else light seeking; None: both.
        jitter: whether jitter counts as behaviour.
    """

    name: str
    arena: Arena | None
    exemplars: str | None
    jitter: bool = True


def setting_of(trials: Sequence[Trial], task: Task | str | PathLike[str] | None = None) -> Setting:
    """The setting of trials: a task's arena, or the paper's arena in which they fit.

    Raises:
        TrackError: a track that leaves the task's arena; neither trials nor a task.
    """
    if task is not None:
        task = load_task(task)
        _require_inside(trials, task)
        return _setting(task, task.name)
    if not trials:
        raise TrackError("trials: expected at least one, or a task, got none. Name the task.")
    for name in TASKS:
        guess = load_task(name)
        if all(fits(guess.arena, t.x, t.y, t.radius_cm) for t in trials):
            return _setting(guess, f"{name} (guessed from where the tracks are)")
    return Setting(name="unknown arena: compared by motion alone", arena=None, exemplars=None)


def _setting(task: Task, name: str) -> Setting:
    if "ambient" in task.kinds and task.arena.lamps:
        return Setting(name=name, arena=task.arena, exemplars="light-seeking")
    return Setting(name=name, arena=replace(task.arena, lamps=()), exemplars="obstacle-avoidance")


def _require_inside(trials: Sequence[Trial], task: Task) -> None:
    for t in trials:
        if not fits(task.arena, t.x, t.y, t.radius_cm):
            width, depth = task.arena.size_cm
            metres = fits(task.arena, 100 * t.x, 100 * t.y, t.radius_cm)
            cure = "Name another --task, or leave it out."
            cure = "Are they in metres? Convert them to cm." if metres else cure
            raise TrackError(
                f"{t.source}, start {t.start}: expected a track in the arena of task {task.name!r} "
                f"({width:g} by {depth:g} cm, clear of its walls and cylinders), got x from {t.x.min():.1f} "
                f"to {t.x.max():.1f} and y from {t.y.min():.1f} to {t.y.max():.1f} cm. {cure}"
            )


class Around(NamedTuple):
    """Surroundings along one trial, arrays [n]; angles relative to the heading, rad, counter-clockwise."""

    clearance: Floats
    """From the body's edge to the nearest surface, cm."""
    surface: Floats
    """Direction of that surface."""
    lamp_distance: Floats | None
    """To the nearest lamp's centre, cm; None in an arena without one."""
    lamp: Floats | None
    """Direction of the lamp."""


def around(arena: Arena, x: Floats, y: Floats, heading: Floats, radius_cm: Floats | float) -> Around:
    """The surroundings of a robot.

    Args:
        arena: where it is.
        x, y, heading: the poses [n], cm and rad.
        radius_cm: of the body, one or [n].
    """
    dx, dy, gap = _nearest_surface(arena, x, y)
    clearance = gap - _as_described(radius_cm)
    lamps = [(lamp.x_cm, lamp.y_cm) for lamp in arena.lamps]
    surface = _turned(np.arctan2(dy, dx) - heading)
    if not lamps:
        return Around(clearance, surface, None, None)
    to = np.array([[lx - x, ly - y] for lx, ly in lamps])
    far = np.hypot(to[:, 0], to[:, 1])
    near = far.argmin(axis=0)
    n = np.arange(len(x))
    bearing = np.arctan2(to[near, 1, n], to[near, 0, n]) - heading
    return Around(clearance, surface, far[near, n], _turned(bearing))


def fits(arena: Arena, x: Floats, y: Floats, radius_cm: float) -> bool:
    """Whether a robot could have been at all of these positions; arguments as of `around`."""
    return bool((_nearest_surface(arena, x, y)[2] > _as_described(radius_cm) - OUTSIDE_CM).all())


def _as_described(radius_cm: Floats | float) -> Floats:
    return np.where(np.abs(np.asarray(radius_cm) - RADIUS_CM) <= NEARLY_CM, RADIUS_CM, radius_cm)


def _nearest_surface(arena: Arena, x: Floats, y: Floats) -> tuple[Floats, Floats, Floats]:
    """Direction (dx, dy) and distance of the surface nearest to a centre; negative outside the arena."""
    zero = np.zeros_like(x)
    width, depth = arena.size_cm
    found = [
        (zero - 1, zero, x), (zero + 1, zero, width - x),
        (zero, zero - 1, y), (zero, zero + 1, depth - y),
    ]  # fmt: skip
    for c in arena.cylinders:
        dx, dy = c.x_cm - x, c.y_cm - y
        found.append((dx, dy, np.hypot(dx, dy) - c.radius_cm))
    for x0, y0, x1, y1 in arena.walls:
        ex, ey = x1 - x0, y1 - y0
        share = np.clip(((x - x0) * ex + (y - y0) * ey) / (ex * ex + ey * ey), 0, 1)
        dx, dy = x0 + share * ex - x, y0 + share * ey - y
        found.append((dx, dy, np.hypot(dx, dy)))
    every = np.array(found)
    nearest = every[:, 2].argmin(axis=0)
    n = np.arange(len(x))
    return every[nearest, 0, n], every[nearest, 1, n], every[nearest, 2, n]


def _turned(angle: Floats) -> Floats:
    return (angle + np.pi) % (2 * np.pi) - np.pi
