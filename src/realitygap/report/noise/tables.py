"""Tables of a study of noise, for the page, for Markdown, and as CSV."""

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from realitygap.experiments.noise.claims import Contrast, Finding
from realitygap.report.noise.facts import PAPER, NoiseFacts, Span, effect_spans
from realitygap.report.noise.figures import titled
from realitygap.report.noise.results import Misfit, real_misfits
from realitygap.text import to_csv

__all__ = [
    "NoiseTable", "Number", "Row", "calibration_table", "claim_table", "contrast_table",
    "fitness_table", "in_unit", "names_table", "noise_tables", "paper_table", "peaks_table", "probability",
]  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class Number:
    """A figure as displayed, with a number of decimals, with or without a sign."""

    span: Span
    places: int = 2
    signed: bool = False
    scale: float = 1.0

    def __str__(self) -> str:
        value, low, high = (self._one(v) for v in self.span)
        return value if math.isnan(self.span.low) else f"{value} ({low} to {high})"

    def _one(self, value: float) -> str:
        if math.isnan(value):
            return "–"
        return f"{value / self.scale:{'+' if self.signed else ''}.{self.places}f}".replace("-", "−")


Cell = str | int | Number
Row = tuple[Cell, ...]


@dataclass(frozen=True, kw_only=True)
class NoiseTable:
    """A table with a name (its file's), a caption, a head, and rows of cells."""

    name: str
    title: str
    head: tuple[str, ...]
    rows: tuple[Row, ...]

    def texts(self) -> list[list[str]]:
        """Rows as displayed."""
        return [[str(cell) for cell in row] for row in self.rows]

    def markdown(self) -> str:
        """A Markdown table, for the pages of docs."""
        lines = [self.head, ["---"] * len(self.head), *self.texts()]
        return "\n".join("| " + " | ".join(line) + " |" for line in lines)

    def csv(self) -> str:
        """With all digits; a column with intervals becomes three."""
        spans = [
            any(isinstance(c, Number) and not math.isnan(c.span.low) for c in column)
            for column in zip(*self.rows, strict=True)
        ] or [False] * len(self.head)
        head = [
            text for name, span in zip(self.head, spans, strict=True)
            for text in ([name, f"{name}, from", f"{name}, to"] if span else [name])
        ]  # fmt: skip
        rows = ([t for pair in zip(row, spans, strict=True) for t in _exact(*pair)] for row in self.rows)
        return to_csv([head, *rows])


def _exact(cell: Cell, span: bool) -> list[str]:
    if not isinstance(cell, Number):
        return [str(cell), "", ""] if span else [str(cell)]
    return ["" if math.isnan(v) else f"{v:.6g}" for v in (cell.span if span else cell.span[:1])]


def noise_tables(facts: NoiseFacts, calibration: Sequence[Misfit]) -> dict[str, NoiseTable]:
    """Every table, by its name."""
    every = [
        *(
            claim_table(f"{scope.file}-{finding.claim.key}", scope.name, finding)
            for scope in facts.scopes for finding in scope.findings
        ),
        peaks_table(facts), fitness_table(facts), names_table(facts), paper_table(facts),
        calibration_table(calibration),
    ]  # fmt: skip
    return {table.name: table for table in every}


def claim_table(name: str, scope: str, finding: Finding) -> NoiseTable:
    """A claim's contrasts."""
    first = finding.contrasts[0]
    count = f"{first.first} controllers" if finding.claim.key == "a" else (
        f"{first.first} controllers evolved at {first.level:g} and as many at each other level"
    )  # fmt: skip
    title = (
        f"({finding.claim.key}) {finding.claim.title}, {scope}: {finding.verdict}. {count}. "
        "* decides the verdict."
    )
    return contrast_table(name, title, finding.contrasts, finding.coarse)


def contrast_table(
    name: str, title: str, contrasts: Sequence[Contrast], coarse: Sequence[float] = ()
) -> NoiseTable:
    """A row for each level that the robot's is compared with.

    Args:
        name: of its file.
        title: its heading.
        contrasts: the rows.
        coarse: levels whose comparisons decide, which are marked.
    """
    rows: list[Row] = []
    for c in contrasts:
        delta, gap = effect_spans(c.effect)
        rows.append((
            f"{c.other:g}" + (" *" if c.other in coarse else ""),
            *(Number(span=Span(mean)) for mean in c.means),
            *(Number(span=span, signed=True) for span in (gap, delta)),
            *(Number(span=Span(effect.delta), signed=True) for effect in c.sets.values()),
            probability(c.effect.p), probability(c.p_holm), c.found,
        ))  # fmt: skip
    return NoiseTable(
        name=name, title=title,
        head=(
            "against level", f"mean at {contrasts[0].level:g}", "mean there", "difference", "Cliff's delta",
            *(f"delta, set {s}" for s in contrasts[0].sets), "p", "p (Holm)", "found",
        ),
        rows=tuple(rows),
    )  # fmt: skip


def probability(p: float) -> str:
    """A p-value as text."""
    return "< .0001" if p < 1e-4 else f"{p:.4f}".lstrip("0") if p < 0.9999 else "1"


def peaks_table(facts: NoiseFacts) -> NoiseTable:
    """The maximum of each curve, and where the twin stops being noisier than the simulation."""
    rows: list[Row] = []
    for scope in facts.scopes:
        tops = [Number(span=scope.curves[key].top) for key in "abc"]
        rows.append((scope.name, *tops, Number(span=scope.noisiness.top)))
    return NoiseTable(
        name="peaks",
        title=f"Levels at which the curves peak, and at which noisiness changes its sign. The robot's own "
        f"level is {facts.data.robot:g}. An interval over all levels means that no peak can be seen.",
        head=("tasks", "(a) comparison level", "(b) evolved level", "(c) diagonal", "noisiness passes zero"),
        rows=tuple(rows),
    )


def fitness_table(facts: NoiseFacts) -> NoiseTable:
    """Fitness in simulation, on the twin, the drop, by evolved level."""
    rows: list[Row] = []
    for row in facts.fitness:
        name, shown = in_unit(facts, row.task, (row.simulated, row.situated, row.drop))
        pair = row.correlation
        r = Span(math.nan) if pair is None else Span(pair.r, *pair.interval)
        rows.append((
            name, f"{row.level:g}", row.count, *shown,
            "–" if row.delta is None else Number(span=row.delta, signed=True), Number(span=r),
        ))  # fmt: skip
    return NoiseTable(
        name="fitness",
        title="Fitness by evolved level, means over runs. Delta: Cliff's, of fitness on the twin against "
        "the robot's level. r: simulated against situated fitness over controllers.",
        head=("task", "level", "runs", "simulated", "on the twin", "drop", "delta on the twin", "r"),
        rows=tuple(rows),
    )


def in_unit(facts: NoiseFacts, task: str, spans: Sequence[Span]) -> tuple[str, list[Number]]:
    """A task with its unit of fitness, and figures of fitness in that unit."""
    scale, unit = facts.scales[task]
    places = 2 if scale != 1 else 3
    shown = [Number(span=span, places=places, scale=scale) for span in spans]
    return titled(task) + (f", {unit}" if unit else ""), shown


def names_table(facts: NoiseFacts) -> NoiseTable:
    """Number of controllers of each behaviour at each level."""
    data = facts.data
    rows: list[Row] = []
    for task in data.tasks:
        part = data.part(task=task)
        counts = [Counter(part.name[part.evolved == level].tolist()) for level in data.levels]
        for name in sorted(set(part.name.tolist()), key=lambda n: (-sum(c[n] for c in counts), n)):
            rows.append((titled(task), str(name), *(c[name] for c in counts)))
    return NoiseTable(
        name="names",
        title="What evolved: runs by behaviour in simulation and evolved level.",
        head=("task", "behaviour", *(f"{level:g}" for level in data.levels)),
        rows=tuple(rows),
    )


def paper_table(facts: NoiseFacts) -> NoiseTable:
    """The paper's averages beside the diagonal's, at zero, observed and double noise; never at a level that
    stands for one of these."""
    data = facts.data
    rows: list[Row] = []
    for scope in facts.scopes:
        paper = [PAPER[task] for task in (data.tasks if scope.name not in PAPER else [scope.name])
                 if task in PAPER]  # fmt: skip
        for times, word in ((0.0, "zero"), (1.0, "observed"), (2.0, "double")):
            if not paper:
                continue
            mark = float(np.mean([np.mean(marks[times]) for marks in paper]))
            ours = [s for lv, s in zip(data.levels, scope.curves["c"].spans, strict=True)
                    if lv == times]  # fmt: skip
            rows.append((
                scope.name, word, Number(span=Span(mark), places=1),
                Number(span=ours[0], places=1) if ours else "–",
            ))  # fmt: skip
    return NoiseTable(
        name="paper",
        title="Average correspondence scores: the paper's (five runs a task, by eye), the diagonal's here.",
        head=("tasks", "noise", "the paper", "here"),
        rows=tuple(rows),
    )


def calibration_table(calibration: Sequence[Misfit]) -> NoiseTable:
    """Model error over noise, for each unit and channel, and those of a real robot."""
    judged = all(m.judged for m in calibration)
    real = real_misfits(judged=judged) if calibration else ()
    counted = (
        "on places held out, where readings are neither dark nor saturated"
        if judged
        else "over all readings, so that dark ones flatter them"
    )
    rows = tuple(
        (
            str(m.unit) if m.unit else "a real Khepera", m.channel, Number(span=Span(m.model_error)),
            Number(span=Span(m.noise)), Number(span=Span(m.ratio)), f"{m.limit:g}",
            "▲ model error exceeds noise" if m.too_far else "",
        )
        for m in (*calibration, *real)
    )  # fmt: skip
    return NoiseTable(
        name="calibration",
        title=f"The calibrated simulations: model error over noise deviation, in counts, {counted}. ▲: above "
        "the limit, where model error exceeds noise. Last: such a fit to "
        "a real robot, the tables behind the profile khepera.",
        head=("unit", "channel", "model error", "noise", "ratio", "limit", ""),
        rows=rows,
    )
