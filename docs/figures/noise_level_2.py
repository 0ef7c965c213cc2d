"""Writes docs/noise-level-2-results.md and its figures from the arms' tables kept in docs/noise-level-2.

`python docs/figures/noise_level_2.py` renders docs/noise-level-2/page.md.j2: what is said stands there, what
is printed as a figure comes from ARM/controllers.csv, cells.csv, calibration.csv and study.toml, and from
docs/measure-or-randomise/ARM. Arms without tables are named as not yet run.
"""

from __future__ import annotations

import csv
import statistics
import sys
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from jinja2 import Environment, FileSystemLoader, StrictUndefined

from realitygap.errors import UsageError
from realitygap.experiments.noise.second import arms as planned
from realitygap.experiments.noise.second.verdicts import CLAIMS, PLAN, Comparison, Peak, peak_of
from realitygap.experiments.randomise.plan import NOISES, RandomiseConfig
from realitygap.experiments.randomise.results import Comparison as Bargain
from realitygap.experiments.randomise.results import Outcome, compared_in
from realitygap.report.noise.arms import Arm
from realitygap.report.noise.asides import CHANNELS
from realitygap.report.noise.facts import Span
from realitygap.report.noise.second import (
    ARMS,
    answer_figures,
    answer_tables,
    estimate,
    headline,
    read_arms,
    strays,
    warned,
    word_of,
)
from realitygap.report.noise.tables import Number, probability
from realitygap.report.randomise import outcomes_figure
from realitygap.report.style import save_figure, styled

DOCS = Path(__file__).resolve().parent.parent
KEPT = DOCS / "noise-level-2"
BOUGHT = DOCS / "measure-or-randomise"
DRAWN_BY = DOCS / "figures" / "noise-level-2-drawn-by.txt"
"""Another version of Matplotlib draws other pixels."""
PLACES = {"correspondence": 2, "fitness_situated": 3}
REALITIES = {None: "the twin", "enki:khepera": "Enki's Khepera", "stranger": "the stranger"}
"""By the robot of an arm's design."""
LEVELS = sorted({PLAN.robot, *PLAN.against})
"""That every arm has."""
ALLOWED = 6
"""Hours of two cores that the plan gives to the whole."""
HEAD = "<!-- Made by docs/figures/noise_level_2.py of noise-level-2/page.md.j2: change that, not this. -->\n"


@dataclass(frozen=True, kw_only=True)
class Bought:
    """What measuring or randomising bought in an arm: settings, tables, median model error over noise."""

    name: str
    settings: Mapping[str, Any]
    found: list[Outcome]
    comparisons: list[Bargain]
    ratios: Mapping[str, float]

    def cell(self, outcome: str, known: str, randomised: bool, noise: float) -> str:
        """A condition's mean with its interval; a dash for one that is not there."""
        same = (known, randomised, noise)
        one = next((one for one in self.found if (one.outcome, *one.condition) == (outcome, *same)), None)
        places = PLACES[outcome]
        return "–" if one is None else str(Number(span=Span(one.mean, one.low, one.high), places=places))

    def rows(self) -> list[tuple[str, ...]]:
        """What was planned to be compared, as it is shown."""
        return [
            (
                one.outcome.replace("_", " "), one.first, one.second,
                str(Number(span=Span(*one[3:6]), places=PLACES[one.outcome], signed=True)),
                probability(one.p_holm), one.found,
            )
            for one in self.comparisons
        ]  # fmt: skip

    @property
    def known(self) -> list[str]:
        """What simulations knew, in order."""
        return list(dict.fromkeys(one.condition.known for one in self.found))


def main() -> None:
    """Read the arms, draw them, write the page."""
    try:
        arms = read()
    except UsageError as error:
        sys.exit(str(error))
    draw(arms, DOCS / "figures", bought())
    if arms:
        DRAWN_BY.write_text(f"matplotlib {matplotlib.__version__}\n", encoding="utf-8")
    (DOCS / "noise-level-2-results.md").write_text(page(arms, bought()), encoding="utf-8")
    print(f"wrote {DOCS / 'noise-level-2-results.md'}")


def read(kept: Path = KEPT) -> list[Arm]:
    """The arms that have tables."""
    return read_arms([file.parent for file in sorted(kept.glob("*/study.toml"))])


def bought(kept: Path = BOUGHT) -> list[Bought]:
    """The experiments of measuring or randomising that have tables, by arm."""
    made = []
    for file in sorted(kept.glob("*/experiment.toml")):
        fits: dict[str, list[float]] = {}
        for row in csv.DictReader((file.parent / "calibration.csv").read_text("utf-8").splitlines()):
            if row["channel"] == "infrared":
                fits.setdefault(row["known"], []).append(float(row["ratio"]))
        found, comparisons = compared_in(file.parent)
        made.append(
            Bought(
                name=file.parent.name, settings=tomllib.loads(file.read_text("utf-8")), found=found,
                comparisons=comparisons, ratios={key: statistics.median(row) for key, row in fits.items()},
            )
        )  # fmt: skip
    return made


def draw(arms: list[Arm], folder: Path, others: list[Bought]) -> None:
    """All figures."""
    for one in others:
        with styled():
            name = f"noise-level-2-bought-{one.name}"
            save_figure(outcomes_figure(one.found), folder, name, dpi=130)
            (folder / f"{name}.svg").unlink()
    for name, picture in answer_figures(arms).items() if arms else ():
        file = f"noise-level-2-{name}"
        replace(picture, name=file).save(folder, dpi=130)
        (folder / f"{file}.svg").unlink()


def page(arms: list[Arm], others: list[Bought]) -> str:
    """The page's text."""
    environment = Environment(
        loader=FileSystemLoader(KEPT), undefined=StrictUndefined, keep_trailing_newline=True,
        trim_blocks=True, lstrip_blocks=True,
    )  # fmt: skip
    judged = [arm for arm in arms if not arm.void]
    said = {f"{c.key} {c.by}": {arm.name: word_of(arm, c) for arm in judged} for c in CLAIMS}
    tables = answer_tables(arms) if arms else {}
    within = {name: word == "supported" for name, word in said["e interval"].items()}
    order = list(ARMS)
    missing = [name for name in order if name not in said_of(arms)]
    late = [arm.name for arm in arms if missing and order.index(arm.name) > order.index(missing[0])]
    about_levels = next(claim for claim in CLAIMS if claim.key == "a")
    less, by_means = list(small(judged)), list(turned(judged))
    return HEAD + environment.get_template("page.md.j2").render(
        arms={arm.name: arm for arm in arms}, bought=others, judged=judged, said=said, agree=PLAN.agree,
        pays=paid(others, "correspondence"), fitter=paid(others, "fitness_situated"),
        unsettled=all(one.comparisons[1].found == "open" for one in others),
        spent=hours([arm for arm in arms if arm.name not in late]), allowed=ALLOWED, late=listed(late),
        many=len(late) > 1, more=hours([arm for arm in arms if arm.name in late]),
        standard=RandomiseConfig.robot, void={arm.name: facts_of(arm) for arm in arms if arm.void},
        percent="95 %", quiet=NOISES[0], noisy=NOISES[1], missing=missing,
        heads=[(claim, headline(arms, claim)) for claim in CLAIMS], warnings=list(warned(arms)),
        all=lambda key, word: bool(said[key]) and set(said[key].values()) == {word},
        some=lambda key, word: word in said[key].values(),
        peaks=[f"{arm.name} {shown(arm.judged.peak)}" for arm in arms], coarse=list(coarse(judged)),
        firm=all(told.endswith("supported") for arm in judged for told in estimates(arm).values()),
        levels=LEVELS, estimates={arm.name: estimates(arm) for arm in judged},
        design=planned.arm, reality=reality, alike=alike(judged),
        signed=lambda *span: Number(span=Span(*span), signed=True),
        small=[told(*one) for one in less], turned=[told(*one) for one in by_means],
        within=in_arms(within, is_true=True), beyond=in_arms(within, is_true=False),
        otherwise=[f"arm {arm.name} {stray}" for arm in judged for stray in strays(arm, about_levels)],
        little=[f"arm {name} against level {one.against}" for name, one in less if one.key == "a"],
        captions={name: one.caption for name, one in answer_figures(arms).items()},
        verdicts=tables.pop("verdicts", None), tables=tables,
    )  # fmt: skip


def paid(others: list[Bought], outcome: str) -> str:
    """The arms in which measuring a few places was found to beat randomised constants; empty if none."""
    few = {
        one.name: any(
            (c.outcome, c.found) == (outcome, "above") and c.second.endswith("randomised")
            for c in one.comparisons
        )
        for one in others
    }
    return in_arms(few, is_true=True) if any(few.values()) else ""


def facts_of(arm: Arm) -> dict[str, object]:
    """Of an arm that supports no claim: its models' errors, its levels and peak, and (a) against double."""
    ratios: dict[str, list[float]] = {}
    for one in arm.calibration:
        ratios.setdefault(CHANNELS[one.channel], []).append(one.ratio)
    errors = [
        f"{statistics.median(own):.1f} deviations of the noise in {name}" for name, own in ratios.items()
    ]
    about_levels = next(verdict for verdict in arm.judged.verdicts if verdict.claim.key == "a")
    double = next(one.found for one in about_levels.comparisons if one.against == f"{max(PLAN.against):g}")
    levels = [f"{level:g}" for level in arm.data.levels]
    return {"errors": errors, "levels": levels, "peak": shown(arm.judged.peak), "double": double}


def small(arms: list[Arm]) -> Iterator[tuple[str, Comparison]]:
    """What was found, by arm, and is less than the smallest difference that was called of interest."""
    return ((name, one) for name, one in found(arms) if 0 <= side(one) < PLAN.bound)


def turned(arms: list[Arm]) -> Iterator[tuple[str, Comparison]]:
    """What was found by ranks, and by means is on the other side."""
    return ((name, one) for name, one in found(arms) if side(one) < 0)


def found(arms: list[Arm]) -> Iterator[tuple[str, Comparison]]:
    """All comparisons that were, by arm."""
    for arm in arms:
        for one in (one for verdict in arm.judged.verdicts for one in verdict.comparisons):
            if one.found in ("for", "against"):
                yield arm.name, one


def side(one: Comparison) -> float:
    """The difference of means, above zero on the side of what was found."""
    return one.difference[0] if one.found == "for" else -one.difference[0]


def told(name: str, one: Comparison) -> str:
    """A comparison and its difference of means."""
    said = f"{name}, ({one.key}) by {one.by} against level {one.against}"
    return f"{said}: {Number(span=Span(*one.difference), signed=True)}"


def in_arms(words: Mapping[str, bool], *, is_true: bool) -> str:
    """The arms of which something is true or not, by name."""
    names = [name for name, word in words.items() if word == is_true]
    return f"arm{'s' if len(names) > 1 else ''} {listed(names)}"


def listed(names: list[str]) -> str:
    """A, B and C."""
    return " and ".join([*filter(None, [", ".join(names[:-1])]), *names[-1:]])


def hours(arms: list[Arm]) -> float:
    """What arms took, by their own clocks."""
    return sum(sum(arm.settings.get("seconds", {}).values()) for arm in arms) / 3600


def said_of(arms: list[Arm]) -> set[str]:
    """Names of the arms that were run."""
    return {arm.name for arm in arms}


def reality(name: str) -> str:
    """What an arm's controllers were carried over to."""
    design = planned.arm(name)
    louder = f" at noise scale {design.twin_noise:g}" if design.twin_noise != 1 else ""
    return REALITIES[design.robot] + louder


def alike(arms: list[Arm]) -> dict[str, list[str]]:
    """Names of arms by the reality that they share."""
    made: dict[str, list[str]] = {}
    for arm in arms:
        made.setdefault(reality(arm.name), []).append(arm.name)
    return made


def estimates(arm: Arm) -> dict[str, str]:
    """The peak and the word on (e) by each analysis that decides nothing."""
    return {name: estimate(made) for name, made in arm.robust.items() if name != "fitness"}


def coarse(arms: list[Arm]) -> Iterator[str]:
    """The peaks of arms with more levels than all have, by those alone."""
    for arm in arms:
        some = np.isin(arm.data.levels, LEVELS)
        if not some.all():
            top = peak_of(replace(arm.data, levels=arm.data.levels[some], score=arm.data.score[:, some]))
            yield f"{arm.name} {shown(top)}, not {shown(arm.judged.peak)}"


def shown(top: Peak) -> str:
    """The level at which tracks agree best, with its interval."""
    return str(Number(span=Span(top.value, top.low, top.high)))


if __name__ == "__main__":
    main()
