"""A task as a problem for any optimiser: solutions [B, dim] in, fitness and measures out.

An optimiser asks:

    problem = Problem("obstacle-avoidance", controller="feed-forward:8")
    batch = problem.evaluate(X, seed=generation)  # maximise batch.fitness
"""

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import lru_cache
from os import PathLike
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from realitygap.compiled import compiled, kernel, naming
from realitygap.control.encoding import Variation
from realitygap.control.genotype import Genotype, NetworkController
from realitygap.control.slots import bounds
from realitygap.errors import UsageError
from realitygap.kernels import trial as loop
from realitygap.kernels import weights as controllers
from realitygap.kernels.network import LIMIT
from realitygap.kernels.trial import new_scratch
from realitygap.kernels.types import Networks, Path
from realitygap.plugins import blamed_on, named_object, place_of
from realitygap.simulation.simulation import Simulation, Streams, batch_streams
from realitygap.tasks.load import load_task
from realitygap.tasks.score import reason
from realitygap.tasks.task import Task
from realitygap.values import Command, Floats, as_count, as_stream
from realitygap.work.pool import cores
from realitygap.world.arena import Arena
from realitygap.world.robot import Profile

__all__ = ["Batch", "Form", "Problem", "WeightedController", "form_of"]

REACH = 4.0
"""Weights lie in ±4, as the paper's do (§5.3); nothing but the bounds says so."""
WIDEST = 256
"""Hidden neurons at most."""
FRESH = 2**62
"""Seeds from here on are those of retests."""
MOST_TRIALS, MOST_THREADS = 10**5, 1024
"""Limits on the trials of one solution, whose paths are held at once, and on threads."""


@dataclass(frozen=True, kw_only=True)
class Form:
    """A kind of controller with real-valued weights.

    Attributes:
        inputs: how many feed it.
        weights: how many; memory: numbers that it keeps from step to step.
        decide: writes outputs, see `kernels.weights`; the compiled function, or a user's.
        run: trials under it, compiled, as of `kernels.trial.run_each`.
    """

    inputs: int
    weights: int
    memory: int
    decide: Callable[[Floats, Floats, Floats, Floats], None]
    run: Callable[..., None]

    def brain(self, weights: Floats) -> tuple[Any, ...]:
        """What `run` takes for controllers with weights [N, W]: those, and scratch, see kernels.weights."""
        own = np.zeros(self.weights), np.zeros(self.memory), np.zeros(self.inputs), np.zeros(2)
        return weights, *own, np.zeros(1, np.int64)


class WeightedController:
    """One of them that drives any body, as a network does: inputs −10 … 10 in, commands −10 … 10 out."""

    def __init__(self, form: Form, weights: Floats) -> None:
        self.form, self.weights = form, np.array(weights, np.float64)
        self._memory, self._outputs = np.zeros(form.memory), np.zeros(2)
        self.reset()

    def reset(self) -> None:
        """Before a trial: it remembers nothing, and has learnt nothing."""
        self._weights = self.weights.copy()
        self._memory[:] = 0.0
        self._outputs[:] = 0.0

    def decide(self, inputs: Sequence[int]) -> Command:
        """One step.

        Raises:
            UsageError: another number of inputs, or one beyond ±10; an output that is not finite, or a
                user's function that fails.
        """
        fed = np.array(inputs, np.float64) / LIMIT
        if fed.shape != (self.form.inputs,) or not (np.abs(fed) <= 1).all():
            expected = f"{self.form.inputs} numbers from -{LIMIT} to {LIMIT}"
            raise UsageError(f"inputs: expected {expected}, got {inputs!r}.")
        try:
            self.form.decide(self._weights, self._memory, fed, self._outputs)
        except Exception as error:
            raise _stopped(self.form, error, self._weights, self._memory, fed, self._outputs) from None
        if not np.isfinite(self._outputs).all():
            raise UsageError(f"controller: expected finite outputs, got {self._outputs.tolist()}.")
        left, right = (int(controllers.command(value)) for value in self._outputs)
        return Command(left=left, right=right)


def _stopped(form: Form, error: Exception, *given: Floats) -> UsageError:
    """The error of a user's function that failed when given these: names its line."""
    plain: Any = getattr(form.decide, "py_func", form.decide)
    place = plain.__code__.co_filename
    try:
        with blamed_on(place, UsageError, "the controller fails"):
            plain(*given)
    except UsageError as told:
        return told
    return UsageError(f"{place}: the controller fails with {type(error).__name__}: {error}.")


def form_of(given: object, inputs: int) -> Form:
    """A controller by its name, or a user's own.

    Args:
        given: "feed-forward:8" or "recurrent:4", with its hidden neurons; or FILE.py:NAME, or what such a
            name stands for: a function decide(weights, memory, inputs, outputs) whose file says how many
            `WEIGHTS` and how much `MEMORY` it needs (numbers, or functions of the inputs' number), or a class
            that holds all three.
        inputs: how many sensors feed it.

    Raises:
        UsageError: no such controller; names what was expected.
    """
    name = getattr(given, "__qualname__", str(given))
    if callable(given) or place_of(name) is not None:
        own = given if callable(given) else named_object(name, UsageError, "controller")
        decide, weights, memory = _own(own, name, inputs)
        return Form(inputs=inputs, weights=weights, memory=memory, decide=decide, run=_trials(decide, True))
    kind, _, size = name.partition(":")
    hidden = int(size) if size.isdecimal() else 0
    if kind not in ("feed-forward", "recurrent") or not 1 <= hidden <= WIDEST:
        raise UsageError(
            "controller: expected feed-forward:N or recurrent:N (hidden neurons, 1 to "
            f"{WIDEST}), delay-network, FILE.py:NAME, or a function or class of yours, got {given!r}."
        )
    if kind == "feed-forward":
        weights, memory, decide = hidden * (inputs + 1), hidden, controllers.feed_forward
    else:
        weights, memory, decide = hidden * (inputs + hidden + 1), 2 * hidden, controllers.recurrent
    weights += 2 * (hidden + 1)
    return Form(inputs=inputs, weights=weights, memory=memory, decide=decide, run=_trials(decide, False))


def _own(given: Any, name: str, inputs: int) -> tuple[Any, int, int]:
    """A user's function, or that of a class, compiled; how many weights and how much memory it needs."""
    plain: Any = getattr(given, "decide", None) if isinstance(given, type) else given
    plain = getattr(plain, "py_func", plain)  # a user's own @njit
    if not hasattr(plain, "__code__"):
        raise UsageError(
            f"{name}: expected a function decide(weights, memory, inputs, outputs), or a class with one and "
            f"with WEIGHTS, got {given!r}."
        )
    file = plain.__code__.co_filename
    parts = {key: getattr(given, key) for key in dir(given)} if isinstance(given, type) else plain.__globals__
    with blamed_on(file, UsageError, "the size of its controller fails"):
        sizes = [
            size(inputs) if callable(size) else size
            for size in (parts.get("WEIGHTS"), parts.get("MEMORY", 0))
        ]
    weights, memory = as_count(sizes[0], f"{name}: WEIGHTS"), as_count(sizes[1], f"{name}: MEMORY", 0)
    decide = compiled(plain, boundscheck=True)
    try:
        decide(np.zeros(weights), np.zeros(memory), np.zeros(inputs), np.zeros(2))
    except Exception as error:
        raise UsageError(
            f"{file}: the controller cannot be run: {reason(error).rstrip('.')}. It is given "
            f"weights[{weights}], memory[{memory}], inputs[{inputs}] and outputs[2]."
        ) from None
    return decide, weights, memory


@lru_cache(maxsize=16)
def _trials(decide: Any, may_allocate: bool) -> Callable[..., None]:
    """Trials under a controller: ours never allocate, which halves their time."""
    flags = {"fastmath": False, "allocates": True} if may_allocate else {}
    loop, home = naming(controllers.run, function=decide), getattr(decide, "py_func", decide)
    run: Callable[..., None] = kernel(loop, home=home, **flags)
    return run


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
            own, itself or as FILE.py:NAME (`form_of` says what it is given).
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

    measures = ("speed", "turning")

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
        self.variation = Variation(inputs=inputs) if str(controller) == "delay-network" else None
        if self.variation is not None:
            limits = bounds(inputs, self.variation.slots, self.variation.links)
            self.bounds = limits.reshape(2, -1).astype(np.float64)
        else:
            self.form = form_of(controller, inputs)
            self.bounds = np.array([[-REACH], [REACH]]) * np.ones(self.form.weights)
        self.dim = self.bounds.shape[1]
        self.integer = np.full(self.dim, self.variation is not None)
        self.measure_bounds = np.array([[-1.0, -1.0], [1.0, 1.0]])

    def x0(self, seed: int = 0) -> Floats:
        """[dim] where a search may start: zero weights, or a random genotype of the paper's kind."""
        stream = as_stream(seed, "seed")
        if self.variation is None:
            return np.zeros(self.dim)
        return self.variation.random(stream).reshape(-1).astype(np.float64)

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
        if self.variation is None:
            return inside
        return np.rint(inside).astype(np.int8).reshape(-1, *self.variation.shape)

    def controller(self, solution: Any) -> WeightedController | NetworkController:
        """A controller that drives any body as one solution [dim] does."""
        if len(found := self.decode(solution)) != 1:
            raise UsageError(f"solution: expected one, {self.dim} numbers, got {len(found)} of them.")
        if self.variation is not None:
            return Genotype(found[0], self.variation.inputs).controller()
        return WeightedController(self.form, found[0])

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
        made = decoded if self.variation is None else self.variation.decode(decoded)
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
        scratch = new_scratch(simulation.robot, simulation.trial, networks)
        run, brain = (loop.run_trials, made) if networks else (self.form.run, self.form.brain(made))
        paths = np.zeros((trials, len(Path._fields), simulation.trial.steps))
        scores, measures = np.empty((len(part), trials)), np.empty((len(part), 2))
        for i, one in enumerate(part):
            try:
                simulation.run(run, brain, np.full(trials, one), streams, paths, scratch, worlds)
            except UsageError:
                raise
            except Exception as error:  # a user's controller
                raise _stopped(self.form, error, *brain[1:5]) from None
            if not networks and brain[-1][0]:
                raise UsageError(
                    f"controller: expected finite outputs, got NaN or infinity from solution {one}."
                )
            scores[i] = simulation.score.over(paths, simulation.room)
            speed, apart = paths[:, 3:5].mean(0).mean(1)
            measures[i] = (speed + apart) / 2, (apart - speed) / 2
        return scores, np.clip(measures / simulation.room.top_speed, -1.0, 1.0)
