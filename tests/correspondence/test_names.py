"""Names: held-out exemplars at every noise level, mirror images, and robots that are none of these."""

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from realitygap.correspondence.evidence import tells
from realitygap.correspondence.names import NONE, UNTOLD, common_name, namer, rows_of
from realitygap.correspondence.trials import Trial
from realitygap.errors import TrackError, UsageError
from realitygap.tasks.load import load_task
from realitygap.values import Command
from realitygap.world.arena import load_arena
from tests.correspondence.ladders import KEPT, called, held_out, left_out, miscalibration, right, setting_for
from tests.correspondence.tracks import mirrored, random_walker, standing
from tests.exemplars.kinds import KINDS, LARGE_ARENA, exemplar, shows
from tests.exemplars.make import FIRST_SEED, SETS
from tests.exemplars.wide import FAMILIES

TASKS = pytest.mark.parametrize("task", KINDS)
AVOIDANCE = "obstacle-avoidance"
LEVELS = (0.0, 1.0, 2.0)
LIMIT = 0.08
"""Of miscalibration: what 120 names leave to chance is about 0.04, another temperature 0.12 and more."""
NOBODY = ("standing", "spinning", "random walker", "wanderer", "rocker")


@cache
def robots(task):
    """Robots never seen, of every design and at every level of noise; a fifth of them are nobody."""
    kinds = {level: held_out(task, KINDS[task], range(7000, 7008), level) for level in LEVELS}
    return kinds, held_out(task, NOBODY, range(7000, 7005), 1.0)


@cache
def found(task):
    """What these are called."""
    kinds, nobody = robots(task)
    return {level: called(task, kinds[level]) for level in LEVELS}, called(task, nobody)


def everybody(task):
    kinds, nobody = found(task)
    return [*nobody, *(one for level in LEVELS for one in kinds[level])]


@TASKS
def test_held_out_robots_get_their_names(task):
    """At zero, observed and double noise nine of ten robots of all designs, never seen, get their name."""
    assert right(everybody(task)) >= 0.9
    assert min(right(found(task)[0][level]) for level in LEVELS) >= 0.85


@TASKS
def test_confidence_is_the_share_of_right_names(task):
    """Of names given with 0.8 four in five are right, of designs that are known and of such as are not."""
    assert miscalibration(everybody(task)) < LIMIT
    assert miscalibration(left_out(task)) < LIMIT


@TASKS
@pytest.mark.parametrize("hotter", [0.25, 3.0])
def test_another_temperature_is_off(task, hotter):
    """Votes taken for surer or less sure than they are do not agree with the share of right names."""
    assert miscalibration(left_out(task, hotter)) > LIMIT + 0.03


@pytest.mark.parametrize("of", SETS)
def test_the_kept_exemplars_are_those_that_the_command_makes(of):
    """The first of each kind, made again, is the row that comes with the package."""
    kept, (task, large) = np.load(KEPT), SETS[of]
    for kind in FAMILIES[of]:
        trial, arena = exemplar(task, kind, FIRST_SEED, LEVELS[0], large=large)
        row = kept[f"{of} rows"][kept[f"{of} names"] == kind][0]
        assert rows_of([trial], arena, large=large)[0] == pytest.approx(row, rel=2e-3, abs=2e-3)


@cache
def large_robots():
    return held_out(AVOIDANCE, KINDS[AVOIDANCE], range(7000, 7008), 1.0, large=True)


def test_large_robots_are_named_by_their_own():
    """Robots too large for the paper's arena, never seen, are named after large exemplars, not small ones."""
    setting = setting_for(AVOIDANCE)
    large = called(AVOIDANCE, large_robots(), namer(setting, 8.0))
    assert right(large) >= 0.85
    assert right(large) > right(called(AVOIDANCE, large_robots(), namer(setting)))
    assert miscalibration(large) < 2 * LIMIT  # of 32 names


def test_a_large_robot_is_described_by_its_own_size():
    """Robot and room twice as large, at twice the speed: the same numbers, evidence, and name."""
    for kind, trial, arena in large_robots()[::5]:
        cylinders = tuple(
            replace(c, x_cm=2 * c.x_cm, y_cm=2 * c.y_cm, radius_cm=2 * c.radius_cm) for c in arena.cylinders
        )
        width, depth = arena.size_cm
        room = replace(arena, size_cm=(2 * width, 2 * depth), cylinders=cylinders)
        twice = replace(trial, x=2 * trial.x, y=2 * trial.y, radius_cm=2 * trial.radius_cm)
        rows = [rows_of([one], where, large=True) for one, where in ((trial, arena), (twice, room))]
        assert rows[0] == pytest.approx(rows[1], abs=1e-6)
        assert tells(trial, arena) == tells(twice, room)
        assert tells(trial, arena)[kind]


def test_a_large_robots_name_without_evidence_is_unsure():
    """Who drives straight on and turns once, or only stands, may be of any kind: a quarter goes."""
    arena, setting = load_arena(LARGE_ARENA), setting_for(AVOIDANCE)
    heading = np.repeat([0.0, np.pi / 2], [80, 70])
    x, y = 20 + np.cumsum(np.cos(heading)), 15 + np.cumsum(np.sin(heading))
    trial = Trial(x=x, y=y, heading=np.convolve(heading, np.ones(9) / 9, "same"), radius_cm=8.0)
    trial = replace(trial, x=x[5:-5], y=y[5:-5], heading=trial.heading[5:-5])
    assert not any(tells(trial, arena).values())
    stands = replace(standing(12, 25, 2.0), radius_cm=8.0)
    once, still = namer(setting, 8.0).name([trial, stands], replace(setting, arena=arena))
    assert still.name == NONE and max(once.confidence, still.confidence) <= UNTOLD


def test_another_tasks_setting_is_refused():
    """Its descriptors are others; and nothing is no setting."""
    names, trial = namer(setting_for(AVOIDANCE)), standing(12, 25, 2.0)
    with pytest.raises(TrackError, match="setting: expected one of the task whose kinds are one way turner"):
        names.name([trial], setting_for("light-seeking"))
    with pytest.raises(UsageError, match="setting: expected a Setting, got None"):
        names.name([trial], None)


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
    plain, marked = (
        [exemplar(AVOIDANCE, "two way turner", 7000 + i, 1.0, marked=marked)[0] for i in range(8)]
        for marked in (False, True)
    )
    same = [np.array_equal(a.x, b.x) for a, b in zip(plain, marked, strict=True)]
    assert any(same) and not all(same)


@TASKS
def test_robots_without_a_purpose_are_none_of_these(task):
    """A robot that stands, spins, rocks, drifts or walks at random has none of the paper's names."""
    assert right(found(task)[1]) >= 0.85


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
    trials = [trial for _, trial, arena in robots(AVOIDANCE)[0][1.0] if arena == setting.arena][:12]
    plain, flipped = names.name(trials, setting), names.name(mirrored(trials, 50.0), setting)
    assert [n.name for n in plain] == [n.name for n in flipped]
    assert [n.confidence for n in plain] == pytest.approx([n.confidence for n in flipped], abs=0.02)


@TASKS
def test_confidence_is_a_share(task):
    """Confidences are between 0 and 1, and a robot's common name is its trials' most."""
    setting = setting_for(task)
    trials = [exemplar(task, kind, 9000, 1.0)[0] for kind in KINDS[task]]
    named = namer(setting).name(trials, setting)
    assert all(0 <= n.confidence <= 1 and math.isfinite(n.confidence) for n in named)
    assert common_name([*named, named[0]]) == named[0].name
