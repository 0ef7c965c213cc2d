"""Figures of the second study: where tracks agree best, and the parts of the diagonal's differences."""

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from realitygap.experiments.noise.claims import Split
from realitygap.experiments.noise.second.verdicts import PLAN
from realitygap.report.noise.arms import Arm
from realitygap.report.noise.figures import legend, levels_axis
from realitygap.report.style import INK, MUTED, PAGE, new_figure

__all__ = ["CAPTIONS", "peaks_figure", "splits_figure"]

CAPTIONS = {
    "peaks": "(a) and (e): mean correspondence score of all champions, by the level of the simulation with "
    "which their tracks are compared; bars: 95 % intervals, bootstrap over units and runs. Square: the "
    "curve's peak with its interval. Dotted line: the robot's level.",
    "splits": "What the diagonal's difference between level 1 and each other level is made of, on the "
    "calibration unit, in points of the score: the part of the evolved level (dark) and of the comparison "
    "level (hatched), one bar for each order (E: evolved level changed first; C: comparison level "
    "first). Diamond: the whole difference, with its 95 % interval over runs.",
}
DARK, LIGHT = "#0072b2", "#e69f00"


def peaks_figure(arms: Sequence[Arm]) -> Figure:
    """A panel for each arm: (a)'s curve with its peak."""
    figure, axes = _panels(len(arms))
    for ax, arm in zip(axes.ravel(), arms, strict=False):
        top = arm.judged.peak
        low, high = (np.array([span[k] for span in top.spans]) for k in (0, 1))
        levels_axis(ax, top.levels, PLAN.robot)
        bars = np.maximum([top.means - low, high - top.means], 0.0)
        ax.errorbar(np.sqrt(top.levels), top.means, yerr=bars, color=INK, marker="o", markersize=4,
                    capsize=2, elinewidth=1, label="mean score, 95 % interval", zorder=4)  # fmt: skip
        at = float(high.max()) + 0.15
        span = [[np.sqrt(top.value) - np.sqrt(top.low)], [np.sqrt(top.high) - np.sqrt(top.value)]]
        ax.errorbar([np.sqrt(top.value)], [at], xerr=np.maximum(span, 0.0), color=DARK, marker="s",
                    markersize=5, capsize=3, linestyle="none", label="peak, 95 % interval",
                    zorder=5)  # fmt: skip
        ax.set_title(f"arm {arm.name}", fontsize=8)
        ax.set_xlabel("noise compared with")
    widest = np.array([ax.get_xlim() for ax in axes.ravel()[: len(arms)]])
    for ax in axes.ravel()[: len(arms)]:
        ax.set_xlim(widest[:, 0].min(), widest[:, 1].max())
    for ax in axes[:, 0]:
        ax.set_ylabel("correspondence score")
    legend(figure, axes)
    return figure


def splits_figure(arms: Sequence[Arm]) -> Figure:
    """A panel for each arm: two bars for each other level, one for each order."""
    figure, axes = _panels(len(arms))
    for ax, arm in zip(axes.ravel(), arms, strict=False):
        for k, split in enumerate(arm.split):
            for side, (evolved, compared) in ((-0.2, _parts(split, 0)), (0.2, _parts(split, 1))):
                base = evolved if evolved * compared > 0 else 0.0
                ax.bar(k + side, evolved, 0.34, color=DARK, label="evolved level")
                ax.bar(k + side, compared, 0.34, bottom=base, color=LIGHT, hatch="///", edgecolor=INK,
                       linewidth=0.5, label="comparison level")  # fmt: skip
                ax.text(k + side, 0.01, "EC"[side > 0], fontsize=6, ha="center", va="bottom",
                        transform=ax.get_xaxis_transform())  # fmt: skip
            whole = split.diagonal.difference
            low, high = split.diagonal.difference_interval or (whole, whole)
            ax.errorbar([k], [whole], yerr=[[max(whole - low, 0)], [max(high - whole, 0)]], color=INK,
                        marker="D", markersize=4, capsize=2, linestyle="none", label="whole, 95 % interval",
                        zorder=5)  # fmt: skip
        ax.axhline(0, color=MUTED, linewidth=0.7)
        ax.set_xticks(range(len(arm.split)), [f"{split.other:g}" for split in arm.split])
        ax.set_xlabel("against level")
        ax.set_title(f"arm {arm.name}", fontsize=8)
        ax.margins(y=0.14)
    for ax in axes[:, 0]:
        ax.set_ylabel("points in favour of level 1")
    legend(figure, axes)
    return figure


def _panels(count: int) -> tuple[Figure, NDArray[np.object_]]:
    """A figure with this many panels, three in a row."""
    rows, columns = -(-count // 3), min(count, 3)
    figure = new_figure(PAGE * max(0.68, columns / 3), 2.5 * rows + 0.35, layout="constrained")
    axes = figure.subplots(rows, columns, squeeze=False, sharey=True)
    for ax in axes.ravel()[count:]:
        ax.set_axis_off()
    return figure, axes


def _parts(split: Split, order: int) -> tuple[float, float]:
    """The parts of evolved and comparison level, with the evolved level changed first, or second."""
    pairs = ((split.evolved_first, split.comparison_after), (split.evolved_after, split.comparison_first))
    evolved, compared = pairs[order]
    return evolved.difference, compared.difference
