"""A finished small study, made once."""

from __future__ import annotations

from pathlib import Path

import pytest

from realitygap.study.load import Study
from realitygap.study.runner import run_study
from tests.study.helpers import small


@pytest.fixture(scope="session")
def finished(tmp_path_factory) -> Study:
    """The small study, carried out in this process; tests leave it as it is."""
    return run_study(tmp_path_factory.mktemp("finished") / "study", small(), workers=1)


@pytest.fixture
def folder(tmp_path) -> Path:
    """Where a study may be made."""
    return tmp_path / "study"
