"""Runs of one condition side by side as arrays: `advance` of run.py for all of them at once, with its bits.

For the shipped algorithms with the shipped encoding, whose operators are compiled: through Python an
evaluation takes ten times as long. Whatever is a user's own goes that way.
"""

# mypy: allow-untyped-defs, no-check-untyped-defs
from collections.abc import Generator, Sequence
from contextlib import suppress
from itertools import repeat
from typing import Any, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from realitygap.compiled import routine, step
from realitygap.control.encoding import Variation
from realitygap.control.slots import FIRST_LINK, LINK_FIELDS, crosses, offspring, random_genes
from realitygap.evolution import ALGORITHMS
from realitygap.evolution.algorithm import NOBODY
from realitygap.evolution.ga import DistributedGA, Population, select
from realitygap.kernels.rng import substream
from realitygap.streams import OFFSPRING, TRIALS
from realitygap.study.plan import trial_streams
from realitygap.study.run import ConditionRunner, Scores, TrialRequest, mean
from realitygap.study.store import Records

__all__ = ["advance", "prepare", "supports"]


class Residents(NamedTuple):
    """The residents of all runs' cells; changed in place."""

    genes: NDArray[np.int8]
    """[runs, cells, slots, columns]."""
    fitness: NDArray[np.float64]
    """[runs, cells]."""
    numbers: NDArray[np.int64]
    """[runs, cells]."""


class Offspring(NamedTuple):
    """n evaluations of each run; see `Records`."""

    genes: NDArray[np.int8]
    """[runs, n, slots, columns]."""
    parents: NDArray[np.int64]
    """[runs, n, 2]."""
    cells: NDArray[np.int64]
    """[runs, n]."""


@step
def _copy(genes, place):
    """As slices they take four seconds more to compile."""
    for slot in range(genes.shape[0]):
        for column in range(genes.shape[1]):
            place[slot, column] = genes[slot, column]


@routine
def _breed(rates, streams, number, chosen, living, born, i):
    """Each run's evaluation `number`, the i-th of those born, of the cells [runs, 3] that `select` chose."""
    slots, columns = born.genes.shape[2:]
    for r in range(len(streams)):
        stream = np.uint64(substream(np.uint64(substream(streams[r], number)), OFFSPRING))
        cell, mate = chosen[r, 0], chosen[r, 1]
        born.cells[r, i] = chosen[r, 2]
        born.parents[r, i] = NOBODY
        if cell == NOBODY:
            links = (columns - FIRST_LINK) // LINK_FIELDS
            _copy(random_genes(slots, links, rates, stream), born.genes[r, i])
            continue
        _copy(offspring(living.genes[r, cell], living.genes[r, mate], rates, stream), born.genes[r, i])
        born.parents[r, i, 0] = living.numbers[r, cell]
        if crosses(rates.crossover, stream):
            born.parents[r, i, 1] = living.numbers[r, mate]


def supports(runner: ConditionRunner) -> bool:
    """Whether a condition's algorithm and encoding are the shipped ones."""
    return type(runner.algorithm) in ALGORITHMS.values() and type(runner.encoding) is Variation


def prepare(runner: ConditionRunner) -> None:
    """Load or compile what `advance` calls."""
    steps = advance(runner, [(np.uint64(0), runner.algorithm.init(np.uint64(0)))], 1)
    next(steps)
    with suppress(StopIteration):
        steps.send(np.zeros((1, runner.task.trials)))


def advance(
    runner: ConditionRunner, runs: Sequence[tuple[np.uint64, Any]], n: int
) -> Generator[TrialRequest, Scores, list[tuple[Population, Records]]]:
    """Carry out the next `n` evaluations of each run.

    Args:
        runner: task, engine and algorithm, which `supports`.
        runs: their streams and states, all after the same number of evaluations.
        n: evaluations.

    Returns:
        Each run's state after them, and their records.
    """
    names, states = zip(*runs, strict=True)
    algorithm, encoding = cast("DistributedGA", runner.algorithm), cast("Variation", runner.encoding)
    trials = runner.task.trials
    start, size = states[0].evaluations, (len(runs), n)
    living = Residents(*(np.stack([getattr(state, name) for state in states]) for name in Residents._fields))
    born = Offspring(
        np.empty((*size, *encoding.shape), np.int8), np.empty((*size, 2), np.int64), np.empty(size, np.int64)
    )
    breeding = np.array([state.stream for state in states], np.uint64)
    under = (np.uint64(substream(name, TRIALS)) for name in names)
    streams = np.stack([trial_streams(name, start, n, trials) for name in under])
    scores, fitness, done = np.empty(streams.shape), np.empty(streams.shape[:2]), 0
    while done < n:
        some = slice(done, min(n, max(done + 1, algorithm.cells - start)))  # all that are random, then one
        for i in range(some.start, some.stop):
            chosen = select(living.fitness, algorithm.grid, breeding, start + i)
            _breed(encoding.rates, breeding, start + i, chosen, living, born, i)
        genes, cells = born.genes[:, some], born.cells[:, some]
        flat = genes.reshape(-1, *encoding.shape)
        found = yield TrialRequest(runner.noise, flat, streams[:, some].reshape(-1, trials))
        scores[:, some] = found.reshape(len(runs), -1, trials)
        fitness[:, some] = mean(found).reshape(len(runs), -1)
        takes = algorithm.takes(fitness[:, some], np.take_along_axis(living.fitness, cells, 1))
        r, k = np.nonzero(takes)
        at = r, cells[r, k]
        living.genes[at], living.fitness[at] = genes[r, k], fitness[:, some][r, k]
        living.numbers[at] = start + done + k
        done = some.stop
    records = map(Records, repeat(np.arange(start, start + n)), fitness, scores, *born)
    return [
        (state.after(lived.genes, lived.fitness, lives._asdict()), lived)
        for state, lives, lived in zip(states, map(Residents, *living), records, strict=True)
    ]
