"""Small studies with their pages, made once for all tests of the report."""

from __future__ import annotations

import shutil

import pytest

from realitygap.report import build_report
from realitygap.study.config import StudyConfig
from realitygap.study.load import Study, load_study
from realitygap.study.runner import run_study
from tests.report.scenes import draw_only, few
from tests.transfer.helpers import transfer


@pytest.fixture(scope="session")
def paper(tmp_path_factory: pytest.TempPathFactory) -> Study:
    """The paper's six conditions, two short runs each; drawn are all figures but most of the networks."""
    config = few(StudyConfig.reproduction(runs=2, evaluations=70, seed=3))
    study = run_study(tmp_path_factory.mktemp("paper") / "study", config, workers=1)
    with pytest.MonkeyPatch.context() as patch:
        draw_only(patch, lambda name: "network" not in name or name.endswith("network-zero-1"))
        build_report(study.folder)
    return study


@pytest.fixture(scope="session")
def played(tmp_path_factory: pytest.TempPathFactory) -> Study:
    """Both tasks, two runs a noise level, calibrated; both first runs drove the twin for two seconds, one
    twice. Of its figures only the answers' are drawn."""
    config = StudyConfig.reproduction(runs=2, evaluations=64, seed=3)
    config = config.with_settings(["task.seconds=2", "retest_trials=2", "fresh_trials=3", "profile=khepera"])
    folder = tmp_path_factory.mktemp("played") / "study"
    study = run_study(folder, config, workers=1)
    unit = folder / "calibration" / "unit-1" / "robot.toml"  # its recordings were removed to save space
    unit.parent.mkdir(parents=True)
    shutil.copy(folder / "profile.toml", unit)
    transfer(study, [1], starts=2, path_from="wheels", workers=1)
    transfer(study, [2], path_from="wheels", workers=1)
    with pytest.MonkeyPatch.context() as patch:
        draw_only(patch, lambda name: name.endswith("-answer"))
        build_report(folder)
    return load_study(folder)
