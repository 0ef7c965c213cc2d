"""studies/misfit: on made-up tables the analysis finds the trend that is there, and none where none is."""

from __future__ import annotations

import importlib.util
import io
import re
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pandas as pd
import pytest
from statsmodels.regression.linear_model import OLS
from statsmodels.stats.multitest import multipletests

STUDY = Path(__file__).parents[2] / "studies" / "misfit"
MISFITS = {"own, all": 0.4, "own, 5 %": 1.5, "nominal": 3.7, "nominal, spread × 1": 3.7}
LEVELS, COMPARED = (0.0, 1.0, 2.0, 4.0), (0.0, 0.7, 1.0, 1.4, 2.0, 4.0)
BEST = {0.4: 1.0, 1.5: 1.2, 3.7: 1.6}
"""Root of the level at which the made-up tracks agree best, by misfit."""


@pytest.fixture(scope="module")
def analyse() -> Iterator[ModuleType]:
    path = sys.path.copy()
    spec = importlib.util.spec_from_file_location("misfit_analyse", STUDY / "analyse.py")
    assert spec and spec.loader
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    yield module
    sys.path[:] = path


def tables(
    name: str, *, failures: float, fitness: float, runs: int = 10, seed: int = 1
) -> dict[str, pd.DataFrame]:
    """An arm's tables whose contrasts are these: 16 units, or arm K's six realities, three simulations, and
    a rival that loses .05 of fitness."""
    draw, units = np.random.default_rng(seed), 6 if name == "K" else 16
    steps = np.log2(3.7 / 0.4) * 2.0  # of the contrast: misfits, and roots of levels
    rows: list[dict[str, Any]] = []
    cells: list[dict[str, Any]] = []
    for unit in range(units):
        for simulation, misfit in MISFITS.items():
            worse, rival = np.log2(misfit / 0.4), "spread" in simulation
            for level in LEVELS if not rival else LEVELS[:2]:
                for run in range(runs):
                    pull = worse * np.sqrt(level) / steps
                    key = {
                        "set": 1 + unit * 2 // units, "reality": str(unit), "simulation": simulation,
                        "evolved_level": level, "run": run, "individual": "champion",
                    }  # fmt: skip
                    fails = draw.random() < 0.1 + max(failures, 0.0) * pull
                    fit = 0.5 + fitness * pull - 0.05 * rival + 0.03 * draw.standard_normal()
                    rows.append({**key, "fitness_situated": fit, "fitness_simulated": fit})
                    for one in COMPARED:
                        off = (np.sqrt(one) - BEST[misfit]) ** 2
                        score = (3.0 if fails else 9.0) - 0.5 * off + 0.01 * draw.standard_normal()
                        cells.append(
                            {**key, "comparison_level": one, "score": score, "without_jitter": score}
                        )
    misfits = [
        {"reality": str(u), "simulation": s, "misfit": m} for u in range(units) for s, m in MISFITS.items()
    ]
    both = [{"individual": "champion"}, {"individual": "fittest"}]
    controllers = pd.DataFrame([row | who for row in rows for who in both])
    judged = pd.DataFrame([row | who for row in cells for who in both])
    judged["without_jitter"] = judged["score"]
    return {"controllers": controllers, "cells": judged, "misfits": pd.DataFrame(misfits)}


def arm(analyse: ModuleType, name: str, **truth: Any) -> Any:
    return analyse.Arm.of(name, **tables(name, **truth))


@pytest.mark.parametrize("name", ["E", "K"])
def test_a_trend_is_found_with_its_size(analyse, name):
    """In failures and in fitness, and in the level to judge by; the intervals hold the truth."""
    made = arm(analyse, name, failures=0.4, fitness=-0.06)
    for by, truth, claim in (("failures", 0.4, 0), ("fitness_situated", -0.06, 1)):
        found = made.models.trend(by)
        assert found.low < truth < found.high and found.p < 0.001 and found.agrees
        assert analyse.word(analyse.PLAN["claim"][claim], found, found.p) == "found"
    judged = made.models.judging()
    assert judged.contrast == pytest.approx(0.6, abs=0.05) and judged.p < 0.01


@pytest.mark.parametrize("name", ["E", "K"])
def test_where_nothing_is_nothing_is_found(analyse, name):
    """Fitness is null, which its interval says; what is found the other way is called reversed."""
    made = arm(analyse, name, failures=0.0, fitness=0.0)
    claims = analyse.PLAN["claim"]
    fitness, failures = made.models.trend("fitness_situated"), made.models.trend("failures")
    assert analyse.word(claims[1], fitness, fitness.p) == "null" and failures.p > 0.01
    assert analyse.word(claims[0], failures, 1.0) in ("null", "open")
    other = analyse.Trend(0.05, 0.04, 0.06, 1e-6, (0.05, 0.05))
    assert analyse.word(claims[1], other, 1e-6) == "found, reversed"
    assert analyse.word(claims[1], other._replace(sets=(0.1, -0.01)), 1e-6) == "open"


def test_every_table_and_the_figure_come_out(analyse, monkeypatch, tmp_path):
    """Both seed sets apart, the paper's diagonal beside ours, the rival by as much as it lost."""
    monkeypatch.setattr(analyse, "RIVAL", ["nominal, spread × 1"])
    monkeypatch.setitem(analyse.ARMS["rival"], "against", ["own, 5 %"])
    made = [arm(analyse, name, failures=0.4, fitness=-0.06, runs=4) for name in ("K", "E")]
    page = analyse.page(made)
    assert "| the paper (judged by eye) |  |  | 6.2 | 8.0 | 6.8 | – |" in page
    assert "all else simulated" in page and page.count("| own, all | 2 | 0.40 |") == 2
    less = re.search(r"own, 5 % \| \+([\d.]+) \(\+([\d.]+) to \+([\d.]+)\) \|", page)
    truth = 0.05 + 0.06 * (1 - np.log2(1.5 / 0.4) / np.log2(3.7 / 0.4)) / 4  # half a root, of two
    assert less and float(less[2]) < truth < float(less[3])
    analyse.figure(made, tmp_path / "levels.png")
    assert (tmp_path / "levels.png").stat().st_size > 10_000


def test_own_statistics_are_the_libraries(analyse):
    """The interaction is statsmodels' coefficient; Holm's correction is its."""
    draw = np.random.default_rng(2)
    level, misfit = draw.choice(LEVELS, 60), draw.choice([0.4, 1.5, 3.7], 60)
    y = draw.standard_normal(60)
    fixed = (misfit[:, None] == np.unique(misfit)).astype(float)
    x = np.column_stack([fixed, np.sqrt(level), np.sqrt(level) * np.log2(misfit)])
    assert analyse.interaction(level, misfit, misfit, y) == pytest.approx(OLS(y, x).fit().params[-1])
    p = [0.04, 0.001, 0.03, 0.2]
    assert analyse.holm(p) == pytest.approx(multipletests(p, method="holm")[1])


def test_the_plan_says_what_decides(analyse):
    """Seeds, units and bounds of the two files stand in the plan; the pilots' seeds are not among them."""
    plan = (STUDY / "plan.md").read_text("utf-8")
    arms = tomllib.loads((STUDY / "arms.toml").read_text("utf-8"))
    assert not {1995, 20267, 424242} & set(arms["design"]["seeds"])
    said = ["units 117 to 132", "ten failures in a hundred; .02 of fitness", "is below 6"]
    for one in (*map(str, arms["design"]["seeds"]), *said, "at misfit 3.7, less the same at misfit 0.4"):
        assert one in plan
    assert [claim["least"] for claim in analyse.PLAN["claim"]] == [0.1, 0.02, 0.5]


def test_the_archive_makes_the_printed_tables(analyse: ModuleType) -> None:
    """All but the tests' own, which take long; and there is a track of each champion."""
    printed = (STUDY / "tables.md").read_text("utf-8")
    arms = analyse.read(None)
    assert [arm.name for arm in arms] and analyse.diagonals(arms) in printed
    for arm in arms:
        assert analyse.by_simulation(arm) in printed and analyse.in_short(arm) in printed
        parts = [
            name for name in analyse.archive() if re.fullmatch(rf"misfit/{arm.name}(-\d)?/tracks.npy", name)
        ]
        tracks = [np.load(io.BytesIO(analyse.archive()[name])) for name in parts]
        assert sum(map(len, tracks)) == (arm.rows["individual"] == "champion").sum()
        assert all(one.shape[1:] == (4, 41, 3) and one[..., :2].max() < 1200 for one in tracks)
