"""Made-up data that the report's tests draw: no simulation is needed to look at a figure."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from realitygap.control.genotype import Genotype
from realitygap.kernels.types import MAX_DELAY
from realitygap.report.evolution import Mean, NoiseClass, Row, TaskPart, mean_of
from realitygap.report.page import Picture
from realitygap.track import Trajectory
from realitygap.values import Pose
from tests.conftest import FIGURE

LEVELS = {0.0: "zero", 1.0: "observed", 2.0: "double"}
EQUAL = {0.0: [0.5, 0.6, 0.55], 1.0: [0.56, 0.52, 0.58], 2.0: [0.54, 0.6, 0.5]}
APART = {0.0: [0.5, 0.51, 0.52], 1.0: [0.9, 0.91, 0.92], 2.0: [0.2, 0.21, 0.22]}
"""Means of runs by noise level: alike, and clearly apart."""


def circle(steps: int = 50, *, radius: float = 8.0, centre: tuple[float, float] = (25.0, 25.0)) -> Trajectory:
    """A robot that drives along a circle, counter-clockwise, with rising readings."""
    turn = np.linspace(0, 1.5 * np.pi, steps + 1)
    x, y = centre[0] + radius * np.cos(turn), centre[1] + radius * np.sin(turn)
    heading = turn + np.pi / 2
    rising = np.repeat(np.linspace(0, 480, steps)[:, None], 8, axis=1)
    return Trajectory(
        t=0.1 * np.arange(steps),
        x=x[:-1],
        y=y[:-1],
        heading=heading[:-1],
        proximity=2 * rising,
        ambient=rising,
        inputs=np.zeros((steps, 8), np.int64),
        commands=np.tile([3, 7], (steps, 1)),
        wheels=np.tile([3.0, 7.0], (steps, 1)),
        contact=np.zeros(steps, bool),
        end=Pose(x=float(x[-1]), y=float(y[-1]), heading=float(heading[-1])),
    )


def random_genotype(
    seed: int, *, hidden: float = 0.1, slots: int = 30, links: int = 8, inputs: int = 8
) -> Genotype:
    """A random genotype, every field filled whether expressed or not."""
    random = np.random.default_rng(seed)
    genes = np.zeros((slots, 2 + 4 * links), np.int8)
    genes[:, 0] = random.random(slots) < hidden
    genes[: inputs + 2, 0] = 1
    genes[:, 1] = random.integers(-10, 11, slots)
    genes[:, 2::4] = random.random((slots, links)) < 0.5
    genes[:, 3::4] = random.integers(0, slots, (slots, links))
    genes[:, 4::4] = random.integers(-4, 5, (slots, links))
    genes[:, 5::4] = random.integers(0, MAX_DELAY + 1, (slots, links))
    return Genotype(genes, inputs)


def table(
    fittest: dict[float, list[float]],
    champion: dict[float, list[float]],
    stored: float = 0.7,
    scale: float = 1.0,
) -> TaskPart:
    """A table whose individuals score the same at every noise level: given means by noise class."""
    classes = []
    for level, means in fittest.items():
        rows = tuple(
            Row(
                run=SimpleNamespace(
                    index=k + 1,
                    id=k + 1,
                    name=f"made-up/{level}/{k + 1}",
                    evaluations=1000,
                    finished=True,
                    best_fitness=stored * scale,
                ),
                means={
                    (who, at): _mean(value * scale)
                    for who, value in (("fittest", means[k]), ("champion", champion[level][k]))
                    for at in LEVELS
                },
            )
            for k in range(len(means))
        )
        classes.append(NoiseClass(level=level, name=LEVELS[level], rows=rows))
    return TaskPart(task=made_up(scale), conditions=tuple(classes), levels=LEVELS)


def made_up(scale: float = 1.0) -> SimpleNamespace:
    """What a table needs to know of its task."""
    return SimpleNamespace(name="made-up", fitness_unit="", fitness_scale=scale)


def _mean(value: float) -> Mean:
    """The mean of two trials about a value."""
    mean = mean_of([value - 0.01 * abs(value), value + 0.01 * abs(value)])
    assert mean is not None
    return mean


def draw_only(patch: pytest.MonkeyPatch, wanted: Callable[[str], bool]) -> None:
    """Pages have an empty figure, as files too, in the place of each whose name is not wanted."""
    save = Picture.save

    def some(picture: Picture, folder: Path, **settings: int) -> str:
        if wanted(picture.name):
            return save(picture, folder, **settings)
        for kind in ("png", "svg"):
            (folder / f"{picture.name}.{kind}").write_text(FIGURE, "utf-8")
        return FIGURE

    patch.setattr(Picture, "save", some)
