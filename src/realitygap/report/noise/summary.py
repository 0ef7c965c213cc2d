"""What a study of noise says, ready for JSON."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

from realitygap.experiments.noise.claims import Contrast, Split
from realitygap.report.noise.facts import Curve, Fall, FitnessRow, NoiseFacts, Scope, Span
from realitygap.report.noise.report import NoiseReport
from realitygap.report.noise.results import Misfit, read_results, real_misfits

__all__ = ["noise_summary"]

Facts = dict[str, object]


def noise_summary(out: str | Path) -> Facts:
    """What a finished study of noise says, ready for JSON: no NaN, None where nothing is known.

    Args:
        out: the study's folder, with `results/`.

    Raises:
        StudyError: results are missing or broken.
    """
    report = NoiseReport(read_results(Path(out) / "results"))
    facts = report.facts
    summary = {
        "paragraph": report.paragraph,
        "robot_level": facts.data.robot,
        "levels": facts.data.levels.tolist(),
        "settings": dict(report.results.settings),
        "claims": _claims(facts),
        "scopes": {scope.name: _scope(scope) for scope in facts.scopes},
        "fitness": [_fitness(row) for row in facts.fitness],
        "falls": [_fall(fall) for fall in facts.falls],
        "calibration": [_misfit(m) for m in report.results.calibration],
        "calibration_to_a_real_robot": [_misfit(m) for m in real_misfits()],
        "warnings": report.warnings,
    }
    return {key: _known(value) for key, value in summary.items()}


def _claims(facts: NoiseFacts) -> list[Facts]:
    return [
        {
            "key": f.claim.key, "title": f.claim.title, "text": f.claim.text, "test": f.claim.test,
            "measured": f.claim.measured, "verdict": f.verdict,
            "verdicts_by_task": {
                s.name: s.findings[i].verdict for s in facts.scopes if s.name in facts.data.tasks
            },
        }
        for i, f in enumerate(facts.headline.findings)
    ]  # fmt: skip


def _scope(scope: Scope) -> Facts:
    return {
        "contrasts": {f.claim.key: [_contrast(c) for c in f.contrasts] for f in scope.findings},
        "curves": {key: _curve(curve) for key, curve in scope.curves.items()},
        "noisiness": _curve(scope.noisiness),
        "diagonal_split": [_split(split) for split in scope.split],
        "home_unit_alone": [_contrast(c) for c in scope.home],
    }


def _fitness(r: FitnessRow) -> Facts:
    return {
        "task": r.task, "evolved_level": r.level, "runs": r.count,
        "simulated": _span(r.simulated), "situated": _span(r.situated),
        "drop": _span(r.drop), "delta": _span(r.delta),
        "correlation": None if r.correlation is None else r.correlation._asdict(),
    }  # fmt: skip


def _fall(fall: Fall) -> Facts:
    levels = [
        {"evolved_level": row.level, "runs": row.runs, "home": _span(row.home),
         "foreign": _span(row.foreign), "fall": _span(row.fall)}
        for row in fall.rows
    ]  # fmt: skip
    return {"task": fall.task, "rho": _span(fall.rho), "shown": fall.shown, "levels": levels}


def _contrast(c: Contrast) -> Facts:
    return {
        "level": c.level, "against": c.other, "means": c.means, "delta": c.effect.delta,
        "delta_interval": c.effect.delta_interval, "difference": c.effect.difference,
        "difference_interval": c.effect.difference_interval, "p": c.effect.p, "p_holm": c.p_holm,
        "found": c.found, "delta_by_seed_set": {str(s.seed_set): s.effect.delta for s in c.sets},
    }  # fmt: skip


def _split(split: Split) -> Facts:
    steps = {
        name: getattr(split, name)
        for name in ("diagonal", "evolved_first", "comparison_after", "comparison_first", "evolved_after")
    }
    kept = ("difference", "difference_interval", "delta", "delta_interval")
    told = {name: {key: getattr(step, key) for key in kept} for name, step in steps.items()}
    return {"against": split.other, **told}


def _misfit(misfit: Misfit) -> Facts:
    return {**misfit._asdict(), "too_far": misfit.too_far}


def _curve(curve: Curve) -> Facts:
    return {
        "means": [_span(span) for span in curve.spans],
        "means_by_seed_set": {str(number): means.tolist() for number, means in curve.sets.items()},
        "at_level": _span(curve.top),
    }


def _span(span: Span | None) -> Facts | None:
    return None if span is None else {"value": span.value, "interval": [span.low, span.high]}


def _known(value: object) -> object:
    """The same without NaN, in plain lists and dictionaries; an interval of nothing is None."""
    if isinstance(value, Mapping):
        return {str(key): _known(one) for key, one in value.items()}
    if isinstance(value, Sequence) and not isinstance(value, str):
        made = [_known(one) for one in value]
        return None if made and len(made) == 2 and all(one is None for one in made) else made
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value if value is None or isinstance(value, str | int | float | bool) else str(value)
