"""docs/noise-level-2-results.md is what the kept arms' tables say: every figure, and the pictures."""

from __future__ import annotations

import csv
import importlib
import re
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import matplotlib
import numpy as np
import pytest
from PIL import Image
from scipy.stats import ttest_rel

from realitygap.experiments.randomise.results import compared_in
from realitygap.report.noise.arms import Arm
from tests.experiments.crosses import TASKS, comparison
from tests.experiments.second import arm, write

DOCS = Path(__file__).parents[2] / "docs"
TEMPLATE = (DOCS / "noise-level-2" / "page.md.j2").read_text("utf-8")
CURE = "change docs/noise-level-2/page.md.j2, not the page, and run docs/figures/noise_level_2.py"


@pytest.fixture(scope="module")
def script() -> Iterator[ModuleType]:
    """The script that makes the page."""
    pytest.importorskip("statsmodels", reason="no mixed models here: pip install statsmodels")
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(DOCS / "figures"))
        yield importlib.import_module("noise_level_2")
        sys.modules.pop("noise_level_2", None)


@pytest.fixture(scope="module")
def kept(script: ModuleType) -> list[Arm]:
    """The arms whose tables are kept."""
    return script.read()


@pytest.fixture(scope="module")
def made(script: ModuleType, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Arm]:
    """Four arms of one made-up truth, by name: E5 has fewer levels, the model of S errs too much.

    They are judged once, by whoever asks first.
    """
    folder, data = tmp_path_factory.mktemp("arms"), arm(comparison(1.0), runs=16, tasks=TASKS[:1])
    few, some = data.only(np.isin(data.evolved, script.LEVELS)), np.isin(data.levels, script.LEVELS)
    columns = ("score", "behaviour", "layout", "home_score", "noisiness", "responsiveness")
    few = replace(few, levels=few.levels[some], **{name: getattr(few, name)[:, some] for name in columns})
    for name, its, error in (("E", data, 20.0), ("T", data, 20.0), ("E5", few, 20.0), ("S", few, 60.0)):
        write(its, folder / name, name=name, error=error)
    return {one.name: one for one in script.read(folder)}


def test_the_page_is_made_of_its_tables_byte_for_byte(script: ModuleType, kept: list[Arm]) -> None:
    """Rendered again from the kept tables, the page is the one that is there."""
    made = script.page(kept, script.bought()).splitlines()
    there = (DOCS / "noise-level-2-results.md").read_text("utf-8").splitlines()
    for number, (ours, theirs) in enumerate(zip(made, there, strict=False), start=1):
        assert ours == theirs, f"line {number}: {CURE}"
    assert len(made) == len(there), CURE


def test_the_pictures_are_those_of_the_tables(script: ModuleType, kept: list[Arm], tmp_path: Path) -> None:
    """Drawn again by the Matplotlib that drew them, the pictures are the same, pixel for pixel."""
    if not kept:
        assert not list((DOCS / "figures").glob("noise-level-2-*.png"))
        return
    drawn_by, here = script.DRAWN_BY.read_text().strip(), f"matplotlib {matplotlib.__version__}"
    if drawn_by != here:
        pytest.skip(f"the pictures were drawn by {drawn_by}, here is {here}")
    script.draw(kept, tmp_path, script.bought())
    for file in tmp_path.glob("*.png"):
        ours, theirs = (np.asarray(Image.open(one)) for one in (file, DOCS / "figures" / file.name))
        assert ours.shape == theirs.shape and (ours == theirs).all(), f"{file.name}: {CURE}"


def test_no_result_is_typed() -> None:
    """What the template says of results depends on the verdicts; no digit of it is typed."""
    results = re.sub(r"{{.*?}}|{%.*?%}|`[^`]*`|\([^)]*\.(?:md|png)(?:#[^)]*)?\)|√2", "", TEMPLATE, flags=re.S)
    assert not re.findall(r"[^\n]{0,40}\d[^\n]{0,20}", results)


def test_it_is_right_with_any_arms(script: ModuleType, made: dict[str, Arm]) -> None:
    """With none it says so; with one the others are named, and what it advises is its verdict."""
    nothing = script.page([], [])
    assert "No arm has been run yet: E, T, E5, T5, T2, S" in nothing and "Monday" not in nothing
    text = script.page([made["E"]], [])
    assert "Not yet carried out as planned on any robot." in text
    assert "**Not yet run:** T, E5, T5, T2, S." in text and "no headline: T not run" in text
    assert "give the simulation by which you judge as much noise" in text
    assert "Do not count on the noise during evolution" in text and "nan" not in text


def test_arms_of_other_levels_and_realities_are_told_apart(
    script: ModuleType, made: dict[str, Arm], tmp_path: Path
) -> None:
    """An arm of fewer levels in the first one's reality is no second reality; one without a model is mute."""
    arms, data = [made["E"], made["E5"], made["S"]], made["E"].data
    text = script.page(arms, [])
    assert "rests on one simulated reality (Enki's Khepera: arms E, E5); a headline waits for arm T." in text
    assert "Arms E and E5 are one reality" in text and "**Out of order.**" in text
    assert "S (the stranger, 1000 evaluations, 96 champions" in text and "(e) in arm S" not in text
    assert "| S | proximity | 16 | 3.00" in text and "supports no claim" in text
    (told,) = re.findall(r"From levels 0, 1 and 2 alone, which every arm has, it is: E ([^,]+), not", text)
    some = np.isin(data.levels, script.LEVELS)
    three = replace(data, levels=data.levels[some], score=data.score[:, some])
    assert told == script.shown(script.peak_of(three)) and "nan" not in text
    assert "| (d) | slopes | all levels |" in text.split("Arm E5: level 1 against")[1]
    script.draw(arms, tmp_path, [])


def test_what_does_not_fit_into_the_plans_hours_is_said(
    script: ModuleType, made: dict[str, Arm], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Arms fall off the end where what a headline needs has taken the hours; not before."""
    arms, late, bought = [made["E"], made["T"]], made["S"], script.bought()
    assert "**Not yet run:** E5, T5, T2, S." in script.page(arms, [])
    for one in (*arms, late):
        monkeypatch.setitem(one.settings, "seconds", {"evolve": 12_000.0})
    text = script.page(arms, [one for one in bought if one.name == "E"])
    assert "**Not run:** E5, T5, T2, S: the arms before E5 took 6.7 hours of two cores" in text
    assert "The plan also has this experiment on arm T's robot" in text and "on arm E's robot" not in text
    assert "the plan also has this experiment" not in script.page(arms, bought).lower()
    text = script.page([*arms, late], bought)
    assert "**Not run:** E5, T5, T2: the arms before E5 took 6.7 hours of two cores" in text
    assert "S was run all the same, past those hours and out of order" in text
    assert "in another 3.3 hours: it is reported" in text
    assert "**Not yet run:** T, E5, T5, T2, S." in script.page(arms[:1] * 2, [])


@pytest.mark.parametrize("folder", sorted((DOCS / "measure-or-randomise").iterdir()), ids=lambda f: f.name)
def test_what_measuring_bought_is_what_its_controllers_say(folder: Path) -> None:
    """Of the kept controllers' figures come each condition's mean and each planned comparison."""
    values: dict[tuple[str, ...], dict[str, list[float]]] = {}
    for row in csv.DictReader((folder / "controllers.csv").read_text("utf-8").splitlines()):
        for outcome in ("correspondence", "fitness_situated"):
            runs = values.setdefault((outcome, row["known"], row["randomised"], row["noise"]), {})
            runs.setdefault(row["unit"], []).append(float(row[outcome]))
    units = {key: np.array([np.mean(runs[u]) for u in sorted(runs)]) for key, runs in values.items()}
    found, compared = compared_in(folder)
    for one in found:
        known, randomised, noise = one.condition
        mine = units[one.outcome, known, str(randomised).lower(), f"{noise:g}"]
        assert one.mean == pytest.approx(mine.mean(), rel=1e-3) and one.units == len(mine)
    assert len(found) == len(units)
    for two in compared:
        both = []
        for words in (two.first, two.second):
            known, drawn = words.removesuffix(", randomised"), str(words.endswith("randomised")).lower()
            both.append(sum(units[two.outcome, known, drawn, noise] for noise in ("0", "1")) / 2)
        told = ttest_rel(*both)
        assert two.p == pytest.approx(told.pvalue, rel=0.01)
        assert two.difference == pytest.approx((both[0] - both[1]).mean(), rel=0.01)
        interval = told.confidence_interval()
        assert (two.low, two.high) == pytest.approx((interval.low, interval.high), rel=0.02)
