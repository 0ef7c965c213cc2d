"""studies/noise-level-2: the analysis makes the published tables, and the plan is as it became binding."""

import hashlib
import importlib.util
import json
import re
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from scipy import stats

STUDY = Path(__file__).parents[2] / "studies" / "noise-level-2"
PLAN = (STUDY / "plan.md").read_text("utf-8")
TABLES = (STUDY / "tables.md").read_text("utf-8")
README = (STUDY / "README.md").read_text("utf-8")
BINDING = "The first studies stand on one reality"
BINDING_SHA256 = "f7c5e0706c452e88d00f94b213307e70110dd72c76d640e2b001068d7bf99472"
"""Of the binding text without the addresses of its links, as it stood in docs/noise-level-2.md."""
STATED_SHA256 = {
    "claims.toml": "d06f4d0f302efd48",
    "arms.toml": "c9a036c584c0f1c5",
}
"""Beginnings of the checksums of what the two files say, their comments apart."""
VERDICTS = {
    "E": "supported open absent open supported open supported",
    "T": "supported open absent open supported open supported",
    "E5": "supported open absent open supported open open",
    "T2": "supported open absent open supported open supported",
    "S": " ".join(["no-claim"] * 7),
}
"""Published, claim by claim, in the plan's order."""


def _load(name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(f"noise_level_2_{name}", STUDY / f"{name}.py")
    assert spec and spec.loader
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def analyse() -> Iterator[ModuleType]:
    path = sys.path.copy()
    yield _load("analyse")
    sys.path[:] = path


@pytest.fixture(scope="module")
def arms(analyse: ModuleType) -> list[Any]:
    return [analyse.read_arm(name) for name in analyse.RUN]


def _rows(text: str, head: str) -> list[list[str]]:
    """The rows of the first table whose head begins so."""
    lines = text[text.index(head) :].splitlines()
    table = lines[: next(k for k, line in enumerate(lines) if not line.startswith("|"))]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in table[2:]]


def test_the_analysis_makes_every_published_table(analyse: ModuleType, arms: list[Any]) -> None:
    """What is printed is tables.md, to the last character."""
    made = analyse.page(arms)
    for line, there in zip(made.splitlines(), TABLES.splitlines(), strict=True):
        assert line == there


def test_the_thirty_five_verdicts_are_those_published(analyse: ModuleType, arms: list[Any]) -> None:
    """Seven claims in five arms, and the README has them too."""
    words = {arm.name: [arm.word(claim) for claim in analyse.CLAIMS] for arm in arms}
    assert words == {name: [w.replace("-", " ") for w in all_.split()] for name, all_ in VERDICTS.items()}
    shown = _rows(README, "| claim | E | T |")
    assert [row[1:] for row in shown] == [row[1:] for row in _rows(TABLES, "| claim | E | T |")]
    assert len(README.splitlines()) <= 120


def test_the_plan_is_as_it_became_binding() -> None:
    """Only the addresses of its links may differ; claims and arms say what they said."""
    text = PLAN[PLAN.index(f"\n\n{BINDING}") + 2 :]
    assert hashlib.sha256(re.sub(r"\]\([^)]*\)", "]", text).encode()).hexdigest() == BINDING_SHA256
    for name, digest in STATED_SHA256.items():
        said = json.dumps(tomllib.loads((STUDY / name).read_text("utf-8")), sort_keys=True)
        assert hashlib.sha256(said.encode()).hexdigest().startswith(digest)


def test_what_decides_is_what_the_plan_says(analyse: ModuleType) -> None:
    """Levels, bounds and numbers of claims.toml stand in the plan."""
    plan, text = analyse.PLAN, PLAN.replace(" ", " ")
    for said in (
        f"score below {plan['failed']:g}",
        f"p below {plan['alpha']:g}".replace("0.", "."),
        f"within ±{plan['bound']:g} points",
        f"the {100 * plan['share']:.0f} % interval",
        f"the {100 * plan['peak_share']:.0f} % interval of the peak",
        f"Permutations: {plan['permutations']:,}".replace(",", " "),
        f"{plan['resamples']} times sixteen units",
        "({:.2f} to {:.2f})".format(*plan["peak_between"]),
        "Compared are levels 0 and 2",
        "needs the arms T and E to agree",
    ):
        assert said in text


def test_own_statistics_are_the_libraries_in_one_stratum(analyse: ModuleType) -> None:
    """Ranks, permuted means, failures and Welch's interval, with ties."""
    tests, draw = analyse.lt, np.random.default_rng(4)
    x, y = draw.integers(3, 9, 40) + 0.0, draw.integers(2, 9, 50) + 0.0
    assert tests.by_ranks([(x, y)]).p == pytest.approx(
        stats.mannwhitneyu(x, y, method="asymptotic", use_continuity=True).pvalue
    )
    permuted = stats.permutation_test(
        (x, y), lambda a, b, axis: a.mean(axis) - b.mean(axis), n_resamples=5000, vectorized=True, rng=1
    )
    assert tests.by_means([(x, y)], 5000).p == pytest.approx(permuted.pvalue, abs=0.02)
    low, high = stats.ttest_ind(x, y, equal_var=False).confidence_interval(0.9)
    assert tests.welch([(x, y)], 0.9) == pytest.approx((x.mean() - y.mean(), low, high))
    failed = [[(g < 6).sum(), (g >= 6).sum()] for g in (x, y)]
    exact = stats.chi2_contingency(np.array(failed), correction=True).pvalue
    assert tests.by_failures([(x, y)]).p == pytest.approx(exact, rel=0.05)
