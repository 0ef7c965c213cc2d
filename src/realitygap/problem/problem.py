"""A task as a problem for any optimiser: solutions [B, dim] in, fitness and measures out.

problem = Problem("obstacle-avoidance", controller="feed-forward:8")
batch = problem.evaluate(X, seed=generation)        # maximise batch.fitness
"""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from os import PathLike
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from realitygap.control.genotype import (
    DELAY,
    EXPRESSED,
    FIRST_LINK,
    LINK_FIELDS,
    MAX_DELAY,
    MAX_THRESHOLD,
    MAX_WEIGHT,
    SOURCE,
    THRESHOLD,
    WEIGHT,
    Layout,
)
from realitygap.control.network import NetworkController, decode
from realitygap.control.operators import Variation
from realitygap.errors import UsageError
from realitygap.kernels import batch
from realitygap.kernels.params import Networks, Path
from realitygap.kernels.work import new_work
from realitygap.problem.controllers import WeightedController, form_of, stopped
from realitygap.simulation.simulation import Simulation, Streams, batch_streams
from realitygap.tasks.load import load_task
from realitygap.tasks.task import Task
from realitygap.values import Floats, as_count, as_stream
from realitygap.work.pool import cores
from realitygap.world.arena import Arena
from realitygap.world.robot import Profile

__all__ = ["Batch", "Problem"]

REACH = 4.0
"""Weights lie in ±4, as the paper's do (§5.3); nothing but the bounds says so."""
FRESH = 2**62
"""Seeds from here on are those of retests."""
MEASURES = ("speed", "turning")
MOST_TRIALS, MOST_THREADS = 10**5, 1024
"""Limits on the trials of one solution, whose paths are held at once, and on threads."""


class Batch(NamedTuple):
    """The results of B solutions.

    Attributes:
        fitness: [B] mean score over the trials; larger is better.
        measures: [B, 2] the mean of the wheels' speeds, and half of the right one's lead over the left, over
            the top speed; means over the trials.
        info: "scores" [B, trials], "sd" [B] over the trials.
    """

    fitness: Floats
    measures: Floats
    info: dict[str, Floats]


class Problem:
    """A task, a robot and a kind of controller.

    Args:
        task: one that comes with the package, a Python file of your own, or a Task.
        controller: "feed-forward:8" or "recurrent:4" (hidden neurons; weights are real numbers),
            "delay-network" (the paper's genotype of slots, whole numbers), or a function or class of your
            own, itself or as FILE.py:NAME (`controllers.form_of` says what it is given).
        profile: the robot: a shipped profile's name or a TOML file.
        noise: zero, observed, double or a number.
        arena: in place of the task's.
        spread: share, 0 to 0.9, within which each trial draws the robot's constants anew (`Task.spread`);
            None: the task's own.
        workers: threads; one a core if None. It never changes a result.

    Attributes:
        dim: numbers of a solution.
        bounds: [2, dim] lowest and highest; what lies beyond is clipped.
        integer: bool[dim], numbers that are rounded to whole ones.
        measures: their names; measure_bounds: [2, 2] lowest and highest of each.
        simulation: where solutions are tried.

    Raises:
        RealityGapError: no such task, controller, profile, noise or arena; says what was expected.
    """

    measures = MEASURES

    def __init__(
        self,
        task: Task | str | PathLike[str],
        controller: str | Callable[..., None] | type = "feed-forward:8",
        *,
        profile: Profile | str | PathLike[str] = "paper",
        noise: str | float = "observed",
        arena: Arena | str | PathLike[str] | None = None,
        spread: float | None = None,
        workers: int | None = None,
    ) -> None:
        self.simulation = Simulation(load_task(task).under(spread), profile, noise, arena)
        self.workers = as_count(cores() if workers is None else workers, "workers", most=MOST_THREADS)
        inputs = len(self.simulation.trial.channels)
        self.layout = Layout(inputs=inputs) if str(controller) == "delay-network" else None
        if self.layout is not None:
            self.bounds = _gene_bounds(self.layout)
        else:
            self.form = form_of(controller, inputs)
            self.bounds = np.array([[-REACH], [REACH]]) * np.ones(self.form.weights)
        self.dim = self.bounds.shape[1]
        self.integer = np.full(self.dim, self.layout is not None)
        self.measure_bounds = np.array([[-1.0, -1.0], [1.0, 1.0]])

    def x0(self, seed: int = 0) -> Floats:
        """[dim] where a search may start: zero weights, or a random genotype of the paper's kind."""
        stream = as_stream(seed, "seed")
        if self.layout is None:
            return np.zeros(self.dim)
        return Variation(layout=self.layout).random(stream).reshape(-1).astype(np.float64)

    def decode(self, solutions: Any) -> Any:
        """Weights [B, dim] within the bounds; of "delay-network" genotypes int8[B, slots, fields].

        Raises:
            UsageError: an array of another shape, or numbers that are not finite.
        """
        expected = f"solutions: expected finite numbers [B, {self.dim}], B at least 1, got"
        try:
            given = np.atleast_2d(np.asarray(solutions).astype(np.float64, casting="same_kind"))
        except (TypeError, ValueError) as error:
            raise UsageError(f"{expected} something else: {error}.") from None
        if given.ndim != 2 or given.shape[1] != self.dim or not len(given):
            raise UsageError(f"{expected} an array of shape {list(given.shape)}.")
        if not np.isfinite(given).all():
            raise UsageError(f"{expected} NaN or infinity in row {np.argwhere(~np.isfinite(given))[0, 0]}.")
        inside = np.clip(given, *self.bounds)
        if self.layout is None:
            return inside
        return np.rint(inside).astype(np.int8).reshape(-1, *self.layout.shape)

    def controller(self, solution: Any) -> WeightedController | NetworkController:
        """A controller that drives any body as one solution [dim] does."""
        if len(found := self.decode(solution)) != 1:
            raise UsageError(f"solution: expected one, {self.dim} numbers, got {len(found)} of them.")
        (one,) = found
        if self.layout is not None:
            return NetworkController(one, self.layout)
        return WeightedController(self.form, one)

    def evaluate(self, solutions: Any, seed: int = 0, trials: int | None = None) -> Batch:
        """Fitness of solutions on the same trials each: a function of solution, seed and number of trials.

        Args:
            solutions: [B, dim].
            seed: names the trials' starts and noise; take another for each generation.
            trials: of each; the task's own if None.

        Raises:
            UsageError: an array that does not fit, an invalid seed, or outputs that are not finite.
        """
        decoded = self.decode(solutions)
        wanted = self.simulation.task.trials if trials is None else trials
        count = as_count(wanted, "trials", most=MOST_TRIALS)
        streams = batch_streams(int(as_stream(seed, "seed")), count)
        made = decode(decoded, self.layout) if self.layout is not None else decoded
        worlds = self.simulation.worlds(streams)
        jobs = [part for part in np.array_split(np.arange(len(decoded)), 4 * self.workers) if len(part)]
        _ = self.simulation.score, self.simulation.room  # made once, before threads ask
        with ThreadPoolExecutor(self.workers) as pool:
            parts = list(pool.map(lambda part: self._part(made, part, streams, worlds), jobs))
        scores, measures = (np.concatenate(one) for one in zip(*parts, strict=True))
        self.simulation.require_finite(scores)
        return Batch(scores.mean(1), measures, {"scores": scores, "sd": scores.std(1)})

    def retest(self, solutions: Any, trials: int = 100, seed: int = 0) -> Batch:
        """Fitness on trials that no `evaluate` with a seed below 2**62 has seen: of a champion, free of the
        luck that chose it."""
        return self.evaluate(solutions, FRESH + int(as_stream(seed, "seed")), trials)

    def champion(self, solutions: Any, trials: int = 100, choosing: int = 20) -> tuple[int, Batch]:
        """Which solution is best on fresh trials, and its fitness on others, which did not choose it.

        Args:
            solutions: [B, dim]: a last population, say, or an archive's elites.
            trials: that measure the best one.
            choosing: trials of each solution that choose it.
        """
        best = int(np.argmax(self.retest(solutions, choosing, seed=1).fitness))
        return best, self.retest(np.atleast_2d(solutions)[best], trials)

    def _part(
        self, made: Any, part: NDArray[np.int64], streams: Streams, worlds: list[Any]
    ) -> tuple[Floats, Floats]:
        """Scores [b, trials] and measures [b, 2] of some solutions, one after the other, in one thread."""
        simulation, trials = self.simulation, len(streams)
        networks = made if isinstance(made, Networks) else None
        work = new_work(simulation.robot, simulation.trial, networks)
        run, brain = (batch.run_trials, made) if networks else (self.form.run, self.form.brain(made))
        paths = np.zeros((trials, len(Path._fields), simulation.trial.steps))
        scores, measures = np.empty((len(part), trials)), np.empty((len(part), 2))
        for i, one in enumerate(part):
            try:
                simulation.run(run, brain, np.full(trials, one), streams, paths, work, worlds)
            except UsageError:
                raise
            except Exception as error:  # a user's controller
                raise stopped(self.form, error, *brain[1:5]) from None
            if not networks and brain[-1][0]:
                raise UsageError(
                    f"controller: expected finite outputs, got NaN or infinity from solution {one}."
                )
            scores[i] = simulation.score.over(paths, simulation.room)
            speed, apart = paths[:, 3:5].mean(0).mean(1)
            measures[i] = (speed + apart) / 2, (apart - speed) / 2
        return scores, np.clip(measures / simulation.room.top_speed, -1.0, 1.0)


def _gene_bounds(layout: Layout) -> Floats:
    """[2, genes] of the paper's encoding (§5.2, §5.3); what must be expressed cannot be switched off."""
    low, high = np.zeros((2, *layout.shape))
    high[:, EXPRESSED] = 1
    low[: layout.first_hidden, EXPRESSED] = 1
    low[:, THRESHOLD], high[:, THRESHOLD] = -MAX_THRESHOLD, MAX_THRESHOLD
    fields = slice(FIRST_LINK, None)
    for column, least, most in ((0, 0, 1), (SOURCE, 0, layout.slots - 1), (WEIGHT, -MAX_WEIGHT, MAX_WEIGHT),
                                (DELAY, 0, MAX_DELAY)):  # fmt: skip
        low[:, fields][:, column::LINK_FIELDS] = least
        high[:, fields][:, column::LINK_FIELDS] = most
    return np.stack([low.reshape(-1), high.reshape(-1)])
