"""The report of a study of noise: claims and verdicts, figures, tables, and a paragraph in plain words."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from realitygap import whole
from realitygap.report.noise.results import Misfit, NoiseResults, read_results, real_misfits
from realitygap.study.sources import refuse_links

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from realitygap.experiments.noise.claims import Contrast, Split
    from realitygap.report.noise.facts import Curve, NoiseFacts, Span
    from realitygap.report.noise.tables import NoiseTable

__all__ = ["NoiseReport", "build_noise_report", "noise_summary"]

Progress = Callable[[int, int, str], None]
FIGURES = ("noise-map", "noise-claims", "noise-fitness", "noise-noisiness")


def build_noise_report(out: str | Path, *, on_progress: Progress | None = None) -> Path:
    """Write the report of a finished study of noise into its folder `report/`; return the page's path.

    Args:
        out: the study's folder, with `results/`.
        on_progress: called with parts done, parts in all, and the name of the next one.

    Raises:
        StudyError: results are missing or broken: names the file and the line.
        OSError: the report cannot be written.
    """
    from realitygap.report.noise.page import render

    folder = Path(out) / "report"
    refuse_links(folder)
    report = NoiseReport(read_results(Path(out) / "results"))
    for name in ("figures", "tables"):
        (folder / name).mkdir(parents=True, exist_ok=True)
    tell = on_progress or (lambda done, total, name: None)
    total = len(FIGURES) + 1
    tell(0, total, "statistics")
    for name, table in report.tables.items():
        whole.write(folder / "tables" / f"{name}.csv", table.csv())
    svgs = {}
    for done, name in enumerate(FIGURES, start=1):
        tell(done, total, name)
        svgs[name] = report.save_figure(name, folder / "figures", name)
    target = folder / "index.html"
    whole.write(target, re.sub(r"\n\s*\n+", "\n", render(report, svgs)))
    tell(total, total, target.name)
    return target


def noise_summary(out: str | Path) -> dict[str, Any]:
    """What a finished study of noise says, ready for JSON: no NaN, None where nothing is known.

    Args:
        out: the study's folder, with `results/`.

    Raises:
        StudyError: results are missing or broken.
    """
    return NoiseReport(read_results(Path(out) / "results")).to_dict()


@dataclass(frozen=True)
class NoiseReport:
    """A study's results and, computed when first asked for, all that is told of them."""

    results: NoiseResults

    @cached_property
    def facts(self) -> NoiseFacts:
        """Verdicts, curves, fitness."""
        from realitygap.report.noise.facts import gather_facts

        return gather_facts(self.results.data)

    @cached_property
    def scales(self) -> dict[str, tuple[float, str]]:
        """For each task what fitness is divided by, and the unit that remains."""
        from realitygap.tasks import load_task

        tasks = {name: load_task(name) for name in self.results.data.tasks}
        return {name: (task.fitness_scale, task.fitness_unit) for name, task in tasks.items()}

    @cached_property
    def tables(self) -> dict[str, NoiseTable]:
        """Every table by its name."""
        from realitygap.report.noise.asides import aside_tables
        from realitygap.report.noise.tables import noise_tables

        planned = noise_tables(self.facts, self.results.calibration, self.scales)
        return planned | aside_tables(self.facts, self.results.settings, self.scales)

    @cached_property
    def paragraph(self) -> str:
        """The result in plain words."""
        return " ".join([*self.thoughts[:-1], *self.warnings, self.thoughts[-1]])

    @cached_property
    def thoughts(self) -> list[str]:
        """The paragraph's parts, without its warnings."""
        from realitygap.report.noise.words import thoughts

        return thoughts(self.facts, self.results.settings, self.scales, self.results.calibration)

    @property
    def warnings(self) -> list[str]:
        """Where the calibration is too far off for the level of noise to mean anything; who is missing."""
        from realitygap.report.noise.words import warnings

        return warnings(self.results.calibration, self.facts.data.tasks, self.results.lost)

    def save_figure(self, which: str, folder: Path, name: str, *, dpi: int = 200) -> str:
        """Write one of FIGURES as NAME.png and NAME.svg; its SVG."""
        from realitygap.report.noise import figures as draw
        from realitygap.report.style import save_figure, styled

        makers: dict[str, Callable[[], Figure]] = {
            "noise-map": lambda: draw.map_figure(self.facts.data),
            "noise-claims": lambda: draw.claims_figure(self.facts),
            "noise-fitness": lambda: draw.fitness_figure(self.facts, self.scales),
            "noise-noisiness": lambda: draw.noisiness_figure(self.facts),
        }
        with styled():
            return save_figure(makers[which](), folder, name, dpi=dpi)

    def to_dict(self) -> dict[str, Any]:
        """Ready for JSON."""
        facts = self.facts
        levels = facts.data.levels.tolist()
        summary = {
            "paragraph": self.paragraph,
            "robot_level": facts.data.robot,
            "levels": levels,
            "settings": dict(self.results.settings),
            "claims": [
                {
                    "key": f.claim.key, "title": f.claim.title, "text": f.claim.text, "test": f.claim.test,
                    "measured": f.claim.measured, "verdict": f.verdict,
                    "verdicts_by_task": {
                        s.name: s.findings[i].verdict for s in facts.scopes if s.name in facts.data.tasks
                    },
                }
                for i, f in enumerate(facts.headline.findings)
            ],
            "scopes": {
                scope.name: {
                    "contrasts": {
                        f.claim.key: [_contrast(c) for c in f.contrasts] for f in scope.findings
                    },
                    "curves": {key: _curve(curve) for key, curve in scope.curves.items()},
                    "noisiness": _curve(scope.noisiness),
                    "diagonal_split": [_split(split) for split in scope.split],
                    "home_unit_alone": [_contrast(c) for c in scope.home],
                }
                for scope in facts.scopes
            },
            "fitness": [
                {
                    "task": r.task, "evolved_level": r.level, "runs": r.count,
                    "simulated": _span(r.simulated), "situated": _span(r.situated),
                    "drop": _span(r.drop), "delta": _span(r.delta),
                    "correlation": None if r.correlation is None else r.correlation._asdict(),
                }
                for r in facts.fitness
            ],
            "falls": [
                {
                    "task": fall.task, "rho": _span(fall.rho), "shown": fall.shown,
                    "levels": [
                        {"evolved_level": row.level, "runs": row.runs, "home": _span(row.home),
                         "foreign": _span(row.foreign), "fall": _span(row.fall)}
                        for row in fall.rows
                    ],
                }
                for fall in facts.falls
            ],
            "calibration": [_misfit(m) for m in self.results.calibration],
            "calibration_to_a_real_robot": [_misfit(m) for m in real_misfits()],
            "warnings": self.warnings,
        }  # fmt: skip
        known: dict[str, Any] = _known(summary)
        return known


def _contrast(c: Contrast) -> dict[str, Any]:
    return {
        "level": c.level, "against": c.other, "means": c.means, "delta": c.effect.delta,
        "delta_interval": c.effect.delta_interval, "difference": c.effect.difference,
        "difference_interval": c.effect.difference_interval, "p": c.effect.p, "p_holm": c.p_holm,
        "found": c.found, "delta_by_seed_set": {str(s.seed_set): s.effect.delta for s in c.sets},
    }  # fmt: skip


def _split(split: Split) -> dict[str, Any]:
    steps = {
        name: getattr(split, name)
        for name in ("diagonal", "evolved_first", "comparison_after", "comparison_first", "evolved_after")
    }
    kept = ("difference", "difference_interval", "delta", "delta_interval")
    told = {name: {key: getattr(step, key) for key in kept} for name, step in steps.items()}
    return {"against": split.other, **told}


def _misfit(misfit: Misfit) -> dict[str, Any]:
    return {**misfit._asdict(), "too_far": misfit.too_far}


def _curve(curve: Curve) -> dict[str, Any]:
    return {
        "means": [_span(span) for span in curve.spans],
        "means_by_seed_set": {str(number): means.tolist() for number, means in curve.sets.items()},
        "at_level": _span(curve.top),
    }


def _span(span: Span | None) -> dict[str, Any] | None:
    return None if span is None else {"value": span.value, "interval": [span.low, span.high]}


def _known(value: Any) -> Any:
    """The same without NaN, in plain lists and dictionaries; an interval of nothing is None."""
    if isinstance(value, Mapping):
        return {str(key): _known(one) for key, one in value.items()}
    if isinstance(value, Sequence) and not isinstance(value, str):
        made = [_known(one) for one in value]
        return None if made and len(made) == 2 and all(one is None for one in made) else made
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value if value is None or isinstance(value, str | int | float | bool) else str(value)
