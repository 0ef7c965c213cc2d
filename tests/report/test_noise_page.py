"""docs/noise-level.md is what its studies' tables say: every printed figure, and the pictures."""

from __future__ import annotations

import csv
import importlib
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import matplotlib
import numpy as np
import pytest
from PIL import Image
from scipy import stats

from realitygap.experiments.noise.contrasts import unpaired
from realitygap.report.calibration import beside_real
from realitygap.world.profile import load_profile

DOCS = Path(__file__).parents[2] / "docs"
TEMPLATE = (DOCS / "noise-level" / "page.md.j2").read_text("utf-8")
CURE = "change docs/noise-level/page.md.j2, not the page, and run docs/figures/noise_level.py"


@pytest.fixture(scope="module")
def script() -> Iterator[ModuleType]:
    """The script that makes the page."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(DOCS / "figures"))
        yield importlib.import_module("noise_level")
        for name in ("noise_level", "noise_level_told", "noise_level_power", "noise_level_2_power"):
            sys.modules.pop(name, None)


@pytest.fixture(scope="module")
def told(script: ModuleType) -> Any:
    """The kept studies."""
    return script.read()


def test_the_page_is_made_of_its_tables_byte_for_byte(script: ModuleType, told: Any) -> None:
    """Rendered again from the kept tables, the page is the one that is there."""
    made = script.page(told).splitlines()
    there = (DOCS / "noise-level.md").read_text("utf-8").splitlines()
    for number, (ours, theirs) in enumerate(zip(made, there, strict=False), start=1):
        assert ours == theirs, f"line {number}: {CURE}"
    assert len(made) == len(there), CURE


def test_no_figure_of_the_results_is_typed() -> None:
    """In the results every digit comes from an expression; what cannot be computed again has its dagger."""
    results = TEMPLATE[TEMPLATE.index("## Results") : TEMPLATE.index("## The shadow beneath the lamp")]
    typed = re.sub(r"{{.*?}}|{%.*?%}|`[^`]*`", "", results, flags=re.S)
    assert not re.findall(r"[^\n]{0,40}\d[^\n]{0,20}", typed)
    times = TEMPLATE[TEMPLATE.index("## How long it takes") : TEMPLATE.index("## Limits")]
    assert not re.search(r"\d", re.sub(r"{{.*?}}", "", times))
    looked_up = re.findall(r'lost\("([^"]+)"\)', TEMPLATE)
    page = (DOCS / "noise-level.md").read_text("utf-8")
    assert len(looked_up) >= 8 and all(f"{text}†" in page for text in looked_up)


def test_the_split_of_the_diagonal_is_what_the_cells_say() -> None:
    """By hand, from cells.csv alone: 0.73 = 0.50 + 0.23, or 0.27 + 0.46; against zero 1.19 = 0.25 + 0.94."""
    cells: dict[tuple[float, float], list[float]] = {}
    with (DOCS / "noise-level" / "default" / "cells.csv").open(newline="") as file:
        for row in csv.DictReader(file):
            key = (float(row["evolved_level"]), float(row["comparison_level"]))
            cells.setdefault(key, []).append(float(row["score"]))
    mean = {key: sum(scores) / len(scores) for key, scores in cells.items()}
    page = (DOCS / "noise-level.md").read_text("utf-8")
    bullet = next(line for line in page.splitlines() if line.startswith("- **What the diagonal is made"))
    printed = [float(text) for text in re.findall(r"([+][0-9.]+) \(", bullet)]
    wanted = []
    for level in (2.0, 0.0):
        evolved = (mean[1, 1] - mean[level, 1], mean[1, level] - mean[level, level])
        compared = (mean[level, 1] - mean[level, level], mean[1, 1] - mean[1, level])
        wanted += [mean[1, 1] - mean[level, level], evolved[0], compared[0], evolved[1], compared[1]]
    assert printed == pytest.approx(wanted, abs=0.00501)
    assert printed[:6] == [0.73, 0.5, 0.23, 0.27, 0.46, 1.19]


def test_beside_the_twins_model_error_stands_a_real_robots_wherever_it_is_told() -> None:
    """Over all readings 0.2 and 0.3 of the kept studies, 1.08 and 3.52 of a real robot's tables; where these
    are neither dark nor saturated 3.49 and 3.69, which is what everything else tells."""
    with (DOCS / "noise-level" / "default" / "calibration.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    fits = {fit.channel: fit for fit in load_profile("khepera").provenance.fits}
    kept = (("infrared", "0.2", "1.08", "3.49"), ("ambient", "0.3", "3.52", "3.69"))
    for channel, twin, over_all, judged in kept:
        assert {f"{float(row['ratio']):.1f}" for row in rows if row["channel"] == channel} == {twin}
        assert f"{fits[channel].ratio_over_all:.2f}" == over_all and f"{fits[channel].ratio:.2f}" == judged
        assert judged in beside_real(channel)
    assert "over all readings, is 0.22 to 0.24 in proximity" in (DOCS / "noise-level.md").read_text("utf-8")
    for file in ("twin.md", "how-to.md", "noise-level.md"):
        assert "3.49 and 3.69" in (DOCS / file).read_text("utf-8")


def test_many_rank_tests_at_once_are_the_studys_own(script: ModuleType) -> None:
    """What power is computed by gives delta and p of the planned test, ties and strata included."""
    power = importlib.import_module("noise_level_power")
    draw = np.random.default_rng(3)
    strata = np.array([0] * 9 + [1] * 6)
    first, second = draw.integers(0, 7, (20, 15)) + 1.0, draw.integers(0, 9, (20, 15)) + 0.0
    for x, y, delta, p in zip(first, second, *power.rank_tests(first, second, strata), strict=True):
        made = unpaired(x, y, strata=(strata.tolist(), strata.tolist()))
        assert (delta, p) == pytest.approx((made.delta, made.p))


def test_the_second_studys_tests_are_what_theory_says(script: ModuleType) -> None:
    """Their tables stand in the plan; p of means and of failures are those of SciPy and of an exact count."""
    power = importlib.import_module("noise_level_2_power")
    plan = (DOCS / "noise-level-2.md").read_text("utf-8")
    assert all(table in plan for table in power.tables().split("\n\n"))
    draw = np.random.default_rng(5)
    x, y, one = draw.uniform(0, 10, (4, 60)), draw.uniform(1, 10, (4, 60)), np.zeros(60, np.int64)
    _, means, _ = power.by_means(x, y, one)
    assert means == pytest.approx(stats.ttest_ind(x, y, axis=1).pvalue, rel=0.2)
    tables = [[[(g < 6).sum(), (g >= 6).sum()] for g in pair] for pair in zip(x, y, strict=True)]
    exact = [stats.chi2_contingency(np.array(t), correction=True).pvalue for t in tables]
    assert power.by_failures(x, y, one)[1] == pytest.approx(exact, rel=0.2)


def test_power_is_that_of_the_plans_arms(script: ModuleType) -> None:
    """Runs and levels that power is reckoned with are those of the plan's table of arms."""
    power = importlib.import_module("noise_level_2_power")
    plan = (DOCS / "noise-level-2.md").read_text("utf-8")
    for arm in power.ARMS:
        row = next(line for line in plan.splitlines() if line.startswith(f"| {arm.name} |"))
        _, _, _, tasks, _, runs, _, _ = (cell.strip() for cell in row.split("|"))
        assert (tasks == "both") == (arm.tasks == 2)
        levels = dict(zip((0.0, 0.5, 1.0, 2.0, 4.0), runs.split(", "), strict=True))
        assert arm.runs == {level: int(count) for level, count in levels.items() if count != "–"}


def test_power_is_what_theory_says(script: ModuleType, told: Any) -> None:
    """Nothing is found as often as Holm's step; a difference found half the time has z at that step."""
    power = importlib.import_module("noise_level_power")
    rows = power.powers(told["default"].data, studies=1500, seed=7)
    assert rows[0].found == pytest.approx(power.STEP, abs=0.01)
    sizes = [14, 14, 12] * 2
    spread = 2 * np.sqrt(sum(n * n * (2 * n + 1) / 12 for n in sizes)) / sum(n * n for n in sizes)
    assert power.least_delta(rows, 0.5) == pytest.approx(2.5 * spread, rel=0.1)
    assert rows[-1].delta == pytest.approx(0.1, abs=0.02)


def test_the_pictures_are_those_of_the_tables(script: ModuleType, told: Any, tmp_path: Path) -> None:
    """Drawn again by the Matplotlib that drew them, the pictures are the same, pixel for pixel."""
    name = "twin-noise-2"
    kept = {word: DOCS / "figures" / f"noise-level-{name}-{word}.png" for word in script.FIGURES.values()}
    drawn_by, here = script.DRAWN_BY.read_text().strip(), f"matplotlib {matplotlib.__version__}"
    if drawn_by != here:
        pytest.skip(f"the pictures were drawn by {drawn_by}, here is {here}")
    script.draw(told[name], tmp_path)
    for file in kept.values():
        ours, theirs = (np.asarray(Image.open(one)) for one in (tmp_path / file.name, file))
        assert ours.shape == theirs.shape and (ours == theirs).all(), f"{file.name}: {CURE}"
