"""The study of the level of noise with a robot of one's own in the twin's place."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from realitygap.errors import UsageError
from realitygap.experiments.noise.config import NoiseConfig
from realitygap.experiments.noise.folder import command_of
from realitygap.experiments.noise.plan import controllers
from realitygap.experiments.noise.run import noise_study
from realitygap.experiments.noise.situated import read_situated
from realitygap.experiments.noise.stage import Stage
from realitygap.report.noise.report import build_noise_report, noise_summary
from realitygap.world.profile import load_profile
from tests.experiments.noise_parts import tables

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
ROBOT, BASE = f"{EXAMPLES / 'own_robot.py'}:FiveEyes", str(EXAMPLES / "five_eyes.toml")
SMALL = NoiseConfig(
    levels=(0.0, 1.0), runs=1, seed_sets=1, units=1, starts=2, evaluations=40, seconds=2.0,
    tasks=("obstacle-avoidance",), robot=ROBOT, base=BASE,
)  # fmt: skip


def test_a_robot_of_ones_own_takes_the_twins_place(tmp_path):
    """Five eyes are recorded, fitted, evolved for, driven and compared; resumed, every bit is the same."""
    results = noise_study(tmp_path, SMALL, workers=1)
    profile = load_profile(tmp_path / "calibration" / "unit-1" / "robot.toml")
    assert len(profile.infrared.sensors) == 5 and abs(profile.noise.proximity - 60) < 6
    stage, made = Stage(tmp_path, SMALL), controllers(SMALL)
    for one in made:
        kept = read_situated(stage, one)
        starts = [(pose.x, pose.y) for pose in stage.starts(one.task, 1)]
        assert np.array_equal(kept.poses[0, :, 0, :2], starts) and np.isfinite(kept.poses).all()
    assert {one.level for one in made} == {0.0, 1.0}
    before, summary = tables(results), noise_summary(tmp_path)
    assert "own_robot.py:FiveEyes" in summary["paragraph"] and "set by us" not in summary["paragraph"]
    assert "pseudo-reality" not in build_noise_report(tmp_path).read_text()
    for place in ("situated", "simulated", "results"):
        shutil.rmtree(tmp_path / place)
    assert tables(noise_study(tmp_path, workers=1, resume=True)) == before
    assert f"--robot {ROBOT} --base {BASE}" in command_of(SMALL) and "--units" not in command_of(SMALL)
    with pytest.raises(UsageError, match="made with base = "):
        noise_study(tmp_path, replace(SMALL, base="paper"), resume=True)
