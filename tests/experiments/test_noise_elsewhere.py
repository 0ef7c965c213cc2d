"""The noise experiment on the twin itself, by shards, by far workers, and with a robot of one's own."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from realitygap.errors import StudyError
from realitygap.experiments.noise import NoiseConfig, NoiseExperiment, merge_noise, noise_experiment
from realitygap.report.experiment import NoiseData, build_noise_page, noise_summary
from realitygap.work.pool import Here
from realitygap.work.shard import Shard, all_shards
from realitygap.world.robot import load_profile
from tests.experiments.noise_parts import quick_units, tables, tiny

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
PERIOD_S = 0.06


class Far(Here):
    """A pool whose workers do not see the experiment's folder."""

    far = True


@pytest.fixture(scope="module")
def made(tmp_path_factory) -> tuple[dict[str, str], list[Path]]:
    """Tables of an experiment in one piece, and the folders of its two shards, one by a pool that sees no
    files."""
    place = tmp_path_factory.mktemp("noise")
    design = tiny(tasks=("obstacle-avoidance",), units=1)
    shards = [Shard(number, 2) for number in (1, 2)]
    with quick_units():
        one = tables(noise_experiment(place / "one", design, workers=1))
        for shard, workers in zip(shards, (1, Far()), strict=True):
            noise_experiment(shard.folder(place / "study"), design, workers=workers, shard=shard)
    return one, [shard.folder(place / "study") for shard in shards]


def test_shards_merged_are_the_experiment_in_one_piece(made, tmp_path):
    """Its tables, byte by byte."""
    one, folders = made
    assert not any((folder / "results").exists() for folder in folders)
    merge_noise(all_shards(folders), tmp_path / "whole")
    assert tables(noise_experiment(tmp_path / "whole", workers=1, resume=True)) == one


def test_what_does_not_belong_together_is_not_merged(made, tmp_path):
    """Units that were measured otherwise; a shard that lost a file. Nothing is left."""
    _, folders = made
    profile = NoiseExperiment(folders[1], tiny()).profile_file(1)
    text = profile.read_text()
    profile.write_text(f"{text}\n# by another machine\n")
    with pytest.raises(StudyError, match="differ: the robot was recorded on different kinds of machine"):
        merge_noise(all_shards(folders), tmp_path / "whole")
    profile.write_text(text)
    for files in ("simulated/*.json", "situated/*.npz"):
        file = next(folders[0].glob(files))
        kept = file.read_bytes()
        file.write_bytes(kept[: len(kept) // 2])
        with pytest.raises(StudyError, match=rf"{file}: expected .* Delete it and resume"):
            merge_noise(all_shards(folders), tmp_path / "whole")
        file.write_bytes(kept)
    assert not [*tmp_path.iterdir()]


def test_the_number_of_workers_changes_no_bit(tmp_path):
    """Two processes with twins of their own come to the bits of one; the camera sees every trial whole."""
    small = tiny(tasks=("obstacle-avoidance",), units=1, runs=1, starts=2, seconds=2.0)
    with quick_units(rig=False):
        one = noise_experiment(tmp_path / "one", small, workers=1)
        folder = Path(shutil.copytree(tmp_path / "one", tmp_path / "two"))
        for name in ("situated", "simulated", "results"):  # all of it is made again
            shutil.rmtree(folder / name)
        two = noise_experiment(folder, small, workers=2, resume=True)
    assert tables(one) == tables(two)
    designs = [NoiseExperiment(tmp_path / name, small) for name in ("one", "two")]
    for controller in designs[0].controllers():
        files = [design.driven_file(controller).read_bytes() for design in designs]
        assert files[0] == files[1]
        poses = designs[0].read_driven(controller).poses
        starts = [(pose.x, pose.y) for pose in designs[0].starts(controller.task, 1, 1)]
        assert np.isfinite(poses).all() and np.hypot(*(poses[0, :, 0, :2] - starts).T).max() < 0.1


@pytest.fixture
def own(tmp_path: Path) -> NoiseConfig:
    """An experiment with the example's robot, at another period of control than the paper's."""
    robot, base = tmp_path / "own_robot.py", tmp_path / "five_eyes.toml"
    text = (EXAMPLES / robot.name).read_text("utf-8")
    robot.write_text(text.replace("(Body):", f"(Body):\n    period_s = {PERIOD_S}"), "utf-8")
    faster = (EXAMPLES / base.name).read_text("utf-8").replace("[0.75, 0.75]", "[1.25, 1.25]")
    base.write_text(f"period_s = {PERIOD_S}\n{faster}", "utf-8")
    return NoiseConfig(
        levels=(0.0, 1.0), runs=1, units=1, starts=2, evaluations=40, seconds=2.4,
        tasks=("obstacle-avoidance",), robot=f"{robot}:FiveEyes", base=str(base),
    )  # fmt: skip


def by_hand(folder: Path, *, robot: str, base: str, seed: int, **_: object) -> Path:
    """Its rough profile as the calibrated one: to fit it takes a minute, and is the example's test."""
    assert robot.endswith(":FiveEyes")
    folder.mkdir(parents=True)
    return Path(shutil.copy(base, folder / "robot.toml"))


def test_a_robot_of_ones_own_takes_the_twins_place(tmp_path, own, monkeypatch):
    """Five eyes are evolved for, driven and compared, at their own period; resumed, every bit is the same."""
    monkeypatch.setattr("realitygap.calibration.unit.calibrated_robot", by_hand)
    folder = tmp_path / "study"
    phases: set[str] = set()
    results = noise_experiment(folder, own, workers=1, on_progress=lambda event: phases.add(event.phase))
    assert "on the robot" in phases and not any("twin" in phase for phase in phases)
    profile = load_profile(folder / "calibration" / "unit-1" / "robot.toml")
    assert profile.period_s == PERIOD_S and len(profile.infrared.sensors) == 5
    design = NoiseExperiment(folder, own)
    for one in design.controllers():
        kept = design.read_driven(one)
        starts = [(pose.x, pose.y) for pose in design.starts(one.task, 1, 1)]
        assert np.array_equal(kept.poses[0, :, 0, :2], starts) and np.isfinite(kept.poses).all()
        track = kept.track(1, 1)
        assert len(track) == 41 and track.t[-1] == pytest.approx(2.4)
    before = tables(results)
    page = build_noise_page(folder).read_text()
    assert "own_robot.py:FiveEyes" in page and "simulated." not in page.split("“The robot” is")[1][:80]
    assert noise_summary(NoiseData.read(folder))["tasks"]["obstacle-avoidance"]["levels"][0]["runs"] == 1
    for place in ("situated", "simulated", "results"):
        shutil.rmtree(folder / place)
    assert tables(noise_experiment(folder, workers=1, resume=True)) == before
    assert f"--robot {own.robot} --base {own.base}" in own.command and "--units" not in own.command
