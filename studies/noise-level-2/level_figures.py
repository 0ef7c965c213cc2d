"""The figures of the second study: two for docs/noise.md, two beside the tables."""

from collections.abc import Sequence
from io import BytesIO
from pathlib import Path

import level_tests as lt
import numpy as np
from level_arms import Arm
from level_tests import PLAN, ROBOT
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from PIL import Image

from realitygap.report.style import GRID, INK, MUTED, new_figure, noise_styles, styled

DOCS = Path(__file__).resolve().parents[2] / "docs" / "figures"
DARK, LIGHT = "#0072b2", "#e69f00"
CLAIMS = {
    ("a", "signed ranks"): "(a) by the level compared with",
    ("c", "ranks"): "(c) by both at once: the paper's diagonal",
    ("b", "means"): "(b) by the level evolved at, compared with 1",
}
MODEL_ERROR = {"E": 0.43, "E5": 0.43, "T2": 0.47, "T": 0.74, "S": 5.84}
"""Median error of the proximity model over the noise (tables.md); for E that of the same units in E5."""
REAL = "3.35 to 3.70"
"""The same of a real Khepera's tables (shared tables: benchmarks/real_khepera.py)."""
CURVE_ORDER = ["E", "E5", "T2", "T", None, "S"]
"""By model error; None: where a real Khepera would stand."""
NAMES = {
    "E": "E: Enki's robot",
    "E5": "E5: longer evolution",
    "T2": "T2: twin, noise twice",
    "T": "T: the twin",
    "S": "S: another robot",
}
COLOURS = 256
"""Of a saved picture: a third of the size, the same colours."""
PHONE = 4.4
"""Width in inches at which the letters stay readable on a phone."""


def forest(arms: Sequence[Arm]) -> Figure:
    """Differences of means with 90 % intervals by arm and by the other level; hollow without jitter."""
    figure = new_figure(PHONE, 6.4, layout="constrained")
    axes = figure.subplots(len(CLAIMS), len(PLAN["against"]), sharex=True, sharey=True)
    for row, (claim, title) in zip(axes, CLAIMS.items(), strict=True):
        for ax, against in zip(row, PLAN["against"], strict=True):
            ax.axvspan(-PLAN["bound"], PLAN["bound"], color=GRID, alpha=0.6, linewidth=0, zorder=0)
            ax.axvline(0, color=MUTED, linewidth=0.8, zorder=1)
            for k, arm in enumerate(arms):
                for judged, shift, face in (
                    (arm.judged, -0.17, INK),
                    (arm.robust["without jitter"], 0.17, "white"),
                ):
                    same = (judged["claim"] == claim[0]) & (judged["by"] == claim[1])
                    one = judged[same & (judged["against"] == f"{against:g}")].iloc[0]
                    ax.plot([one["low"], one["high"]], [k + shift] * 2, color=INK, linewidth=1.4, zorder=2)
                    ax.plot(
                        one["difference"],
                        k + shift,
                        marker="o",
                        markersize=5.5,
                        color=INK,
                        markerfacecolor=face,
                        linestyle="none",
                        zorder=3,
                    )
            ax.set_yticks(range(len(arms)), [arm.name for arm in arms], fontsize=9)
            ax.tick_params(axis="x", labelsize=9)
            ax.set_xlim(-1.1, 2.5)
            ax.set_xticks([-1, 0, 1, 2], ["−1", "0", "1", "2"])
        row[0].set_title(title, fontsize=9, loc="left")
    axes[0, 0].invert_yaxis()
    for ax, against in zip(axes[-1], ("no noise (0)", "double (2)"), strict=True):
        ax.set_xlabel(f"points, 1 less {against}", fontsize=9)
    marks = [
        axes[0, 0].plot([], [], marker="o", color=INK, markerfacecolor=face, linewidth=1.4)[0]
        for face in (INK, "white")
    ]
    named = [*marks, Patch(color=GRID, alpha=0.6)]
    words = ["as planned, 90 %", "without jitter", "under ½ point"]
    figure.legend(named, words, loc="outside lower center", ncols=3, fontsize=9, columnspacing=1.0)
    return figure


def curves(arms: Sequence[Arm]) -> Figure:
    """Score by level of comparison, a panel an arm, in order of the error of its models."""
    there = {arm.name: arm for arm in arms}
    figure = new_figure(PHONE, 5.6, layout="constrained")
    axes = figure.subplots(3, 2, sharey=True)
    for ax, name in zip(axes.ravel(), CURVE_ORDER, strict=True):
        if name is None:
            ax.set_axis_off()
            text = f"A real Khepera's tables\nwould stand here:\nmodel error {REAL}.\nNo arm lies there."
            ax.text(0.5, 0.5, text, ha="center", va="center", fontsize=9, transform=ax.transAxes, color=INK)
            continue
        _curve(ax, there[name])
        ax.set_title(f"{NAMES[name]}\nmodel error {MODEL_ERROR[name]:g}", fontsize=9)
    for ax in (*axes[:2, 0], axes[2, 1]):
        ax.set_ylabel("score (0 to 10)", fontsize=9)
    for ax in (axes[1, 0], axes[2, 1]):
        ax.set_xlabel("noise compared with", fontsize=9)
    axes[2, 1].tick_params(labelleft=True)
    return figure


def _curve(ax: Axes, arm: Arm) -> None:
    """(a)'s curve with 95 % intervals; every level in its own colour and shape."""
    peak, root = arm.peak, np.sqrt(arm.peak.levels)
    ax.axvline(np.sqrt(ROBOT), color=MUTED, linewidth=0.8, linestyle=(0, (1, 2)), zorder=1)
    ax.plot(root, peak.means, color=MUTED, linewidth=1, zorder=2)
    for level, look in noise_styles([0, 0.5, 1, 2, 4]).items():
        for i in np.flatnonzero(peak.levels == level):
            ax.plot([root[i]] * 2, peak.spans[:, i], color=look.colour, linewidth=1.6, zorder=3)
            ax.plot(
                root[i],
                peak.means[i],
                look.marker,
                color=look.colour,
                markersize=5.5,
                zorder=4,
                clip_on=False,
            )
    ax.set_ylim(0, 10)
    ax.set_yticks([0, 2, 4, 6, 8, 10])
    ax.grid(axis="y")
    ax.set_xlim(-0.15, 2.15)
    ax.set_xticks(root, ["½" if level == 0.5 else f"{level:g}" for level in peak.levels])
    ax.tick_params(labelsize=9)


def parts(arms: Sequence[Arm]) -> Figure:
    """The diagonal's difference from each level, split in both orders."""
    figure = new_figure(7.0, 4.6, layout="constrained")
    axes = figure.subplots(2, 3, sharey=True)
    for ax in axes.ravel()[len(arms) :]:
        ax.set_axis_off()
    for ax, arm in zip(axes.ravel(), arms, strict=False):
        split = lt.diagonal_parts(arm.champions)
        for k, whole in enumerate(split.values()):
            orders = (
                ("E", -0.2, "evolved_first", "comparison_after"),
                ("C", 0.2, "evolved_after", "comparison_first"),
            )
            for letter, side, evolved, compared in orders:
                first, second = whole[evolved].means[0], whole[compared].means[0]
                base = first if first * second > 0 else 0.0
                ax.bar(k + side, first, 0.34, color=DARK, label="evolved level")
                ax.bar(
                    k + side,
                    second,
                    0.34,
                    bottom=base,
                    color=LIGHT,
                    hatch="///",
                    edgecolor=INK,
                    linewidth=0.5,
                    label="comparison level",
                )
                where = ax.get_xaxis_transform()
                ax.text(k + side, 0.01, letter, fontsize=6, ha="center", va="bottom", transform=where)
            value, low, high = whole["diagonal"].means
            ax.errorbar(
                [k],
                [value],
                yerr=[[value - low], [high - value]],
                color=INK,
                marker="D",
                markersize=4,
                capsize=2,
                linestyle="none",
                label="whole, 95 % interval",
                zorder=5,
            )
        ax.axhline(0, color=MUTED, linewidth=0.7)
        ax.set_xticks(range(len(split)), [f"{level:g}" for level in split])
        ax.set_xlabel("against level")
        ax.set_title(f"arm {arm.name}")
    for ax in axes[:, 0]:
        ax.set_ylabel("points in favour of level 1")
    named = dict(zip(*reversed(axes[0, 0].get_legend_handles_labels()), strict=True))
    figure.legend(named.values(), named.keys(), loc="outside lower center", ncols=3)
    return figure


def write_figures(arms: Sequence[Arm], folder: Path) -> None:
    """Save every figure as a PNG: two for the docs, one beside the tables."""
    for place, name, draw, dpi in (
        (DOCS, "noise-forest", forest, 150),
        (DOCS, "noise-levels", curves, 150),
        (folder, "diagonal", parts, 110),
    ):
        buffer = BytesIO()
        with styled():
            draw(arms).savefig(buffer, dpi=dpi, metadata={"Software": None})
        Image.open(buffer).convert("RGB").quantize(COLOURS).save(place / f"{name}.png", optimize=True)
