"""A study's tables, read back with the libraries that they are for."""

import json
import sys

import numpy as np
import pytest
from click.testing import CliRunner

from realitygap import load_study, load_transfers, marks_of
from realitygap.cli import realitygap
from realitygap.errors import UsageError
from realitygap.export import TABLES, table, write_tables

KINDS = ("parquet", "csv")


@pytest.fixture(scope="module")
def written(played, tmp_path_factory):
    """Both formats, as the command writes them: folder and what it said, by format."""
    made = {}
    for kind in KINDS:
        folder = tmp_path_factory.mktemp(kind)
        words = [
            "export",
            "tables",
            str(played.folder),
            "--format",
            kind,
            "--out",
            str(folder / "tables"),
            "--json",
        ]
        result = CliRunner().invoke(realitygap, words)
        assert result.exit_code == 0, result.output
        made[kind] = (folder / "tables", json.loads(result.stdout))
    return made


@pytest.mark.parametrize("kind", KINDS)
def test_pandas_reads_what_the_study_holds(written, played, kind):
    """Every table, every column, every number, in both formats."""
    pandas = pytest.importorskip("pandas", reason="no pandas here: pip install pandas")
    folder, said = written[kind]
    for name in TABLES:
        read = getattr(pandas, f"read_{kind}")(folder / f"{name}.{kind}")
        there = table(played, name)
        assert list(read.columns) == list(there) and len(read) == said["rows"][name] > 0
        for key, values in there.items():
            column = read[key]
            if values.dtype == object:
                texts = [None if value is None else str(value) for value in values]
                assert [None if pandas.isna(one) else str(one) for one in column] == texts, (name, key)
            else:
                assert np.array_equal(column.to_numpy(float), values.astype(float), equal_nan=True), (
                    name,
                    key,
                )


def test_trials_bear_their_scores(played):
    """A trial's two scores are its transfer's, its correspondence that of its run's score row."""
    rows, trials = table(played, "trials"), load_transfers(played.folder)
    assert rows["score_simulated"].tolist() == [one.fitness_simulated for one in trials]
    assert rows["run"].tolist() == [one.run for one in trials] and set(rows["robot"]) == {"twin-1"}
    marks = {one.run: one for one in marks_of(played) if one.kind}
    assert rows["behaviour"].tolist() == [marks[one.run].behaviour for one in trials]
    assert (played.folder / rows["folder"][0] / "transfer.toml").is_file()


def test_frames_and_files_are_the_same(played, written):
    """`to_pandas` gives what the file holds."""
    pandas = pytest.importorskip("pandas", reason="no pandas here: pip install pandas")
    runs = load_study(played.folder).to_pandas()
    read = pandas.read_parquet(written["parquet"][0] / "runs.parquet")
    assert runs["champion_fresh"].tolist() == read["champion_fresh"].tolist() and len(runs) == 12


@pytest.mark.parametrize("missing", ["pandas", "pyarrow"])
def test_a_missing_package_is_named(played, tmp_path, monkeypatch, missing):
    """With the line that installs it; nothing is written."""
    for name in [one for one in sys.modules if one.partition(".")[0] == missing]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, missing, None)
    with pytest.raises(UsageError, match=rf"{missing} is not installed.*pip install 'realitygap\[tables\]'"):
        played.to_pandas() if missing == "pandas" else write_tables(played, "parquet", tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_a_study_and_a_folder_go_by_their_paths(played, written, tmp_path):
    """As text, too."""
    write_tables(str(played.folder), "csv", str(tmp_path / "tables"))
    for name in TABLES:
        text, there = (
            (folder / f"{name}.csv").read_text() for folder in (tmp_path / "tables", written["csv"][0])
        )
        assert text == there


def test_no_such_table(played):
    """Is told those that there are."""
    with pytest.raises(UsageError, match="expected runs, evaluations, tests, trials, scores, got 'run'"):
        played.to_pandas("run")
