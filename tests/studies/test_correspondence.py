"""The validation of the correspondence score, at a size that is quick: ladders, names, what run.py makes."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from studies.correspondence.kinds import KINDS, Behaviour, exemplar, shows
from studies.correspondence.ladders import climb, order_of_phrases, phrase_scores, setting_for
from studies.correspondence.naming import (
    SHIPPED,
    called,
    held_out,
    miscalibration,
    named,
    right,
    vehicles_named,
)
from studies.correspondence.twin import names_on_the_twin
from studies.correspondence.vehicles import SMALL, VEHICLES

from realitygap.correspondence.names import namer
from realitygap.values import Command

STUDY = Path(__file__).resolve().parents[2] / "studies" / "correspondence"
TASKS = pytest.mark.parametrize("task", KINDS)
AVOIDANCE = "obstacle-avoidance"
with_enki = pytest.mark.skipif(
    not os.path.exists("/usr/include/enki/PhysicalEngine.h") or shutil.which("g++") is None,
    reason="Enki is not installed here: apt install libenki-dev g++",
)


def test_run_makes_what_the_package_ships(tmp_path):
    """A small run writes both files, with the names that the package reads."""
    script = [sys.executable, STUDY / "run.py", tmp_path, "--runs", "1"]
    told = subprocess.run(script, capture_output=True, text=True, check=True).stdout
    assert "other than shipped" in told
    with np.load(tmp_path / "exemplars.npz") as made, np.load(SHIPPED) as kept:
        assert made.keys() == kept.keys()
    assert (tmp_path / "scales.json").read_text().startswith("{")


@pytest.mark.parametrize(
    ("task", "kind", "what"),
    [(AVOIDANCE, "wall follower", "gain"), ("light-seeking", "bobber", "noise")],
)
def test_a_ladder_is_the_published_one(task, kind, what):
    """It goes down, and its phrases have the paper's order; tables.md has its scores, to a tenth."""
    made = climb(Behaviour(task=task, kind=kind), what)
    row = f"| {task} | {kind} | 1 | {what} | {made.spearman:.2f} | "
    published = next(
        line for line in (STUDY / "tables.md").read_text("utf-8").splitlines() if line.startswith(row)
    )
    assert made.spearman > 0.9
    scores = [float(word) for word in published.removeprefix(row).removesuffix(" |").split()]
    assert made.scores == pytest.approx(scores, abs=0.11)
    assert order_of_phrases(phrase_scores(made.rungs), least=1) > 0


@TASKS
def test_nine_in_ten_robots_that_were_held_out_get_their_names(task):
    """Of every kind and two of its designs, never seen, at the observed noise; nobodies are none of these."""
    made = called(task, held_out(task, KINDS[task], range(7000, 7004), 1.0))
    assert right(made) >= 0.9 and miscalibration(made) < 0.16  # of 16 names
    assert (
        right(called(task, held_out(task, ("standing", "wanderer", "rocker"), range(7000, 7002), 1.0))) > 0.8
    )


def test_a_trial_without_its_evidence_is_drawn_again():
    """An exemplar's commands hold what its kind's definition names; a two way turner turns both ways."""
    command = dict(zip("slrbt", [(5, 5), (-3, 3), (3, -3), (-5, -5), (2, 6)], strict=True))

    def said(letters):
        return [Command(left=command[c][0], right=command[c][1]) for c in letters]

    assert shows(AVOIDANCE, "two way turner", said("sssssllllllrrrrr"))
    assert not shows(AVOIDANCE, "two way turner", said("sssssllllllrrrr"))
    assert shows(AVOIDANCE, "one way turner", said("ssssslllll"))
    assert not shows("light-seeking", "straight looper", said("t" * 200))
    assert shows("light-seeking", "random walker", [])
    plain, marked = (
        [exemplar(AVOIDANCE, "two way turner", 7000 + i, 1.0, marked=marked)[0] for i in range(8)]
        for marked in (False, True)
    )
    same = [np.array_equal(a.x, b.x) for a, b in zip(plain, marked, strict=True)]
    assert any(same) and not all(same)


@with_enki
def test_names_on_enkis_robots_are_right_and_as_sure_as_they_are_right():
    """Controllers and robots that no exemplar was made with: nine in ten; a short trial is less sure."""
    drives, made = vehicles_named(SMALL, VEHICLES, range(100, 102))
    assert right(made[made["shown"]]) >= 0.9
    assert miscalibration(made) < 0.15
    setting = setting_for(AVOIDANCE)
    for seconds in (3, 6, 10):
        short = namer(setting).name([one.trial.cut(seconds) for one in drives], setting)
        told = named([one.kind for one in drives], short)
        assert abs(told["confidence"].mean() - right(told)) < 0.09


@with_enki
def test_names_on_a_thymio():
    """Whoever shows its behaviour on a robot that sees nothing beside it gets its name."""
    made = vehicles_named(["thymio2"], VEHICLES, range(100, 104))[1]
    shown = made[made["shown"]]
    assert right(shown) >= 0.8 and abs(shown["confidence"].mean() - right(shown)) < 0.12


@TASKS
def test_names_on_the_twin(task):
    """Of one trial of each kind on each of two units, seven of eight are named rightly."""
    made = names_on_the_twin(task)
    assert len(made) == 8 and right(made) >= 7 / 8
