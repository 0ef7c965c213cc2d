"""Laws that random operators are held against, and the parent they are tried on."""

from __future__ import annotations

import numba
import numpy as np
import pytest
from scipy import stats

from realitygap.control.encoding import Variation

MANY = 1500 if numba.config.DISABLE_JIT else 20000
SURE = 1e-5
"""A test raises a false alarm once in a hundred thousand seeds; the seeds are fixed."""
STILL = {
    "crossover": 0.0,
    "mutation": 0.0,
    "add_neuron": 0.0,
    "delete_neuron": 0.0,
    "add_link": 0.0,
    "delete_link": 0.0,
}
compiled_only = pytest.mark.skipif(
    bool(numba.config.DISABLE_JIT), reason="too few draws without the compiler to tell the laws apart"
)


def rate_fits(count: int, trials: int, chance: float) -> bool:
    return bool(stats.binomtest(int(count), int(trials), chance).pvalue > SURE)


def evenly(counts) -> bool:
    return bool(stats.chisquare(counts).pvalue > SURE)


def only(**rates: float) -> Variation:
    """A variation in which nothing else happens."""
    return Variation(**{**STILL, **rates})


def offspring(variation: Variation, first, second=None, n: int = MANY) -> np.ndarray:
    other = first if second is None else second
    return np.stack([variation.offspring(first, other, np.uint64(k)) for k in range(n)])


def parent() -> np.ndarray:
    """Hidden neurons in slots 10 and 20; half of all link fields expressed, some of them dormant."""
    genes = np.zeros((30, 34), np.int8)
    genes[:10, 0] = 1
    genes[[10, 20], 0] = 1
    for slot in (8, 9, 10, 20):
        genes[slot, 1] = slot - 9
        for k in range(0, 8, 2):
            source = (3, 8, 20, 25)[k // 2]
            genes[slot, 2 + 4 * k : 6 + 4 * k] = 1, source, k // 2 - 2, k // 2
    return genes


def links_of(genes: np.ndarray) -> np.ndarray:
    return genes[..., 2:].reshape(*genes.shape[:-1], -1, 4)
