"""Names on the shipped exemplars: confidence, size, mirror images, robots that are none of these."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from studies.correspondence.kinds import KINDS, exemplar
from studies.correspondence.ladders import setting_for
from studies.correspondence.naming import SHIPPED, called, held_out, left_out, miscalibration, right
from studies.correspondence.run import FIRST_SEED, SETS
from studies.correspondence.wide import FAMILIES

from realitygap.correspondence.names import NONE, namer, rows_of, tells
from realitygap.tasks.load import load_task
from tests.correspondence.tracks import mirrored, random_walker, standing

TASKS = pytest.mark.parametrize("task", KINDS)
AVOIDANCE = "obstacle-avoidance"
LIMIT = 0.08
"""Of miscalibration: another temperature gives 0.12 and more."""


@TASKS
def test_confidence_is_the_share_of_right_names(task):
    """Of names given with 0.8 four in five are right, also of designs that no exemplar had."""
    made = left_out(task)
    assert miscalibration(made) < LIMIT and right(made) > 0.8


@TASKS
@pytest.mark.parametrize("hotter", [0.25, 3.0])
def test_another_temperature_is_off(task, hotter):
    """Votes taken for surer or less sure than they are do not agree with the share of right names."""
    assert miscalibration(left_out(task, hotter)) > LIMIT + 0.03


@pytest.mark.parametrize("of", SETS)
def test_the_shipped_exemplars_are_those_that_the_study_makes(of):
    """The first of each kind, made again, is the row that comes with the package."""
    kept, (task, large) = np.load(SHIPPED), SETS[of]
    for kind in FAMILIES[of]:
        trial, arena = exemplar(task, kind, FIRST_SEED, 0.0, large=large)
        row = kept[f"{of} rows"][kept[f"{of} names"] == kind][0]
        assert rows_of([trial], arena, large=large)[0] == pytest.approx(row, rel=2e-3, abs=2e-3)


@cache
def large_robots():
    return held_out(AVOIDANCE, KINDS[AVOIDANCE], range(7000, 7002), 1.0, large=True)


def test_large_robots_are_named_by_their_own():
    """Robots too large for the paper's arena, never seen, are named after large exemplars."""
    setting = setting_for(AVOIDANCE)
    assert right(called(AVOIDANCE, large_robots(), namer(setting, 8.0))) >= 0.75


def test_a_large_robot_is_described_by_its_own_size():
    """Robot and room twice as large, at twice the speed: the same numbers, evidence, and name."""
    for kind, trial, arena in large_robots()[::3]:
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


@TASKS
def test_a_random_walker_is_none_of_these(task):
    """A walker of another law than the exemplars', or one that stands, has none of the paper's names."""
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
    robots = held_out(AVOIDANCE, KINDS[AVOIDANCE], range(7000, 7003), 1.0)
    trials = [trial for _, trial, arena in robots if arena == setting.arena]
    assert trials
    plain, flipped = names.name(trials, setting), names.name(mirrored(trials, 50.0), setting)
    assert [n.name for n in plain] == [n.name for n in flipped]
    assert [n.confidence for n in plain] == pytest.approx([n.confidence for n in flipped], abs=0.02)
