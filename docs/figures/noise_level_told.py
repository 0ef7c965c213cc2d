"""What docs/noise-level/page.md.j2 asks of the kept studies: every figure that is printed comes from here."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from realitygap.experiments.noise.claims import Contrast, Finding, Split, judge_claims
from realitygap.experiments.noise.contrasts import unpaired
from realitygap.experiments.noise.crossed import Crossed
from realitygap.report.noise.facts import BOTH, FAILED, PAPER, SATURATED, Scope, Span, effect_spans
from realitygap.report.noise.report import NoiseReport
from realitygap.report.noise.results import read_results
from realitygap.report.noise.tables import Number

AVOIDANCE, LIGHT = "obstacle-avoidance", "light-seeking"
NONE = "none of these"


class Told:
    """One kept study: its figures as they are printed. Levels are numbers, scopes a task or both."""

    def __init__(self, folder: Path) -> None:
        self.name = folder.name
        self.report = NoiseReport(read_results(folder))
        self.settings, self.data = self.report.results.settings, self.report.results.data

    @cached_property
    def scopes(self) -> dict[str, Scope]:
        """By name."""
        return {scope.name: scope for scope in self.report.facts.scopes}

    def finding(self, key: str, scope: str = BOTH) -> Finding:
        """On a claim."""
        return next(f for f in self.scopes[scope].findings if f.claim.key == key)

    def contrast(self, key: str, level: float, scope: str = BOTH) -> Contrast:
        """Of a claim, or of (c) on the calibration unit alone ("home"), against a level."""
        home = key == "home"
        contrasts = self.scopes[scope].home if home else self.finding(key, scope).contrasts
        return next(c for c in contrasts if c.other == level)

    def verdict(self, key: str, scope: str = BOTH) -> str:
        """On a claim."""
        return self.finding(key, scope).verdict

    def mean(self, key: str, level: float, scope: str = BOTH) -> str:
        """Of a claim's curve."""
        curve = self.scopes[scope].curves[key]
        return f"{curve.means[self.data.index(level)]:.1f}"

    def means(self, key: str, levels: Sequence[float], scope: str = BOTH) -> list[str]:
        """Several of them."""
        return [self.mean(key, level, scope) for level in levels]

    def peak(self, key: str, scope: str = BOTH) -> str:
        """Where the curve peaks."""
        return str(Number(span=self.scopes[scope].curves[key].top))

    def crossing(self, scope: str = BOTH) -> str:
        """Where noisiness passes zero."""
        return str(Number(span=self.scopes[scope].noisiness.top))

    def gap(self, key: str, level: float, scope: str = BOTH) -> str:
        """Difference of means, with its interval."""
        return str(Number(span=effect_spans(self.contrast(key, level, scope).effect)[1], signed=True))

    def delta(self, key: str, level: float, scope: str = BOTH) -> str:
        """Cliff's delta, with its interval."""
        return str(Number(span=effect_spans(self.contrast(key, level, scope).effect)[0], signed=True))

    def widest(self, key: str) -> str:
        """The largest difference of means that the intervals of open comparisons hold."""
        opened = [c.effect.difference_interval for c in self.finding(key).contrasts if c.found == "open"]
        return f"{max(abs(end) for ends in opened if ends for end in ends):.1f}"

    def split(self, level: float, scope: str = BOTH) -> dict[str, str]:
        """The parts of the diagonal's difference of means, each with its interval."""
        one = next(s for s in self.scopes[scope].split if s.other == level)
        names = [f.name for f in fields(Split) if f.name != "other"]
        return {name: str(Number(span=effect_spans(getattr(one, name))[1], signed=True)) for name in names}

    def failed(self, level: float | None, scope: str = BOTH) -> int:
        """How many of those evolved at a level, or at any, score below 6 in (b)."""
        data = self._evolved(level, scope)
        return int((data.at(data.robot) < FAILED).sum())

    def saturated(self) -> str:
        """Share of the scores in (b) within the scale's floor."""
        scores = self.data.at(self.data.robot)
        return f"{100 * float((scores >= SATURATED).mean()):.0f} %"

    @property
    def has_home(self) -> bool:
        """Whether scores of the home unit alone are known."""
        return bool(self.scopes[BOTH].home)

    def unnamed(self, task: str) -> str:
        """Share of a task's controllers whose behaviour has none of the paper's names."""
        names = self.data.part(task=task).name
        return f"{100 * float((names == NONE).mean()):.0f} %"

    def controllers(self, level: float | None, scope: str = BOTH) -> int:
        """Evolved at a level, or at any."""
        return len(self._evolved(level, scope))

    def _evolved(self, level: float | None, scope: str) -> Crossed:
        data = self.data if scope == BOTH else self.data.part(task=scope)
        return data if level is None else data.only(data.evolved == level)

    def situated(self, task: str, level: float) -> str:
        """Mean fitness on the twin."""
        row = next(r for r in self.report.facts.fitness if r.task == task and r.level == level)
        return f"{row.situated.value / self.report.facts.scales[task][0]:.2f}"

    def fitness_range(self, task: str) -> str:
        """Cliff's deltas of fitness on the twin against the robot's level: lowest to highest."""
        deltas = [r.delta for r in self.report.facts.fitness if r.task == task and r.delta is not None]
        low, high = min(delta.value for delta in deltas), max(delta.value for delta in deltas)
        return " to ".join(str(Number(span=Span(value), signed=True)) for value in (low, high))

    def drops(self, task: str) -> str:
        """What fitness loses on the twin: least to most of all levels."""
        scale = self.report.facts.scales[task][0]
        drops = [r.drop.value / scale for r in self.report.facts.fitness if r.task == task]
        return f"{min(drops):.2f} to {max(drops):.2f}".replace("0.", ".")

    def rho(self, task: str) -> str:
        """Of evolved level and fall of fitness from home."""
        fall = next(f for f in self.report.facts.falls if f.task == task)
        return str(Number(span=fall.rho, signed=True))

    def ratios(self, channel: str, which: str = "ratio") -> list[str]:
        """Model error over noise of each unit."""
        units = (m for m in self.report.results.calibration if m.channel == channel)
        return [f"{getattr(m, which):.2f}" for m in units]

    def noise(self, channel: str) -> str:
        """Mean noise that was measured, counts."""
        return f"{np.mean([m.noise for m in self.report.results.calibration if m.channel == channel]):.0f}"

    def time(self, phase: str | None = None) -> str:
        """That a phase took, or all of them, min:s."""
        seconds = self.settings["seconds"]
        whole = round(sum(seconds.values()) if phase is None else seconds[phase])
        return f"{whole // 60}:{whole % 60:02d}"


def judged_against(told: Told, robot: float) -> dict[str, str]:
    """Verdicts as they would be, were another level the robot's."""
    data = replace(told.data, robot=robot)
    return {f.claim.key: f.verdict for f in judge_claims(data, resamples=0)}


def together(first: Crossed, second: Crossed) -> Crossed:
    """Two makings of one study as one: their seed sets and calibrations stay apart."""
    apart = replace(
        second, seed_set=second.seed_set + max(first.sets), home=second.home + int(first.home.max())
    )
    names = [f.name for f in fields(Crossed) if f.name not in ("levels", "robot")]
    return replace(first, **{n: np.concatenate([getattr(first, n), getattr(apart, n)]) for n in names})


class Makings:
    """The default study's light seeking, made twice: each making, and both together."""

    def __init__(self, first: Told, second: Told) -> None:
        one, two = (told.data.part(task=LIGHT) for told in (first, second))
        self.units = sorted(set(one.home.tolist()))
        self.parts = {"first making": one, "second making": two, "both together": together(one, two)}
        self.findings = {name: judge_claims(data) for name, data in self.parts.items()}

    def verdict(self, name: str, key: str) -> str:
        """On a claim, of one making or both together."""
        return self._finding(name, key).verdict

    def table(self) -> str:
        """Claims (b) and (c), against each level, of each making, both, and each calibration."""
        alone = self._calibrations()
        head = ["claim", "against level", "measure", *self.parts, *alone]
        lines = ["| " + " | ".join(head) + " |", "|---" * len(head) + "|"]
        for key in "bc":
            for i, contrast in enumerate(self._finding("both together", key).contrasts):
                for which, word in ((1, "difference of means"), (0, "Cliff's delta")):
                    made = [self._finding(name, key).contrasts[i] for name in self.parts]
                    cells = [
                        f"{Number(span=effect_spans(c.effect)[which], signed=True)}, {c.found}" for c in made
                    ]
                    cells += [self._alone(data, key, contrast.other, which) for data in alone.values()]
                    lines.append("| " + " | ".join([f"({key})", f"{contrast.other:g}", word, *cells]) + " |")
        return "\n".join(lines)

    def spread(self, key: str, level: float) -> tuple[str, str]:
        """The smallest and largest difference of means among the calibrations."""
        data = self.parts["both together"]
        found = [self._gap(data.only(data.home == h), key, level)[1] for h in sorted(set(data.home.tolist()))]
        low, high = (str(Number(span=Span(value), signed=True)) for value in (min(found), max(found)))
        return low, high

    def _finding(self, name: str, key: str) -> Finding:
        return next(f for f in self.findings[name] if f.claim.key == key)

    def _calibrations(self) -> dict[str, Crossed]:
        names = ("first making", "second making")
        return {
            f"{'1st' if name == names[0] else '2nd'}, unit {unit}": data.only(data.home == unit)
            for name in names for data in [self.parts[name]] for unit in self.units
        }  # fmt: skip

    def _alone(self, data: Crossed, key: str, level: float, which: int) -> str:
        return str(Number(span=Span(self._gap(data, key, level)[which]), signed=True))

    def _gap(self, data: Crossed, key: str, level: float) -> tuple[float, float]:
        """Cliff's delta and difference of means."""
        values = data.at(data.robot) if key == "b" else data.own()
        effect = unpaired(values[data.evolved == data.robot], values[data.evolved == level])
        return effect.delta, effect.difference


def overview(studies: Sequence[Told]) -> str:
    """All studies in one table: verdicts and peaks. Does the peak stay at the noise that was measured?"""
    head = ["study", "twin's noise scale", "evaluations", "(a)", "(b)", "(c)", "peak (a)", "peak (c)",
            "noisiness passes zero"]  # fmt: skip
    lines = ["| " + " | ".join(head) + " |", "|---" * len(head) + "|"]
    for told in studies:
        facts = [f"{told.settings['twin_noise']:g}", str(told.settings.get("evaluations", "–"))]
        verdicts = [finding.verdict for finding in told.report.facts.headline.findings]
        row = told.report.tables["peaks"].texts()[0]
        lines.append("| " + " | ".join([told.name, *facts, *verdicts, row[1], row[3], row[4]]) + " |")
    return "\n".join(lines)


def paper_marks() -> tuple[str, dict[str, str]]:
    """The paper's averages as a table, and p of both tasks' marks between noise classes."""
    words = {0.0: "zero", 1.0: "observed", 2.0: "double"}
    lines = ["| noise | obstacle avoidance | light seeking | both |", "|---|---|---|---|"]
    for level, word in words.items():
        marks = [PAPER[task][level] for task in (AVOIDANCE, LIGHT)]
        means = [np.mean(m) for m in (*marks, [*marks[0], *marks[1]])]
        lines.append(f"| {word} | " + " | ".join(f"{mean:.1f}" for mean in means) + " |")
    both = {level: [*PAPER[AVOIDANCE][level], *PAPER[LIGHT][level]] for level in words}
    pairs = {"zero": (1.0, 0.0), "double": (1.0, 2.0), "neither": (0.0, 2.0)}
    p = {name: _p(both[a], both[b]) for name, (a, b) in pairs.items()}
    tasks = (AVOIDANCE, LIGHT)
    alone = min(unpaired(PAPER[t][1.0], PAPER[t][other]).p for t in tasks for other in (0.0, 2.0))
    return "\n".join(lines), {**p, "least alone": f"{alone:.2f}".lstrip("0")}


def _p(first: Sequence[float], second: Sequence[float]) -> str:
    return f"{unpaired(first, second).p:.3f}".lstrip("0")
