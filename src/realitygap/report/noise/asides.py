"""Unplanned analyses, in tables and words: the calibration unit alone, both ends of the scores, falls."""

from collections.abc import Mapping, Sequence

import numpy as np

from realitygap.experiments.noise.claims import Contrast, Split
from realitygap.report.noise.facts import FAILED, SATURATED, Fall, NoiseFacts, Scope, Span, effect_spans
from realitygap.report.noise.figures import titled
from realitygap.report.noise.results import Misfit, real_misfits
from realitygap.report.noise.tables import NoiseTable, Number, Row, contrast_table, in_unit

__all__ = [
    "CHANNELS", "aside_tables", "calibration_table", "effect_words", "ends_words", "falls_words",
    "home_words", "nearness_words", "shown", "split_words",
]  # fmt: skip

CHANNELS = {"infrared": "proximity", "ambient": "light"}


def aside_tables(facts: NoiseFacts, settings: Mapping[str, object]) -> dict[str, NoiseTable]:
    """All tables by name; those of the calibration unit only if its scores were kept."""
    every = [split_table(f"{s.file}-split", s.name, s.split, facts.data.robot) for s in facts.scopes]
    every += [home_table(scope, settings) for scope in facts.scopes if scope.home]
    every += [ends_table(facts), falls_table(facts)]
    return {table.name: table for table in every}


def split_table(name: str, of: str, splits: Sequence[Split], robot: float) -> NoiseTable:
    """The diagonal's difference from each level, as steps of evolved and comparison level in both orders."""
    rows: list[Row] = []
    for split in splits:
        orders = {
            "evolved level": (split.evolved_first, split.comparison_after),
            "comparison level": (split.evolved_after, split.comparison_first),
        }
        for which, word in ((1, "difference of means"), (0, "Cliff's delta")):
            for first, parts in orders.items():
                spans = (effect_spans(effect)[which] for effect in (split.diagonal, *parts))
                shown = [Number(span=span, signed=True) for span in spans]
                rows.append((f"{split.other:g}", first, word, *shown))
    return NoiseTable(
        name=name,
        title=f"What the diagonal's difference between {robot:g} and each other level is made of, {of}. "
        "A difference of means is the sum of both parts; deltas do not add up. Evolved level first: it is "
        f"judged at {robot:g}, and the comparison level by controllers evolved at the other. Comparison "
        f"level first: it is judged by controllers evolved at {robot:g}, and the evolved level at the other.",
        head=("against level", "first", "measure", "diagonal", "evolved level", "comparison level"),
        rows=tuple(rows),
    )


def home_table(scope: Scope, settings: Mapping[str, object]) -> NoiseTable:
    """Claim (c) against the same simulation that a controller evolved in."""
    first, starts = scope.home[0], settings.get("starts", "a unit's")
    title = (
        f"(c), calibration unit alone, {scope.name}: each controller on the unit for which it was evolved, "
        f"against the simulation in which it was evolved. {first.first} controllers evolved at "
        f"{first.level:g}, {', '.join(f'{c.second} at {c.other:g}' for c in scope.home)}. "
        f"Not planned: Holm's correction is over these comparisons alone. The scale is that for {starts} "
        "pairs of trials, whose floor is wider."
    )
    return contrast_table(f"{scope.file}-home", title, scope.home)


def ends_table(facts: NoiseFacts) -> NoiseTable:
    """Both ends of the scores behind claim (b): misses, and scores whose ranks are chance."""
    data, rows = facts.data, list[Row]()
    for scope in facts.scopes:
        part = data if scope.name not in data.tasks else data.part(task=scope.name)
        for level in data.levels.tolist():
            scores = part.at(part.robot)[part.evolved == level]
            middle = Number(span=Span(float(np.median(scores))))
            low, high = int((scores < FAILED).sum()), int((scores >= SATURATED).sum())
            mean = Number(span=Span(float(scores.mean())))
            rows.append((scope.name, f"{level:g}", len(scores), mean, middle, low, high))
    return NoiseTable(
        name="ends",
        title=f"Scores against the simulation at {data.robot:g}, as in (b), by evolved level. From "
        f"{SATURATED:g} on a score lies within the scale's floor, where ranks are mostly chance; the few "
        f"below {FAILED:g} decide the means. So means and ranks may disagree.",
        head=("tasks", "level", "controllers", "mean", "median", f"below {FAILED:g}",
              f"{SATURATED:g} or more"),
        rows=tuple(rows),
    )  # fmt: skip


def falls_table(facts: NoiseFacts) -> NoiseTable:
    """Fall of fitness on the twin from the calibration unit to the others, by evolved level."""
    rows: list[Row] = []
    for fall in facts.falls:
        for row in fall.rows:
            name, shown = in_unit(facts, fall.task, (row.home, row.foreign, row.fall))
            rho = Number(span=fall.rho, signed=True) if row is fall.rows[0] else ""
            rows.append((name, f"{row.level:g}", row.runs, *shown, rho))
    return NoiseTable(
        name="falls",
        title="Not planned: fitness on the twin, on the calibration unit and on the others, by evolved "
        "level. Rho: Spearman's, of evolved level and fall over the task's controllers, each fall minus "
        "the mean of those with the same calibration unit; below 0, the fall shrinks with noise.",
        head=("task", "level", "runs", "calibration unit", "other units", "fall", "rho over all levels"),
        rows=tuple(rows),
    )


def shown(span: Span, *, signed: bool = False) -> str:
    """A figure with its interval, as in the tables."""
    return str(Number(span=span, signed=signed))


def effect_words(contrast: Contrast) -> str:
    sign = f"delta {contrast.effect.delta:+.2f}".replace("-", "−")
    return sign if contrast.found != "open" else f"{sign}, open"


def split_words(scope: Scope, coarse: Sequence[float]) -> str:
    """The parts of the diagonal's difference, in both orders."""
    said = []
    for split in scope.split:
        if split.other in coarse:
            whole, *steps = (
                shown(effect_spans(step)[1], signed=True)
                for step in (split.diagonal, split.evolved_first, split.comparison_after,
                             split.evolved_after, split.comparison_first)
            )  # fmt: skip
            said.append(
                f"against {split.other:g}: {whole.partition(' ')[0]} = {steps[0]} by evolved level and "
                f"{steps[1]} by comparison level, or, the comparison level first, {steps[2]} and {steps[3]}"
            )
    if not said:
        return ""
    return f"The diagonal's difference of means can be split in two orders: {'; '.join(said)}."


def home_words(scope: Scope) -> str:
    """Claim (c) as it was stated: against the simulation that a controller evolved in."""
    if not scope.home:
        return ""
    robot = scope.home[0]
    means = ", ".join(f"{c.means[1]:.1f} at {c.other:g} ({effect_words(c)})" for c in scope.home)
    return (
        "On the calibration unit alone, against the very simulation that a controller was evolved in (not "
        f"planned; the scale is wider): {robot.means[0]:.1f} at {robot.level:g}, {means}."
    )


def ends_words(facts: NoiseFacts) -> str:
    """Why means and ranks may disagree."""
    scores = facts.data.at(facts.data.robot)
    high, low = (100 * float(share.mean()) for share in (scores >= SATURATED, scores < FAILED))
    return (
        f"Means and ranks may disagree: of the scores in (b) {high:.0f} % are {SATURATED:g} or more, where "
        f"ranks are mostly chance, and {low:.0f} % are below {FAILED:g}, which decide the means."
    )


def falls_words(falls: Sequence[Fall]) -> str:
    """Fall of fitness from the calibration unit to the others; not planned."""
    said = []
    for fall in falls:
        rho, task = f"rho {shown(fall.rho, signed=True)}", titled(fall.task).lower()
        way = "shrinks" if fall.rho.value < 0 else "grows"
        said.append(
            f"in {task} the fall {way} with evolved noise, {rho}" if fall.shown
            else f"in {task} no change of the fall with evolved noise is shown, {rho}"
        )  # fmt: skip
    if not said:
        return ""
    return (
        f"Not planned: fitness on the twin falls from the calibration unit to the others; {'; '.join(said)}."
    )


def nearness_words(calibration: Sequence[Misfit]) -> str:
    """Accuracy of the simulations for the twin, compared with that for a robot."""
    said, judged = [], all(m.judged for m in calibration)
    for real in real_misfits(judged=judged):
        ratios = sorted(m.ratio for m in calibration if m.channel == real.channel)
        if ratios:
            low, high = f"{ratios[0]:.2f}", f"{ratios[-1]:.2f}"
            ours = low if low == high else f"{low} to {high}"
            said.append(f"in {CHANNELS[real.channel]} {ours} (a real robot's tables: {real.ratio:.2f})")
    if not said:
        return ""
    where = "" if judged else ", over all readings,"
    return f"Model error over noise{where} is {', '.join(said)}: the twin is easier to model than a robot."


def calibration_table(arms: Mapping[str, Sequence[Misfit]]) -> NoiseTable:
    """Model error over noise, by arm and channel."""
    rows: list[Row] = []
    for name, misfits in arms.items():
        for channel in dict.fromkeys(m.channel for m in misfits):
            own = [m for m in misfits if m.channel == channel]
            ratios, far = sorted(m.ratio for m in own), [str(m.unit) for m in own if m.too_far]
            rows.append((name, CHANNELS.get(channel, channel), len(own), f"{ratios[0]:.2f}",
                         f"{np.median(ratios):.2f}", f"{ratios[-1]:.2f}", f"{own[0].limit:g}",
                         ", ".join(far) or "none"))  # fmt: skip
    return NoiseTable(
        name="calibration",
        title="Model error over noise deviation, over units, on places held out where readings are neither "
        "dark nor saturated.",
        head=("arm", "channel", "units", "least", "median", "most", "limit", "units beyond"),
        rows=tuple(rows),
    )
