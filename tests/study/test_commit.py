"""Which commit a study was made by: told of a checkout, of what pip recorded, or not known."""

from __future__ import annotations

import json
import shutil
import subprocess
from pathlib import Path

import pytest

from realitygap.study import versions
from realitygap.study.versions import UNKNOWN, project_commit

pytestmark = pytest.mark.skipif(shutil.which("git") is None, reason="git is not there")


def git(folder: Path, *words: str) -> str:
    who = ["-c", "user.name=a", "-c", "user.email=a@b", "-c", "commit.gpgsign=false"]
    made = subprocess.run(
        ["git", "-C", str(folder), *who, *words], capture_output=True, text=True, check=True
    )
    return made.stdout.strip()


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    """A small project under git, its environment ignored."""
    package = tmp_path / "clone" / "src" / "realitygap"
    package.mkdir(parents=True)
    (package / "__init__.py").write_text("one = 1\n")
    (tmp_path / "clone" / ".gitignore").write_text(".venv\n__pycache__\n")
    git(tmp_path / "clone", "init", "-q")
    git(tmp_path / "clone", "add", ".")
    git(tmp_path / "clone", "commit", "-qm", "first")
    return tmp_path / "clone"


def test_a_checkout_tells_its_commit_and_whether_it_was_changed(checkout: Path) -> None:
    """A change of the package is said, one of anything else is not; a new file is a change."""
    head, package = git(checkout, "rev-parse", "HEAD"), checkout / "src" / "realitygap"
    (checkout / "README.md").write_text("new")
    assert project_commit(package) == head
    (package / "extra.py").write_text("")
    assert project_commit(package) == f"{head} + changes"


def test_what_lies_in_an_environment_of_a_checkout_is_not_that_checkout(
    checkout: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A package that pip put into .venv is of that commit only if it is the same to the byte."""
    head = git(checkout, "rev-parse", "HEAD")
    installed = checkout / ".venv" / "realitygap"
    shutil.copytree(checkout / "src" / "realitygap", installed)
    record = {"url": checkout.as_uri(), "dir_info": {}}
    monkeypatch.setattr(versions, "_pip_record", lambda: record)
    assert project_commit(installed) == head
    (installed / "__init__.py").write_text("one = 2\n")
    assert project_commit(installed) == UNKNOWN


def test_what_pip_recorded_of_a_repository_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """PEP 610: pip install git+https://… writes the commit down; without any record nothing is known."""

    class Installed:
        record: str | None = json.dumps({"url": "https://x", "vcs_info": {"vcs": "git", "commit_id": "abc"}})

        def read_text(self, name: str) -> str | None:
            return self.record if name == "direct_url.json" else None

    monkeypatch.setattr(versions, "distribution", lambda name: Installed())
    assert project_commit(tmp_path) == "abc"
    monkeypatch.setattr(Installed, "record", None)
    assert project_commit(tmp_path) == UNKNOWN
    monkeypatch.setenv("PATH", "")
    assert project_commit() == UNKNOWN
