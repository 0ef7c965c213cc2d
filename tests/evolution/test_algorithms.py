"""What every algorithm promises: one contract, and what sets each of them apart."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from realitygap.evolution import ALGORITHMS, DistributedGA, Panmictic, make_algorithm
from realitygap.testing import AlgorithmContract
from tests.evolution.toy import Toy, advance, fitness_of

SEED = np.uint64(2**64 - 1995)


class CellsContract(AlgorithmContract):
    """What the paper's algorithm and its two baselines have in common; a subclass says which."""

    name: str
    pauses = (0, 1, 19, 20, 21, 77)

    def made(self):
        size = {"rows": 4, "columns": 5} if self.name == "torus" else {"size": 20}
        return make_algorithm(self.name, Toy(), **size)

    def fitness(self, genes):
        return fitness_of(genes)

    def test_first_individuals_are_random(self):
        """The first evaluations have no parents and fill every cell once, in as few batches as one likes."""
        algorithm = self.made()
        state = algorithm.init(SEED)
        batch = algorithm.ask(state, 7)
        assert len(batch.genes) == 7 and (batch.parents == -1).all()
        state = algorithm.tell(state, batch, np.arange(7.0))
        rest = algorithm.ask(state, 1000)
        assert sorted([*batch.cells, *rest.cells]) == list(range(20)) and (rest.parents == -1).all()
        state = algorithm.tell(state, rest, np.arange(13.0))
        assert (state.numbers >= 0).all() and len(algorithm.ask(state, 1000).genes) == 1

    def test_states_share_no_best(self):
        """Nothing that is written into a batch, a later state or what was remembered changes a state."""
        algorithm, size = self.made(), np.ones(2)
        batch = algorithm.ask(algorithm.init(SEED), 4)
        state = algorithm.tell(algorithm.init(SEED), batch, np.arange(4.0)).remember(size=size)
        bytes_before = state.to_bytes()
        later = algorithm.tell(state, algorithm.ask(state, 1), np.zeros(1))
        for array in (batch.genes, later.best_genes, size):
            array[:] += 1
        assert state.to_bytes() == bytes_before

    def test_it_improves(self):
        """More evaluations never make the best worse."""
        algorithm = self.made()
        state, best = algorithm.init(SEED), -np.inf
        for _ in range(5):
            state = advance(algorithm, state, 40)
            assert state.best_fitness >= best
            best = state.best_fitness


class TestTorus(CellsContract):
    name = "torus"


class TestPanmictic(CellsContract):
    name = "panmictic"


class TestRandomSearch(CellsContract):
    name = "random"

    def test_it_keeps_the_best(self):
        """After many evaluations the cells hold the fittest of all, the earlier of equals."""
        algorithm, told = self.made(), []
        state = algorithm.init(SEED)
        for _ in range(150):
            batch = algorithm.ask(state, 1)
            told.append(fitness_of(batch.genes[0]))
            state = algorithm.tell(state, batch, np.array(told[-1:]))
        assert sorted(state.fitness) == sorted(told)[-20:]

    def test_nothing_is_inherited(self):
        """What comes next does not depend on any fitness."""
        algorithm = self.made()
        state = algorithm.init(SEED)
        for number in range(60):
            batch = algorithm.ask(state, 1)
            other = dataclasses.replace(state, fitness=state.fitness + 1.0)
            assert (algorithm.ask(other, 1).genes == batch.genes).all()
            assert (batch.parents == -1).all()
            state = algorithm.tell(state, batch, np.array([float(number % 5)]))


@pytest.mark.parametrize("kind", [DistributedGA, Panmictic])
def test_parents_are_named(kind):
    """Without crossover an offspring has one parent, with it two; they live in the cells drawn."""
    for crossover, has_second in ((0.0, False), (1.0, True)):
        algorithm = kind(encoding=Toy(crossover=crossover))
        state = advance(algorithm, algorithm.init(SEED), 70)
        for _ in range(30):
            batch = algorithm.ask(state, 1)
            first, second = batch.parents[0]
            assert first in state.numbers and (second in state.numbers) == has_second
            assert has_second or second == -1
            state = algorithm.tell(state, batch, np.array([fitness_of(batch.genes[0])]))


def test_evolution_beats_random_search():
    """With the same thousand evaluations both genetic algorithms come closer than random search."""
    best = {}
    for name in ALGORITHMS:
        algorithm = make_algorithm(name, Toy())
        runs = [advance(algorithm, algorithm.init(np.uint64(k)), 1000) for k in range(3)]
        best[name] = np.mean([state.best_fitness for state in runs])
    assert best["torus"] > best["random"] + 10 and best["panmictic"] > best["random"] + 10
