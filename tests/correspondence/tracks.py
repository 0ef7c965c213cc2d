"""Tracks for tests: trials written as a person's files, walkers that obey nobody."""

import csv
import math
from dataclasses import replace
from pathlib import Path

import numpy as np

from realitygap.correspondence.trials import Trial
from realitygap.world.arena import Arena


def write(path: Path, trials, *, hz: float = 10.0, lose=(), columns=(), named: bool = True) -> Path:
    """Write trials as a CSV file at another rate, some rows (of every trial) lost; `named`: by start."""
    with path.open("w", newline="") as file:
        rows = csv.writer(file)
        rows.writerow(["start"] * named + ["t_s", "x_cm", "y_cm", "heading_deg", *columns])
        for trial in trials:
            own = np.arange(len(trial)) / 10
            for i, t in enumerate(np.arange(0, trial.seconds + 1e-9, 1 / hz)):
                x, y, h = (np.interp(t, own, v) for v in (trial.x, trial.y, trial.heading))
                seen = (f"{x:.4f}", f"{y:.4f}", f"{math.degrees(h) % 360:.3f}")
                place = ("", "", "") if i in lose else seen
                rows.writerow([trial.start] * named + [f"{t:.4f}", *place, *("" for _ in columns)])
    return path


def mirrored(trials, width: float):
    """Trials in the mirror x → width − x."""
    return [replace(t, x=width - t.x, heading=math.pi - t.heading) for t in trials]


def turned(trials, width: float, depth: float):
    """Trials in a room that is turned by 180°."""
    return [replace(t, x=width - t.x, y=depth - t.y, heading=t.heading + math.pi) for t in trials]


def in_mirror(arena: Arena) -> Arena:
    """An arena in the same mirror."""
    return _moved(arena, lambda x, y: (arena.size_cm[0] - x, y))


def half_round(arena: Arena) -> Arena:
    """An arena turned by 180°."""
    return _moved(arena, lambda x, y: (arena.size_cm[0] - x, arena.size_cm[1] - y))


def _moved(arena: Arena, to) -> Arena:
    place = lambda thing: dict(zip(("x_cm", "y_cm"), to(thing.x_cm, thing.y_cm), strict=True))  # noqa: E731
    return replace(
        arena,
        walls=tuple((*to(x0, y0), *to(x1, y1)) for x0, y0, x1, y1 in arena.walls),
        cylinders=tuple(replace(c, **place(c)) for c in arena.cylinders),
        lamps=tuple(replace(lamp, **place(lamp)) for lamp in arena.lamps),
    )


def random_walker(seed: int, size=(50.0, 50.0)) -> Trial:
    """Ornstein and Uhlenbeck's turns at a steady pace, stopped by the walls."""
    draw = np.random.default_rng(seed)
    x, y, heading, turn = [size[0] / 2], [size[1] / 2], [draw.uniform(0, 6)], 0.0
    for _ in range(200):
        turn = 0.8 * turn + draw.normal(0, 1.0)
        pace = draw.uniform(-1, 4)
        heading.append(heading[-1] + turn * 0.1)
        x.append(float(np.clip(x[-1] + pace * 0.1 * math.cos(heading[-1]), 20, size[0] - 20)))
        y.append(float(np.clip(y[-1] + pace * 0.1 * math.sin(heading[-1]), 20, size[1] - 20)))
    return Trial(x=np.array(x), y=np.array(y), heading=np.array(heading), start=str(seed))


def standing(x: float, y: float, heading: float) -> Trial:
    """A robot that stands."""
    one = np.ones(201)
    return Trial(x=x * one, y=y * one, heading=heading * one)
