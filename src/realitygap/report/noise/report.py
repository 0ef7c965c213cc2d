"""The report of a study of noise: claims and verdicts, figures, tables, words, and JSON."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property, partial
from pathlib import Path
from typing import cast

import numpy as np

from realitygap.experiments.noise.claims import RESAMPLES, VERDICTS, Contrast, Split
from realitygap.report.noise import figures as draw
from realitygap.report.noise.asides import aside_tables
from realitygap.report.noise.facts import Curve, Fall, FitnessRow, NoiseFacts, Scope, Span, gather_facts
from realitygap.report.noise.figures import titled
from realitygap.report.noise.results import NoiseResults, read_results, real_misfits
from realitygap.report.noise.tables import NoiseTable, noise_tables
from realitygap.report.noise.words import TEXTS, limits, robot_words, thoughts, warnings
from realitygap.report.page import Figures, OnProgress, Steps, Words, noise_key, report_folder, write_page
from realitygap.world.noise import noise_name

__all__ = ["NoiseReport", "build_noise_report", "noise_summary"]

Facts = dict[str, object]

CAPTIONS: dict[str, str] = TEXTS["captions"]
"""Captions of the figures, in the page's order."""


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
    names = {level: noise_name(level) for level in report.facts.data.levels.tolist()}
    levels = {v: name if name == f"{v:g}" else f"{name} ({v:g})" for v, name in names.items()}
    facts = {
        "report": report,
        "facts": report.facts,
        "settings": results.settings,
        "cards": report.figures,
        "key": noise_key(levels),
        "limits": limits(results.settings),
        "resamples": RESAMPLES,
        "robot": robot_words(results.settings),
        "tables": report.tables,
        "text": (results.folder / "study.toml").read_text("utf-8"),
        "titled": titled,
        "verdicts": VERDICTS,
    }
    return write_page(target, "noise.html.j2", report.figures, facts, step, tables=tables)


@dataclass(frozen=True)
class NoiseReport:
    """A study's results and, computed when first needed, everything that the report says about them."""

    results: NoiseResults

    @property
    def own(self) -> bool:
        """Whether a user's own robot replaced the twin."""
        return "robot" in self.results.settings

    def said(self, text: str) -> str:
        """A text about the twin, or about the robot that replaced it."""
        return text.replace("he twin", "he robot") if self.own else text

    @cached_property
    def facts(self) -> NoiseFacts:
        """Verdicts, curves, fitness."""
        return gather_facts(self.results.data)

    @cached_property
    def tables(self) -> dict[str, NoiseTable]:
        """Every table by its name."""
        planned = noise_tables(self.facts, self.results.calibration)
        planned |= aside_tables(self.facts, self.results.settings)
        return {
            name: replace(table, title=self.said(table.title), head=tuple(map(self.said, table.head)))
            for name, table in planned.items()
        }

    @cached_property
    def figures(self) -> Figures:
        """Every figure, with its words."""
        data, figures = self.facts.data, Figures()
        sets = "Filled dots, left of their level: odd seed sets; hollow, right: even. "
        dots = f"{sets * (len(data.sets) > 1)}Bars: 95 % intervals, bootstrap over runs. "
        dots += f"Dotted line: the robot's level, {data.robot:g}."
        runs, who = len(data) // (len(data.tasks) * len(data.levels)), "robot" if self.own else "twin"
        draws = {
            "noise-map": partial(draw.map_figure, data),
            "noise-claims": partial(draw.claims_figure, self.facts),
            "noise-fitness": partial(draw.fitness_figure, self.facts, who),
            "noise-noisiness": partial(draw.noisiness_figure, self.facts, who),
        }
        for name, words in CAPTIONS.items():
            caption = self.said(words.format(runs=runs, dots=dots))
            said = _means(self.facts) if name == "noise-claims" else "The tables below have the figures."
            figures.add(name, draws[name], Words(f"{caption} {said}", caption))
        return figures

    @cached_property
    def paragraph(self) -> str:
        """The result in plain words."""
        return " ".join([*self.thoughts[:-1], *self.warnings, self.thoughts[-1]])

    @cached_property
    def thoughts(self) -> list[str]:
        """The paragraph's parts, without its warnings."""
        told = thoughts(self.facts, self.results.settings, self.results.calibration)
        return [self.said(thought) for thought in told]

    @property
    def warnings(self) -> list[str]:
        """Where calibration errors are too large for noise levels to be meaningful; lost controllers."""
        return warnings(self.results.calibration, self.facts.data.tasks, self.results.lost)


def _means(facts: NoiseFacts) -> str:
    """The curves' values, as a text alternative."""
    said = "; ".join(
        f"({key}) " + ", ".join(f"{m:.1f} at {lv:g}" for lv, m in zip(curve.levels, curve.means, strict=True))
        for key, curve in facts.headline.curves.items()
    )
    return f"Means of {facts.headline.name}: {said}."


def noise_summary(out: str | Path) -> Facts:
    """The findings of a finished study of noise, ready for JSON: None in place of NaN.

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
        "calibration": [{**m._asdict(), "too_far": m.too_far} for m in report.results.calibration],
        "calibration_to_a_real_robot": [{**m._asdict(), "too_far": m.too_far} for m in real_misfits()],
        "warnings": report.warnings,
    }
    return cast(Facts, _known(summary))


def _claims(facts: NoiseFacts) -> list[Facts]:
    return [
        {
            **asdict(f.claim), "verdict": f.verdict,
            "verdicts_by_task": {scope.name: scope.findings[i].verdict for scope in facts.by_task},
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
    spans = {key: getattr(r, key) for key in ("simulated", "situated", "drop", "delta")}
    pair = None if r.correlation is None else r.correlation._asdict()
    return {"task": r.task, "evolved_level": r.level, "runs": r.count, **spans, "correlation": pair}


def _fall(fall: Fall) -> Facts:
    rows = [row._asdict() for row in fall.rows]
    levels = [{"evolved_level": row.pop("level"), **row} for row in rows]
    return {"task": fall.task, "rho": fall.rho, "shown": fall.shown, "levels": levels}


def _contrast(c: Contrast) -> Facts:
    return {
        "level": c.level, "against": c.other, "means": c.means, **c.effect._asdict(), "p_holm": c.p_holm,
        "found": c.found, "delta_by_seed_set": {s: effect.delta for s, effect in c.sets.items()},
    }  # fmt: skip


def _split(split: Split) -> Facts:
    names = ("diagonal", "evolved_first", "comparison_after", "comparison_first", "evolved_after")
    kept = ("difference", "difference_interval", "delta", "delta_interval")
    steps = {name: {key: getattr(getattr(split, name), key) for key in kept} for name in names}
    return {"against": split.other, **steps}


def _curve(curve: Curve) -> Facts:
    return {"means": curve.spans, "means_by_seed_set": curve.sets, "at_level": curve.top}


def _known(value: object) -> object:
    """A copy without NaN, in plain lists and dictionaries; an empty interval is None."""
    if isinstance(value, Span):
        value = {"value": value.value, "interval": value[1:]}
    if isinstance(value, Mapping):
        return {str(key): _known(one) for key, one in value.items()}
    if isinstance(value, np.ndarray):
        value = value.tolist()
    if isinstance(value, Sequence) and not isinstance(value, str):
        made = [_known(one) for one in value]
        return None if made and len(made) == 2 and all(one is None for one in made) else made
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value if value is None or isinstance(value, str | int | float | bool) else str(value)
