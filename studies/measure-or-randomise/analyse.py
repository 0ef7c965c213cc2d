"""Measure or randomise: every published table and both figures, from the archived tables.

`python studies/measure-or-randomise/analyse.py` prints the tables; with `--write` they go to tables.md, and
the figures to differences.png and docs/figures/noise-knowledge.png.
"""

import sys
from itertools import product
from pathlib import Path

import pandas as pd
from matplotlib.axes import Axes
from scipy.stats import ttest_1samp
from statsmodels.stats.multitest import multipletests

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))
from common import estimate, markdown, number, table  # noqa: E402

from realitygap.report.style import INK, PAGE, new_figure, styled  # noqa: E402

ROBOTS = {"E": "Enki's Khepera", "T": "the twin"}
OUTCOMES = {"correspondence": ("correspondence", 2), "fitness_situated": ("fitness on the robot", 3)}
"""By column of controllers.csv: what it is called here, and the digits with which it is printed."""
KNOWN = ("paper", "another unit", "own, 5 %", "own, 20 %", "own, all", "look-up table")
"""What a simulation knew of the unit, in the plan's order."""
TICKS = {known: known.replace(" ", "\n", 1) for known in KNOWN}
Condition = tuple[str, bool]
"""What the simulation knew, and whether its constants were randomised."""
PLANNED: tuple[tuple[Condition, Condition], ...] = (
    (("own, 5 %", False), ("paper", True)),
    (("own, all", False), ("own, 20 %", False)),
)
EXPLORATORY: tuple[tuple[Condition, Condition], ...] = (
    (("paper", True), ("paper", False)),
    (("own, 5 %", False), ("paper", False)),
    (("another unit", True), ("paper", True)),
    (("own, 5 %", False), ("another unit", True)),
    (("own, all", False), ("another unit", True)),
)
"""Not planned: chosen after the data were published, by a recomputation that asked for the fair rival."""
ERROR_LIMIT = 2.0
"""Deviations of the noise: models that err by more bear no claim about noise (the second study's plan)."""
HEAD = """# Measure or randomise: the tables

Made by `python studies/measure-or-randomise/analyse.py`. "The robot" is Enki's Khepera or the twin: both are
simulated.

Everything is computed from the figures of each controller, which the archive has to five digits. The page
published first was computed before that rounding and then rounded twice, so four of its figures differ in
their last digit: p .8374 (twice) and 10.29 for Enki's Khepera, 10.04 for the twin."""


def main(words: list[str]) -> None:
    """Print the tables; with `--write`, keep them and draw the figures."""
    text = tables()
    if "--write" in words:
        (HERE / "tables.md").write_text(text, encoding="utf-8")
        draw_differences(HERE / "differences.png")
        draw_knowledge(HERE.parents[1] / "docs" / "figures" / "noise-knowledge.png")
    else:
        print(text, end="")


def by_unit(robot: str, outcome: str) -> pd.DataFrame:
    """Means over a unit's runs: a row for each unit, a column for each (known, randomised, noise)."""
    kept = table(f"measure-or-randomise/{robot}/controllers.csv")
    return kept.pivot_table(outcome, "unit", ["known", "randomised", "noise"], aggfunc="mean")


def both_levels(units: pd.DataFrame, condition: Condition) -> pd.Series:
    """A condition's value of each unit: its mean over both levels of noise."""
    return units[condition].mean(axis=1)


def interval(values: pd.Series) -> tuple[float, float, float]:
    """Mean over units and its 95 % interval by Student's t."""
    found = ttest_1samp(values, 0.0)
    return (float(values.mean()), *map(float, found.confidence_interval(0.95)))


def difference(robot: str, outcome: str, pair: tuple[Condition, Condition]) -> pd.Series:
    """First less second condition, by unit."""
    units = by_unit(robot, outcome)
    return both_levels(units, pair[0]) - both_levels(units, pair[1])


def planned(robot: str) -> pd.DataFrame:
    """The four planned comparisons of a robot, with Holm's correction over them."""
    rows = []
    for outcome, pair in product(OUTCOMES, PLANNED):
        gap = difference(robot, outcome, pair)
        mean, low, high = interval(gap)
        rows.append((outcome, *pair, mean, low, high, float(ttest_1samp(gap, 0.0).pvalue)))
    made = pd.DataFrame(rows, columns=["outcome", "first", "second", "difference", "low", "high", "p"])
    made["p_holm"] = multipletests(made.p, method="holm")[1]
    sign = made.difference.gt(0).map({True: "above", False: "below"})
    made["found"] = sign.where(made.p_holm < 0.05, "open")
    return made


def model_errors(robot: str) -> pd.DataFrame:
    """Error of the proximity models on places held out, deviations of the noise: [unit, known].

    A 0 in calibration.csv means that it was not measurable, and is missing here.
    """
    kept = table(f"measure-or-randomise/{robot}/calibration.csv")
    kept = kept[kept.channel == "infrared"]
    return kept.pivot_table("ratio", "unit", "known")[list(KNOWN[2:])].replace(0.0, float("nan"))


def tables() -> str:
    """All tables, as Markdown."""
    parts = [HEAD, *(part for robot in ROBOTS for part in tables_of(robot))]
    return "\n\n".join(parts) + "\n"


def tables_of(robot: str) -> list[str]:
    """A robot's tables."""
    parts = [f"## {ROBOTS[robot][0].upper()}{ROBOTS[robot][1:]} ({robot})"]
    parts.append(
        "The planned comparisons: means over 16 units of the paired difference, 95 % intervals, Student's t, "
        "Holm's correction over the four. Open: not found, which is not absent."
    )
    rows = [
        (
            OUTCOMES[one.outcome][0], words_of(one.first), words_of(one.second),
            estimate(one.difference, one.low, one.high, OUTCOMES[one.outcome][1], signed=True),
            probability(one.p_holm), one.found,
        )
        for one in planned(robot).itertuples()
    ]  # fmt: skip
    parts.append(markdown(["outcome", "", "against", "difference", "p (Holm)", "found"], rows))
    parts.append(
        "*Exploratory*: comparisons that were not planned, with 95 % intervals, uncorrected, without a test."
    )
    rows = [
        (OUTCOMES[outcome][0], words_of(pair[0]), words_of(pair[1]), signed_difference(robot, outcome, pair))
        for outcome, pair in product(OUTCOMES, EXPLORATORY)
    ]
    parts.append(markdown(["outcome", "", "against", "difference"], rows))
    for outcome, (name, places) in OUTCOMES.items():
        parts.append(
            f"{name[0].upper()}{name[1:]}: means over units with 95 % intervals, by what the simulation knew "
            "of the unit, without noise and at the robot's level."
        )
        units = by_unit(robot, outcome)
        head = ["known", "no noise", "robot's level", "no noise, randomised", "robot's level, randomised"]
        columns = list(product((False, True), (0, 1)))
        rows = [
            (
                known,
                *(
                    estimate(*interval(units[known, *column]), places) if (known, *column) in units else "–"
                    for column in columns
                ),
            )
            for known in KNOWN
        ]
        parts.append(markdown(head, rows))
    return [*parts, *tables_of_error(robot)]


def tables_of_error(robot: str) -> list[str]:
    """How far a robot's proximity models err."""
    errors = model_errors(robot)
    rows = [
        (
            known, number(errors[known].fillna(0.0).median()), number(errors[known].median()),
            number(errors[known].max()), f"{(errors[known] > ERROR_LIMIT).sum()} of {errors[known].count()}",
        )
        for known in errors
    ]  # fmt: skip
    head = ["known", "median", "median of the measurable", "largest", f"more than {ERROR_LIMIT:g}"]
    parts = [
        "Error of the proximity models on places held out, in deviations of the noise, over units.",
        markdown(head, rows),
    ]
    missing = [f"{known}: unit {unit}" for known in errors for unit in errors.index[errors[known].isna()]]
    if missing:
        parts.append(
            f"Not measurable ({'; '.join(missing)}): `calibration.csv` has 0 there, which the first column, "
            "as published, counts as 0."
        )
    return parts


def words_of(condition: Condition) -> str:
    """A condition, as printed."""
    return condition[0] + ", randomised" * condition[1]


def probability(p: float) -> str:
    """p as printed: four places, without the zero before the point."""
    return "< .0001" if p < 0.0001 else f"{p:.4f}".removeprefix("0")


def signed_difference(robot: str, outcome: str, pair: tuple[Condition, Condition]) -> str:
    """A difference with its interval, as printed."""
    return estimate(*interval(difference(robot, outcome, pair)), OUTCOMES[outcome][1], signed=True)


def draw_differences(path: Path) -> None:
    """The planned and exploratory differences with their intervals: a panel for each robot and outcome."""
    pairs = [*PLANNED, *EXPLORATORY]
    with styled():
        figure = new_figure(PAGE, 4.4, layout="constrained")
        panels = figure.subplots(2, 2, sharey=True, sharex="col")
        for (robot, name), row in zip(ROBOTS.items(), panels, strict=True):
            for outcome, axes in zip(reversed(OUTCOMES), row, strict=True):
                for i, pair in enumerate(pairs):
                    mean, low, high = interval(difference(robot, outcome, pair))
                    axes.errorbar(
                        mean, i, xerr=[[mean - low], [high - mean]], fmt="o", color=INK, capsize=2,
                        markersize=4, markerfacecolor=INK if pair in PLANNED else "white",
                    )  # fmt: skip
                axes.axvline(0, color="0.6", linewidth=0.8, zorder=0)
                axes.axhline(len(PLANNED) - 0.5, color="0.8", linewidth=0.8, linestyle=":", zorder=0)
                axes.set_title(f"{name[0].upper()}{name[1:]}")
                axes.set_ylim(len(pairs) - 0.5, -0.5)
                names = [f"{words_of(first)}\n− {words_of(second)}" for first, second in pairs]
                axes.set_yticks(range(len(pairs)), names, fontsize=6.5)
        panels[1][0].set_xticks([-0.05, 0, 0.05, 0.1], ["−0.05", "0", "+0.05", "+0.10"])
        panels[1][0].set_xlabel("difference of fitness on the robot")
        panels[1][1].set_xlabel("difference of correspondence, points of ten")
        figure.savefig(path, dpi=130, metadata={"Software": None})


def draw_knowledge(path: Path) -> None:
    """Fitness on the robot and correspondence by what the simulation knew, plain and randomised."""
    with styled():
        figure = new_figure(PAGE, 4.6, layout="constrained")
        panels = figure.subplots(2, 2, sharex=True, sharey="col")
        for (robot, name), row in zip(ROBOTS.items(), panels, strict=True):
            for outcome, axes in zip(reversed(OUTCOMES), row, strict=True):
                _draw_conditions(axes, by_unit(robot, outcome))
                axes.set_title(f"{name[0].upper()}{name[1:]}")
                axes.set_ylabel(OUTCOMES[outcome][0])
        panels[0][0].set_ylim(0.4, 0.65)
        panels[0][1].set_ylim(0, 10.3)
        for axes in panels[1]:
            axes.set_xticks(range(len(KNOWN)), [TICKS[known] for known in KNOWN])
            axes.set_xlabel("what the simulation knew of the unit")
        handles, labels = panels[0][0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside upper center", ncols=2)
        figure.savefig(path, dpi=130, metadata={"Software": None})


def _draw_conditions(axes: Axes, units: pd.DataFrame) -> None:
    """Means over units and both levels of noise with 95 % intervals; hollow: randomised."""
    for randomised in (False, True):
        known = [one for one in KNOWN if (one, randomised) in units.columns.droplevel("noise")]
        found = [interval(both_levels(units, (one, randomised))) for one in known]
        means, lows, highs = map(pd.Series, zip(*found, strict=True))
        axes.errorbar(
            [KNOWN.index(one) + (0.14 if randomised else -0.14) for one in known], means,
            yerr=[means - lows, highs - means], fmt="D" if randomised else "s", color=INK, capsize=2,
            markersize=4.5, markerfacecolor="white" if randomised else INK,
            label="constants randomised" if randomised else "as measured or printed",
        )  # fmt: skip


if __name__ == "__main__":
    main(sys.argv[1:])
