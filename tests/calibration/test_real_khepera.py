"""The kept model errors are those of `benchmarks/real_khepera.py`, and the quick ones still come out."""

from __future__ import annotations

import csv
from pathlib import Path

import pytest
from benchmarks.real_khepera import FILE, NAMES, table

from realitygap.report.experiment import READINGS


def kept() -> list[dict[str, str]]:
    """The file's rows."""
    with FILE.open(encoding="utf-8") as file:
        return list(csv.DictReader(file))


@pytest.mark.parametrize("name", ["khepera-wall-extended", "khepera-light-extended"])
def test_the_quick_ones_still_come_out(tables: Path, name: str) -> None:
    """The extended form errs on a real Khepera's wall and lamp by what the file says (some 15 s in all)."""
    assert table(tables.parent, name, workers=1) == [row for row in kept() if row["name"] == name]


def test_the_file_is_whole() -> None:
    """It has rows for each fit, in the script's order."""
    assert tuple(dict.fromkeys(row["name"] for row in kept())) == NAMES


def test_the_page_of_several_robots_has_the_files_figures() -> None:
    """Beside simulated robots stand fits to real robots' readings: with one place, both forms of the wall."""
    rows = {row["name"]: row for row in kept()}
    for key, k in (("ratio", 0), ("percent_of_scale", 1)):
        wall = sorted(float(rows[f"khepera-wall-{form}"][key]) for form in ("measured", "extended"))
        khepera, thymio = READINGS.values()
        assert khepera["infrared"][k] == " to ".join(f"{value:.1f}" for value in wall)
        assert khepera["ambient"][k] == f"{float(rows['khepera-light-extended'][key]):.1f}"
        assert thymio["infrared"][k] == f"{float(rows['thymio'][key]):.1f}"
