"""Shards of a study, done apart and put together, are the study in one piece; what is no whole is refused."""

from __future__ import annotations

import json
import shutil
import sqlite3
from contextlib import closing
from pathlib import Path

import pytest

from realitygap.errors import ConfigError, StudyError
from realitygap.study.load import load_study
from realitygap.study.merge import all_shards, merge_runs
from realitygap.study.runner import run_study
from realitygap.work.shard import MARK, Shard, read_mark, whole_of
from tests.study.helpers import content, small


@pytest.fixture(scope="module")
def shards(tmp_path_factory) -> list[Path]:
    """The small study (two runs) in three shards, the last of which has nothing to do."""
    place = tmp_path_factory.mktemp("shards")
    folders = [Shard(number, 3).folder(place / "study") for number in (1, 2, 3)]
    for number, folder in enumerate(folders, start=1):
        run_study(folder, small(), shard=Shard(number, 3), workers=1)
    return folders


@pytest.fixture
def copies(shards, tmp_path) -> list[Path]:
    """Shards that may be spoilt."""
    return [Path(shutil.copytree(folder, tmp_path / folder.name)) for folder in shards]


@pytest.mark.parametrize("text", ["4/3", "0/3", "1/0", "1", "a/b", "1/3/2", "-1/3", "1/1000000"])
def test_what_is_no_shard_is_refused(text):
    """From 1/N to N/N."""
    with pytest.raises(ConfigError, match=r"shard: expected I/N, share I \(from 1 to N\) of N"):
        Shard.parse(text)


def test_shards_share_everything_once():
    """Whatever their number."""
    for of in (1, 2, 3, 7, 12):
        parts = [Shard.parse(f"{k}/{of}").own(range(10)) for k in range(1, of + 1)]
        assert sorted(x for part in parts for x in part) == list(range(10))


def test_shards_merged_are_the_study_in_one_piece(shards, finished, tmp_path):
    """Every table, genotype and checkpoint; the shards are left as they are."""
    before = [content(folder) for folder in shards]
    assert [sum(run.finished for run in load_study(one).runs) for one in shards] == [1, 1, 0]
    merged = merge_runs(all_shards(shards), tmp_path / "whole")
    assert content(merged.folder) == content(finished.folder)
    assert [content(folder) for folder in shards] == before
    assert (merged.runs[1].champion == finished.runs[1].champion).all()
    assert run_study(merged.folder, small(), resume=True, workers=1).runs[1].finished
    assert whole_of(shards[1]) == shards[1].with_name("study") and read_mark(merged.folder) is None


def test_a_shard_goes_on_as_what_it_is(shards, copies):
    """Without saying which; another share, or a whole, is refused there, as is a shard of a whole."""
    study = run_study(copies[1], small(), resume=True, workers=1)
    assert content(study.folder) == content(shards[1])
    with pytest.raises(StudyError, match="holds shard 2/3 of 'evolve', not 3/3"):
        run_study(copies[1], small(), resume=True, shard=Shard(3, 3), workers=1)
    (copies[1] / MARK).unlink()
    with pytest.raises(StudyError, match=r"begun without a shard\. Choose another --out"):
        run_study(copies[1], small(), resume=True, shard=Shard(2, 3), workers=1)


def test_what_does_not_belong_together_is_not_merged(copies, finished, tmp_path):
    """One missing, one twice, one unfinished, one of another number, one that is none: it says which."""
    a, b, c = copies
    with pytest.raises(StudyError, match=r"^missing: shard 2/3\. Give the folders of all 3 shards"):
        all_shards([a, c])
    with pytest.raises(StudyError, match=r"shard 2/3 is given twice: .*, "):
        all_shards([a, b, b, c])
    with pytest.raises(StudyError, match=r"expected a shard's folder, .*shard.json is missing"):
        all_shards([a, finished.folder])
    mark = json.loads((b / MARK).read_text())
    for change, words in (
        ({"shard": "2/4"}, r"holds shard 2/4 of 'evolve'; .* holds shard 1/3|holds shard 2/4"),
        ({"finished": False}, "shard 2/3 is not finished. Finish it first"),
        ({"shard": 3}, "expected a shard's mark"),
    ):
        (b / MARK).write_text(json.dumps({**mark, **change}))
        with pytest.raises(StudyError, match=words):
            all_shards([a, b, c])
    (b / MARK).write_text(json.dumps(mark))
    (tmp_path / "there").mkdir()
    (tmp_path / "there" / "thesis.txt").touch()
    with pytest.raises(StudyError, match="there exists already, and is not overwritten"):
        merge_runs(all_shards([a, b, c]), tmp_path / "there")


def test_shards_of_different_studies_are_not_merged(copies, tmp_path):
    """The setting, or the file, in which they differ is named; so is a damaged database. Nothing is left."""
    a, _, c = copies
    other = tmp_path / "other-shard-2-of-3"
    run_study(other, small(seed=8, evaluations=70), shard=Shard(2, 3), workers=1)
    with pytest.raises(StudyError, match=r"with seed = 7, not 8\. .*Only shards of one study are merged"):
        merge_runs(all_shards([a, other, c]), tmp_path / "whole")
    with closing(sqlite3.connect(copies[1] / "study.db")) as database, database:
        database.execute("UPDATE retest SET score = 0.5 WHERE run = 2 AND trial = 1")
    with pytest.raises(StudyError, match=r"study-shard-2-of-3/study\.db: run 2: table 'retest'"):
        merge_runs(all_shards(copies), tmp_path / "whole")
    assert not (tmp_path / "whole").exists()
