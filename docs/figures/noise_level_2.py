"""Writes docs/noise-level-2-results.md and its figures from the arms' tables kept in docs/noise-level-2.

`python docs/figures/noise_level_2.py` renders docs/noise-level-2/page.md.j2: what is said stands there, what
is printed as a figure comes from ARM/controllers.csv, cells.csv, calibration.csv and study.toml. Arms without
tables are named as not yet run.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import matplotlib
from jinja2 import Environment, FileSystemLoader, StrictUndefined

from realitygap.errors import UsageError
from realitygap.experiments.noise.second.verdicts import CLAIMS, PLAN
from realitygap.report.noise.arms import Arm
from realitygap.report.noise.facts import Span
from realitygap.report.noise.second import (
    ARMS,
    answer_figures,
    answer_tables,
    headline,
    read_arms,
    warned,
    word_of,
)
from realitygap.report.noise.tables import Number

DOCS = Path(__file__).resolve().parent.parent
KEPT = DOCS / "noise-level-2"
DRAWN_BY = DOCS / "figures" / "noise-level-2-drawn-by.txt"
"""Another version of Matplotlib draws other pixels."""
HEAD = "<!-- Made by docs/figures/noise_level_2.py of noise-level-2/page.md.j2: change that, not this. -->\n"


def main() -> None:
    """Read the arms, draw them, write the page."""
    try:
        arms = read()
    except UsageError as error:
        sys.exit(str(error))
    draw(arms, DOCS / "figures")
    if arms:
        DRAWN_BY.write_text(f"matplotlib {matplotlib.__version__}\n", encoding="utf-8")
    (DOCS / "noise-level-2-results.md").write_text(page(arms), encoding="utf-8")
    print(f"wrote {DOCS / 'noise-level-2-results.md'}")


def read(kept: Path = KEPT) -> list[Arm]:
    """The arms that have tables."""
    return read_arms([file.parent for file in sorted(kept.glob("*/study.toml"))])


def draw(arms: list[Arm], folder: Path) -> None:
    """Both figures."""
    for name, picture in answer_figures(arms).items() if arms else ():
        file = f"noise-level-2-{name}"
        replace(picture, name=file).save(folder, dpi=130)
        (folder / f"{file}.svg").unlink()


def page(arms: list[Arm]) -> str:
    """The page's text."""
    environment = Environment(
        loader=FileSystemLoader(KEPT), undefined=StrictUndefined, keep_trailing_newline=True,
        trim_blocks=True, lstrip_blocks=True,
    )  # fmt: skip
    said = {
        f"{claim.key} {claim.by}": {arm.name: word_of(arm, claim) for arm in arms if not arm.void}
        for claim in CLAIMS
    }
    tables = answer_tables(arms) if arms else {}
    return HEAD + environment.get_template("page.md.j2").render(
        arms={arm.name: arm for arm in arms}, every=ARMS, missing=[n for n in ARMS if n not in said_of(arms)],
        heads=[(claim, headline(arms, claim)) for claim in CLAIMS], warnings=list(warned(arms)),
        all=lambda key, word: bool(said[key]) and set(said[key].values()) == {word},
        some=lambda key, word: word in said[key].values(), peaks=[(arm.name, peak(arm)) for arm in arms],
        signed=lambda *span: Number(span=Span(*span), signed=True),
        small=list(small(arms)), first_rule=[(arm.name, arm.judged.peak) for arm in arms],
        captions={name: one.caption for name, one in answer_figures(arms).items()},
        verdicts=tables.pop("verdicts", None), tables=tables,
    )  # fmt: skip


def small(arms: list[Arm]) -> Iterator[str]:
    """What was found, and is less than the smallest difference of means that was called of interest."""
    for arm in arms:
        for one in (one for verdict in arm.judged.verdicts for one in verdict.comparisons):
            if one.found == "for" and 0 < one.difference[0] < PLAN.bound:
                span = Number(span=Span(*one.difference))
                yield f"{arm.name}, ({one.key}) by {one.by} against level {one.against}: {span}"


def said_of(arms: list[Arm]) -> set[str]:
    """Names of the arms that were run."""
    return {arm.name for arm in arms}


def peak(arm: Arm) -> str:
    """The level at which tracks agree best, with its interval."""
    top = arm.judged.peak
    return str(Number(span=Span(top.value, top.low, top.high)))


if __name__ == "__main__":
    main()
