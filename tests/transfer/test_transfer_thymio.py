"""Controllers evolved for a Thymio II (profile `thymio`) drive Enki's, in its arena and over its protocol."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import replace

import numpy as np
import pytest

from realitygap.robots.body import Body
from realitygap.robots.enki import EnkiBody
from realitygap.study.config import StudyConfig
from realitygap.study.load import Study
from realitygap.study.runner import run_study
from realitygap.transfer.options import Transfer
from realitygap.transfer.rig import driven
from realitygap.transfer.run import TrialWorker, run_transfer
from realitygap.transfer.spec import trial_specs
from realitygap.values import Command, Pose
from tests.robots.aseba import Node, at_a_node

TASK = "obstacle-avoidance"
SECONDS = 4.0
needs_enki = pytest.mark.skipif(
    not os.path.exists("/usr/include/enki/PhysicalEngine.h") or shutil.which("g++") is None,
    reason="Enki is not installed here: apt install libenki-dev g++",
)


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> Study:
    """A run of a few evaluations, in the arena that a Thymio fits."""
    config = StudyConfig.single(TASK, profile="thymio", evaluations=60).with_settings(
        ["evolution.rows=3", "evolution.columns=3", f"task.seconds={SECONDS}", f"arenas.{TASK}={TASK}-large"]
    )
    return run_study(tmp_path_factory.mktemp("thymio") / "study", config, workers=1)


@contextmanager
def behind_a_node(pose: Pose, room: dict[str, object]) -> Iterator[tuple[Body, EnkiBody]]:
    """Enki's Thymio II at the end of a Thymio's line, in virtual time."""
    node = Node()
    with closing(EnkiBody("thymio2", 0)) as enki:
        enki.enter(room, 5, pose)

        def live(left: int, right: int) -> None:
            enki.act(Command(left=left, right=right))
            enki.clock.sleep_until(node.now())
            node.set("prox.horizontal", *enki.sense().proximity.clip(0, 4500).astype(int))

        node.moves = live
        with at_a_node(node) as body:
            yield body, enki


@needs_enki
def test_it_drives_enkis_thymio(study: Study) -> None:
    """From profile to paths: the same start in simulation and on Enki, whose scale is 5 counts longer."""
    (made,) = run_transfer(study, Transfer(robots=("enki:thymio2:1",), path_from="wheels"), workers=1)
    assert made.situated_from == "robot" and made.late_steps == 0 and made.missed_steps is None
    assert made.situated.t[-1] == SECONDS and made.lost_steps == 0
    assert (made.situated.x[0], made.situated.y[0]) == pytest.approx((made.pose.x, made.pose.y))
    assert np.hypot(np.diff(made.situated.x), np.diff(made.situated.y)).sum() > 2.0


@needs_enki
def test_its_path_is_reckoned_from_the_speeds_that_its_motors_measure(study: Study) -> None:
    """Over the line a Thymio tells no pose and counts no turns: by speeds its path ends near Enki's."""
    (one,) = trial_specs(study, Transfer(robots=("thymio:somewhere:33333",)))
    assert one.source == "speeds"
    pose, task = (
        TrialWorker(study, study.folder, study.folder).simulation(one.task, one.noise).start(one.stream),
        study.task(TASK),
    )
    controller = study.controller(TASK, study.genotype(one.run, one.evaluation))
    profile = replace(
        study.profile, wheels=replace(study.profile.wheels, speed_per_unit_cm_s=(0.0332, 0.0332))
    )
    with behind_a_node(pose, task.arena.plain()) as (body, enki):
        made = driven(body, controller, task=task, profile=profile, seconds=SECONDS)
        there = enki.pose
    path = made.path(pose, task, profile)
    gone = np.hypot(there.x - pose.x, there.y - pose.y)
    assert gone > 2.0 and np.hypot(path.x[-1] - there.x, path.y[-1] - there.y) < 0.15 * gone
    assert made.recording.missed_steps == 0 and np.isfinite(made.recording.speeds).all()
