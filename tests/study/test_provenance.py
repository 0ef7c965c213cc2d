"""A study names the commit, the machine and the versions that it was made with."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

from realitygap.errors import StudyInterruptedError
from realitygap.study.load import load_study
from realitygap.study.provenance import project_commit, versions
from realitygap.study.runner import EVOLVING, Progress, run_study
from tests.study.helpers import small


def git(folder: Path, *words: str) -> str:
    who = ["-c", "user.name=a", "-c", "user.email=a@b", "-c", "commit.gpgsign=false"]
    made = subprocess.run(
        ["git", "-C", str(folder), *who, *words], capture_output=True, text=True, check=True
    )
    return made.stdout.strip()


@pytest.mark.skipif(shutil.which("git") is None, reason="git is not there")
def test_a_checkout_tells_its_commit_and_whether_it_was_changed(tmp_path: Path) -> None:
    """A change of the package is said, one of anything else is not; a new file is a change."""
    package = tmp_path / "src" / "realitygap"
    package.mkdir(parents=True)
    (package / "__init__.py").write_text("one = 1\n")
    git(tmp_path, "init", "-q")
    git(tmp_path, "add", ".")
    git(tmp_path, "commit", "-qm", "first")
    head = git(tmp_path, "rev-parse", "HEAD")
    (tmp_path / "README.md").write_text("new")
    assert project_commit(package) == head
    (package / "extra.py").write_text("")
    assert project_commit(package) == f"{head} + changes"


def test_a_study_knows_all_machines_that_worked_on_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One that is resumed elsewhere names both processors, and every version once."""
    here = versions()
    assert {"realitygap", "commit", "python", "numpy", "numba", "platform", "processor"} <= set(here)

    def stop(progress: Progress) -> None:
        if progress.phase == EVOLVING:
            raise KeyboardInterrupt

    monkeypatch.setattr("realitygap.work.progress.EVERY_S", 0.0)
    with pytest.raises(StudyInterruptedError):
        run_study(tmp_path / "study", small(), workers=1, on_progress=stop)
    monkeypatch.setattr("realitygap.study.runner.versions", lambda: {**here, "processor": "another"})
    run_study(tmp_path / "study", None, resume=True, workers=1)
    found = load_study(tmp_path / "study").versions()
    assert found["processor"] == [here["processor"], "another"] and found["numpy"] == [here["numpy"]]
