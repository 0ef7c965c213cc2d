"""Selection follows its rank law, and events far apart do not touch each other."""

from __future__ import annotations

import numba
import numpy as np
import pytest
from scipy import stats

from realitygap.evolution.ga import EVERYBODY, select

MANY = 25000 if numba.config.DISABLE_JIT else 60000
SURE = 1e-5


def by_rank(fitness: np.ndarray) -> np.ndarray:
    """The law (§5.1), the long way: rank 1 … n, weight = rank; equals share their ranks' weights."""
    return stats.rankdata(fitness) / (len(fitness) * (len(fitness) + 1) / 2)


def neighbours(cell: int, rows: int, columns: int) -> list[int]:
    row, column = divmod(cell, columns)
    around = [(row + i) % rows * columns + (column + j) % columns for i in (-1, 0, 1) for j in (-1, 0, 1)]
    return [other for other in around if other != cell]


def fits(drawn: np.ndarray, law: np.ndarray) -> bool:
    """Whether draws of 0 … n − 1 follow a law."""
    counts = np.bincount(drawn, minlength=len(law))
    return bool(stats.chisquare(counts, law * len(drawn)).pvalue > SURE)


FITNESS = {
    "all different": np.random.default_rng(3).permutation(20.0 * np.arange(30)),
    "some alike": np.random.default_rng(4).integers(0, 3, 30).astype(float),
    "all alike": np.zeros(30),
}


def draws(fitness: np.ndarray, grid: int, n: int = MANY) -> np.ndarray:
    """(cell, mate, replaced) of the next evaluation of n runs with the same fitness."""
    return select(np.tile(fitness, (n, 1)), grid, np.arange(n, dtype=np.uint64), len(fitness))


@pytest.fixture(scope="module")
def grid():
    """Draws on a grid of 5 × 6, for each kind of fitness."""
    return {name: draws(fitness, 5) for name, fitness in FITNESS.items()}


def places(drawn: np.ndarray, cells_of) -> np.ndarray:
    """Each drawn cell as its place in the list of cells that it was drawn from."""
    return np.array([cells_of[cell].index(other) for cell, other in drawn])


AROUND = {cell: neighbours(cell, 5, 6) for cell in range(30)}
NINE = {cell: [*neighbours(cell, 5, 6), cell] for cell in range(30)}


@pytest.mark.parametrize("name", FITNESS)
def test_breeding_cells_are_uniform(grid, name):
    """Every cell breeds as often as any other, whatever its fitness."""
    assert fits(grid[name][:, 0], np.full(30, 1 / 30))


@pytest.mark.parametrize("name", FITNESS)
def test_mates_by_linear_rank(grid, name):
    """A mate is one of the eight neighbours, by linear rank of fitness; ties are even."""
    expected = np.zeros(30)
    for cell in range(30):
        expected[AROUND[cell]] += by_rank(FITNESS[name][AROUND[cell]]) / 30
    assert all(mate in AROUND[cell] for cell, mate in grid[name][:, :2])
    assert fits(grid[name][:, 1], expected)


@pytest.mark.parametrize("name", FITNESS)
def test_replaced_by_inverse_rank(grid, name):
    """The replaced cell is one of the nine, by linear inverse rank: perhaps a parent's."""
    expected = np.zeros(30)
    for cell in range(30):
        expected[NINE[cell]] += by_rank(-FITNESS[name][NINE[cell]]) / 30
    assert all(cell in NINE[centre] for centre, cell in grid[name][:, [0, 2]])
    assert fits(grid[name][:, 2], expected)


def test_wrong_laws_are_found_out(grid):
    """Uniform choice, the better of two with repetition, or the other direction do not pass."""
    fitness, drawn = FITNESS["all different"], grid["all different"]
    laws = {
        "uniform": lambda f: np.full(len(f), 1 / len(f)),
        "tournament": lambda f: (2 * stats.rankdata(f) - 1) / len(f) ** 2,
        "inverse": lambda f: by_rank(-f),
    }
    for name, law in laws.items():
        expected = np.zeros(30)
        for cell in range(30):
            expected[AROUND[cell]] += law(fitness[AROUND[cell]]) / 30
        assert not fits(drawn[:, 1], expected), name


def test_ranks_within_a_neighbourhood():
    """Around one cell the best of eight is the mate eight times as often as the worst."""
    fitness = FITNESS["all different"]
    drawn = draws(fitness, 5)
    here = drawn[drawn[:, 0] == 8]
    law = by_rank(fitness[AROUND[8]])
    assert law.max() == pytest.approx(8 * law.min())
    assert fits(places(here[:, :2], AROUND), law)
    assert fits(places(here[:, [0, 2]], NINE), by_rank(-fitness[NINE[8]]))


@pytest.mark.parametrize("name", FITNESS)
def test_panmictic_ranks(name):
    """Without the grid the mate is drawn from all others and the replaced cell from all."""
    fitness = FITNESS[name][:12]
    drawn = draws(fitness, EVERYBODY)
    assert (drawn[:, 0] != drawn[:, 1]).all() and fits(drawn[:, 0], np.full(12, 1 / 12))
    expected = np.zeros(12)
    for cell in range(12):
        others = [other for other in range(12) if other != cell]
        expected[others] += by_rank(fitness[others]) / 12
    assert fits(drawn[:, 1], expected)
    assert fits(drawn[:, 2], by_rank(-fitness))
