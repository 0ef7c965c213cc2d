"""docs/noise-level-2-results.md is what the kept arms' tables say: every figure, and the pictures."""

from __future__ import annotations

import importlib
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import matplotlib
import numpy as np
import pytest
from PIL import Image

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


def test_the_page_is_made_of_its_tables_byte_for_byte(script: ModuleType, kept: list[Arm]) -> None:
    """Rendered again from the kept tables, the page is the one that is there."""
    made = script.page(kept).splitlines()
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
    script.draw(kept, tmp_path)
    for file in tmp_path.glob("*.png"):
        ours, theirs = (np.asarray(Image.open(one)) for one in (file, DOCS / "figures" / file.name))
        assert ours.shape == theirs.shape and (ours == theirs).all(), f"{file.name}: {CURE}"


def test_no_result_is_typed() -> None:
    """What the template says of results depends on the verdicts; no digit of it is typed."""
    results = re.sub(r"{{.*?}}|{%.*?%}|`[^`]*`|\([^)]*\.(?:md|png)\)|√2", "", TEMPLATE, flags=re.S)
    assert not re.findall(r"[^\n]{0,40}\d[^\n]{0,20}", results)


def test_it_is_right_with_any_arms(script: ModuleType, tmp_path: Path) -> None:
    """With none it says so; with one the others are named, and what it advises is its verdict."""
    nothing = script.page([])
    assert "No arm has been run yet: E, T, E5, T5, T2, S" in nothing and "Monday" not in nothing
    write(arm(comparison(1.0), runs=16, tasks=TASKS[:1]), tmp_path / "E", name="E")
    text = script.page(script.read(tmp_path))
    assert "**Not yet run:** T, E5, T5, T2, S." in text and "no headline: T not yet run" in text
    assert "give the simulation that you judge by as much noise" in text
    assert "Do not count on the noise that you evolve under" in text and "nan" not in text
