"""The table of random streams: every name once, no two alike under one parent."""

import pytest

from realitygap import streams

TABLE = {
    "a study's seed": ("PICTURES",),
    "a run": ("BREEDING", "TRIALS", "RETEST", "FRESH", "TRANSFER", "NAMED"),
    "a trial": ("UNFED", "TWIN_NOISE", "CONSTANTS", "BETWEEN"),
    "an evaluation": ("CELL", "MATE", "REPLACED", "OFFSPRING"),
    "an individual": (
        "CROSSOVER", "MUTATION", "ADD_NEURON", "DELETE_NEURON", "ADD_LINK", "DELETE_LINK", "START",
    ),
}  # fmt: skip
"""The names under each kind of parent."""


def numbers() -> dict[str, int]:
    return {name: value for name, value in vars(streams).items() if isinstance(value, int)}


@pytest.mark.parametrize("parent", TABLE)
def test_no_two_streams_of_a_parent_are_one(parent):
    """Two purposes under one parent never draw the same numbers."""
    named = [numbers()[name] for name in TABLE[parent]]
    assert len(set(named)) == len(named) > 0


def test_every_name_stands_under_one_parent():
    """The table holds each name once, and nothing else."""
    listed = [name for names in TABLE.values() for name in names]
    assert sorted(listed) == sorted(numbers())


def test_no_number_ever_changes():
    """A study's seed means the same draws in every version."""
    assert numbers() == {
        "PICTURES": 5, "BREEDING": 1, "TRIALS": 2, "RETEST": 3, "FRESH": 4, "TRANSFER": 6,
        "NAMED": 7, "UNFED": 1, "TWIN_NOISE": 2, "CONSTANTS": 3, "BETWEEN": 4, "CELL": 0,
        "MATE": 1, "REPLACED": 2,
        "OFFSPRING": 3, "CROSSOVER": 0, "MUTATION": 1, "ADD_NEURON": 2, "DELETE_NEURON": 3, "ADD_LINK": 4,
        "DELETE_LINK": 5, "START": 6,
    }  # fmt: skip
