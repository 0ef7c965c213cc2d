"""The crossed design: every controller, evolved at one level, compared at every level."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from realitygap.errors import StudyError
from realitygap.experiments.noise.contrasts import Effect, unpaired
from realitygap.values import Floats

__all__ = ["FEWEST", "Crossed", "robot_level"]

Weights = NDArray[np.float64]

FEWEST = 5
"""Smallest number of runs in a cell for which resampling measures uncertainty."""


def robot_level(levels: Sequence[float]) -> float:
    """The robot's own level: 1, or the study's level nearest to it (by roots).

    Level 1 is the noise that the calibration measured on the robot.

    Raises:
        StudyError: fewer than two levels: nothing can be compared.
    """
    known = sorted(set(map(float, levels)))
    if len(known) < 2:
        raise StudyError(f"levels: expected two or more different ones, got {known}.")
    return min(known, key=lambda level: (abs(level**0.5 - 1.0), level))


@dataclass(frozen=True, kw_only=True, eq=False)
class Crossed:
    """Scores of n controllers at L levels of comparison.

    Attributes:
        levels: [L], rising. robot: the robot's own level, one of them.
        task, seed_set, run, home, evolved: [n], of the controllers.
        name: [n], of its behaviour in simulation.
        score: [n, L], correspondence score 0 to 10 against the simulation at each level;
            behaviour, layout: its two parts.
        home_score: [n, L], the score on the calibration unit alone; nan if it was not kept.
        noisiness, responsiveness: [n, L], positive if the situated robot has more.
        simulated, situated: [n], fitness at the own level, and on the twin.
        situated_home, situated_foreign: [n], fitness on the calibration unit, and its mean over the others.
    """

    levels: Floats
    robot: float
    task: NDArray[np.str_]
    seed_set: NDArray[np.int64]
    run: NDArray[np.int64]
    home: NDArray[np.int64]
    evolved: Floats
    name: NDArray[np.str_]
    score: Floats
    behaviour: Floats
    layout: Floats
    home_score: Floats
    noisiness: Floats
    responsiveness: Floats
    simulated: Floats
    situated: Floats
    situated_home: Floats
    situated_foreign: Floats

    def __len__(self) -> int:
        return len(self.task)

    @property
    def tasks(self) -> list[str]:
        """Tasks in order of appearance."""
        return list(dict.fromkeys(self.task.tolist()))

    @property
    def sets(self) -> list[int]:
        """Numbers of the seed sets."""
        return sorted(set(self.seed_set.tolist()))

    def at(self, level: float) -> Floats:
        """Scores [n] against the simulation at one level."""
        column: Floats = self.score[:, self.index(level)]
        return column

    def own(self, *, home: bool = False) -> Floats:
        """Scores [n] against the simulations at the level at which each controller evolved: the diagonal.

        Over all units; with `home` over the calibration unit alone.
        """
        columns = np.searchsorted(self.levels, self.evolved)
        scores: Floats = (self.home_score if home else self.score)[np.arange(len(self)), columns]
        return scores

    def index(self, level: float) -> int:
        """A level's index among the levels."""
        return int(np.searchsorted(self.levels, level))

    def part(self, *, task: str | None = None, seed_set: int | None = None) -> Self:
        """Only the controllers of one task, of one seed set."""
        keep = np.ones(len(self), bool)
        if task is not None:
            keep &= self.task == task
        if seed_set is not None:
            keep &= self.seed_set == seed_set
        return self.only(keep)

    def only(self, keep: NDArray[np.bool_]) -> Self:
        """Only the controllers that are marked [n]."""
        names = [f.name for f in fields(self) if f.name not in ("levels", "robot")]
        return replace(self, **{name: getattr(self, name)[keep] for name in names})

    def cells(self) -> Iterator[NDArray[np.int64]]:
        """Rows of each cell of the design: one task, seed set and evolved level."""
        keys = list(zip(self.task.tolist(), self.seed_set.tolist(), self.evolved.tolist(), strict=True))
        for key in dict.fromkeys(keys):
            yield np.array([i for i, other in enumerate(keys) if other == key], np.int64)

    def between(
        self, values: Floats, first: NDArray[np.int64], second: NDArray[np.int64], weights: Floats | None
    ) -> Effect:
        """Effect of values [n] between two groups of controllers, by their rows, within task and calibration
        unit; `weights` as of `resamples`, or None."""
        strata = list(zip(self.task.tolist(), self.home.tolist(), strict=True))
        return unpaired(
            values[first],
            values[second],
            strata=([strata[i] for i in first], [strata[i] for i in second]),
            weights=None if weights is None else (weights[:, first], weights[:, second]),
        )

    def resamples(self, count: int, *, seed: int = 0) -> Weights | None:
        """Number of times each controller is drawn in each resample [count, n]; None if cells are too small.

        In cells of k runs the resampled spread is too small by √(1 − 1/k): a 95 % interval contains the truth
        in 94.4 % of studies of 20 runs, in 93.7 % with 10.
        """
        cells = list(self.cells())
        if count < 1 or min(map(len, cells), default=0) < FEWEST:
            return None
        draw = np.random.default_rng(seed)
        weights = np.zeros((count, len(self)))
        for rows in cells:
            weights[:, rows] = draw.multinomial(len(rows), np.full(len(rows), 1 / len(rows)), size=count)
        return weights
