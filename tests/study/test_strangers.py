"""A study that somebody else made: what only looks runs no code and leaves the folder alone."""

from __future__ import annotations

import os
import shutil
import tomllib
from pathlib import Path

import pytest

from realitygap.errors import StudyError, UsageError
from realitygap.report.build import build_report
from realitygap.study import folder as sources
from realitygap.study.config import StudyConfig
from realitygap.study.folder import LOOSE
from realitygap.study.load import load_study
from realitygap.study.runner import run_study
from realitygap.work.folder import SEALS, RunFolder

TASK = """
from realitygap import Start, Task
{spy}
def score(path, room):
    return {score}

task = Task(name="touch", arena="obstacle-avoidance", feeds="proximity", sensors=(2, 3),
            start=Start(x_cm=25, y_cm=25), score=score)
"""
SMALL = {"evaluations": 66, "retest_trials": 1, "fresh_trials": 1}


def requested(file: Path, **changes: object) -> StudyConfig:
    return StudyConfig.single(file, **{**SMALL, **changes}).with_settings(["task.seconds=0.5"])


def write(file: Path, score: str = "1.0 - path.contact.mean()", spy: str = "") -> Path:
    file.write_text(TASK.format(score=score, spy=spy))
    return file


@pytest.fixture(scope="module")
def theirs(tmp_path_factory) -> tuple[Path, Path]:
    """A study of somebody's own task, which leaves a trace whenever its file is run; and that trace."""
    place = tmp_path_factory.mktemp("theirs")
    trace = place / "trace"
    file = write(place / "touch.py", spy=f"open({str(trace)!r}, 'a').close()")
    run_study(place / "study", requested(file), workers=1)
    return place / "study", trace


@pytest.fixture
def stranger(theirs, tmp_path, monkeypatch) -> tuple[Path, Path]:
    """That study, come to another user; and the trace, which is not there."""
    study, trace = theirs
    trace.unlink(missing_ok=True)
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    sources._known.cache_clear()
    yield Path(shutil.copytree(study, tmp_path / "study")), trace
    sources._known.cache_clear()


def test_overviewing_runs_no_code(stranger):
    """Runs, champions, genotypes, tables, layouts and streams come from the database."""
    folder, trace = stranger
    study = load_study(folder)
    run = study.run("touch/observed/1")
    assert run.champion.shape == study.encoding("touch").shape and study.encoding("touch").inputs == 2
    assert study.facts("touch")["feeds"] == "proximity" and study.profile.name == "paper"
    assert len(study.genotypes(1)) == len(study.evaluations()["number"]) == 66
    assert not trace.exists()


def test_running_asks_first(stranger):
    """A simulation, a report and a resumption are refused, naming the program; trust is remembered."""
    folder, trace = stranger
    for work in (lambda: load_study(folder).task("touch"), lambda: build_report(folder),
                 lambda: run_study(folder, resume=True)):  # fmt: skip
        with pytest.raises(StudyError, match=r"brings a program, .*touch.py, .* --trust.*trust=True"):
            work()
    with pytest.raises(UsageError, match="trust: expected a bool, got 'no'"):
        load_study(folder, trust="no")
    assert not trace.exists()
    assert load_study(folder, trust=True).task("touch").trials == 2
    assert trace.exists()
    sources._known.cache_clear()  # as in another process
    assert load_study(folder).task("touch").trials == 2


@pytest.mark.parametrize("missing", ["profile.toml", "arenas/touch.toml", "tasks/touch/touch.py"])
def test_nothing_is_taken_from_the_current_directory(theirs, tmp_path, monkeypatch, missing):
    """A missing file of a study is refused, whatever lies where the user stands."""
    folder = Path(shutil.copytree(theirs[0], tmp_path / "study"))
    here = tmp_path / "here" / missing
    here.parent.mkdir(parents=True)
    (folder / missing).rename(here)
    monkeypatch.chdir(tmp_path / "here")
    with pytest.raises(StudyError, match=rf"{missing}: missing. Restore it"):
        load_study(folder).task("touch")


@pytest.mark.parametrize("way", ["../{}", "{}", "link"])
def test_paths_that_lead_outside_are_refused(theirs, tmp_path, way):
    """Two dots, a whole path and a link: a study is made of its own files."""
    folder = Path(shutil.copytree(theirs[0], tmp_path / "study"))
    other = shutil.copy(folder / "profile.toml", tmp_path / "other.toml")
    if way == "link":
        (folder / "profile.toml").unlink()
        (folder / "profile.toml").symlink_to(other)
        words = "'profile.toml' leads out of it"
    else:
        name = way.format("other.toml" if "." in way[:1] else other)
        _forge(folder, '"profile.toml"', f'"{name}"')
        words = r"other.toml' leads out of it"
    with pytest.raises(StudyError, match=words):
        _ = load_study(folder).profile


def _forge(folder: Path, old: str, new: str) -> None:
    """Change a study's configuration, with the digest that belongs to it."""
    config, place = folder / "study.toml", RunFolder(folder, "study.toml", "study", LOOSE)
    config.write_text(config.read_text().replace(old, new))
    table = tomllib.loads(config.read_text())
    seal = table[SEALS]["study.toml"]
    config.write_text(config.read_text().replace(seal, place._digest(table)))


@pytest.mark.parametrize("link", ["report", "report/figures", "report/index.html", "study.lock"])
def test_links_are_not_written_through(theirs, tmp_path, link):
    """A report that leads elsewhere, or a lock that does, is refused; nothing is written there."""
    folder = Path(shutil.copytree(theirs[0], tmp_path / "study"))
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir() if link in ("report", "report/figures") else elsewhere.write_text("precious")
    (folder / link).parent.mkdir(exist_ok=True)
    (folder / link).unlink(missing_ok=True)
    (folder / link).symlink_to(elsewhere)
    with pytest.raises(StudyError, match=f"{link}: a link to .*elsewhere, which is not followed"):
        run_study(folder, resume=True) if link == "study.lock" else build_report(folder)
    assert elsewhere.read_text() == "precious" if elsewhere.is_file() else not os.listdir(elsewhere)


def test_an_edited_task_is_not_ignored(theirs, tmp_path):
    """Whoever resumes with a task file that has been edited since is told, with the line."""
    folder = Path(shutil.copytree(theirs[0], tmp_path / "study"))
    mine = tmp_path / "touch.py"
    text = (folder / "tasks/touch/touch.py").read_text()
    mine.write_text(text.replace("1.0 - ", "2.0 - "))
    words = r"keeps a different tasks/touch/touch.py"
    with pytest.raises(StudyError, match=words):
        run_study(folder, requested(mine), resume=True)
    (folder / "tasks/touch/touch.py").write_text(mine.read_text())
    with pytest.raises(StudyError, match=r"touch.py has been edited since the study was made"):
        run_study(folder, resume=True)


def test_other_peoples_folders_keep_no_lock(tmp_path):
    """A folder that is refused is left as it was."""
    (tmp_path / "thesis.tex").write_text("…")
    with pytest.raises(StudyError, match="other files"):
        run_study(tmp_path, StudyConfig.single("light", **SMALL))
    assert os.listdir(tmp_path) == ["thesis.tex"]
