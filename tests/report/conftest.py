"""A small study with transfers and its page, made once for all tests of the player."""

from __future__ import annotations

import pytest

from realitygap.report import build_report
from realitygap.study.config import StudyConfig
from realitygap.study.load import Study, load_study
from realitygap.study.runner import run_study
from tests.conftest import draw_nothing
from tests.transfer.helpers import transfer


@pytest.fixture(scope="session")
def played(tmp_path_factory: pytest.TempPathFactory) -> Study:
    """Both tasks, two runs a noise level; both first runs drove the twin for two seconds, one twice.

    Its figures are not drawn: these tests do not look at them.
    """
    config = StudyConfig.reproduction(runs=2, evaluations=64, seed=3)
    config = config.with_settings(["task.seconds=2", "retest_trials=2", "fresh_trials=3"])
    folder = tmp_path_factory.mktemp("played") / "study"
    study = run_study(folder, config, workers=1)
    transfer(study, [1], starts=2, path_from="wheels", workers=1)
    transfer(study, [2], path_from="wheels", workers=1)
    with pytest.MonkeyPatch.context() as patch:
        draw_nothing(patch)
        build_report(folder)
    return load_study(folder)
