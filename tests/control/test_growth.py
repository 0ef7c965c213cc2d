"""Neurons and links added and deleted: rates, reach, and what stays as it was."""

from __future__ import annotations

import numpy as np

from realitygap.control.encoding import Variation
from realitygap.control.genotype import Genotype
from tests.control.laws import (
    MANY,
    STILL,
    compiled_only,
    evenly,
    links_of,
    offspring,
    only,
    parent,
    rate_fits,
)
from tests.control.reference import ReferenceNetwork


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


def test_nothing_to_add_or_delete():
    """A full genotype gains nothing and an empty one loses nothing."""
    size = {"slots": 10, "links": 1}
    bare = np.zeros((10, 6), np.int8)
    bare[:, 0] = 1
    full = bare.copy()
    full[8:, 2] = 1
    loses = Variation(**{**STILL, **size, "delete_neuron": 1.0, "delete_link": 1.0})
    gains = Variation(**{**STILL, **size, "add_neuron": 1.0, "add_link": 1.0})
    assert (offspring(loses, bare, n=20) == bare).all()
    assert (offspring(gains, full, n=20) == full).all()


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
            for n in Genotype(old, 8).neurons
            if n.slot != slot
        ]
        assert list(Genotype(new, 8).neurons) == kept
        new[slot] = old[slot]
        assert (new == old).all()
