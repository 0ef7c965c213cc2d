"""Random starts, mutation and crossover against their laws; a wrong law must be found out."""

from __future__ import annotations

import numpy as np

from realitygap.control.encoding import Variation
from tests.control.laws import (
    MANY,
    compiled_only,
    evenly,
    links_of,
    offspring,
    only,
    parent,
    rate_fits,
)


def test_nothing_happens_at_rate_zero():
    """With all rates zero an offspring is its first parent, whoever the second is."""
    second = Variation().random(np.uint64(9))
    assert (offspring(only(), parent(), second, 50) == parent()).all()


def test_parents_stay_as_they_are():
    """Operators never change a parent, and the same stream gives the same offspring."""
    first, second = parent(), Variation(start_neurons=0.5).random(np.uint64(9))
    kept = first.copy(), second.copy()
    variation = Variation(mutation=0.9, add_neuron=1, delete_neuron=1, add_link=1, delete_link=1)
    once = offspring(variation, first, second, 50)
    assert (first == kept[0]).all() and (second == kept[1]).all()
    assert (once == offspring(variation, first, second, 50)).all()


def mutated_pieces(chance: float) -> int:
    """How many of the 4 · 13 pieces of information changed; redrawn ones may come out alike."""
    return int((offspring(only(mutation=chance), parent()) != parent()).sum())


MUTATION_CHANGE = 4 * (20 / 21 + 4 * (8 / 9 + 4 / 5)) + 4 * (3 * 11 / 12 + 1)
"""Pieces that differ if all are drawn anew: a dormant link's source (25) always, as it is not held."""


def test_mutation_rate():
    """Each stored piece of information is drawn anew with probability 0.05, uniformly."""
    assert rate_fits(mutated_pieces(0.05), MANY * 52, 0.05 * MUTATION_CHANGE / 52)


@compiled_only
def test_a_wrong_mutation_rate_is_found_out():
    """A rate of 0.053 instead of 0.05 does not pass."""
    assert not rate_fits(mutated_pieces(0.053), MANY * 52, 0.05 * MUTATION_CHANGE / 52)


def test_mutated_values_are_uniform():
    """Thresholds, weights and delays are drawn over all their values, sources over held slots."""
    made = offspring(only(mutation=1.0), parent(), n=MANY // 4)
    links = links_of(made)[:, 8][:, ::2]
    assert evenly(np.bincount(made[:, 8, 1].astype(int) + 10, minlength=21))
    assert evenly(np.bincount(links[..., 2].ravel().astype(int) + 4, minlength=9))
    assert evenly(np.bincount(links[..., 3].ravel().astype(int), minlength=5))
    held = [*range(11), 20]
    counts = np.bincount(links[..., 1].ravel().astype(int), minlength=30)
    assert evenly(counts[held]) and counts.sum() == counts[held].sum()


def test_mutation_leaves_expression_alone():
    """Point mutation expresses and silences nothing, and writes nothing into what is blank."""
    made, old = offspring(only(mutation=1.0), parent(), n=200), parent()
    assert (made[:, :, 0] == old[:, 0]).all()
    assert (links_of(made)[..., 0] == links_of(old)[..., 0]).all()
    assert not links_of(made)[:, links_of(old)[..., 0] == 0].any()
    assert not made[:, old[:, 0] == 0].any() and not made[:, :8, 1:].any()


def test_crossover_rate_and_cut():
    """Crossover happens with probability 0.8, at one cut, uniform between two slots; `crosses` knows."""
    first, second = np.ones((2, 30, 34), np.int8)
    first[:, 1], second[:, 1] = 2, 5
    variation = only(crossover=0.8)
    made = offspring(variation, first, second)
    own = (made[:, :, 1] == 2).sum(axis=1)
    assert (np.diff((made[:, :, 1] == 5).astype(int), axis=1) >= 0).all()
    assert rate_fits((own < 30).sum(), MANY, 0.8)
    assert evenly(np.bincount(own[own < 30], minlength=30)[1:])
    said = np.array([variation.crosses(np.uint64(k)) for k in range(MANY)])
    assert (said == (own < 30)).all()


@compiled_only
def test_a_wrong_crossover_rate_is_found_out():
    """A rate of 0.82 instead of 0.8 does not pass."""
    said = sum(only(crossover=0.82).crosses(np.uint64(k)) for k in range(MANY))
    assert not rate_fits(said, MANY, 0.8)


def test_random_start():
    """Hidden slots hold a neuron with 0.05, link fields a link with 0.5, from held slots, uniformly."""
    made = np.stack([Variation().random(np.uint64(k)) for k in range(MANY // 4)])
    assert (made[:, :10, 0] == 1).all()
    assert rate_fits(made[:, 10:, 0].sum(), made[:, 10:, 0].size, 0.05)
    assert evenly(made[:, 10:, 0].sum(axis=0))
    links = links_of(made)
    motors = links[:, 8:10]
    assert rate_fits(motors[..., 0].sum(), motors[..., 0].size, 0.5)
    assert evenly(np.bincount(made[:, 8:10, 1].ravel().astype(int) + 10, minlength=21))
    shown = links[:, 8:][links[:, 8:][..., 0] == 1].astype(int)
    assert evenly(np.bincount(shown[:, 2] + 4, minlength=9))
    assert evenly(np.bincount(shown[:, 3], minlength=5))
    bare = made[made[:, 10:, 0].sum(axis=1) == 0]
    sources = links_of(bare)[:, 8:10]
    assert evenly(np.bincount(sources[sources[..., 0] == 1][:, 1].astype(int), minlength=10))
    where = np.argwhere(links[..., 0] == 1)
    assert (made[where[:, 0], links[tuple(where.T)][:, 1], 0] == 1).all()


def test_all_slots_as_sources():
    """With sources "all" a link may come from any slot, held or not."""
    made = offspring(only(mutation=1.0, sources="all"), parent(), n=MANY // 4)
    sources = links_of(made)[:, 8:11, ::2, 1].ravel().astype(int)
    assert evenly(np.bincount(sources, minlength=30))
