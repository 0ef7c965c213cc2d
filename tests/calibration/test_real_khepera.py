"""The pages' model errors are those of `benchmarks/real_khepera.py`, and these still come out."""

from __future__ import annotations

import csv
import re
from collections.abc import Sequence
from pathlib import Path

import pytest
from benchmarks.real_khepera import FILE, NAMES, table

from realitygap.report.experiment import READINGS

ROOT = FILE.parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
QUOTED = {
    "README.md": (),
    "docs/differences.md": ("twin", "stranger", "enki-khepera", "enki-epuck", "enki-thymio2"),
    "docs/how-to-robots.md": ("twin",),
    "docs/noise.md": (),
    "docs/robots.md": ("twin", "stranger", "enki-khepera", "enki-epuck", "enki-thymio2"),
}
"""Pages that say how far a model errs, and the simulated robots whose figures they give."""
RATIO = re.compile(r"(?<![\d.,−+/-])3\.[3-9]\d?(?!\d|\.\d| %)")
"""A model error over noise as pages print the real Khepera's, with one place or two."""


def kept() -> list[dict[str, str]]:
    """The file's rows."""
    with FILE.open(encoding="utf-8") as file:
        return list(csv.DictReader(file))


def printed(names: Sequence[str]) -> list[set[str]]:
    """How a page may print the model error of each row of these fits."""
    ratios = [float(row["ratio"]) for row in kept() if row["name"] in names]
    return [{f"{ratio:.2f}", f"{ratio:.1f}"} for ratio in ratios]


@pytest.mark.parametrize("name", ["khepera-wall-extended", "khepera-light-extended"])
def test_the_quick_ones_still_come_out(tables: Path, name: str) -> None:
    """The extended form errs on a real Khepera's wall and lamp by what the file says (some 15 s in all)."""
    assert table(tables.parent, name, workers=1) == [row for row in kept() if row["name"] == name]


def test_the_file_is_whole() -> None:
    """It has rows for each fit, in the script's order."""
    assert tuple(dict.fromkeys(row["name"] for row in kept())) == NAMES


def test_lines_about_a_real_khepera_quote_the_file() -> None:
    """Their ratios are the file's, and each page that says how far a model errs has such a line."""
    right = set().union(*printed([name for name in NAMES if name.startswith("khepera")]))
    quoting = set()
    for page in PAGES:
        for line in page.read_text("utf-8").splitlines():
            found = set(RATIO.findall(line)) if "real Khepera" in line else set()
            assert found <= right, f"{page.name}: {found - right} is not in {FILE.name}: {line}"
            quoting |= {str(page.relative_to(ROOT))} if found else set()
    assert quoting >= set(QUOTED)


@pytest.mark.parametrize("page", QUOTED)
def test_pages_give_simulated_robots_figures_as_the_file_does(page: str) -> None:
    """Of unit 1 of the twin, the stranger and Enki's robots: infrared, and light where it has any."""
    numbers = set(re.findall(r"(?<![\d.])\d+\.\d+", (ROOT / page).read_text("utf-8")))
    for ways in printed(QUOTED[page]):
        assert numbers & ways, f"{page}: {ways} of {FILE.name} is not in it"


def test_the_page_of_several_robots_has_the_files_figures() -> None:
    """Beside simulated robots stand fits to real robots' readings: with one place, both forms of the wall."""
    rows = {row["name"]: row for row in kept()}
    for key, k in (("ratio", 0), ("percent_of_scale", 1)):
        wall = sorted(float(rows[f"khepera-wall-{form}"][key]) for form in ("measured", "extended"))
        khepera, thymio = READINGS.values()
        assert khepera["infrared"][k] == " to ".join(f"{value:.1f}" for value in wall)
        assert khepera["ambient"][k] == f"{float(rows['khepera-light-extended'][key]):.1f}"
        assert thymio["infrared"][k] == f"{float(rows['thymio'][key]):.1f}"
