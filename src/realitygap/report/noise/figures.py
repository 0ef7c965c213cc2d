"""Figures of a study of noise: the map of scores, the claims' curves, fitness, noisiness."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from numpy.typing import NDArray

from realitygap.experiments.noise.crossed import Crossed
from realitygap.report import style
from realitygap.report.noise.facts import PAPER, Curve, NoiseFacts, Scope, Span, heat, points
from realitygap.report.style import INK, MUTED, PAGE, new_figure, noise_styles
from realitygap.values import Floats

if TYPE_CHECKING:
    from matplotlib.typing import LineStyleType

__all__ = [
    "claims_figure", "fitness_figure", "legend", "levels_axis", "map_figure", "noisiness_figure", "panel",
    "titled",
]  # fmt: skip

SETS = ((0, (4, 1.5)), (0, (1, 1)), (0, (4, 1, 1, 1)), (0, (8, 2)))
"""Line styles of seed sets, repeated if there are more sets."""
BARS: Mapping[str, tuple[str, LineStyleType, str]] = {
    "all, 95 % interval": ("o", "-", INK),
    "simulated": ("o", "-", style.PAPER),
    "situated": ("s", (0, (2, 1)), INK),
    "drop": ("D", "-", INK),
}
"""Marker, line and face of means, by their kind."""
PANELS = {
    "a": ("(a) all controllers, by comparison level", "noise of the simulation compared with"),
    "b": ("(b) by evolved level, one simulation", "noise evolved under"),
    "c": ("(c) each at the level it evolved at", "noise evolved under"),
}
_HEAT = LinearSegmentedColormap.from_list("scores", ["#fdfdfc", "#56b4e9", "#0072b2", "#00304b"])
_DARK = 0.6
"""Share of the scale from which a cell's number is white."""


def titled(task: str) -> str:
    """A task's name as a heading."""
    return task.replace("-", " ").capitalize()


def map_figure(data: Crossed) -> Figure:
    """Mean score of every cell of the crossed design: a row a task; all seed sets, then each alone."""
    sets, tasks = data.sets, data.tasks
    alone = sets if len(sets) > 1 else []
    panels = 1 + len(alone)
    figure = new_figure(PAGE * min(1.0, 0.25 + 0.25 * panels), 2.6 * len(tasks), layout="constrained")
    axes = figure.subplots(len(tasks), panels, squeeze=False)
    every = {(t, s): heat(data.part(task=t, seed_set=s)) for t in tasks for s in (None, *alone)}
    ends = np.floor(min(m.min() for m in every.values())), np.ceil(max(m.max() for m in every.values()))
    for row, task in zip(axes, tasks, strict=True):
        for ax, one in zip(row, (None, *alone), strict=True):
            _draw_map(ax, data, every[task, one], ends)
            ax.set_title(titled(task) if one is None else f"seed set {one} alone", fontsize=8)
        row[0].set_ylabel("noise evolved under")
    for ax in axes[-1]:
        ax.set_xlabel("noise compared with")
    return figure


def _draw_map(ax: Axes, data: Crossed, means: Floats, ends: tuple[float, float]) -> None:
    """A cell for each mean score, with its number; the diagonal is framed, the robot's level bold."""
    count, (low, high) = len(data.levels), ends
    ax.pcolormesh(np.arange(count + 1), np.arange(count + 1), means, cmap=_HEAT, vmin=low, vmax=high)
    for i, j in np.ndindex(means.shape):
        colour = "#ffffff" if means[i, j] >= low + _DARK * (high - low) else "#1b1d22"
        ax.text(j + 0.5, i + 0.5, f"{means[i, j]:.1f}", ha="center", va="center", color=colour, fontsize=7)
    for i in range(count):
        frame = Rectangle((i + 0.05, i + 0.05), 0.9, 0.9, fill=False, edgecolor="#d55e00", linewidth=1.3)
        ax.add_patch(frame)
    labels = [f"{level:g}" for level in data.levels]
    ticks = np.arange(count) + 0.5
    ax.set_xticks(ticks, labels)
    ax.set_yticks(ticks, labels)
    for names in (ax.get_xticklabels(), ax.get_yticklabels()):
        names[data.index(data.robot)].set_fontweight("bold")
    ax.set_aspect("equal")
    ax.tick_params(length=0)
    ax.spines[["left", "bottom"]].set_visible(False)


def claims_figure(facts: NoiseFacts) -> Figure:
    """A panel a claim and task: every run a dot, seed sets as lines, all together with intervals."""
    scopes = facts.by_task
    figure = new_figure(PAGE, 2.35 * len(scopes) + 0.35, layout="constrained")
    axes = figure.subplots(len(scopes), 3, squeeze=False, sharey=True)
    for row, scope in zip(axes, scopes, strict=True):
        data = facts.data.part(task=scope.name)
        for ax, key in zip(row, PANELS, strict=True):
            _claim_panel(ax, data, scope, key)
        row[0].set_ylabel(f"{titled(scope.name)}\ncorrespondence score")
    for ax, (title, _) in zip(axes[0], PANELS.values(), strict=True):
        ax.set_title(title, fontsize=8)
    for ax, (_, label) in zip(axes[-1], PANELS.values(), strict=True):
        ax.set_xlabel(label)
    legend(figure, axes)
    return figure


def _claim_panel(ax: Axes, data: Crossed, scope: Scope, key: str) -> None:
    panel(ax, data, *points(data, key), scope.curves[key])
    paper = PAPER.get(scope.name, {})
    if key == "c" and paper:
        at = np.sqrt([*paper])
        marks = [float(np.mean(scores)) for scores in paper.values()]
        ax.plot(
            at, marks, linestyle="none", marker="*", markersize=9, markerfacecolor="#e69f00",
            markeredgecolor=INK, markeredgewidth=0.6, zorder=6, label="the paper's averages (by eye)",
        )  # fmt: skip
    ax.set_ylim(-0.3, 10.3)


def panel(ax: Axes, data: Crossed, level: Floats, score: Floats, curve: Curve) -> None:
    """Dots of every run and the curve of means with intervals, also of each of several seed sets.

    Args:
        ax: the axes.
        data: the study's table.
        level: [n] of the dots, as many for each run.
        score: [n].
        curve: of all of them.
    """
    _dots(ax, data, level, score, np.repeat(data.seed_set, len(score) // len(data)))
    levels_axis(ax, data.levels, data.robot)
    x = np.sqrt(curve.levels)
    if len(curve.sets) > 1:
        for number, means in curve.sets.items():
            ax.plot(x, means, color=MUTED, linewidth=1, linestyle=SETS[(number - 1) % len(SETS)], zorder=3,
                    label=f"seed set {number}")  # fmt: skip
    _bars(ax, x, curve.spans, "all, 95 % interval")


def _dots(ax: Axes, data: Crossed, level: Floats, score: Floats, sets: NDArray[np.int64]) -> None:
    """Every run: filled left of its level for odd seed sets, hollow right of it for even ones."""
    styles = noise_styles(data.levels.tolist())
    for one in data.sets:
        for lv in data.levels.tolist():
            y = score[(sets == one) & (level == lv) & np.isfinite(score)]
            side = -1 if one % 2 else 1
            spread = side * (0.02 + 0.09 * _scatter(len(y)))
            look = styles[lv]
            ax.plot(
                np.sqrt(lv) + spread, y, linestyle="none", marker=look.marker, markersize=1.8,
                markeredgewidth=0.4, markeredgecolor=look.colour, zorder=2, alpha=0.55,
                markerfacecolor=look.colour if one % 2 else "none",
            )  # fmt: skip


def _scatter(count: int) -> Floats:
    """Even but unordered places 0 to 1 (golden ratio), so that dots do not hide each other."""
    places: Floats = np.modf(np.arange(count) * 0.6180339887498949)[0]
    return places


def levels_axis(ax: Axes, levels: Floats, robot: float) -> None:
    """An axis over the root of the level, which spreads small levels; with a line at the robot's."""
    ax.set_xticks(np.sqrt(levels), [f"{level:g}" for level in levels])
    ax.axvline(np.sqrt(robot), color=MUTED, linewidth=0.7, linestyle=(0, (1, 2)), zorder=1)
    ax.grid(axis="y")
    ax.set_axisbelow(True)


def _bars(ax: Axes, x: Floats, spans: Sequence[Span], of: str, label: str = "") -> None:
    """Means joined by a line, with their intervals, in a style of BARS; the legend names them as `of`."""
    marker, line, face = BARS[of]
    y = np.array([s.value for s in spans])
    bars = np.nan_to_num(np.array([[s.value - s.low for s in spans], [s.high - s.value for s in spans]]))
    ax.errorbar(
        x, y, yerr=np.maximum(bars, 0), color=INK, marker=marker, markersize=4, capsize=2, linewidth=1.4,
        elinewidth=1, linestyle=line, label=label or of, zorder=5, markerfacecolor=face,
    )  # fmt: skip


def legend(figure: Figure, axes: NDArray[np.object_]) -> None:
    """One legend, below, of what all panels name."""
    found: dict[str, Artist] = {}
    for ax in axes.ravel():
        for handle, label in zip(*ax.get_legend_handles_labels(), strict=True):
            found.setdefault(label, handle)
    figure.legend(list(found.values()), list(found), loc="outside lower center", ncols=len(found))


def fitness_figure(facts: NoiseFacts, who: str) -> Figure:
    """Two panels a task: fitness in simulation and on the twin (or the robot), its drop, by evolved level."""
    tasks = facts.data.tasks
    figure = new_figure(PAGE, 2.2 * len(tasks) + 0.35, layout="constrained")
    axes = figure.subplots(len(tasks), 2, squeeze=False)
    for (both, drop), task in zip(axes, tasks, strict=True):
        data, (scale, unit) = facts.data.part(task=task), facts.scales[task]
        rows, x = [row for row in facts.fitness if row.task == task], np.sqrt(data.levels)
        _dots(both, data, data.evolved, data.situated / scale, data.seed_set)
        _bars(both, x - 0.012, [_scaled(r.simulated, scale) for r in rows], "simulated")
        _bars(both, x + 0.012, [_scaled(r.situated, scale) for r in rows], "situated", f"on the {who}")
        _dots(drop, data, data.evolved, (data.simulated - data.situated) / scale, data.seed_set)
        _bars(drop, x, [_scaled(r.drop, scale) for r in rows], "drop")
        drop.axhline(0, color=MUTED, linewidth=0.7)
        for ax in (both, drop):
            levels_axis(ax, data.levels, data.robot)
            ax.set_xlabel("noise evolved under")
        unit = f" ({unit})" if unit else ""
        both.set_ylabel(f"{titled(task)}\nfitness{unit}")
        drop.set_ylabel(f"drop in fitness{unit}")
    legend(figure, axes)
    return figure


def _scaled(span: Span, scale: float) -> Span:
    return Span(*(value / scale for value in span))


def noisiness_figure(facts: NoiseFacts, who: str) -> Figure:
    """A panel a task: how much noisier the twin (or the robot) is than the simulation at each level."""
    scopes = facts.by_task
    figure = new_figure(PAGE, 2.6, layout="constrained")
    axes = figure.subplots(1, len(scopes), squeeze=False, sharey=True)
    for ax, scope in zip(axes[0], scopes, strict=True):
        data = facts.data.part(task=scope.name)
        level, _ = points(data, "a")
        panel(ax, data, level, data.noisiness.ravel(), scope.noisiness)
        ax.axhline(0, color=INK, linewidth=0.8)
        ax.set_title(titled(scope.name), fontsize=8)
        ax.set_xlabel(PANELS["a"][1])
    axes[0][0].set_ylabel(f"noisiness of the {who}\n(log2 of the ratio of jitter)")
    legend(figure, axes)
    return figure
