"""Every published table and figure of the second study of the level of noise, from the archived tables.

`python studies/noise-level-2/analyse.py` prints the tables; `--write` writes tables.md and the figures.
The tests are in level_tests.py, the arms in level_arms.py, the figures in level_figures.py.
"""

import argparse
import math
import sys
from collections.abc import Sequence
from itertools import product
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
sys.path.insert(0, str(Path(__file__).resolve().parent))

import level_tests as lt
import numpy as np
import pandas as pd
from common import estimate, markdown, number, table
from level_arms import BEYOND, DESIGN, FITTEST, LIMITS, Arm, headline, probability, read_arm, secondary
from level_tests import AGAINST, CLAIMS, PLAN, ROBOT, Peak

HERE = Path(__file__).resolve().parent
RUN = [name for name in DESIGN if name != "T5"]
REALITIES = {None: "the twin", "enki:khepera": "Enki's Khepera", "stranger": "the stranger"}
CHANNELS = {"infrared": "proximity", "ambient": "light"}
REAL = [
    ("proximity", "measured form", 3.35),
    ("proximity", "extended form", 3.70),
    ("light", "extended form", 3.87),
]
"""Model error of a real Khepera's tables over the noise (shared tables: benchmarks/real_khepera.py)."""
CEILING = 9.7
"""A score above it lies within the scale's own floor of chance."""
REPLAYED = ["readings", "commands", "speeds", "replay_cm"]


def titled(task: str) -> str:
    """A task's name as a heading."""
    return task.replace("-", " ").capitalize()


def reality(arm: Arm) -> str:
    """What an arm's controllers drove."""
    scale = arm.settings["twin_noise"]
    return REALITIES[DESIGN[arm.name].get("robot")] + (f" at noise scale {scale:g}" if scale != 1 else "")


def shown(peak: Peak) -> str:
    """A peak with its interval."""
    return estimate(peak.value, peak.low, peak.high)


def runs(arms: Sequence[Arm]) -> str:
    """The arms that were run, and what they took of the plan's six hours."""
    rows, spent = [], 0.0
    for arm in arms:
        begun, made = (arm.settings[name]["commit"][:7] for name in ("versions_at_start", "versions"))
        hours = sum(arm.settings["seconds"].values()) / 3600
        spent += hours
        commit = f"`{made}`" + (f", begun at `{begun}`" if begun != made else "")
        named = ", ".join(map(str, arm.beyond)) or "none"
        rows.append(
            (
                arm.name,
                reality(arm),
                arm.settings["evaluations"],
                len(arm.champions.who),
                commit,
                number(hours),
                number(spent),
                named,
            )
        )
    head = [
        "arm",
        "reality",
        "evaluations",
        "champions",
        "commit",
        "hours of two cores",
        "so far",
        "units beyond the limit",
    ]
    return markdown(head, rows)


def verdicts(arms: Sequence[Arm]) -> str:
    """The verdicts by arm."""
    there = {arm.name: arm for arm in arms}
    rows = [
        (
            f"({claim['key']}) {claim['title']}",
            *(there[name].word(claim) if name in there else "not run" for name in DESIGN),
        )
        for claim in CLAIMS
    ]
    return markdown(["claim", *DESIGN], rows)


def headlines(arms: Sequence[Arm]) -> str:
    """The headlines, one a line."""
    return "\n".join(
        f"- **({claim['key']}) {claim['title']}**: {claim['text']}. *{headline(arms, claim)}*."
        for claim in CLAIMS
    )


def evolved_levels(arms: Sequence[Arm]) -> str:
    """(b) by means between every two of the levels 0, 1 and 2; also by task, and with units random."""
    rows = []
    for arm in arms:
        tasks = list(dict.fromkeys(arm.champions.who["task"]))
        for task in [None, *tasks] if len(tasks) > 1 else tasks:
            some = (
                arm.champions
                if task is None
                else arm.champions.keep((arm.champions.who["task"] == task).to_numpy())
            )
            cells = []
            for pair in ((1.0, 0.0), (1.0, 2.0), (0.0, 2.0)):
                gap = lt.welch(lt.strata(some, some.at(ROBOT), pair))
                cells.append(estimate(*gap, signed=True) + ("" if inside(gap) else " ◆"))
            random = estimate(*lt.over_units(some, some.at(ROBOT), (0.0, 2.0)), signed=True)
            rows.append((arm.name, "both tasks" if task is None else titled(task), *cells, random))
    return markdown(["arm", "tasks", "1 less 0", "1 less 2", "0 less 2", "0 less 2, units random"], rows)


def inside(gap: Sequence[float]) -> bool:
    """Whether an interval excludes half a point on either side."""
    return -PLAN["bound"] < gap[1] and gap[2] < PLAN["bound"]


def jitter(arms: Sequence[Arm]) -> str:
    """(a) and (c) by each score: difference of means, 90 %, and what was found."""
    names = ["without jitter", "layout alone", FITTEST]
    rows = []
    for arm, row in ((one, row) for one in arms for row in one.judged.itertuples()):
        if (row.claim, row.by) in (("a", "signed ranks"), ("c", "ranks")):
            others = {name: one for name, _, _, one in secondary(arm, row)}
            told = [
                f"{estimate(o.difference, o.low, o.high, signed=True)}, {o.found}"
                for o in (row, *map(others.get, names))
            ]
            fitness = others.get("fitness")
            rows.append((arm.name, f"({row.claim})", row.against, *told, fitness.found if fitness else "–"))
    return markdown(["arm", "claim", "against", "as planned", *names, "fitness on the robot"], rows)


def jitter_counts(arms: Sequence[Arm]) -> str:
    """In how many of the arms that support claims (a) and (c) are found."""
    names, rows = ["without jitter", "layout alone", FITTEST, "fitness"], []
    judged = [arm for arm in arms if not arm.void]
    for key, against in product("ac", (f"{level:g}" for level in AGAINST)):
        counts = dict.fromkeys(["as planned", *names], 0)
        for arm in judged:
            row = next(r for r in arm.judged.itertuples() if (r.claim, r.against) == (key, against))
            counts["as planned"] += row.found == "for"
            for name, _, _, other in secondary(arm, row):
                if name in counts:
                    counts[name] += other.found == "for"
        cells = [
            f"{n} of {len(judged)}" if name != "fitness" or key == "c" else "–" for name, n in counts.items()
        ]
        rows.append((f"({key})", against, *cells))
    return markdown(["claim", "against", "as planned", *names], rows)


def equivalent(arms: Sequence[Arm]) -> str:
    """What was found, and whether it is below the bound by which (b) is called absent."""
    rows = []
    for arm in (arm for arm in arms if not arm.void):
        for row in arm.judged[arm.judged["found"].isin(["for", "against"])].itertuples():
            gap = (row.difference, row.low, row.high)
            size = "below half a point" if inside(gap) else "half a point or more not excluded"
            rows.append(
                (arm.name, f"({row.claim}) by {row.by}", row.against, estimate(*gap, signed=True), size)
            )
    small = sum(row[-1] == "below half a point" for row in rows)
    head = markdown(["arm", "found", "against", "difference of means, 90 %", "size"], rows)
    return f"{head}\n\n{small} of the {len(rows)} are below half a point."


def comparison_less_evolved(arms: Sequence[Arm]) -> str:
    """(a) less (b) against level 2, difference of means; 95 %, bootstrap by unit and run."""
    rows = []
    for arm in arms:
        gap = (arm.champions.score[ROBOT] - arm.champions.score[2.0]).to_numpy()
        at, evolved = arm.champions.at(ROBOT), arm.champions.who["evolved_level"].to_numpy()
        parts = [(evolved >= 0, gap, 1.0), (evolved == ROBOT, at, -1.0), (evolved == 2.0, at, 1.0)]
        whole, drawn = (
            sum(sign * (w[:, of] @ v[of] / w[:, of].sum(axis=1)) for of, v, sign in parts)
            for w in (np.ones((1, len(at))), lt.unit_weights(arm.champions))
        )
        low, high = np.quantile(drawn, [0.025, 0.975])
        rows.append((arm.name, estimate(float(whole[0]), low, high, signed=True)))
    return markdown(["arm", "(a) less (b) against 2, 95 %"], rows)


def where_peaks_lie(arms: Sequence[Arm]) -> str:
    """(e) as planned, by every other analysis, from three levels only, and with level 1 hidden."""
    rows = []
    for arm in arms:
        levels = list(arm.champions.score.columns)
        paper = lt.peak_of(arm.champions, [0.0, 1.0, 2.0]) if len(levels) > 3 else None
        hidden = lt.peak_of(arm.champions, [x for x in levels if x != ROBOT]) if len(levels) > 3 else None
        others = [
            f"{shown(arm.peaks[n])}, {arm.peaks[n].word}" if n in arm.peaks else "–"
            for n in ("without jitter", "layout alone", FITTEST, BEYOND)
        ]
        rows.append(
            (
                arm.name,
                f"{shown(arm.peak)}, {'no claim' if arm.void else arm.peak.word}",
                *others,
                *(shown(one) if one else "–" for one in (paper, hidden)),
                f"{100 * arm.peak.first:.0f} %",
            )
        )
    head = [
        "arm",
        "as planned",
        "without jitter",
        "layout alone",
        FITTEST,
        BEYOND,
        "levels 0, 1, 2 alone",
        "level 1 hidden",
        "level 1 best in",
    ]
    return markdown(head, rows)


def evolved_and_compared(arms: Sequence[Arm]) -> str:
    """In how many cells of arm, task and evolved level the mean score is higher at 1 than at 2."""
    counts = {"as planned": 0, "without jitter": 0}
    cells = 0
    for arm in (arm for arm in arms if not arm.void):
        for name in counts:
            scores = arm.again.get(name, arm.champions)
            gap = (
                (scores.score[ROBOT] - scores.score[2.0])
                .groupby([scores.who["task"], scores.who["evolved_level"]])
                .mean()
            )
            counts[name] += int((gap > 0).sum())
            cells += len(gap) * (name == "as planned")
    return (
        f"Level 1 has a better mean than level 2 in {counts['as planned']} of {cells} cells of arm, task and "
        f"evolved level as planned, and in {counts['without jitter']} without jitter."
    )


def model_error(arms: Sequence[Arm]) -> str:
    """Model error over the deviation of the noise, held out; with a real Khepera's tables below."""
    rows: list[tuple[object, ...]] = []
    for arm, (channel, own) in (
        (one, part) for one in arms for part in one.calibration.groupby("channel", sort=False)
    ):
        ratio, limit = own["ratio"], LIMITS[channel]
        far = ", ".join(map(str, own.loc[ratio > limit, "unit"])) or "none"
        rows.append(
            (
                arm.name,
                CHANNELS[channel],
                len(own),
                number(ratio.min()),
                number(ratio.median()),
                number(ratio.max()),
                f"{limit:g}",
                far,
            )
        )
    limits = {CHANNELS[channel]: limit for channel, limit in LIMITS.items()}
    for channel, form, error in REAL:
        rows.append(
            (
                f"a real Khepera (tables), {form}",
                channel,
                1,
                "–",
                number(error),
                "–",
                f"{limits[channel]:g}",
                "beyond the limit",
            )
        )
    return markdown(["arm", "channel", "units", "least", "median", "most", "limit", "units beyond"], rows)


def champions(arms: Sequence[Arm]) -> str:
    """Means by evolved level, from which the verdicts follow."""
    rows = []
    for arm in arms:
        frame = arm.champions.who.assign(
            b=arm.champions.at(ROBOT), c=arm.champions.own(), fall=arm.champions.fall()
        )
        for task, part in frame.groupby("task", sort=False):
            for level, one in part.groupby("evolved_level"):
                fall = one["fall"].mean() / part["fall"].std(ddof=0)
                failed = f"{100 * (one['b'] < PLAN['failed']).mean():.0f} %"
                rows.append(
                    (
                        arm.name,
                        titled(task),
                        f"{level:g}",
                        len(one),
                        number(one["b"].mean()),
                        number(one["c"].mean()),
                        failed,
                        number(fall, signed=True),
                    )
                )
    return markdown(
        ["arm", "task", "level", "controllers", "(b) mean", "(c) mean", "(b) failures", "(d) fall"], rows
    )


def ceiling(arms: Sequence[Arm]) -> str:
    """Share of champions whose score at level 1 is so high that their order is mostly chance."""
    told = []
    for arm in arms:
        high = (
            pd.Series(arm.champions.at(ROBOT) > CEILING)
            .groupby(arm.champions.who["task"].to_numpy(), sort=False)
            .mean()
        )
        told += [f"{arm.name}, {task.replace('-', ' ')} {100 * share:.0f} %" for task, share in high.items()]
    return (
        f"Above {CEILING} of 10 at level 1, where the order of champions is mostly chance: {'; '.join(told)}."
    )


def comparisons(arm: Arm) -> str:
    """The twelve, and (c)'s means beside them."""
    rows = []
    for row in arm.judged.itertuples():
        planned = math.isfinite(row.p_holm)
        rows.append(
            (
                f"({row.claim})",
                row.by if planned else f"{row.by}, beside",
                row.against,
                number(row.effect, signed=True),
                estimate(row.difference, row.low, row.high, signed=True),
                " ".join("−0+"[sign + 1] for sign in row.sets),
                probability(row.p),
                probability(row.p_holm) if planned else "–",
                row.found,
            )
        )
    head = ["claim", "by", "against", "effect", "difference of means, 90 %", "sets", "p", "p (Holm)", "found"]
    return markdown(head, rows)


def robustness(arm: Arm) -> str:
    """Every planned comparison, and the peak, by the other analyses."""
    names, rows = [*arm.robust, "mixed model"], []
    for row in arm.judged[arm.judged["found"] != "–"].itertuples():
        told = {
            name: ("▲ " if sign * row.statistic < 0 else "") + text
            for name, sign, text, _ in secondary(arm, row)
        }
        rows.append(
            (
                f"({row.claim}) {row.by}",
                row.against,
                f"{number(row.effect, signed=True)}, {row.found}",
                *(told.get(name, "–") for name in names),
            )
        )
    told = {name: f"{shown(peak)}, {peak.word}" for name, peak in arm.peaks.items()}
    rows.append(
        ("(e) peak", "", f"{shown(arm.peak)}, {arm.peak.word}", *(told.get(name, "–") for name in names))
    )
    return markdown(["claim", "against", "as planned", *names], rows)


def diagonal(arm: Arm) -> str:
    """What the diagonal's difference from each level is made of."""
    rows = []
    orders = {
        "evolved level": ("evolved_first", "comparison_after"),
        "comparison level": ("evolved_after", "comparison_first"),
    }
    for other, parts in lt.diagonal_parts(arm.champions).items():
        for measure, word in (("means", "difference of means"), ("delta", "Cliff's delta")):
            for first, names in orders.items():
                spans = [
                    estimate(*getattr(parts[name], measure), signed=True) for name in ("diagonal", *names)
                ]
                rows.append((f"{other:g}", first, word, *spans))
    return markdown(
        ["against level", "first", "measure", "diagonal", "evolved level", "comparison level"], rows
    )


def without_camera(arm: Arm) -> str:
    """Whether measures without a camera order champions as the camera's score does, and it as itself."""
    rows = []
    whole = table(f"noise-level-2/{arm.name}/without-camera.csv")
    names = ["seed_set", "run", "evolved_level"]
    homes = arm.champions.who.set_index(["task", *names])["home_unit"]
    for task, part in whole.groupby("task", sort=False):
        means = part.groupby(names).mean(numeric_only=True)
        home = homes[task].loc[means.index].to_numpy()
        far, near = -means["distance"].to_numpy(), means["correspondence"].to_numpy()
        draw, own = np.random.default_rng(0), [np.flatnonzero(home == unit) for unit in np.unique(home)]
        drawn = [np.concatenate([own[k] for k in draw.integers(0, len(own), len(own))]) for _ in range(1000)]
        low, high = np.quantile([lt.rho(far[some], near[some]) for some in drawn], [0.025, 0.975])
        word = "a substitute" if low > 0.8 else "no substitute" if high < 0.8 else "open"
        simulated, on_robot = means["fitness_simulated"].to_numpy(), means["fitness_situated"].to_numpy()
        draw = np.random.default_rng(0)
        picks = [draw.integers(0, len(means), len(means)) for _ in range(2000)]
        r = np.quantile([np.corrcoef(simulated[p], on_robot[p])[0, 1] for p in picks], [0.025, 0.975])
        grid = np.array([one.to_numpy() for _, one in part.groupby(names)["correspondence"] if len(one) == 4])
        rows.append(
            (
                titled(task),
                len(means),
                estimate(lt.rho(far, near), low, high, signed=True),
                number(lt.reliability(grid), signed=True),
                word,
                *(number(lt.rho(-means[name].to_numpy(), near), signed=True) for name in REPLAYED),
                estimate(float(np.corrcoef(simulated, on_robot)[0, 1]), *r, signed=True),
                *(
                    number(lt.rho(means[name].to_numpy(), on_robot), signed=True)
                    for name in ("fitness_simulated", "fitness_pseudo")
                ),
            )
        )
    head = [
        "task",
        "champions",
        "without a camera",
        "camera with itself",
        "by the plan",
        "readings",
        "commands",
        "speeds",
        "replayed commands",
        "r of fitness",
        "simulated",
        "pseudo-realities",
    ]
    return markdown(head, rows)


TITLE = """# The second study of the level of noise: tables

Made by `python studies/noise-level-2/analyse.py --write` from `studies/data.tar.xz`: change that, not this.
[The answer](README.md), [the plan](plan.md). Every robot here is simulated. "On the robot" stands for Enki's
robot in arms E and E5, and for the twin in T, T2 and S. Tables marked *exploratory* were not planned.
"""

OF_ALL = [
    (
        "Arms",
        "What was run, in the plan's order; T5 was not. The plan gives six hours of two cores to the "
        "whole: by its rule E5 falls too, with which they came to 7.9.",
        runs,
    ),
    (
        "Verdicts",
        'By arm. "No claim": the calibrated models err too much.',
        verdicts,
    ),
    (
        "Headlines",
        "Arms T and E have to agree. Behind each verdict stands every other analysis of these two arms "
        "that contradicts it: of another sign; by which what was found is not; by which half a point is "
        "not excluded (difference of means, 90 %; not asked of fitness, which has no points).",
        headlines,
    ),
    (
        "Evolved level, all pairs (exploratory but for the first two columns of all tasks)",
        "Difference of mean scores in the simulation at level 1 between champions evolved at two "
        "levels, within strata, with 90 % intervals; last, with units as a random factor (Student's "
        "interval over sixteen units). ◆: half a point is not excluded.",
        evolved_levels,
    ),
    (
        "Comparison level and diagonal, by each score",
        "Difference of means between level 1 and the other, 90 %, and what was found by the planned "
        "test. The score without jitter leaves out the descriptors of trembling.",
        jitter,
    ),
    (
        "How often they were found",
        "Arms E, T, E5 and T2, of which T2 and E5 are beside the headlines.",
        jitter_counts,
    ),
    (
        "Comparison level, by evolved level (exploratory)",
        "",
        evolved_and_compared,
    ),
    (
        "Found, but how large?",
        "What was found in the arms that support claims, and whether its 90 % interval lies within half "
        "a point on either side: the bound by which (b) is called absent.",
        equivalent,
    ),
    (
        "Comparison level less evolved level (exploratory)",
        "Difference of means of (a) against 2, less that of (b) against 2, with 95 % intervals: "
        "bootstrap over units and runs.",
        comparison_less_evolved,
    ),
    (
        "Where tracks agree best",
        "(e): the peak of the curve over comparison levels, with 95 % intervals, and the word that its "
        "rule gives (0.71 to 1.41). Exploratory: from levels 0, 1 and 2 alone; with level 1 hidden; the "
        "share of resamples in which level 1 has the best mean. Where it is best between ½ and 2, a "
        "parabola's top must lie in 0.73 to 1.46, so the rule follows nearly from (a) and from the grid "
        "of levels.",
        where_peaks_lie,
    ),
    (
        "Model error",
        "Over the deviation of the noise, over units, on places held out where readings are neither "
        "dark nor saturated. Arm E's own figure was reckoned with a fault (each fold's search began "
        "from a coarse fit that had seen all places); arm E5's, of the same sixteen units, is the "
        "honest one for both. The last three rows are not of this study: the same forms, fitted to the "
        "published tables of a real Khepera.",
        model_error,
    ),
    (
        "Champions by evolved level",
        "(b): mean score in the simulation at level 1, and the share below 6; (c): in the simulation in "
        "which each was evolved, on its calibration unit; (d): mean fall of fitness from calibration "
        "unit to foreign units, in the task's deviations.",
        champions,
    ),
    (
        "Near the end of the scale",
        "",
        ceiling,
    ),
]

OF_ARM = [
    (
        "level 1 against each other level",
        "Above zero favours 1, except in (d), where the fall shrinks below zero. Effect: the "
        "rank-biserial correlation for signed ranks, Cliff's delta for ranks, points for means, a share "
        "for failures, a correlation for slopes. Sets: the sign in each seed set.",
        comparisons,
    ),
    (
        "again by other scores and other individuals",
        "Effect, and what would have been found; they change no verdict. ▲: another sign. Fitness is "
        "that on the robot, in deviations within the task.",
        robustness,
    ),
    (
        "what the diagonal's difference is made of",
        "Calibration unit alone. A difference of means is the sum of both parts; deltas do not add up. "
        "Evolved level first: it is judged at 1, and the comparison level by controllers evolved at the "
        "other. Comparison level first: it is judged by controllers evolved at 1, and the evolved level "
        "at the other. Intervals: 95 %.",
        diagonal,
    ),
    (
        "without a camera",
        "Spearman's rho, with the camera's score over champions, of the Wasserstein distances of what "
        "the robot and the simulation at level 1 read and did (95 % over calibration units with their "
        "controllers), and of their parts. Beside it the agreement of the camera's score with itself "
        "(half of a controller's units against the other half; exploratory): where that is below .8, "
        "whether a measure could stand in for the camera cannot be told here. Then Pearson's r of "
        "fitness in simulation and on the robot (Kadian et al. 2020); rho of fitness on the robot with "
        "that in simulation and in pseudo-realities.",
        without_camera,
    ),
]


def page(arms: Sequence[Arm]) -> str:
    """All tables, as tables.md."""
    parts = [TITLE]
    for name, caption, make in OF_ALL:
        parts.append("\n\n".join(filter(None, [f"## {name}", caption, make(arms)])) + "\n")
    for arm in arms:
        parts.append(f"## Arm {arm.name}: {reality(arm)}\n")
        for name, caption, make in OF_ARM:
            parts.append(f"### Arm {arm.name}, {name}\n\n{caption}\n\n{make(arm)}\n")
    return "\n".join(parts)


def main() -> None:
    """Print the tables, or write them and the figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--write", action="store_true", help="write tables.md and the figures")
    arms = [read_arm(name) for name in RUN]
    if not parser.parse_args().write:
        print(page(arms))
        return
    from level_figures import write_figures

    (HERE / "tables.md").write_text(page(arms), encoding="utf-8")
    write_figures(arms, HERE)


if __name__ == "__main__":
    main()
