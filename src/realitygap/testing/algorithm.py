"""What every algorithm does, whatever it searches."""

from typing import Any
from unittest import TestCase

import numpy as np
from numpy.typing import NDArray

from realitygap.errors import RealityGapError
from realitygap.evolution.algorithm import Algorithm, Batch, State, check_batch, same

__all__ = ["AlgorithmContract"]

STREAM = np.uint64(2**64 - 1995)


class AlgorithmContract:
    """Tests of an algorithm: override `made`, and `fitness` unless larger sums of genes will do.

    Example:
        class TestMyAlgorithm(AlgorithmContract):
            def made(self):
                return MyAlgorithm(encoding=Variation())
    """

    pauses = (0, 1, 7, 40)
    """Evaluations before states are looked at."""

    def made(self) -> Algorithm[Any]:
        """The algorithm, with individuals of any encoding."""
        raise NotImplementedError("override made()")

    def fitness(self, genes: NDArray[Any]) -> float:
        """Of one individual: a finite number, the larger the fitter."""
        return float(np.abs(genes.astype(float)).sum())

    def test_it_starts_empty(self) -> None:
        """Before the first evaluation all cells are empty and there is no best."""
        algorithm = self.made()
        state = algorithm.init(STREAM)
        assert state.evaluations == 0 and state.best_number == -1
        assert len(state.genes) == len(state.numbers) == algorithm.cells
        assert (state.numbers == -1).all()

    def test_asking_changes_nothing(self) -> None:
        """Asking twice gives the same batch, and leaves the state as it was."""
        algorithm = self.made()
        for pause in self.pauses:
            state = self._after(algorithm, pause)
            kept = state.to_bytes()
            once, twice = algorithm.ask(state, 5), algorithm.ask(state, 5)
            assert same(once, twice) and state.to_bytes() == kept

    def test_batches_are_as_large_as_they_may_be_at_most(self) -> None:
        """From one individual to as many as requested, numbered from those told, of one type."""
        algorithm = self.made()
        one = algorithm.ask(algorithm.init(STREAM), 1).genes[0]
        for pause in self.pauses:
            for n in (1, 2, 33):
                state = self._after(algorithm, pause)
                assert 1 <= check_batch(algorithm.ask(state, n), state, n, one) <= n

    def test_the_size_of_batches_changes_nothing(self) -> None:
        """Asking for one at a time gives the same individuals."""
        algorithm = self.made()
        single, many = algorithm.init(STREAM), algorithm.init(STREAM)
        lived: list[list[Batch]] = [[], []]
        for _ in range(60):
            lived[0].append(algorithm.ask(single, 1))
            single = self._told(algorithm, single, lived[0][-1])
        while many.evaluations < 60:
            lived[1].append(algorithm.ask(many, 60 - many.evaluations))
            many = self._told(algorithm, many, lived[1][-1])
        assert all(np.array_equal(*pair) for pair in zip(*map(_genes, lived), strict=True))
        assert single.to_bytes() == many.to_bytes()

    def test_telling_leaves_the_old_state(self) -> None:
        """From the old state another future is possible."""
        algorithm = self.made()
        for pause in self.pauses:
            state = self._after(algorithm, pause)
            kept, batch = state.to_bytes(), algorithm.ask(state, 1)
            high, low = (algorithm.tell(state, batch, np.array([value])) for value in (9e9, -9e9))
            assert state.to_bytes() == kept and high.to_bytes() != low.to_bytes()
            assert high.evaluations == low.evaluations == pause + 1
            assert high.best_number == pause and np.array_equal(high.best_genes, batch.genes[0])

    def test_residents_are_who_they_say(self) -> None:
        """Parents are earlier; each resident was evaluated under its number."""
        algorithm, lived = self.made(), []
        state = algorithm.init(STREAM)
        while state.evaluations < 120:
            batch = algorithm.ask(state, 120 - state.evaluations)
            assert ((batch.parents >= -1) & (batch.parents < batch.number)).all()
            assert ((batch.cells >= 0) & (batch.cells < algorithm.cells)).all()
            lived += list(batch.genes)
            state = self._told(algorithm, state, batch)
        for genes, number in zip(state.genes, state.numbers.tolist(), strict=True):
            assert number == -1 or np.array_equal(genes, lived[number])

    def test_the_best_is_kept(self) -> None:
        """The fittest ever told is remembered, the first of several equals."""
        algorithm, told = self.made(), []
        state = algorithm.init(STREAM)
        for number in range(60):
            told.append(float(number % 7))
            state = algorithm.tell(state, algorithm.ask(state, 1), np.array(told[-1:]))
        assert state.best_fitness == 6.0 and state.best_number == told.index(6.0)

    def test_resuming_continues_with_the_same_bits(self) -> None:
        """A run that was saved and read again ends in the same bytes."""
        algorithm = self.made()
        straight = self._after(algorithm, 90)
        for pause in self.pauses:
            again = self.made()
            read = again.from_bytes(self._after(algorithm, pause).to_bytes())
            assert self._after(again, 90 - pause, read).to_bytes() == straight.to_bytes()

    def test_streams_differ(self) -> None:
        """Another stream is another run."""
        algorithm = self.made()
        one, other = (algorithm.ask(algorithm.init(np.uint64(k)), 1).genes for k in (1, 2))
        assert not np.array_equal(one, other)

    def test_a_fitness_that_is_no_number_is_refused(self) -> None:
        """NaN and infinite fitness are refused, and nothing is lost."""
        algorithm = self.made()
        state = self._after(algorithm, 25)
        batch = algorithm.ask(state, 1)
        for wrong in (np.nan, np.inf, -np.inf):
            with TestCase().assertRaises(RealityGapError, msg=f"a fitness of {wrong} was accepted"):
                algorithm.tell(state, batch, np.array([wrong]))
        assert algorithm.tell(state, batch, np.zeros(1)).evaluations == 26

    def _after(self, algorithm: Algorithm[Any], n: int, state: State | None = None) -> State:
        """The state after n evaluations more."""
        state = algorithm.init(STREAM) if state is None else state
        end = state.evaluations + n
        while state.evaluations < end:
            state = self._told(algorithm, state, algorithm.ask(state, end - state.evaluations))
        return state

    def _told(self, algorithm: Algorithm[Any], state: State, batch: Batch) -> State:
        told: State = algorithm.tell(state, batch, np.array([self.fitness(one) for one in batch.genes]))
        return told


def _genes(batches: list[Batch]) -> list[NDArray[Any]]:
    return [one for batch in batches for one in batch.genes]
