"""Figures 4 and 6: the fittest individual at each evaluation, averaged over a condition's runs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from realitygap.report.statistics import student
from realitygap.report.style import COLUMN, NoiseStyle, new_figure, noise_styles

__all__ = ["curves_figure", "draw_curves", "mean_curve"]


def mean_curve(runs: Sequence[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Mean [n] over the runs and the half width [n] of its 95 % interval (nan for one run).

    Runs of different lengths (an unfinished study) are averaged as far as all of them reach.
    """
    reach = min(len(run) for run in runs)
    rows = np.array([run[:reach] for run in runs], dtype=float)
    if len(rows) == 1:
        return rows[0], np.full(reach, np.nan)
    half = student(len(rows) - 1) * rows.std(axis=0, ddof=1) / np.sqrt(len(rows))
    return rows.mean(axis=0), half


def draw_curves(
    ax: Axes,
    conditions: Mapping[float, Sequence[np.ndarray]],
    names: Mapping[float, str],
    *,
    scale: float = 1.0,
    unit: str = "",
    fresh: Mapping[float, float] | None = None,
) -> None:
    """One curve a noise level with its 95 % band.

    Args:
        ax: where.
        conditions: for each noise level the running best fitness of each of its runs, from evaluation 1.
        names: what each noise level is called.
        scale: what fitness is divided by, `unit` what remains.
        unit: shown on the axis.
        fresh: for each noise level a mean on fresh trials, drawn as a mark behind the curve's end.
    """
    styles = noise_styles(conditions)
    drawn = {level: [run for run in runs if len(run)] for level, runs in conditions.items()}
    longest = max(
        (_draw_one(ax, runs, names[level], styles[level], scale) for level, runs in drawn.items() if runs),
        default=1,
    )
    for level, value in (fresh or {}).items():
        look = styles[level]
        ax.plot(
            [longest * 1.035],
            [value / scale],
            marker=look.marker,
            color=look.colour,
            markersize=5,
            markerfacecolor="none",
            clip_on=False,
            linestyle="none",
            zorder=4,
        )
    ax.set_xlim(0, longest * 1.06)
    lowest = min((float(run.min()) for runs in drawn.values() for run in runs), default=0.0)
    ax.set_ylim(bottom=min(0.0, lowest / scale))
    ax.set_xlabel("evaluations")
    ax.set_ylabel("fitness of the fittest" + (f" ({unit})" if unit else ""))
    ax.grid(axis="y")
    ax.set_axisbelow(True)
    ax.legend(loc="lower right")


def _draw_one(ax: Axes, runs: Sequence[np.ndarray], name: str, look: NoiseStyle, scale: float) -> int:
    """One noise level's curve and band; how many evaluations it reaches."""
    mean, half = mean_curve(runs)
    at = np.arange(1, len(mean) + 1)
    if len(runs) > 1:
        ax.fill_between(
            at,
            (mean - half) / scale,
            (mean + half) / scale,
            color=look.colour,
            alpha=0.14,
            linewidth=0,
            zorder=1,
        )
    marks = np.unique(np.linspace(0, len(mean) - 1, 6).astype(int)[1:])
    ax.plot(
        at,
        mean / scale,
        color=look.colour,
        linestyle=look.line,
        marker=look.marker,
        label=name,
        markevery=list(marks),
        markersize=4,
        zorder=3,
    )
    return len(mean)


def curves_figure(conditions: Any, names: Mapping[float, str], **options: Any) -> Figure:
    """Figure 4 or 6 in one column of a paper."""
    figure = new_figure(COLUMN * 1.25, COLUMN * 0.85, layout="constrained")
    draw_curves(figure.add_subplot(), conditions, names, **options)
    return figure
