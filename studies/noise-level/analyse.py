"""Every published table of the first study of the level of noise, from the archived tables.

    python studies/noise-level/analyse.py            # prints the tables
    python studies/noise-level/analyse.py --write    # writes tables.md and the figures beside this file

The analysis is that of plan.md; crossed.py has the statistics, figures.py the figures.
"""

import io
import sys
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
import pandas as pd
from scipy import stats

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from common import markdown, number, settings, table
from crossed import (
    AVOIDANCE,
    BOTH,
    LIGHT,
    PAPER,
    UNITS,
    Rows,
    Study,
    compare,
    contrasts,
    correlation,
    curve,
    evolved,
    fitness_spans,
    judged,
    load,
    scopes,
    spearman,
    unpaired,
    verdicts,
)  # fmt: skip

HERE = Path(__file__).resolve().parent

STUDIES = {
    "default-first": "The default, first making",
    "default": "The default, second making",
    "default-again": "The default, third making",
    "evaluations-5000": "Five thousand evaluations",
    "twin-noise-2": "A twin twice as noisy",
}
FAILED, SATURATED = 6.0, 9.7
"""Below the first, a score is a miss ("hit or miss"); from the second on it lies within the scale's floor."""
LIMITS = {"infrared": 2, "ambient": 1}
"""Model error, in deviations of the noise, beyond which the level of noise explains nothing."""
REAL = (
    ("a real Khepera (tables), extended form", "infrared", "25.76", "23.79", "1.08", "3.70", 2, "▲"),
    ("a real Khepera (tables), measured form", "infrared", "–", "–", "–", "3.35", 2, "▲"),
    ("a real Khepera (tables), extended form", "ambient", "15.23", "4.33", "3.52", "3.87", 1, "▲"),
)
"""Over all readings as published; held out by the calibration at commit d6980081."""


# Tables ---------------------------------------------------------------------------------------------------


def probability(p: float) -> str:
    """A p-value as printed."""
    return "< .0001" if p < 1e-4 else f"{p:.4f}".lstrip("0") if p < 0.9999 else "1"


def overview() -> str:
    """Verdicts and peaks of every making, both tasks and each alone."""
    rows = []
    for name in STUDIES:
        made = settings(f"noise-level/{name}/study.toml")
        for scope, study in scopes(name).items():
            tops = [curve(study, claim)[1].text() for claim in ("a", "b", "c", "noisiness")]
            facts = (name, f"{made['twin_noise']:g}", made["evaluations"], scope)
            rows.append((*facts, *verdicts(study, judged(name, scope)), *tops))
    tops = ("peak (a)", "peak (b)", "peak (c)", "noisiness passes zero")
    head = ("study", "twin's noise scale", "evaluations", "tasks", "(a)", "(b)", "(c)")
    return markdown((*head, *tops), rows)


def contrast_table(rows: pd.DataFrame) -> str:
    """A row for each comparison; a star at those that decide the verdict."""
    made = []
    for row in rows.itertuples():
        star = " *" if row.other in (0.0, 2.0) and row.claim != "home" else ""
        claim = "(c), calibration unit" if row.claim == "home" else f"({row.claim})"
        values = (number(m) for m in row.means)
        effects = (row.difference.text(signed=True), row.delta.text(signed=True))
        alone = (number(delta, signed=True) for delta in row.sets)
        tests = (probability(row.p), probability(row.p_holm), row.found)
        made.append((claim, f"{row.other:g}{star}", *values, *effects, *alone, *tests))
    head = ("claim", "against level", "mean at 1", "mean there", "difference", "Cliff's delta")
    return markdown((*head, "delta, set 1", "delta, set 2", "p", "p (Holm)", "found"), made)


def split_table(study: Study) -> str:
    """The diagonal's difference from each level as a step of evolved and one of comparison level."""
    rows = []
    for other in study.others:
        here, there = study.evolved == study.robot, study.evolved == other
        diagonal = compare(study, "c", other)
        orders = {
            "evolved level": (compare(study, "b", other), compare(study, "a", other, there)),
            "comparison level": (evolved(study, study.at(other), other), compare(study, "a", other, here)),
        }
        for which, word in (("difference", "difference of means"), ("delta", "Cliff's delta")):
            for first, steps in orders.items():
                spans = (getattr(effect, which).text(signed=True) for effect in (diagonal, *steps))
                rows.append((f"{other:g}", first, word, *spans))
    head = ("against level", "first", "measure", "diagonal", "evolved level", "comparison level")
    return markdown(head, rows)


def ends_table(name: str) -> str:
    """Scores behind claim (b): how many fail, and how many lie within the scale's floor."""
    rows = []
    for scope, study in scopes(name).items():
        for level in study.levels:
            scores = study.at(study.robot)[study.evolved == level]
            ends = ((scores < FAILED).sum(), (scores >= SATURATED).sum())
            rows.append(
                (scope, f"{level:g}", len(scores), number(scores.mean()), number(np.median(scores)), *ends)
            )
    return markdown(("tasks", "level", "controllers", "mean", "median", "below 6", "9.7 or more"), rows)


def by_task_and_level(name: str) -> Iterator[tuple[str, Study, float, Rows]]:
    """Each task's controllers evolved at each level."""
    for task in (AVOIDANCE, LIGHT):
        study = scopes(name)[task]
        for level in study.levels:
            yield task, study, level, study.evolved == level


def fitness_table(name: str) -> str:
    """Fitness in simulation and on the twin, by evolved level."""
    rows = []
    for task, study, level, at in by_task_and_level(name):
        heading, scale, places = UNITS[task]
        spans = fitness_spans(study, at, "simulated", "situated")
        simulated, situated = (study.controllers[c].to_numpy() for c in ("simulated", "situated"))
        delta = "–"
        if level != study.robot:
            delta = unpaired(study, situated, at, study.evolved == study.robot).delta.text(signed=True)
        texts = (span.text(places, scale=scale) for span in spans)
        rows.append(
            (heading, f"{level:g}", at.sum(), *texts, delta, correlation(simulated[at], situated[at]).text())
        )
    head = ("task", "level", "runs", "simulated", "on the twin", "drop", "delta on the twin", "r")
    return markdown(head, rows)


def falls_table(name: str) -> str:
    """Fitness on the twin, on the calibration unit and on the others, by evolved level."""
    rows = []
    for task, study, level, at in by_task_and_level(name):
        heading, scale, places = UNITS[task]
        texts = [s.text(places, scale=scale) for s in fitness_spans(study, at, "at_home", "elsewhere")]
        rho = ""
        if level == study.levels[0]:  # over all of the task's controllers, so once
            fall = study.controllers["at_home"] - study.controllers["elsewhere"]
            beyond = fall - fall.groupby(study.controllers["home_unit"]).transform("mean")
            rho = spearman(study.evolved, beyond.to_numpy()).text(signed=True)
        rows.append((heading, f"{level:g}", at.sum(), *texts, rho))
    head = ("task", "level", "runs", "calibration unit", "other units", "fall", "rho over all levels")
    return markdown(head, rows)


def names_table(name: str) -> str:
    """Runs by behaviour in simulation and evolved level."""
    rows = []
    for task in (AVOIDANCE, LIGHT):
        part, heading = scopes(name)[task].controllers, UNITS[task][0].partition(",")[0]
        counts = pd.crosstab(part["name"], part["evolved_level"])
        for one in sorted(counts.index, key=lambda one: (-counts.loc[one].sum(), one)):
            rows.append((heading, one, *counts.loc[one]))
    return markdown(("task", "behaviour", *(f"{level:g}" for level in load(name).levels)), rows)


def makings_table() -> str:
    """Light seeking of the first two makings: each, both together, and each calibration alone."""
    one, two = (scopes(name)[LIGHT] for name in ("default-first", "default"))
    numbers = two.controllers[["seed_set", "home_unit"]] + [2, 3]  # of their own in the second making
    two = replace(two, controllers=two.controllers.assign(**numbers))
    both = Study(
        **{
            part: pd.concat([getattr(one, part), getattr(two, part)], ignore_index=True)
            for part in ("controllers", "score", "home_score", "noisiness")
        }
    )
    judgements = [judged("default-first", LIGHT), judged("default", LIGHT), contrasts(both)]
    alone = [both.only((both.controllers["home_unit"] == unit).to_numpy()) for unit in range(1, 7)]
    rows = []
    for claim, other in product("bc", both.others):
        made = [f[(f["claim"] == claim) & (f["other"] == other)].iloc[0] for f in judgements]
        units = [compare(study, claim, other) for study in alone]
        for which, word in (("difference", "difference of means"), ("delta", "Cliff's delta")):
            cells = [f"{row[which].text(signed=True)}, {row['found']}" for row in made]
            singles = [number(getattr(effect, which).value, signed=True) for effect in units]
            rows.append((f"({claim})", f"{other:g}", word, *cells, *singles))
    head = ("claim", "against level", "measure", "first making", "second making", "both together")
    said = []
    for which, made in zip(("first making", "second", "both together"), judgements, strict=True):
        _, b, c = verdicts(both, made)
        said.append(f"{which}: (b) {b}, (c) {c}")
    units = [f"{which}, unit {unit}" for which in ("1st", "2nd") for unit in (1, 2, 3)]
    return f"Verdicts: {'; '.join(said)}.\n\n{markdown((*head, *units), rows)}"


def paper_table() -> str:
    """The paper's average scores, by eye, beside the diagonal's of every making."""
    curves = {
        (name, scope): curve(study, "c")[0] for name in STUDIES for scope, study in scopes(name).items()
    }
    rows = []
    for scope in (BOTH, AVOIDANCE, LIGHT):
        for level, word in enumerate(("zero", "observed", "double")):
            marks = [PAPER[task][level] for task in ((AVOIDANCE, LIGHT) if scope == BOTH else (scope,))]
            at = load("default").levels.index(level)
            ours = (curves[name, scope][at].text(1) for name in STUDIES)
            rows.append((scope, word, number(np.mean(marks), 1), *ours))
    return markdown(("tasks", "noise", "the paper", *STUDIES), rows)


def paper_tests() -> str:
    """Mann and Whitney's p between the paper's noise levels, both tasks together; the least of one task."""

    def p(first: Sequence[int], second: Sequence[int]) -> float:
        return float(stats.mannwhitneyu(first, second, method="asymptotic").pvalue)

    both = [[*PAPER[AVOIDANCE][level], *PAPER[LIGHT][level]] for level in (0, 1, 2)]
    single = min(p(PAPER[task][1], PAPER[task][other]) for task in PAPER for other in (0, 2))
    found = (p(both[1], both[0]), p(both[1], both[2]), p(both[0], both[2]))
    zero, double, neither = (f"{value:.3f}".lstrip("0") for value in found)
    least = f"{single:.2f}".lstrip("0")
    return (
        f"p is {zero} for observed against zero, {double} for observed against double, {neither} for zero "
        f"against double; for either task alone none is below {least}"
    )


def calibration_table() -> str:
    """Model error of each unit's calibration in deviations of the noise, beside a real robot's."""
    rows = []
    for name in STUDIES:
        for row in table(f"noise-level/{name}/calibration.csv").dropna(subset="ratio").itertuples():
            over_all = getattr(row, "ratio_over_all", row.ratio)
            held_out = number(row.ratio) if hasattr(row, "ratio_over_all") else "–"
            error, limit = over_all * row.noise, LIMITS[row.channel]
            texts = (number(error), number(row.noise), number(over_all), held_out)
            rows.append((f"{name}, unit {row.unit}", row.channel, *texts, limit, "▲" * (row.ratio > limit)))
    head = ("study", "channel", "model error", "noise", "over noise", "over noise, held out", "limit", "")
    return markdown(head, [*rows, *REAL])


# The page and its figures ---------------------------------------------------------------------------------


def page() -> str:
    """All tables."""
    loud = replace(load("twin-noise-2"), robot=2.0)
    words = zip("abc", verdicts(loud, contrasts(loud)), strict=True)
    at_two = ", ".join(f"({claim}) {word}" for claim, word in words)
    return f"""\
# The level of noise: tables of the first study

Made by `python studies/noise-level/analyse.py --write`. Tests and verdicts are those of [plan.md](plan.md);
what the tables mean is in [README.md](README.md). Levels are multiples of the noise that was measured on
the twin; the robot's own level is 1. Brackets hold 95 % intervals, by bootstrap over runs.

## All makings

Verdicts, the levels at which the curves peak, and the level at which noisiness passes zero (below it the
twin is noisier than the simulation). An interval over all levels means that no peak can be seen. Each task
alone has a Holm family of its own.

{overview()}

By the first definition of the robot's level (2 with noise scale 2) twin-noise-2 would give: {at_two}.

Average correspondence scores: the paper's (five runs a task and noise, by eye), and the diagonal's. Of the
paper's scores, both tasks together, ten runs a noise, Mann and Whitney's {paper_tests()}.

{paper_table()}

The calibrated simulations: model error and noise deviation in counts, over all readings, so that dark ones
flatter them; their ratio; and the ratio on places held out, where readings are neither dark nor saturated,
which only the third making kept. ▲: beyond the limit. Last: such fits to a real robot's tables. Their
figures over all readings are those published with these studies, those held out are of commit d6980081
(published: 3.49 and, in light, 3.69 in the extended form, 3.37 in the measured form).

{calibration_table()}

Light seeking of the default's first two makings, 40 runs a level in each; last, each calibration alone.

{makings_table()}
{"".join(study_page(name, title) for name, title in STUDIES.items())}"""


def study_page(name: str, title: str) -> str:
    """The tables of one making."""
    command = settings(f"noise-level/{name}/study.toml")["command"].replace("study noise", "experiment noise")
    study = load(name)
    comparisons = "\n\n".join(
        f"{scope.capitalize()}:\n\n{contrast_table(judged(name, scope))}" for scope in scopes(name)
    )
    return f"""
## {title}

`{name}`, made by `{command}`: {len(study.score)} controllers, each compared with the simulation at every
level.

### Comparisons

In (a) all controllers, in (b) and (c) 40 of each task at each level. * decides the verdict.

{comparisons}
{home_page(name)}
### What the diagonal's difference is made of

Both tasks, in two orders. Evolved level first: it is judged at 1, and the comparison level by controllers
evolved at the other. Comparison level first: it is judged by controllers evolved at 1, and the evolved
level at the other. Differences of means add up; deltas do not.

{split_table(study)}

### Scores against the simulation at 1, as in (b)

From 9.7 on a score lies within the scale's floor, where ranks are mostly chance; the few below 6 decide the
means.

{ends_table(name)}

### Fitness

Delta: Cliff's, of fitness on the twin against level 1. r: of simulated and situated fitness over
controllers.

{fitness_table(name)}

Not planned: fitness on the twin, on the calibration unit and on the others. Rho: Spearman's, of evolved
level and fall, each fall less the mean of its calibration unit; below 0, the fall shrinks with noise.

{falls_table(name)}

### Runs by behaviour in simulation and evolved level

{names_table(name)}
"""


def home_page(name: str) -> str:
    """Claim (c) on the calibration unit alone, if its scores were kept."""
    if not np.isfinite(load(name).home_score.to_numpy()).all():
        return ""
    tables = "\n\n".join(
        f"{scope.capitalize()}:\n\n{contrast_table(contrasts(study, ['home']))}"
        for scope, study in scopes(name).items()
    )
    return f"""
### (c) on the calibration unit alone

Not planned: each controller against the very simulation in which it was evolved. Holm's correction is over
each table alone. The scale is that for 8 pairs of trials, whose floor is wider.

{tables}
"""


def draw(folder: Path) -> None:
    """The figures of the third making: map.png, claims.png and fitness.png."""
    from figures import claims_figure, fitness_figure, map_figure
    from PIL import Image

    from realitygap.report.style import styled

    with styled():
        for name, make in (("map", map_figure), ("claims", claims_figure), ("fitness", fitness_figure)):
            drawn = io.BytesIO()
            make("default-again").savefig(drawn, dpi=120, metadata={"Software": None})
            few = Image.open(drawn).convert("RGB").quantize(200, kmeans=1)  # colours: a third of the bytes
            few.save(folder / f"{name}.png", optimize=True)


def main() -> None:
    text = page()
    if "--write" in sys.argv[1:]:
        (HERE / "tables.md").write_text(text, encoding="utf-8")
        draw(HERE)
    else:
        sys.stdout.write(text)


if __name__ == "__main__":
    main()
