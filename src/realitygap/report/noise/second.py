"""The second study's results: verdicts on its claims in each arm, tables, two figures, a page, and JSON."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from realitygap.errors import StudyError
from realitygap.experiments.noise.second.arms import arm_names
from realitygap.experiments.noise.second.verdicts import (
    CLAIMS,
    PLAN,
    Comparison,
    Judgement,
    StatedClaim,
    Verdict,
)
from realitygap.report.noise.arms import BEYOND, Arm, arm_folder, read_arm
from realitygap.report.noise.asides import calibration_table, split_table
from realitygap.report.noise.facts import Span
from realitygap.report.noise.figures import titled
from realitygap.report.noise.orders import order_tables
from realitygap.report.noise.second_figures import CAPTIONS, peaks_figure, splits_figure
from realitygap.report.noise.tables import NoiseTable, Number, Row, probability
from realitygap.report.page import Figures, OnProgress, Steps, Words, report_folder, write_page

__all__ = [
    "ARMS", "answer_figures", "answer_summary", "answer_tables", "build_answer", "estimate", "headline",
    "read_arms", "strays", "warned", "word_of",
]  # fmt: skip

ARMS = arm_names()
"""All arms of the plan, in order."""


def read_arms(folders: Sequence[str | Path]) -> list[Arm]:
    """Arms of the second study, in the plan's order.

    Raises:
        StudyError: a folder is not an arm, two are the same arm, or tables are broken.
    """
    arms = {}
    for folder in folders:
        tables = arm_folder(folder)
        if tables is None:
            raise StudyError(f"{folder}: expected an arm of the second study of noise: a folder whose "
                             "study.toml names an arm. Give each arm's folder or its `results`.")  # fmt: skip
        arm = read_arm(tables)
        if arm.name not in ARMS or arm.name in arms:
            raise StudyError(f"{tables / 'study.toml'}: arm: expected one of {', '.join(ARMS)}, each once, "
                             f"got {arm.name!r}. Leave this folder out.")  # fmt: skip
        arms[arm.name] = arm
    return [arms[name] for name in ARMS if name in arms]


def word_of(arm: Arm, claim: StatedClaim) -> str:
    """The verdict on a claim in an arm; none if the model errs too much."""
    return "no claim" if arm.void else _verdict(arm, claim).word


def headline(arms: Sequence[Arm], claim: StatedClaim) -> str:
    """The joint verdict of the arms that a headline needs, and where another analysis differs in sign."""
    there = {arm.name: word_of(arm, claim) for arm in arms if arm.name in PLAN.agree}
    if missing := [name for name in PLAN.agree if name not in there]:
        text = f"no headline: {' and '.join(missing)} not run"
    elif len(set(there.values())) == 1:
        text = next(iter(there.values()))
    else:
        text = f"they differ: {', '.join(f'{name} {word}' for name, word in there.items())}"
    apart = [f"{arm.name} {stray}" for arm in arms if arm.name in there for stray in strays(arm, claim)]
    turned = "otherwise" if claim.key == "e" else "of another sign"
    return f"{text}; {turned}: {', '.join(apart)}" if apart else text


def strays(arm: Arm, claim: StatedClaim) -> list[str]:
    """Secondary analyses whose sign differs from that of the planned one."""
    if claim.key == "e" and word_of(arm, claim) != "reversed":
        told = {name: estimate(judged) for name, judged in arm.robust.items() if name != "fitness"}
        return [f"{name} (reversed)" for name, word in told.items() if word.endswith("reversed")]
    made = []
    for one in _verdict(arm, claim).comparisons:
        if one.found in ("for", "against"):
            means = {"means": one.difference[0]} if one.by.endswith("ranks") else {}
            signs = {**means, **{name: sign for name, (_, sign) in _again(arm, one).items()}}
            word, own = "over" if claim.key == "d" else "against", one.tested.statistic
            made += [f"{k} {word} {one.against}" for k, sign in signs.items() if sign * own < 0]
    return made


def _verdict(arm: Arm, claim: StatedClaim) -> Verdict:
    return next(v for v in arm.judged.verdicts if v.claim == claim)


def _again(arm: Arm, one: Comparison) -> dict[str, tuple[str, float]]:
    """The same comparison by each secondary analysis that has it: as text, and its sign."""
    told = {}
    for name, judgement in arm.robust.items():
        other = next(c for v in judgement.verdicts for c in v.comparisons
                     if (c.key, c.by, c.against) == (one.key, one.by, one.against))  # fmt: skip
        if math.isfinite(other.tested.effect) and _asked(name, one):
            told[name] = f"{_effect(other)}, {other.found}", float(np.sign(other.tested.statistic))
    fit = arm.mixed.get((one.key, one.against)) if one.by in ("means", "slopes") else None
    if fit is not None:
        shown = Number(span=Span(fit.effect), signed=True)
        told["mixed model"] = f"{shown}, p {probability(fit.p)}", float(np.sign(fit.statistic))
    return told


def _asked(name: str, one: Comparison) -> bool:
    """Whether a secondary analysis applies to a comparison: fitness to (b) and (c), scores not to (d)."""
    if name == "fitness":
        return one.key in "bc" and one.by != "failures"
    return one.key != "d" or name == BEYOND


def estimate(made: Judgement) -> str:
    """The level at which tracks agree best, with its interval, and the verdict on (e)."""
    top, word = made.peak, next(v.word for v in made.verdicts if v.claim.key == "e")
    return f"{Number(span=Span(top.value, top.low, top.high))}, {word}"


def _effect(one: Comparison) -> Number:
    return Number(span=Span(one.tested.effect), signed=True)


def answer_tables(arms: Sequence[Arm]) -> dict[str, NoiseTable]:
    """All tables by name, verdicts first."""
    every = [_verdicts(arms), _levels(arms), calibration_table({arm.name: arm.calibration for arm in arms})]
    for arm in arms:
        split = split_table(f"{arm.name}-split", f"arm {arm.name}, calibration unit", arm.split, 1.0)
        every += [_comparisons(arm), _robust(arm), split, *order_tables(arm.name, arm.orders)]
    return {table.name: table for table in every}


def _verdicts(arms: Sequence[Arm]) -> NoiseTable:
    there = {arm.name: arm for arm in arms}
    rows: list[Row] = []
    for claim in CLAIMS:
        words = [word_of(there[name], claim) if name in there else "not run" for name in ARMS]
        rows.append((f"({claim.key}) {claim.title}", *words))
    return NoiseTable(
        name="verdicts",
        title='The verdicts, by arm. "No claim": the calibrated model errs too much.',
        head=("claim", *ARMS), rows=tuple(rows),
    )  # fmt: skip


def _comparisons(arm: Arm) -> NoiseTable:
    """The twelve, (c)'s means beside them, and the peak."""
    judged, rows = arm.judged, list[Row]()
    planned = [c for v in judged.verdicts for c in v.comparisons]
    for one in (*planned, *judged.beside):
        corrected = math.isfinite(one.p_holm)
        rows.append((
            f"({one.key})", one.by if corrected else f"{one.by}, beside", one.against, _effect(one),
            Number(span=Span(*one.difference), signed=True),
            " ".join("−0+"[sign + 1] for sign in one.sets), probability(one.tested.p),
            probability(one.p_holm) if corrected else "–", one.found if corrected else "–",
        ))  # fmt: skip
    return NoiseTable(
        name=f"{arm.name}-comparisons",
        title=f"Arm {arm.name}: level 1 against each other level, {len(arm.data)} controllers; above zero "
        "favours 1, except in (d), where the fall shrinks below zero. Effect: the rank-biserial "
        "correlation for signed ranks, Cliff's delta for ranks, points for means, a share for failures, a "
        "correlation for slopes. Sets: the sign in each seed set.",
        head=("claim", "by", "against", "effect", "difference of means, 90 %", "sets", "p", "p (Holm)",
              "found"),
        rows=tuple(rows),
    )  # fmt: skip


def _robust(arm: Arm) -> NoiseTable:
    """Every comparison by secondary analyses; and the peak."""
    names, rows = [*arm.robust, "mixed model"], list[Row]()
    for one in (c for v in arm.judged.verdicts for c in v.comparisons):
        again = _again(arm, one)
        cells = [again.get(name, ("–", 0.0)) for name in names]
        marked = [("▲ " if sign * one.tested.statistic < 0 else "") + text for text, sign in cells]
        rows.append((f"({one.key}) {one.by}", one.against, f"{_effect(one)}, {one.found}", *marked))
    told = {name: estimate(made) for name, made in arm.robust.items() if name != "fitness"}
    rows.append(("(e) peak", "", estimate(arm.judged), *(told.get(name, "–") for name in names)))
    return NoiseTable(
        name=f"{arm.name}-robust",
        title=f"Arm {arm.name}, again by other scores and other individuals: effect, and what would have "
        "been found. They change no verdict. ▲: another sign. Fitness is in deviations within the task.",
        head=("claim", "against", "as planned", *names), rows=tuple(rows),
    )  # fmt: skip


def _levels(arms: Sequence[Arm]) -> NoiseTable:
    """Means by evolved level, from which the verdicts follow."""
    rows: list[Row] = []
    for arm in arms:
        data = arm.data
        for task in data.tasks:
            part = data.part(task=task)
            for level in sorted(set(part.evolved.tolist())):
                one = part.only(part.evolved == level)
                score, fall = one.at(PLAN.robot), one.situated_home - one.situated_foreign
                scale = max(float(np.nanstd(part.situated_home - part.situated_foreign)), 1e-300)
                figures = (score.mean(), np.mean(one.own(home=True)))
                rows.append((
                    arm.name, titled(task), f"{level:g}", len(one),
                    *(Number(span=Span(float(value))) for value in figures),
                    f"{100 * np.mean(score < PLAN.failed):.0f} %",
                    Number(span=Span(float(np.nanmean(fall)) / scale), signed=True),
                ))  # fmt: skip
    return NoiseTable(
        name="levels",
        title="Champions by evolved level. (b): mean score in the simulation at level 1, and the share below "
        f"{PLAN.failed:g}; (c): in the simulation in which each was evolved; (d): mean fall of fitness from "
        "calibration unit to foreign units, in the task's deviations.",
        head=("arm", "task", "level", "controllers", "(b) mean", "(c) mean", "(b) failures", "(d) fall"),
        rows=tuple(rows),
    )  # fmt: skip


def answer_figures(arms: Sequence[Arm]) -> Figures:
    figures = Figures()
    for name, draw in (("peaks", peaks_figure), ("splits", splits_figure)):
        words = Words(f"{CAPTIONS[name]} The tables have the figures.", CAPTIONS[name])
        figures.add(name, partial(draw, list(arms)), words)
    return figures


def build_answer(arms: Sequence[Arm], out: str | Path, *, on_progress: OnProgress | None = None) -> Path:
    """Write the page of some arms together into `out/report/`; return its path.

    Args:
        arms: that were run.
        out: a folder.
        on_progress: called with parts done, parts in all, and the name of the next one.

    Raises:
        OSError: the page cannot be written.
    """
    target, step = report_folder(Path(out)) / "index.html", Steps(on_progress, 4)
    step("statistics")
    tables, figures = answer_tables(arms), answer_figures(arms)
    facts = {
        "arms": arms, "tables": tables, "cards": figures, "warnings": list(warned(arms)),
        "claims": [(claim, headline(arms, claim)) for claim in CLAIMS],
        "texts": {arm.name: (arm.folder / "study.toml").read_text("utf-8") for arm in arms},
    }  # fmt: skip
    csv = {name: table.csv() for name, table in tables.items()}
    return write_page(target, "noise_answer.html.j2", figures, facts, step, tables=csv)


def warned(arms: Sequence[Arm]) -> Iterator[str]:
    """Warnings to read before the verdicts."""
    for arm in arms:
        units = f"unit{'s' if len(arm.beyond) > 1 else ''} {', '.join(map(str, arm.beyond))}"
        if arm.void:
            yield f"Arm {arm.name} supports no claim: model error exceeds its limit in {units}."
        elif arm.beyond:
            yield f"Arm {arm.name}: model error exceeds its limit in {units}; see the claims without."
        if arm.lost:
            yield f"Arm {arm.name}: the camera lost {arm.lost} controllers, which are not judged."
    if not all(arm.mixed for arm in arms):
        yield "Mixed models are left out: statsmodels is not installed (pip install 'realitygap[mixed]')."


def answer_summary(arms: Sequence[Arm]) -> dict[str, Any]:
    """Verdicts, comparisons and peaks, ready for JSON: None where unknown."""
    return {
        "arms": {arm.name: _summary(arm) for arm in arms},
        "not_yet_run": [name for name in ARMS if name not in {arm.name for arm in arms}],
        "headlines": {f"{c.key} by {c.by}": headline(arms, c) for c in CLAIMS},
        "warnings": list(warned(arms)),
    }


def _summary(arm: Arm) -> dict[str, object]:
    top = arm.judged.peak
    return {
        "folder": str(arm.folder), "commit": arm.settings.get("versions", {}).get("commit"),
        "controllers": len(arm.data),
        "units_beyond_the_limit": arm.beyond, "supports_claims": not arm.void,
        "peak": {"level": top.value, "interval": [top.low, top.high]},
        "verdicts": [
            {"claim": v.claim.key, "by": v.claim.by, "verdict": word_of(arm, v.claim),
             "other_sign": strays(arm, v.claim), "comparisons": [_compared(c) for c in v.comparisons]}
            for v in arm.judged.verdicts
        ],
        "without_camera": [asdict(order) for order in arm.orders],
    }  # fmt: skip


def _compared(c: Comparison) -> dict[str, object]:
    figures = {"effect": c.tested.effect, "p": c.tested.p, "p_holm": c.p_holm, "difference": c.difference[0],
               "difference_from": c.difference[1], "difference_to": c.difference[2]}  # fmt: skip
    known = {key: value if math.isfinite(value) else None for key, value in figures.items()}
    return {"against": c.against, **known, "signs_by_seed_set": list(c.sets), "found": c.found}
