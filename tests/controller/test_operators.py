"""Every operator's rate and reach, against its law; a wrong law must be found out."""

from __future__ import annotations

import numba
import numpy as np
import pytest
from scipy import stats

from realitygap.controller.layout import Layout
from realitygap.controller.network import neurons
from realitygap.controller.operators import Variation
from realitygap.errors import GenotypeError, UsageError
from tests.controller.reference import ReferenceNetwork

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
    layout = Layout()
    genes = np.zeros(layout.shape, np.int8)
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
    layout = Layout()
    first, second = np.ones(layout.shape, np.int8), np.ones(layout.shape, np.int8)
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


def test_add_neuron():
    """A neuron is added with probability 0.05, in any free slot, with fresh content."""
    rare = offspring(only(add_neuron=0.05), parent())
    assert rate_fits((rare[:, :, 0].sum(axis=1) == 13).sum(), MANY, 0.05)
    made = offspring(only(add_neuron=1.0), parent(), n=MANY // 4)
    old = parent()[:, 0] == 1
    assert (made[:, old] == parent()[old]).all()
    counts = made[:, ~old, 0].sum(axis=0)
    assert counts.sum() == len(made) and evenly(counts)
    slots = np.argmax(made[:, :, 0] - parent()[:, 0], axis=1)
    new = made[np.arange(len(made)), slots]
    links = links_of(new)
    assert evenly(np.bincount(new[:, 1].astype(int) + 10, minlength=21))
    assert rate_fits(links[..., 0].sum(), links[..., 0].size, 0.5)
    assert not links[links[..., 0] == 0].any()
    assert (made[np.arange(len(made))[:, None], links[..., 1], 0] == 1).all()


def test_delete_neuron():
    """A hidden neuron is deleted with probability 0.05, any of them; links from it stay."""
    rare = offspring(only(delete_neuron=0.05), parent())
    assert rate_fits((rare[:, :, 0].sum(axis=1) == 11).sum(), MANY, 0.05)
    made = offspring(only(delete_neuron=1.0), parent(), n=MANY // 4)
    gone = made[:, [10, 20], 0] == 0
    assert (gone.sum(axis=1) == 1).all() and evenly(gone.sum(axis=0))
    assert (made[:, :10] == parent()[:10]).all()
    for slot in (10, 20):
        assert not made[made[:, slot, 0] == 0, slot].any()


def test_add_link():
    """A link is added with probability 0.1, in any free field of a motor or hidden neuron."""
    rare = offspring(only(add_link=0.1), parent())
    assert rate_fits((rare != parent()).any(axis=(1, 2)).sum(), MANY, 0.1)
    made = offspring(only(add_link=1.0), parent(), n=MANY // 4)
    old, new = links_of(parent()), links_of(made)
    free = (old[..., 0] == 0) & (parent()[:, 0] == 1)[:, None]
    free[:8] = False
    counts = new[:, free][..., 0].sum(axis=0)
    assert counts.sum() == len(made) and evenly(counts)
    assert (new[:, ~free] == old[~free]).all() and (made[:, :, :2] == parent()[:, :2]).all()
    added = new[:, free][new[:, free][..., 0] == 1].astype(int)
    assert evenly(np.bincount(added[:, 1], minlength=30)[[*range(11), 20]])
    assert evenly(np.bincount(added[:, 2] + 4, minlength=9))
    assert evenly(np.bincount(added[:, 3], minlength=5))


def test_delete_link():
    """A link is deleted with probability 0.1, any of them, live or dormant; its field is blank."""
    rare = offspring(only(delete_link=0.1), parent())
    assert rate_fits((rare != parent()).any(axis=(1, 2)).sum(), MANY, 0.1)
    made = offspring(only(delete_link=1.0), parent(), n=MANY // 4)
    old, new = links_of(parent()), links_of(made)
    gone = (new[..., 0] == 0)[:, old[..., 0] == 1]
    assert (gone.sum(axis=1) == 1).all() and evenly(gone.sum(axis=0))
    assert not new[new[..., 0] == 0].any()


@compiled_only
def test_wrong_operator_rates_are_found_out():
    """Rates of 0.06 for neurons and 0.11 for links, instead of 0.05 and 0.1, do not pass."""
    for name, wrong, right in (
        ("add_neuron", 0.06, 0.05),
        ("delete_neuron", 0.06, 0.05),
        ("add_link", 0.112, 0.1),
        ("delete_link", 0.112, 0.1),
    ):
        made = offspring(only(**{name: wrong}), parent())
        assert not rate_fits((made != parent()).any(axis=(1, 2)).sum(), MANY, right), name


@pytest.mark.parametrize("name", ["add_neuron", "delete_neuron", "add_link", "delete_link"])
def test_operators_are_independent(name):
    """Whether there is crossover says nothing about what else happens."""
    variation = only(crossover=0.5, **{name: 0.5})
    crossed = np.array([variation.crosses(np.uint64(k)) for k in range(MANY)])
    acted = (offspring(variation, parent()) != parent()).any(axis=(1, 2))
    table = [[(crossed & acted).sum(), (crossed & ~acted).sum()]]
    table.append([(~crossed & acted).sum(), (~crossed & ~acted).sum()])
    assert stats.chi2_contingency(table).pvalue > SURE
    assert rate_fits(acted.sum(), MANY, 0.5)


def test_nothing_to_add_or_delete():
    """A full genotype gains nothing and an empty one loses nothing."""
    layout = Layout(slots=10, links=1)
    bare = np.zeros(layout.shape, np.int8)
    bare[:, 0] = 1
    full = bare.copy()
    full[8:, 2] = 1
    loses = Variation(**{**STILL, "layout": layout, "delete_neuron": 1.0, "delete_link": 1.0})
    gains = Variation(**{**STILL, "layout": layout, "add_neuron": 1.0, "add_link": 1.0})
    assert (offspring(loses, bare, n=20) == bare).all()
    assert (offspring(gains, full, n=20) == full).all()


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


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ({"mutation": 1.5}, r"variation\.mutation must be a probability, 0 to 1, not 1\.5"),
        ({"crossover": True}, "variation.crossover"),
        ({"add_link": float("nan")}, "variation.add_link"),
        ({"delete_link": "0.1"}, "variation.delete_link"),
        ({"sources": "some"}, 'must be "expressed" or "all"'),
    ],
)
def test_wrong_settings_are_refused(setting, message):
    """A setting out of its range is refused by its key."""
    with pytest.raises(UsageError, match=message):
        Variation(**setting)


def test_wrong_parents_are_refused():
    """Parents of another shape or type never reach the compiled operators."""
    good = parent()
    for bad in (good[:20], good.astype(np.int64), good[:, :30]):
        with pytest.raises(GenotypeError, match=r"int8\[30, 34\]"):
            Variation().offspring(good, bad, np.uint64(1))


def test_an_added_neuron_changes_no_behaviour():
    """The operator's new neuron is heard by nobody, unless a dormant link was waiting for its slot."""
    steps = np.random.default_rng(1).integers(-10, 11, (8, 8)).tolist()
    added = only(add_neuron=1.0)
    unheard = 0
    for k in range(150):
        old = Variation(start_neurons=0.3).random(np.uint64(k))
        new = added.offspring(old, old, np.uint64(k))
        slot = int(np.flatnonzero(new[:, 0] != old[:, 0])[0])
        fields = links_of(old)
        if not ((fields[..., 0] == 1) & (fields[..., 1] == slot)).any():
            unheard += 1
            assert ReferenceNetwork(new).drive(steps) == ReferenceNetwork(old).drive(steps)
    assert unheard == 150


def test_a_deleted_neuron_changes_only_its_own_links():
    """After the operator took a neuron away, the rest is wired as it was, and can be wired again."""
    gone = only(delete_neuron=1.0)
    for k in range(50):
        old = Variation(start_neurons=0.3).random(np.uint64(k))
        new = gone.offspring(old, old, np.uint64(k))
        (slot,) = np.flatnonzero((new != old).any(axis=1))
        kept = [
            n._replace(links=tuple(link for link in n.links if link.source != slot))
            for n in neurons(old, Layout())
            if n.slot != slot
        ]
        assert list(neurons(new, Layout())) == kept
        new[slot] = old[slot]
        assert (new == old).all()
