"""A study's tables, read back with the libraries that they are for."""

import numpy as np
import pytest
from click.testing import CliRunner

from realitygap import load_transfers, marks_of
from realitygap.cli import realitygap
from realitygap.export import TABLES, table
from realitygap.work.archive import read_file

KINDS = ("parquet", "csv")


@pytest.fixture(scope="module")
def written(played, tmp_path_factory):
    """Both formats, as the command writes them: folder and what it said, by format."""
    made = {}
    for kind in KINDS:
        folder = tmp_path_factory.mktemp(kind)
        words = ["export", "tables", str(played.folder), "--format", kind, "--out", str(folder / "tables")]
        result = CliRunner().invoke(realitygap, words)
        assert result.exit_code == 0, result.output
        made[kind] = (folder / "tables", result.stdout)
    return made


@pytest.mark.parametrize("kind", KINDS)
def test_pandas_reads_what_the_study_holds(written, played, kind):
    """Every table, every column, every number, in both formats."""
    pandas = pytest.importorskip("pandas", reason="no pandas here: pip install pandas")
    folder, said = written[kind]
    for name in TABLES:
        read = getattr(pandas, f"read_{kind}")(folder / f"{name}.{kind}")
        there = table(played, name)
        assert list(read.columns) == list(there) and len(read) > 0
        assert f"{name}.{kind}: {len(read)} rows" in said
        for key, values in there.items():
            column = read[key]
            if values.dtype == object:
                texts = [None if value is None else str(value) for value in values]
                assert [None if pandas.isna(one) else str(one) for one in column] == texts, (name, key)
            else:
                same = np.array_equal(column.to_numpy(float), values.astype(float), equal_nan=True)
                assert same, (name, key)


def test_trials_bear_their_scores(played):
    """A trial's two scores are its transfer's, its correspondence that of its run's score row."""
    rows, trials = table(played, "trials"), load_transfers(played.folder)
    assert rows["score_simulated"].tolist() == [one.fitness_simulated for one in trials]
    assert rows["run"].tolist() == [one.run for one in trials] and set(rows["robot"]) == {"twin-1"}
    marks = {one.run: one for one in marks_of(played) if one.kind}
    assert rows["behaviour"].tolist() == [marks[one.run].behaviour for one in trials]
    assert read_file(played.folder / rows["folder"][0], "transfer.toml")
