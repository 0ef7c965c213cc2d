"""The study of the level of noise on the twin itself: its line, its camera, several processes."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np

from realitygap.experiments.noise.plan import controllers, situated_file
from realitygap.experiments.noise.run import noise_study
from realitygap.experiments.noise.situated import read_situated
from realitygap.experiments.noise.stage import Stage
from tests.experiments.noise_parts import quick_units, tables, tiny


def test_the_number_of_workers_changes_no_bit(tmp_path):
    """Two processes with twins of their own come to the bits of one; the camera sees every trial whole."""
    small = tiny(tasks=("obstacle-avoidance",), units=1, runs=1, starts=2, seconds=2.0)
    with quick_units(rig=False):
        one = noise_study(tmp_path / "one", small, workers=1)
        folder = Path(shutil.copytree(tmp_path / "one", tmp_path / "two"))
        made = [*folder.glob("situated/*.npz"), *folder.glob("simulated/*.json")]
        assert len(made) == 2 * len(controllers(small))  # all of it is made again
        for path in made:
            path.unlink()
        shutil.rmtree(folder / "results")
        two = noise_study(folder, small, workers=2, resume=True)
    assert tables(one) == tables(two)
    stages = [Stage(tmp_path / name, small) for name in ("one", "two")]
    for controller in controllers(small):
        seen = [read_situated(stage, controller) for stage in stages]
        assert np.array_equal(seen[0].poses, seen[1].poses) and np.isfinite(seen[0].poses).all()
        lived, again = (each.lived for each in seen)
        assert all(np.array_equal(*pair) for pair in zip(lived, again, strict=True))
        assert lived.readings.shape[-1] == 8 and 0 < lived.readings.max() <= 1023
        assert lived.commands.shape == lived.speeds.shape == (*lived.readings.shape[:3], 2)
        starts = [(pose.x, pose.y) for pose in stages[0].starts(controller.task, 1, 1)]
        assert np.hypot(*(seen[0].poses[0, :, 0, :2] - starts).T).max() < 0.1
        files = [situated_file(tmp_path / name, controller).read_bytes() for name in ("one", "two")]
        assert files[0] == files[1]
