"""`experiment noise --misfit`, and recorded readings as its robot."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from realitygap.errors import UsageError
from realitygap.experiments.noise import NoiseConfig, check_robot
from realitygap.report.experiment import NoiseData
from realitygap.report.misfit import advice, peak
from tests.robots.test_table import profile

LEVELS = np.array([0.0, 0.5, 1.0, 2.0, 4.0])


def data(fall: float) -> NoiseData:
    """Forty runs a level whose fitness falls by this for each unit of the root away from level 1."""
    evolved = np.repeat(LEVELS, 40)
    noise = 0.02 * np.random.default_rng(3).standard_normal(len(evolved))
    fit = 0.5 - fall * (np.sqrt(evolved) - 1.0) ** 2 + noise
    none = np.zeros((len(evolved), len(LEVELS)))
    return NoiseData(
        levels=LEVELS, task=np.array(["obstacle-avoidance"] * len(evolved)), evolved=evolved, simulated=fit,
        situated=fit, score=none, noisiness=none, ratios={"infrared": np.array([3.5, 3.9])}, noises={},
        settings={},
    )  # fmt: skip


def test_the_level_is_told_with_its_interval_or_not_at_all() -> None:
    """Where fitness has a top, it lies in the interval; where it has none, no level is named."""
    (told,), (none,) = advice(data(0.1)), advice(data(0.0))
    assert told.told and told.low < 1.0 < told.high and told.level == pytest.approx(1.0, abs=0.1)
    assert "at a model error of 3.7 deviations of the noise, evolve at about level 1" in told.words
    assert not none.told and "it cannot be told at which level to evolve: by 40 runs a level" in none.words


def test_a_peak_is_a_parabolas_top_or_an_end() -> None:
    """Over the root of the level, as NumPy fits it through three points; never beyond the levels."""
    means = np.array([0.1, 0.5, 0.6, 0.55, 0.2])
    a, b, _ = np.polyfit(np.sqrt(LEVELS[1:4]), means[1:4], 2)
    assert peak(LEVELS, np.stack([means, -means, means[::-1] * 0 + LEVELS])) == pytest.approx(
        [(-b / (2 * a)) ** 2, 0.0, 4.0]
    )
    assert peak(LEVELS[:2], np.array([2.0, 1.0])) == 0.0


def test_recorded_readings_are_the_only_unit_and_their_own_base(tmp_path: Path, monkeypatch) -> None:
    """Found from any folder; refused, with the cure, for a task that needs light."""
    (tmp_path / "k.toml").write_text(profile().to_toml(), encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    made = NoiseConfig(robot="table:k.toml", units=1, tasks=("obstacle-avoidance",))
    assert made.robot == f"table:{tmp_path / 'k.toml'}" and made.base == str(tmp_path / "k.toml")
    assert made.address(1) == made.robot and NoiseConfig(**made.to_dict()) == made
    check_robot(made)
    with pytest.raises(UsageError, match="--tasks obstacle-avoidance"):
        check_robot(NoiseConfig(robot="table:k.toml", units=1))
