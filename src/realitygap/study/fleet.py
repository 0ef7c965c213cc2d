"""Runs of one condition side by side as arrays: `advance` of run.py for all of them at once, with its bits.

For the shipped algorithms with the shipped encoding, whose steps are compiled: through Python an evaluation
takes ten times as long. Whatever is a user's own goes that way.
"""

# mypy: allow-untyped-defs, no-check-untyped-defs
from collections.abc import Generator, Sequence
from contextlib import suppress
from dataclasses import replace
from itertools import repeat
from typing import Any, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from realitygap.control.genotype import FIRST_LINK, LINK_FIELDS
from realitygap.control.operators import Variation, crosses, offspring, random_genes
from realitygap.evolution.algorithm import NOBODY
from realitygap.evolution.ga import (
    DistributedGA,
    Panmictic,
    Population,
    RandomSearch,
    panmictic_event,
    torus_event,
)
from realitygap.kernels.jit import routine, step
from realitygap.kernels.rng import substream
from realitygap.streams import OFFSPRING, TRIALS
from realitygap.study.plan import trial_streams
from realitygap.study.run import Asked, Bench, Records, Scores, mean

__all__ = ["advance", "fits", "prepare"]

TORUS, PANMICTIC, RANDOM = range(3)
KINDS = {DistributedGA: TORUS, Panmictic: PANMICTIC, RandomSearch: RANDOM}


class Living(NamedTuple):
    """The residents of all runs' cells; changed in place."""

    genes: NDArray[np.int8]
    """[runs, cells, slots, columns]."""
    fitness: NDArray[np.float64]
    """[runs, cells]."""
    numbers: NDArray[np.int64]
    """[runs, cells]."""


class Born(NamedTuple):
    """n evaluations of each run; see `Records`."""

    genes: NDArray[np.int8]
    """[runs, n, slots, columns]."""
    parents: NDArray[np.int64]
    """[runs, n, 2]."""
    cells: NDArray[np.int64]
    """[runs, n]."""


@step
def _copy(genes, place):
    """Half a microsecond less than as slices."""
    for slot in range(genes.shape[0]):
        for column in range(genes.shape[1]):
            place[slot, column] = genes[slot, column]


@step
def _worst(fitness):
    """The first cell of the lowest fitness; Numba's own loads SciPy."""
    found = 0
    for cell in range(1, fitness.shape[0]):
        if fitness[cell] < fitness[found]:
            found = cell
    return found


@routine
def _breed(kind, rows, rates, streams, start, first, end, living, born):
    """Each run's individuals `first` to `end` of those born since evaluation `start`, as `ask` makes them."""
    runs, cells = living.fitness.shape
    slots, columns = born.genes.shape[2:]
    for r in range(runs):
        for i in range(first, end):
            number = start + i
            event = np.uint64(substream(streams[r], number))
            stream = np.uint64(substream(event, OFFSPRING))
            born.parents[r, i] = NOBODY
            if number < cells or kind == RANDOM:
                links = (columns - FIRST_LINK) // LINK_FIELDS
                _copy(random_genes(slots, links, rates, stream), born.genes[r, i])
                born.cells[r, i] = number if number < cells else _worst(living.fitness[r])
                continue
            if kind == TORUS:
                cell, mate, taken = torus_event(living.fitness[r], rows, cells // rows, event)
            else:
                cell, mate, taken = panmictic_event(living.fitness[r], event)
            genes = offspring(living.genes[r, cell], living.genes[r, mate], rates, stream)
            _copy(genes, born.genes[r, i])
            born.cells[r, i] = taken
            born.parents[r, i, 0] = living.numbers[r, cell]
            if crosses(rates.crossover, stream):
                born.parents[r, i, 1] = living.numbers[r, mate]


@routine
def _tell(kind, start, first, fitness, living, born):
    """Each run's individuals from `first` on take their cells, with fitness [runs, …], as `tell` has it."""
    for r in range(fitness.shape[0]):
        for k in range(fitness.shape[1]):
            cell = born.cells[r, first + k]
            if kind != RANDOM or fitness[r, k] > living.fitness[r, cell]:
                _copy(born.genes[r, first + k], living.genes[r, cell])
                living.fitness[r, cell] = fitness[r, k]
                living.numbers[r, cell] = start + first + k


def fits(bench: Bench) -> bool:
    """Whether a condition's algorithm and encoding are the shipped ones."""
    return type(bench.algorithm) in KINDS and type(bench.encoding) is Variation


def prepare(bench: Bench) -> None:
    """Load or compile what `advance` calls."""
    steps = advance(bench, [(np.uint64(0), bench.algorithm.init(np.uint64(0)))], 1)
    next(steps)
    with suppress(StopIteration):
        steps.send(np.zeros((1, bench.task.trials)))


def advance(
    bench: Bench, runs: Sequence[tuple[np.uint64, Any]], n: int
) -> Generator[Asked, Scores, list[tuple[Population, Records]]]:
    """Carry out the next `n` evaluations of each run.

    Args:
        bench: task, engine and algorithm, which `fits`.
        runs: their streams and states, all after the same number of evaluations.
        n: evaluations.

    Returns:
        Each run's state after them, and their records.
    """
    names, states = zip(*runs, strict=True)
    algorithm, encoding, trials = bench.algorithm, cast("Variation", bench.encoding), bench.task.trials
    kind, rows, start = KINDS[type(algorithm)], getattr(algorithm, "rows", 1), states[0].evaluations
    living = Living(*(np.stack([getattr(state, name) for state in states]) for name in Living._fields))
    size = len(runs), n
    born = Born(
        np.empty((*size, *encoding.shape), np.int8), np.empty((*size, 2), np.int64), np.empty(size, np.int64)
    )
    breeding = np.array([state.stream for state in states], np.uint64)
    under = [np.uint64(substream(name, TRIALS)) for name in names]
    streams = np.stack([trial_streams(name, start, n, trials) for name in under])
    scores, fitness, done = np.empty(streams.shape), np.empty(streams.shape[:2]), 0
    while done < n:
        some = slice(done, min(n, max(done + 1, algorithm.cells - start)))  # all that are random, then one
        _breed(kind, rows, encoding.rates, breeding, start, some.start, some.stop, living, born)
        genes = born.genes[:, some].reshape(-1, *encoding.shape)
        found = yield Asked(bench.noise, genes, streams[:, some].reshape(-1, trials))
        scores[:, some] = found.reshape(len(runs), -1, trials)
        fitness[:, some] = mean(found).reshape(len(runs), -1)
        _tell(kind, start, done, fitness[:, some], living, born)
        done = some.stop
    records = map(Records, repeat(np.arange(start, start + n)), fitness, scores, *born)
    residents = map(Living, *living)
    return [(_told(*each), each[-1]) for each in zip(states, residents, records, strict=True)]


def _told(state: Population, living: Living, lived: Records) -> Population:
    """A run's next state: who lives then, and the fittest of its evaluations, if it is fitter than before."""
    found: dict[str, Any] = {**living._asdict(), "evaluations": state.evaluations + len(lived.number)}
    best = int(lived.fitness.argmax())
    if lived.fitness[best] > state.best_fitness:
        found["best_genes"], found["best_number"] = lived.genes[best], int(lived.number[best])
        found["best_fitness"] = float(lived.fitness[best])
    return replace(state, **found)
