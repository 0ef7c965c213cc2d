"""Rewards that add up to a task's score, whatever the score is.

After step k of K a path is worth k/K of the score of its first k rows, so that at its end it is worth its
score; a step's reward is the rise in that worth.
"""

from collections.abc import Callable
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from realitygap.errors import TaskError
from realitygap.kernels.params import Path, Room
from realitygap.tasks.score import CompiledScore

__all__ = ["Rewards"]


class Rewards:
    """The rewards of N robots.

    Args:
        score: the task's.
        room: where they are.
        robots: N.
        steps: of a trial.

    Attributes:
        sums: float[N], of each trial so far: at its end its score.
    """

    def __init__(self, score: CompiledScore, room: Room, robots: int, steps: int) -> None:
        self._score, self._room, self._steps = score, room, steps
        self._take = _prefix_loop(score)
        self.sums = np.zeros(robots)

    def begin(self, which: NDArray[np.int64]) -> None:
        """Start trials of these robots."""
        self.sums[which] = 0.0

    def next(
        self, paths: NDArray[np.float64], done: NDArray[np.int64], which: NDArray[np.int64]
    ) -> NDArray[np.float64]:
        """The rewards of the steps that robots `which` have just done.

        Args:
            paths: float[N, 6, steps], the rows of each as in params.Path.
            done: int[N], steps of each that are done.
            which: int[n].

        Raises:
            TaskError: the score failed on a part of a path, or was not a finite number.
        """
        scores = np.zeros(len(which))
        try:
            self._take(paths, done, which, self._room, scores)
        except Exception as error:
            raise self._failure(error, paths, done, which) from None
        if not np.isfinite(scores).all():
            raise TaskError("score: expected a finite number for every part of a path from its beginning.")
        worth = scores * done[which] / self._steps
        rewards = worth - self.sums[which]
        self.sums[which] = worth
        made: NDArray[np.float64] = rewards
        return made

    def _failure(self, error: Exception, paths: Any, done: Any, which: Any) -> Exception:
        """The user's line that failed."""
        for r in which:
            path = Path(*(row[: done[r]] for row in paths[r]))
            try:
                self._score(path, self._room)
            except TaskError as told:
                return told
        return error


@lru_cache(maxsize=16)
def _prefix_loop(score: CompiledScore) -> Callable[..., None]:
    return score.around(_take)


def _take(paths: Any, done: Any, which: Any, room: Any, scores: Any) -> None:
    """Scores of the first rows of paths."""
    for i in range(which.shape[0]):
        p, k = paths[which[i]], done[which[i]]
        path = Path(p[0, :k], p[1, :k], p[2, :k], p[3, :k], p[4, :k], p[5, :k])
        scores[i] = score(path, room)  # type: ignore[name-defined]  # noqa: F821
