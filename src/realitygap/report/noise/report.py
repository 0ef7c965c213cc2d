"""The report of a study of noise: claims and verdicts, figures, tables, words, and all of it for JSON."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path

from realitygap.experiments.noise.claims import RESAMPLES, VERDICTS, Contrast, Split
from realitygap.report.noise import figures as draw
from realitygap.report.noise.asides import aside_tables
from realitygap.report.noise.facts import Curve, Fall, FitnessRow, NoiseFacts, Scope, Span, gather_facts
from realitygap.report.noise.figures import titled
from realitygap.report.noise.results import Misfit, NoiseResults, read_results, real_misfits
from realitygap.report.noise.tables import NoiseTable, noise_tables
from realitygap.report.noise.words import LIMITS, OF_A_TWIN, thoughts, warnings
from realitygap.report.page import Figures, OnProgress, Steps, Words, noise_key, report_folder, write_page
from realitygap.tasks import load_task
from realitygap.world.noise import noise_name

__all__ = ["NoiseReport", "build_noise_report", "noise_summary"]

Facts = dict[str, object]

CAPTIONS = {
    "noise-map": (
        "Mean correspondence score of {runs} controllers a cell, evolved at a level (rows) and compared with"
        " the simulation at a level (columns). Framed: the paper's diagonal; bold: the robot's level; the "
        "darker, the higher."
    ),
    "noise-claims": (
        "Correspondence score by level. (a): a dot a controller at each level of comparison; (b) and (c): a "
        "dot a run, {runs} a level and task. {dots} Stars: the paper's averages at zero, observed and double"
        " noise, five runs each, marked by eye."
    ),
    "noise-fitness": (
        "Fitness over the same starts in simulation, at the level evolved under, and on the twin (dots), and"
        " the difference; {runs} runs a level. {dots}"
    ),
    "noise-noisiness": (
        "How much noisier the twin's turning is than that of the simulation at each level, a dot a "
        "controller: above 0 the twin is noisier. {dots}"
    ),
}
"""What stands under each figure, in the order of the page."""


def build_noise_report(out: str | Path, *, on_progress: OnProgress | None = None) -> Path:
    """Write the report of a finished study of noise into its folder `report/`; return the page's path.

    Args:
        out: the study's folder, with `results/`.
        on_progress: called with parts done, parts in all, and the name of the next one.

    Raises:
        StudyError: results are missing or broken: names the file and the line.
        OSError: the report cannot be written.
    """
    results = read_results(Path(out) / "results")
    target, report = report_folder(Path(out)) / "index.html", NoiseReport(results)
    step = Steps(on_progress, len(CAPTIONS) + 1)
    step("statistics")
    tables = {name: table.csv() for name, table in report.tables.items()}
    levels = {level: _level(level) for level in report.facts.data.levels.tolist()}
    facts = {
        "report": report,
        "facts": report.facts,
        "settings": results.settings,
        "cards": {picture.name: picture for picture in report.figures},
        "key": noise_key(levels),
        "limits": LIMITS[OF_A_TWIN if "robot" in results.settings else 0 :],
        "resamples": RESAMPLES,
        "robot": Path(str(results.settings.get("robot"))).name,
        "tables": report.tables,
        "text": (results.folder / "study.toml").read_text("utf-8"),
        "titled": titled,
        "verdicts": VERDICTS,
    }
    return write_page(target, "noise.html.j2", report.figures, facts, step, tables=tables)


@dataclass(frozen=True)
class NoiseReport:
    """A study's results and, computed when first asked for, all that is told of them."""

    results: NoiseResults

    @cached_property
    def facts(self) -> NoiseFacts:
        """Verdicts, curves, fitness."""
        return gather_facts(self.results.data)

    @cached_property
    def scales(self) -> dict[str, tuple[float, str]]:
        """For each task what fitness is divided by, and the unit that remains."""
        tasks = {name: load_task(name) for name in self.results.data.tasks}
        return {name: (task.fitness_scale, task.fitness_unit) for name, task in tasks.items()}

    @cached_property
    def tables(self) -> dict[str, NoiseTable]:
        """Every table by its name."""
        planned = noise_tables(self.facts, self.results.calibration, self.scales)
        return planned | aside_tables(self.facts, self.results.settings, self.scales)

    @cached_property
    def figures(self) -> Figures:
        """Every figure, with its words."""
        return _figures(self.facts, self.scales)

    @cached_property
    def paragraph(self) -> str:
        """The result in plain words."""
        return " ".join([*self.thoughts[:-1], *self.warnings, self.thoughts[-1]])

    @cached_property
    def thoughts(self) -> list[str]:
        """The paragraph's parts, without its warnings."""
        return thoughts(self.facts, self.results.settings, self.scales, self.results.calibration)

    @property
    def warnings(self) -> list[str]:
        """Where the calibration is too far off for the level of noise to mean anything; who is missing."""
        return warnings(self.results.calibration, self.facts.data.tasks, self.results.lost)


def _figures(facts: NoiseFacts, scales: Mapping[str, tuple[float, str]]) -> Figures:
    data, figures = facts.data, Figures()
    sets = "Filled dots, left of their level: odd seed sets; hollow, right: even. " * (len(data.sets) > 1)
    dots = f"{sets}Bars: 95 % intervals, bootstrap over runs. Dotted line: the robot's level, {data.robot:g}."
    draws = {
        "noise-map": partial(draw.map_figure, data),
        "noise-claims": partial(draw.claims_figure, facts),
        "noise-fitness": partial(draw.fitness_figure, facts, scales),
        "noise-noisiness": partial(draw.noisiness_figure, facts),
    }
    for name, words in CAPTIONS.items():
        caption = words.format(runs=len(data) // (len(data.tasks) * len(data.levels)), dots=dots)
        said = _means(facts) if name == "noise-claims" else "The tables below have the figures."
        figures.add(name, draws[name], Words(f"{caption} {said}", caption))
    return figures


def _level(level: float) -> str:
    name = noise_name(level)
    return name if name == f"{level:g}" else f"{name} ({level:g})"


def _means(facts: NoiseFacts) -> str:
    """Where the curves stand, for those who cannot see them."""
    said = "; ".join(
        f"({key}) " + ", ".join(f"{m:.1f} at {lv:g}" for lv, m in zip(curve.levels, curve.means, strict=True))
        for key, curve in facts.headline.curves.items()
    )
    return f"Means of {facts.headline.name}: {said}."


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
