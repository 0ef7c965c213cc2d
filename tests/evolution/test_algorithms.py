"""What every algorithm promises: one contract, and what sets each of them apart."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from realitygap.errors import RealityGapError, StudyError, UsageError
from realitygap.evolution import ALGORITHMS, DistributedGA, Panmictic, RandomSearch, make_algorithm
from tests.evolution.toy import Toy, advance, fitness_of

SEED = np.uint64(2**64 - 1995)


class AlgorithmContract:
    """Holds for every algorithm; a subclass says which."""

    name: str

    @pytest.fixture
    def algorithm(self):
        size = {"rows": 4, "columns": 5} if self.name == "torus" else {"size": 20}
        return make_algorithm(self.name, Toy(), **size)

    def test_it_starts_empty(self, algorithm):
        """Before the first evaluation nobody lives anywhere and nobody is best."""
        state = algorithm.init(SEED)
        assert state.evaluations == 0 and state.best_number == -1
        assert state.genes.shape == (algorithm.cells, 4) and state.genes.dtype == np.int8
        assert (state.numbers == -1).all() and (state.fitness == -np.inf).all()

    def test_first_individuals_are_random(self, algorithm):
        """The first evaluations have no parents and fill every cell once."""
        state, cells = algorithm.init(SEED), set()
        for _ in range(algorithm.cells):
            candidate = algorithm.ask(state)
            assert candidate.parents == (-1, -1)
            cells.add(candidate.cell)
            state = algorithm.tell(state, candidate, fitness_of(candidate.genes))
        assert len(cells) == algorithm.cells and (state.numbers >= 0).all()

    @pytest.mark.parametrize("before", [0, 7, 20, 90])
    def test_ask_is_pure(self, algorithm, before):
        """Asking twice gives the same candidate and leaves the state as it was."""
        state = advance(algorithm, algorithm.init(SEED), before)
        kept = state.to_bytes()
        once, twice = algorithm.ask(state), algorithm.ask(state)
        assert (once.genes == twice.genes).all() and once._replace(genes=0) == twice._replace(genes=0)
        assert state.to_bytes() == kept

    @pytest.mark.parametrize("before", [0, 7, 20, 90])
    def test_tell_leaves_the_old_state(self, algorithm, before):
        """Telling gives a new state; from the old one another future can be told."""
        state = advance(algorithm, algorithm.init(SEED), before)
        kept = state.to_bytes()
        candidate = algorithm.ask(state)
        high, low = algorithm.tell(state, candidate, 1.0), algorithm.tell(state, candidate, -9e9)
        assert state.to_bytes() == kept and high.to_bytes() != low.to_bytes()
        assert high.best_number == before and (high.best_genes == candidate.genes).all()

    def test_states_are_frozen(self, algorithm):
        """A state's fields cannot be set."""
        with pytest.raises(dataclasses.FrozenInstanceError):
            algorithm.init(SEED).evaluations = 5

    def test_numbers_count_up(self, algorithm):
        """Candidates are numbered from 0; parents are earlier; residents are who they say."""
        state, lived = algorithm.init(SEED), []
        for number in range(120):
            candidate = algorithm.ask(state)
            assert candidate.number == number == state.evaluations
            assert all(-1 <= parent < number for parent in candidate.parents)
            assert 0 <= candidate.cell < algorithm.cells
            lived.append(candidate)
            state = algorithm.tell(state, candidate, fitness_of(candidate.genes))
        for cell, number in enumerate(state.numbers):
            assert (state.genes[cell] == lived[number].genes).all()
            assert state.fitness[cell] == fitness_of(lived[number].genes)
            assert lived[number].cell == cell

    def test_the_best_is_kept(self, algorithm):
        """The fittest ever told is remembered, the first of several equals."""
        state, told = algorithm.init(SEED), []
        for number in range(100):
            candidate = algorithm.ask(state)
            told.append(float(number % 7))
            state = algorithm.tell(state, candidate, told[-1])
        assert state.best_fitness == 6.0 and state.best_number == told.index(6.0)

    @pytest.mark.parametrize("pause", [0, 1, 19, 20, 21, 77])
    def test_resuming_continues_with_the_same_bits(self, algorithm, pause):
        """A run that was written down and read again ends in the same bytes."""
        straight = advance(algorithm, algorithm.init(SEED), 100)
        state = advance(algorithm, algorithm.init(SEED), pause)
        state = type(state).from_bytes(state.to_bytes())
        assert advance(algorithm, state, 100 - pause).to_bytes() == straight.to_bytes()

    def test_streams_differ(self, algorithm):
        """Another stream is another run."""
        one = advance(algorithm, algorithm.init(SEED), 30)
        other = advance(algorithm, algorithm.init(np.uint64(1)), 30)
        assert not (one.genes == other.genes).all()

    @pytest.mark.parametrize("fitness", [float("nan"), float("inf"), -float("inf")])
    def test_a_fitness_that_is_no_number_is_refused(self, algorithm, fitness):
        """NaN and infinite fitness are refused with the evaluation's number, and nothing is lost."""
        state = advance(algorithm, algorithm.init(SEED), 25)
        candidate = algorithm.ask(state)
        with pytest.raises(RealityGapError, match="evaluation 25 must be a finite number"):
            algorithm.tell(state, candidate, fitness)
        assert algorithm.tell(state, candidate, 0.0).evaluations == 26

    def test_answers_out_of_turn_are_refused(self, algorithm):
        """The fitness of another evaluation than the one that was asked for is refused."""
        state = algorithm.init(SEED)
        candidate = algorithm.ask(state)
        state = algorithm.tell(state, candidate, 0.0)
        with pytest.raises(UsageError, match="expected the fitness of evaluation 1, not of 0"):
            algorithm.tell(state, candidate, 0.0)

    def test_states_of_another_size_are_refused(self, algorithm):
        """A state with other cells than the algorithm's never reaches the compiled code."""
        other = RandomSearch(variation=Toy(), size=3).init(SEED)
        with pytest.raises(StudyError, match="has 20 cells, but the state to go on from 3"):
            algorithm.ask(other)

    def test_it_improves(self, algorithm):
        """More evaluations never make the best worse."""
        state, best = algorithm.init(SEED), -np.inf
        for _ in range(5):
            state = advance(algorithm, state, 40)
            assert state.best_fitness >= best
            best = state.best_fitness


class TestTorus(AlgorithmContract):
    name = "torus"


class TestPanmictic(AlgorithmContract):
    name = "panmictic"


class TestRandomSearch(AlgorithmContract):
    name = "random"

    def test_it_keeps_the_best(self, algorithm):
        """After many evaluations the cells hold the fittest of all, the earlier of equals."""
        state, told = algorithm.init(SEED), []
        for _ in range(150):
            candidate = algorithm.ask(state)
            told.append(fitness_of(candidate.genes))
            state = algorithm.tell(state, candidate, told[-1])
        assert sorted(state.fitness) == sorted(told)[-20:]

    def test_nothing_is_inherited(self, algorithm):
        """What comes next does not depend on any fitness."""
        state = algorithm.init(SEED)
        for number in range(60):
            candidate = algorithm.ask(state)
            other = dataclasses.replace(state, fitness=state.fitness + 1.0)
            assert (algorithm.ask(other).genes == candidate.genes).all()
            assert candidate.parents == (-1, -1)
            state = algorithm.tell(state, candidate, float(number % 5))


@pytest.mark.parametrize("kind", [DistributedGA, Panmictic])
def test_parents_are_named(kind):
    """Without crossover an offspring has one parent, with it two; they live in the cells drawn."""
    for crossover, has_second in ((0.0, False), (1.0, True)):
        algorithm = kind(variation=Toy(crossover=crossover))
        state = advance(algorithm, algorithm.init(SEED), 70)
        for _ in range(30):
            candidate = algorithm.ask(state)
            first, second = candidate.parents
            assert first in state.numbers and (second in state.numbers) == has_second
            assert has_second or second == -1
            state = algorithm.tell(state, candidate, fitness_of(candidate.genes))


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
        ("annealing", {}, "one of torus, panmictic, random; not 'annealing'"),
        ("torus", {"size": 64}, "'torus' has rows, columns; no 'size'"),
        ("random", {"seed": 1}, "has size; no 'seed'"),
        ("torus", {"rows": 2}, "rows of the torus must be a whole number from 3"),
        ("torus", {"columns": 8.0}, "columns of the torus"),
        ("panmictic", {"size": 1}, "whole number from 2"),
        ("random", {"size": True}, "whole number from 1"),
    ],
)
def test_wrong_settings_are_refused(name, params, message):
    """An unknown algorithm, parameter or value is refused with what there is."""
    with pytest.raises(UsageError, match=message):
        make_algorithm(name, Toy(), **params)
