"""Figures 4 and 6: the fittest individual at each evaluation, averaged over a condition's runs."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from realitygap.report.statistics import student
from realitygap.report.style import COLUMN, NoiseStyle, new_figure, noise_styles

__all__ = ["Curves", "curves_figure", "mean_curve"]


def mean_curve(runs: Sequence[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Mean [n] over the runs and the half width [n] of its 95 % interval (nan for one run).

    Runs of different lengths (an unfinished study) are averaged up to the shortest.
    """
    reach = min(len(run) for run in runs)
    rows = np.array([run[:reach] for run in runs], dtype=float)
    if len(rows) == 1:
        return rows[0], np.full(reach, np.nan)
    half = student(len(rows) - 1) * rows.std(axis=0, ddof=1) / np.sqrt(len(rows))
    return rows.mean(axis=0), half


@dataclass(frozen=True, kw_only=True)
class Curves:
    """Data of figure 4 or 6, by noise level; fitness unscaled.

    Attributes:
        runs: the running best fitness of each run, from evaluation 1.
        names: of the page's noise levels, also of those without runs.
        fresh: a mean on fresh trials, drawn as a mark behind the curve's end.
        scale: divisor of fitness; unit: the resulting unit, shown on the axis.
    """

    runs: Mapping[float, Sequence[np.ndarray]]
    names: Mapping[float, str]
    fresh: Mapping[float, float] = field(default_factory=dict)
    scale: float = 1.0
    unit: str = ""


def curves_figure(curves: Curves) -> Figure:
    """Figure 4 or 6 in one column of a paper: a curve a noise level with its 95 % band."""
    figure = new_figure(COLUMN * 1.25, COLUMN * 0.85, layout="constrained")
    ax = figure.add_subplot()
    styles, scale = noise_styles(curves.names), curves.scale
    drawn = {level: [run for run in runs if len(run)] for level, runs in curves.runs.items()}
    longest = max(
        (
            _draw_one(ax, runs, curves.names[level], styles[level], scale)
            for level, runs in drawn.items()
            if runs
        ),
        default=1,
    )
    for level, value in curves.fresh.items():
        look = styles[level]
        ax.plot(
            [longest * 1.035], [value / scale], marker=look.marker, color=look.colour, markersize=5,
            markerfacecolor="none", clip_on=False, linestyle="none", zorder=4,
        )  # fmt: skip
    seen = [float(end) for runs in drawn.values() for run in runs for end in (run.min(), run.max())]
    low, *_, high = sorted([0.0, *seen, *curves.fresh.values()])
    ax.set(xlim=(0, longest * 1.06), xlabel="evaluations")
    # Two runs' interval may be many times as high as they: it is cut.
    ax.set_ylim(low / scale, min(ax.get_ylim()[1], (1.1 * high - 0.1 * low) / scale) or None)
    ax.set_ylabel("fitness of the fittest" + (f" ({curves.unit})" if curves.unit else ""))
    ax.grid(axis="y")
    ax.set_axisbelow(True)
    ax.legend()
    return figure


def _draw_one(ax: Axes, runs: Sequence[np.ndarray], name: str, look: NoiseStyle, scale: float) -> int:
    """One noise level's curve and band; returns its number of evaluations."""
    mean, half = mean_curve(runs)
    at = np.arange(1, len(mean) + 1)
    if len(runs) > 1:
        low, high = (mean - half) / scale, (mean + half) / scale
        ax.fill_between(at, low, high, color=look.colour, alpha=0.14, linewidth=0, zorder=1)
    marks = np.unique(np.linspace(0, len(mean) - 1, 6).astype(int)[1:])
    ax.plot(
        at, mean / scale, color=look.colour, linestyle=look.line, marker=look.marker, label=name,
        markevery=list(marks), markersize=4, zorder=3,
    )  # fmt: skip
    return len(mean)
