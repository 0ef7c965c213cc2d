"""What every algorithm promises: one contract, and what sets each of them apart."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from realitygap.errors import StudyError, UsageError
from realitygap.evolution import ALGORITHMS, DistributedGA, Panmictic, RandomSearch, make_algorithm
from realitygap.evolution.algorithm import check_batch
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

    def test_states_are_frozen(self):
        """A state's fields cannot be set."""
        with pytest.raises(dataclasses.FrozenInstanceError):
            self.made().init(SEED).evaluations = 5

    def test_a_wrong_fitness_is_told_by_its_number(self):
        """NaN is refused with the evaluation's number, anywhere in a batch."""
        algorithm = self.made()
        state = algorithm.init(SEED)
        with pytest.raises(UsageError, match="evaluation 2: expected a finite number"):
            algorithm.tell(state, algorithm.ask(state, 4), np.array([0.0, 1.0, np.nan, 2.0]))

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

    def test_answers_out_of_turn_are_refused(self):
        """The fitness of another evaluation than the one that was asked for is refused."""
        algorithm = self.made()
        state = algorithm.init(SEED)
        batch = algorithm.ask(state, 1)
        state = algorithm.tell(state, batch, np.zeros(1))
        with pytest.raises(UsageError, match="expected the fitness of evaluation 1, not of 0"):
            algorithm.tell(state, batch, np.zeros(1))

    def test_states_of_another_size_are_refused(self):
        """A state with other cells than the algorithm's never reaches the compiled code."""
        other = RandomSearch(encoding=Toy(), size=3).init(SEED)
        with pytest.raises(StudyError, match="has 20 cells, but the state to continue from 3"):
            self.made().ask(other, 1)

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


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"genes": np.zeros((2, 4))}, r"expected genes int8\[2, 4\], got float64\[2, 4\]"),
        ({"number": 5}, "from number 0, got 2 from number 5"),
        ({"cells": np.zeros(3, np.int64)}, r"cells int64\[2\], got int64\[3\]"),
        ({"cells": [0, 1]}, r"cells int64\[2\], got list"),
        ({"parents": np.full((2, 2), 0.5)}, r"parents int64\[2, 2\], got float64\[2, 2\]"),
    ],
)
def test_wrong_batches_are_refused(change, message):
    """What an algorithm of a user's answers is looked at before it is evaluated."""
    state = make_algorithm("random", Toy()).init(SEED)
    batch = state.batch(np.zeros((2, 4), np.int8))
    check_batch(batch, state, 3, np.zeros(4, np.int8))
    with pytest.raises(UsageError, match=message):
        check_batch(batch._replace(**change), state, 3, np.zeros(4, np.int8))
    with pytest.raises(UsageError, match="expected 1 to 1 individuals from number 0, got 2"):
        check_batch(batch, state, 1, np.zeros(4, np.int8))
    with pytest.raises(UsageError, match="expected a Batch, got list"):
        check_batch([1], state, 3, np.zeros(4, np.int8))


def test_evolution_beats_random_search():
    """With the same thousand evaluations both genetic algorithms come closer than random search."""
    best = {}
    for name in ALGORITHMS:
        algorithm = make_algorithm(name, Toy())
        runs = [advance(algorithm, algorithm.init(np.uint64(k)), 1000) for k in range(3)]
        best[name] = np.mean([state.best_fitness for state in runs])
    assert best["torus"] > best["random"] + 10 and best["panmictic"] > best["random"] + 10


@pytest.mark.parametrize(
    ("name", "params", "message"),
    [
        ("annealing", {}, "one of torus, panmictic, random, or FILE.py:NAME, got 'annealing'"),
        ("torus", {"size": 64}, "'torus' has rows, columns; no 'size'"),
        ("random", {"seed": 1}, "has size; no 'seed'"),
        ("torus", {"rows": 2}, "rows of the torus: expected a whole number from 3"),
        ("torus", {"columns": 8.0}, "columns of the torus"),
        ("panmictic", {"size": 1}, "whole number from 2"),
        ("random", {"size": True}, "whole number from 1"),
    ],
)
def test_wrong_settings_are_refused(name, params, message):
    """An unknown algorithm, parameter or value is refused with what there is."""
    with pytest.raises(UsageError, match=message):
        make_algorithm(name, Toy(), **params)
