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
from realitygap.experiments.noise.situated import check_robot, read_situated
from realitygap.experiments.noise.stage import Stage
from realitygap.report.noise.report import build_noise_report, noise_summary
from realitygap.world.profile import load_profile
from tests.experiments.noise_parts import tables

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
PERIOD_S = 0.06


@pytest.fixture
def small(tmp_path: Path) -> NoiseConfig:
    """A study of the example's robot, at another period of control than the paper's."""
    robot, base = tmp_path / "own_robot.py", tmp_path / "five_eyes.toml"
    text = (EXAMPLES / robot.name).read_text("utf-8")
    robot.write_text(text.replace("counts_turns = 0.1", f"counts_turns = {PERIOD_S}"), "utf-8")
    faster = (EXAMPLES / base.name).read_text("utf-8").replace("[0.75, 0.75]", "[1.25, 1.25]")
    base.write_text(f"period_s = {PERIOD_S}\n{faster}", "utf-8")
    return NoiseConfig(
        levels=(0.0, 1.0), runs=1, seed_sets=1, units=1, starts=2, evaluations=40, seconds=2.4,
        tasks=("obstacle-avoidance",), robot=f"{robot}:FiveEyes", base=str(base),
    )  # fmt: skip


def by_hand(folder: Path, *, robot: str, base: str, seed: int, **_: object) -> Path:
    """Its rough profile as the calibrated one: to fit it takes a minute, and is the example's test."""
    assert robot.endswith(":FiveEyes")
    folder.mkdir(parents=True)
    return Path(shutil.copy(base, folder / "robot.toml"))


def test_a_robot_of_ones_own_takes_the_twins_place(tmp_path, small, monkeypatch):
    """Five eyes are evolved for, driven and compared, at their own period; resumed, every bit is the same."""
    monkeypatch.setattr("realitygap.calibration.unit.calibrated_robot", by_hand)
    folder = tmp_path / "study"
    phases: set[str] = set()
    results = noise_study(folder, small, workers=1, on_progress=lambda event: phases.add(event.phase))
    assert "on the robot" in phases and not any("twin" in phase for phase in phases)
    profile = load_profile(folder / "calibration" / "unit-1" / "robot.toml")
    assert profile.period_s == PERIOD_S
    assert len(profile.infrared.sensors) == 5
    stage, made = Stage(folder, small), controllers(small)
    for one in made:
        kept = read_situated(stage, one)
        starts = [(pose.x, pose.y) for pose in stage.starts(one.task, 1, 1)]
        assert np.array_equal(kept.poses[0, :, 0, :2], starts) and np.isfinite(kept.poses).all()
        track = kept.track(1, 1)
        assert len(track) == 41 and track.t[-1] == pytest.approx(2.4)
    assert {one.level for one in made} == {0.0, 1.0}
    before, summary = tables(results), noise_summary(folder)
    assert "own_robot.py:FiveEyes" in summary["paragraph"] and "set by us" not in summary["paragraph"]
    assert "pseudo-reality" not in build_noise_report(folder).read_text()
    for place in ("situated", "simulated", "results"):
        shutil.rmtree(folder / place)
    assert tables(noise_study(folder, workers=1, resume=True)) == before
    command = command_of(small)
    assert f"--robot {small.robot} --base {small.base}" in command and "--units" not in command
    other = shutil.copy(small.base, tmp_path / "other.toml")
    with pytest.raises(UsageError, match="made with base = "):
        noise_study(folder, replace(small, base=str(other)), resume=True)


def test_a_period_that_does_not_fit_is_refused(small, tmp_path):
    """Before any work: a base whose step is not the robot's, a trial of no whole steps."""
    with pytest.raises(UsageError, match=r"seconds: expected whole steps of 0.06 s, .* got 2\.$"):
        check_robot(replace(small, seconds=2.0))
    with pytest.raises(
        UsageError, match=r"expected a period of 0.1 s, as the base 'five-eyes' has; .*0.06 s"
    ):
        check_robot(replace(small, base=str(EXAMPLES / "five_eyes.toml")))
