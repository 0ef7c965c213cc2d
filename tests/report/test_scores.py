"""Tables 1 and 2 hold the study's marks beside the paper's own."""

from __future__ import annotations

import csv
import re
from dataclasses import replace

import pytest

from realitygap.report.scores import PAPER_ROWS, score_tables, scores_csv, study_tables
from realitygap.study.load import Study
from realitygap.tasks import load_task
from realitygap.transfer.scores import ScoreRow
from realitygap.world.robot import load_profile

AVOID = load_task("avoidance")
LEVELS = (0.0, 1.0, 2.0)


def marks(scores: dict[float, list[float]], **changes) -> list[ScoreRow]:
    """Made-up marks: correspondence scores by noise level, one run each."""
    return [
        ScoreRow(**{
            "run": 10 * int(level) + k, "name": f"obstacle-avoidance/{level}/{k}", "task": AVOID.name,
            "noise": level, "index": k, "individual": "champion", "type": "wall follower", "share": 0.9,
            "behaviour": 5.0 + level, "kind": "twin", "situated_type": "wall follower",
            "differences": "a little noisier", "correspondence": score, "low": score - 1, "high": score + 1,
            "starts": 8, "units": 1, **changes,
        })
        for level, values in scores.items()
        for k, score in enumerate(values, 1)
    ]  # fmt: skip


SPREAD = {0.0: [4.0, 6.0], 1.0: [7.0, 8.0], 2.0: [5.0, 5.5]}


PRINTED = {
    "obstacle-avoidance": [(4.0, 6.2), (6.0, 8.0), (4.8, 6.8)],
    "light-seeking": [(6.4, 5.6), (6.8, 7.8), (5.8, 5.4)],
}
"""The averages that tables 1 and 2 print, by noise level."""


@pytest.mark.parametrize("task", ["avoidance", "light"])
def test_the_papers_rows_give_the_papers_averages(task: str) -> None:
    """Five rows a level; their means are the averages that it prints."""
    task = load_task(task)
    (table,) = score_tables(task, LEVELS, [replace(one, task=task.name) for one in marks(SPREAD)])
    assert [one.paper_average for one in table.classes] == PRINTED[task.name]
    assert all(len(rows) == 5 for rows in PAPER_ROWS[task.name].values())


def test_the_csv_has_every_column_of_every_run_the_averages_and_the_papers() -> None:
    """A row a run, one a level's average, and the paper's rows as such."""
    (table,) = score_tables(AVOID, LEVELS, marks(SPREAD))
    rows = list(csv.DictReader(scores_csv([table]).splitlines()))
    ours = [row for row in rows if row["source"] == "here"]
    assert [row["row"] for row in ours] == ["1", "2", "average"] * 3
    assert ours[1]["type"] == "wall follower" and ours[1]["differences"] == "a little noisier"
    assert [float(ours[1][key]) for key in ("behaviour", "correspondence", "low", "high")] == [5, 6, 5, 7]
    assert float(ours[5]["correspondence"]) == 7.5 and float(ours[5]["behaviour"]) == 6
    paper = [row for row in rows if row["source"] == "paper"]
    assert [row["row"] for row in paper] == ["1", "2", "3", "4", "5", "average"] * 3
    assert (paper[0]["type"], float(paper[5]["correspondence"])) == ("one way turner", 6.2)


def test_robots_and_twins_have_tables_of_their_own() -> None:
    """Marks on another kind of robot are never averaged with them."""
    both = [*marks(SPREAD, kind="robot"), *marks(SPREAD)]
    tables = score_tables(AVOID, LEVELS, both)
    assert score_tables(AVOID, LEVELS, []) == [] and len(scores_csv([]).splitlines()) == 1
    assert [table.kind for table in tables] == ["robot", "twin"]
    assert len({table.id for table in tables}) == 2


def test_the_page_holds_tables_1_and_2_beside_the_papers(played: Study) -> None:
    """Types, scores and words where a robot was driven; else a dash, and how to get it is said. A calibration
    is told from the profile's own provenance: each channel's error beside its noise."""
    text = (played.folder / "report" / "index.html").read_text("utf-8")
    for label, name in (("Table 1.", "obstacle-avoidance"), ("Table 2.", "light-seeking")):
        assert f"<h3>{label.rstrip('.')}</h3>" in text
        assert (played.folder / "report" / "tables" / f"{name}-scores.csv").is_file()
        assert f'href="tables/{name}-scores.csv"' in text
    assert text.count('<tr class="average"><th scope="row">average') >= 12
    assert "the paper’s judges, 1995" in text
    table = study_tables(played)[0].to_dict()
    assert [row["starts"] for row in table["rows"]][:2] == [2, 1]
    assert table["paper"][1]["correspondence"] == 8.0 and len(table["averages"]) == 3
    found = re.search(r'<table class="scores" aria-labelledby="light.*?</table>.*?</p>', text, re.DOTALL)
    assert found and "no transfer: it has not driven a robot" in found[0]
    assert "realitygap transfer" in found[0] and " there, compared" not in found[0]
    fits = load_profile("khepera").provenance.fits
    assert 'id="calibration-section"' in text and fits and "profile khepera" in text
    assert all(f"{fit.ratio:.2f}" in text for fit in fits)
