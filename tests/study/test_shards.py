"""Shards of a study, done apart and put together, are the study in one piece; what is no whole is refused."""

from __future__ import annotations

import json
import shutil
import sqlite3
from contextlib import closing
from pathlib import Path

import pytest

from realitygap.errors import ConfigError, StudyBusyError, StudyError
from realitygap.study import runner
from realitygap.study.load import load_study
from realitygap.study.runner import merge_runs, run_study
from realitygap.work.folder import LOCK, new_folder
from realitygap.work.shard import MARK, Shard, all_shards, read_mark, whole_of
from tests.study.helpers import content, small


@pytest.fixture(scope="module")
def shards(tmp_path_factory) -> list[Path]:
    """The small study (two runs) in three shards, the last of which has nothing to do."""
    place = tmp_path_factory.mktemp("shards")
    folders = [Shard(number, 3).folder(place / "study") for number in (1, 2, 3)]
    for number, folder in enumerate(folders, start=1):
        run_study(folder, small(), shard=Shard(number, 3) if number == 1 else f"{number}/3", workers=1)
    return folders


@pytest.fixture
def copies(shards, tmp_path) -> list[Path]:
    """Shards that may be spoilt."""
    return [Path(shutil.copytree(folder, tmp_path / folder.name)) for folder in shards]


def stop(event) -> None:
    """Ctrl-C when a run is under way."""
    if event.done:
        raise KeyboardInterrupt


@pytest.mark.parametrize("text", ["4/3", "0/3", "a/b"])
def test_what_is_no_shard_is_refused(text):
    """From 1/N to N/N."""
    with pytest.raises(ConfigError, match=r"shard: expected I/N, share I \(from 1 to N\) of N"):
        Shard.parse(text)


def test_a_study_that_fails_to_start_is_taken_back(tmp_path, monkeypatch):
    """Whatever the error, before anything was saved."""
    monkeypatch.setattr(runner.StudyExecutor, "compile", lambda self: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        run_study(tmp_path / "study", small(), shard="1/2", workers=1)
    assert not list(tmp_path.iterdir())


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
    with pytest.raises(StudyError, match=r"started without one\. Choose another --out"):
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
        database.execute("UPDATE tested SET data = substr(data, 9) WHERE run = 2")
    with pytest.raises(StudyError, match=r"study-shard-2-of-3/study\.db: run 2: table 'tested'"):
        merge_runs(all_shards(copies), tmp_path / "whole")
    assert not [*tmp_path.glob("*whole*")]


def test_a_shard_that_was_copied_while_it_was_worked_on_is_not_merged(copies, finished, tmp_path):
    """Its database is older than its mark: a run is not finished. The copy can be finished."""
    shutil.rmtree(copies[1])
    with pytest.raises(KeyboardInterrupt):
        run_study(copies[1], small(), shard=Shard(2, 3), workers=1, on_progress=stop)
    mark = copies[1] / MARK
    mark.write_text(mark.read_text().replace("false", "true"))
    with pytest.raises(StudyError, match=r"study-shard-2-of-3: run 2 of shard 2/3 is not finished, .*copied"):
        merge_runs(all_shards(copies), tmp_path / "whole")
    run_study(copies[1], small(), resume=True, workers=1)
    assert content(merge_runs(all_shards(copies), tmp_path / "whole").folder) == content(finished.folder)


def test_one_process_merges_into_a_folder(shards, tmp_path):
    """A second one is told who does; what a kill left is begun anew; a folder is not put into itself."""
    half = tmp_path / ".whole.half"
    half.mkdir()
    (half / "study.db").write_text("left by a kill")
    with new_folder(tmp_path / "whole", "again") as filled:
        assert filled == half and [path.name for path in half.iterdir()] == [LOCK]
        (filled / "theirs").touch()
        with pytest.raises(
            StudyBusyError, match=r"\.whole\.half: this very process is working on this study"
        ):
            merge_runs(all_shards(shards), tmp_path / "whole")
        assert (filled / "theirs").exists()
    assert (tmp_path / "whole" / "theirs").exists()
    with pytest.raises(StudyError, match=r"exists already, and is not overwritten"):
        merge_runs(all_shards(shards), Path())


def test_shards_that_cannot_be_written_are_merged(shards, finished, tmp_path, monkeypatch):
    """On a medium that is only read SQLite finds no room for its own side files."""
    connect = sqlite3.connect

    class Blind(sqlite3.Connection):
        """Opens, and fails at the first statement, as SQLite does there."""

        def execute(self, *words):
            raise sqlite3.OperationalError("unable to open database file")

    def opened(path, *words, **options):
        blind = "-shard-" in str(path) and "immutable" not in str(path)
        return connect(path, *words, **options, **({"factory": Blind} if blind else {}))

    monkeypatch.setattr(sqlite3, "connect", opened)
    merged = merge_runs(all_shards(shards), tmp_path / "whole")
    assert content(merged.folder) == content(finished.folder)
