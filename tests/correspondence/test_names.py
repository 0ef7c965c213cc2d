"""Names: held-out exemplars at every noise level, mirror images, and robots that are none of these."""

import math

import numpy as np
import pytest

from realitygap.correspondence.exemplars.kinds import KINDS, exemplar, shows
from realitygap.correspondence.names import NONE, common_name, namer
from realitygap.tasks.load import load_task
from realitygap.values import Command
from tests.correspondence.ladders import held_out, setting_for
from tests.correspondence.tracks import mirrored, random_walker, standing

TASKS = pytest.mark.parametrize("task", KINDS)
EACH = 15


@TASKS
def test_held_out_exemplars_get_their_names(task):
    """At zero, observed and double noise 95 % or more of robots never seen get their kind's name."""
    right = []
    for level in (0.0, 1.0, 2.0):
        trials = {kind: [exemplar(task, kind, 7000 + i, level) for i in range(EACH)] for kind in KINDS[task]}
        right.append(np.mean(list(held_out(task, trials).values())))
    assert min(right) >= 0.95


def test_a_trial_without_its_mark_is_drawn_again():
    """An exemplar's commands hold what its kind's definition names; a two way turner turns both ways."""
    command = dict(zip("slrbt", [(5, 5), (-3, 3), (3, -3), (-5, -5), (2, 6)], strict=True))

    def said(letters):
        return [Command(left=command[c][0], right=command[c][1]) for c in letters]

    assert shows("obstacle-avoidance", "two way turner", said("sssssllllllrrrrr"))
    assert not shows("obstacle-avoidance", "two way turner", said("sssssllllllrrrr"))
    assert shows("obstacle-avoidance", "one way turner", said("ssssslllll"))
    assert not shows("light-seeking", "straight looper", said("t" * 200))
    assert not shows("light-seeking", "bobber", said("s" * 200))
    assert shows("light-seeking", "random walker", [])
    plain = [exemplar("obstacle-avoidance", "two way turner", 7000 + i, 1.0, marked=False) for i in range(8)]
    marked = [exemplar("obstacle-avoidance", "two way turner", 7000 + i, 1.0) for i in range(8)]
    same = [np.array_equal(a.x, b.x) for a, b in zip(plain, marked, strict=True)]
    assert any(same) and not all(same)


@TASKS
@pytest.mark.parametrize("nobody", ["standing", "spinning", "random walker"])
def test_robots_without_a_purpose_are_none_of_these(task, nobody):
    """A robot that stands, spins or walks at random has none of the paper's names."""
    trials = [exemplar(task, nobody, 8000 + i, 1.0) for i in range(EACH)]
    assert held_out(task, {nobody: trials})[nobody] >= 0.93


@TASKS
def test_another_random_walker_is_none_of_these(task):
    """Nor has a walker of another law than the exemplars', or one that stands elsewhere."""
    setting = setting_for(task)
    size = load_task(task).arena.size_cm
    names = namer(setting)
    walkers = [random_walker(seed, size) for seed in range(12)]
    assert np.mean([found.name == NONE for found in names.name(walkers, setting)]) >= 0.9
    stands = [standing(25, 25, h) for h in np.linspace(0, 6, 5)]
    assert all(found.name == NONE for found in names.name(stands, setting))


def test_a_mirror_image_has_the_same_name():
    """Turning left or right makes no other kind, nor another confidence."""
    setting = setting_for("obstacle-avoidance")
    names = namer(setting)
    trials = [exemplar("obstacle-avoidance", kind, 7000, 1.0) for kind in KINDS["obstacle-avoidance"]]
    plain, flipped = names.name(trials, setting), names.name(mirrored(trials, 50.0), setting)
    assert [n.name for n in plain] == [n.name for n in flipped]
    assert [n.confidence for n in plain] == pytest.approx([n.confidence for n in flipped], abs=0.02)


@TASKS
def test_confidence_is_a_share(task):
    """Confidences are between 0 and 1, and a robot's common name is its trials' most."""
    setting = setting_for(task)
    trials = [exemplar(task, kind, 9000, 1.0) for kind in KINDS[task]]
    named = namer(setting).name(trials, setting)
    assert all(0 <= n.confidence <= 1 and math.isfinite(n.confidence) for n in named)
    assert common_name([*named, named[0]]) == named[0].name
