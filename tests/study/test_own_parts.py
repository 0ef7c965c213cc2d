"""An algorithm and an encoding of a user's own in a study: kept, trusted, and told off by file and line."""

from __future__ import annotations

import shutil
import sqlite3
from contextlib import closing
from pathlib import Path

import pytest

from realitygap.errors import RealityGapError, StudyError
from realitygap.evolution import Population
from realitygap.study import folder as sources
from realitygap.study.config import StudyConfig
from realitygap.study.load import load_study
from realitygap.study.runner import run_study
from realitygap.study.store import DATABASE

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
SMALL = {"evaluations": 9, "retest_trials": 1, "fresh_trials": 1}
ALGORITHM = (EXAMPLES / "one_plus_one.py").read_text("utf-8")
ENCODING = (
    (EXAMPLES / "real_weights.py").read_text("utf-8").replace("import dataclass", "import dataclass, replace")
)
TOLD = "state = state.told(batch, fitness)"


def config(*settings: str) -> StudyConfig:
    return StudyConfig.single("avoidance", **SMALL).with_settings(["task.seconds=0.5", *settings])


def own(folder: Path, **changes: str) -> StudyConfig:
    """Of both examples, with texts in their files changed."""
    files = {"a.py": ALGORITHM, "e.py": ENCODING + "\n    # the end\n"}
    for name, text in files.items():
        for old, new in changes.items():
            text = text.replace(old.replace("_", " "), new)
        (folder / name).write_text(text)
    return config(
        f"encoding.kind={folder / 'e.py'}:Weights",
        "encoding.hidden=0",
        f"evolution.algorithm={folder / 'e.py'}:Strategy",
        "evolution.children=5",
    )


@pytest.fixture(scope="module")
def theirs(tmp_path_factory) -> Path:
    """A study of somebody's own algorithm and encoding, by two processes."""
    place = tmp_path_factory.mktemp("own")
    run_study(place / "study", own(place).from_dict({**own(place).to_dict(), "runs": 2}), workers=2)
    return place / "study"


def test_the_database_says_what_its_genotypes_are(theirs):
    """Type, shape and settings stand with each run, so that its bytes can be read without its files."""
    with closing(sqlite3.connect(theirs / DATABASE)) as database:
        facts = database.execute("SELECT encoding FROM run WHERE id = 1").fetchone()[0]
    assert '"dtype": "<f8", "shape": [2, 11], "kind": "encoding/e.py:Weights", "hidden": 0' in facts
    study = load_study(theirs)
    assert (study.genotypes(1)[3] == study.genotype(1, 3)).all()
    assert isinstance(study.state(1), Population) and study.runs[1].population.shape == (5, 2, 11)


def test_their_files_are_run_only_where_trusted(theirs, tmp_path, monkeypatch):
    """Whoever looks at champions runs nothing; decoding them does, and is refused until agreed to."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    sources._known.cache_clear()
    folder = shutil.copytree(theirs, tmp_path / "study")
    study = load_study(folder)
    assert study.runs[0].champion.shape == (2, 11) and len(study.evaluations()["cell"]) == 18
    with pytest.raises(StudyError, match=r"brings a program, .*study/(evolution|encoding)/e\.py"):
        study.networks("obstacle-avoidance", study.runs[0].champion)
    trusted = load_study(folder, trust=True)
    assert trusted.networks("obstacle-avoidance", study.runs[0].champion).neurons[0] == 2
    (folder / "encoding" / "e.py").write_text("hidden = 3\n")
    with pytest.raises(StudyError, match=r"encoding/e\.py has been edited since"):
        load_study(folder).encoding("obstacle-avoidance")
    sources._known.cache_clear()


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("slots[:, :, 0] = 1", "slots[:, :, 0] = 1 / 0", r"e\.py, line \d+: .*ZeroDivisionError"),
        ("1.5, self.shape", "1.5, 7", r"e\.py: random: expected an array float64\[2, 11\].*got float64\[7\]"),
        (TOLD, "return None", "tell: expected a state after 5 evaluations, got NoneType"),
    ],
)
def test_what_stops_is_told_by_its_line(tmp_path, old, new, message):
    """An error in a user's algorithm or encoding names the file and the line, and leaves no study behind."""
    assert old in ENCODING
    made = own(tmp_path)
    (tmp_path / "e.py").write_text(ENCODING.replace(old, new))
    with pytest.raises(RealityGapError, match=message):
        run_study(tmp_path / "study", made, workers=1)
    assert not (tmp_path / "study" / DATABASE).exists()
