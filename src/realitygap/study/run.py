"""One run: `advance(runner, plan, state, n)` evaluates n more individuals; `finish` tests the last.

State is a value, and every draw is named by the run, the evaluation and the trial: results do not depend on
how a run is divided or on the engine. Both functions are generators: they yield the trials that they need and
are sent the scores, so that an engine may run the trials of many runs at once.
"""

import math
from collections.abc import Generator
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from realitygap.control.encoding import Encoding, Variation, check_networks
from realitygap.errors import UsageError
from realitygap.evolution.algorithm import Algorithm, Batch, Genes, State, check_batch, check_state
from realitygap.kernels.rng import substream
from realitygap.simulation.simulation import Simulation
from realitygap.streams import BREEDING, FRESH, RETEST, TRIALS
from realitygap.study.folder import Materials
from realitygap.study.plan import Plan, trial_streams
from realitygap.study.store import WHO, Records, Results
from realitygap.world.robot import NOISE_LEVELS

__all__ = ["ConditionRunner", "TrialRequest", "advance", "begin", "finish", "mean", "tested_levels"]

Scores = NDArray[np.float64]


class TrialRequest(NamedTuple):
    """Trials that a run requests, to be sent their scores [n, trials]."""

    noise: float
    genes: Genes
    """[n, ...]."""
    streams: NDArray[np.uint64]
    """[n, trials]."""


class ConditionRunner:
    """Carries out the runs of one condition of a study; created once in a process."""

    def __init__(self, materials: Materials, condition: int, engine: str = "cores") -> None:
        config = materials.config
        self.task, self.profile, self.engine = materials.tasks[condition], materials.profile, engine
        self.noise = config.conditions[condition].noise
        self.encoding: Encoding = config.encoding_for(self.task)
        self.algorithm: Algorithm[Any] = config.evolution.make(self.encoding)
        self.retest_trials, self.fresh_trials = config.retest_trials, config.fresh_trials
        self._simulations: dict[float, Simulation] = {}

    def simulation(self, noise: float) -> Simulation:
        """The simulation at a noise level, cached."""
        if noise not in self._simulations:
            self._simulations[noise] = Simulation(self.task, self.profile, noise, engine=self.engine)
        return self._simulations[noise]

    def scores(self, asked: TrialRequest) -> Scores:
        """The requested scores, [n, trials]."""
        networks = self.encoding.decode(asked.genes.copy())
        if not isinstance(self.encoding, Variation):
            check_networks(networks, len(self.task.sensors))
        return self.simulation(asked.noise).scores(networks, asked.streams)

    @cached_property
    def individual(self) -> Genes:
        """Any individual, for its type and shape."""
        return self.encoding.random(np.uint64(0))

    def compile(self) -> None:
        """Load or compile everything that a run calls."""
        self.simulation(self.noise).compile()
        self.breed()

    def breed(self) -> None:
        """Breed some offspring, for whatever that compiles."""
        state: State = self.algorithm.init(np.uint64(0))
        trial_streams(np.uint64(0), 0, 1, 1)
        while state.evaluations < self.algorithm.cells + 2:
            batch = self.ask(state, self.algorithm.cells)
            self.encoding.decode(batch.genes)
            state = self.tell(state, batch, np.zeros(len(batch.genes)))

    def ask(self, state: State, n: int) -> Batch:
        """The algorithm's next individuals, checked."""
        batch: Batch = self.algorithm.ask(state, n)
        check_batch(batch, state, n, self.individual)
        return batch

    def tell(self, state: State, batch: Batch, fitness: NDArray[np.float64]) -> State:
        """The algorithm's next state, checked."""
        own = batch._replace(genes=batch.genes.copy(), parents=batch.parents.copy(), cells=batch.cells.copy())
        told: State = self.algorithm.tell(state, own, fitness.copy())  # the study's stay what they are
        expected = state.evaluations + len(fitness)
        came = getattr(told, "evaluations", type(told).__name__)
        if came != expected:
            raise UsageError(f"tell: expected a state after {expected} evaluations, got {came}.")
        return told


def begin(runner: ConditionRunner, plan: Plan) -> State:
    """The state before a run's first evaluation."""
    state: State = runner.algorithm.init(np.uint64(substream(plan.stream, BREEDING)))
    return state


def advance(
    runner: ConditionRunner, plan: Plan, state: State, n: int
) -> Generator[TrialRequest, Scores, tuple[State, Records]]:
    """Carry out the next `n` evaluations of a run, in batches of the algorithm's size.

    Args:
        runner: task, engine and algorithm.
        plan: of the run.
        state: of the algorithm.
        n: evaluations.

    Returns:
        The state after them, and their records.
    """
    trials, start = runner.task.trials, state.evaluations
    streams = trial_streams(np.uint64(substream(plan.stream, TRIALS)), start, n, trials)
    batches: list[Batch] = []
    scores: list[NDArray[np.float64]] = []
    fitness: list[NDArray[np.float64]] = []
    done = 0
    while done < n:
        batch = runner.ask(state, n - done)
        some = slice(done, done + len(batch.genes))
        scores.append((yield TrialRequest(runner.noise, batch.genes, streams[some])))
        fitness.append(mean(scores[-1]))
        state = runner.tell(state, batch, fitness[-1])
        batches.append(batch)
        done = some.stop
    records = Records(
        number=np.arange(start, start + n),
        fitness=np.concatenate(fitness),
        scores=np.concatenate(scores),
        genes=np.concatenate([batch.genes for batch in batches]),
        parents=np.concatenate([batch.parents for batch in batches]),
        cell=np.concatenate([batch.cells for batch in batches]),
    )
    check_state(state, runner.algorithm.cells, records.fitness, runner.individual)
    return state, records


def mean(scores: Scores) -> NDArray[np.float64]:
    """Fitness [n] of individuals with scores [n, trials]."""
    trials = scores.shape[1]
    return np.array([math.fsum(row) / trials for row in scores.tolist()])


def tested_levels(noise: float) -> tuple[float, ...]:
    """The noise levels of the fresh trials of a run that evolved at one: the paper's, and its own."""
    return tuple(dict.fromkeys((*NOISE_LEVELS.values(), noise)))


def finish(runner: ConditionRunner, plan: Plan, state: State) -> Generator[TrialRequest, Scores, Results]:
    """Retest the last population, then test the fittest and the champion at the paper's noise levels and
    at their own.

    All individuals have the same starts and draws, so that they are comparable.
    """
    cells = np.flatnonzero(state.numbers >= 0)
    if not len(cells):
        raise UsageError("tell: expected an occupied cell (numbers) at a run's end, got none.")
    retest = yield _test(runner.noise, state.genes[cells], plan, RETEST, runner.retest_trials)
    champion = int(np.argmax([math.fsum(row) for row in retest.tolist()]))
    pair = np.stack([state.best_genes, state.genes[cells[champion]]])
    fresh = {}
    for noise in tested_levels(runner.noise):
        scores = yield _test(noise, pair, plan, FRESH, runner.fresh_trials)
        fresh.update({(who, noise): scores[i] for i, who in enumerate(WHO)})
    return Results(cells, state.numbers[cells], retest, champion, fresh)


def _test(noise: float, genes: Genes, plan: Plan, purpose: int, trials: int) -> TrialRequest:
    """Trials of individuals, with streams that depend on the run and the purpose."""
    streams = trial_streams(plan.stream, purpose, 1, trials)
    return TrialRequest(noise, genes, np.repeat(streams, len(genes), axis=0))
