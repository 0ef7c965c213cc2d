"""The figures beside README.md: mean scores, the three claims, and fitness, all of one making."""

import numpy as np
from crossed import AVOIDANCE, LIGHT, PAPER, UNITS, Span, Study, curve, fitness_spans, scopes
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from realitygap.report.style import INK, MUTED, PAGE, new_figure, noise_styles

TASKS = {AVOIDANCE: "Obstacle avoidance", LIGHT: "Light seeking"}
PANELS = {
    "a": ("(a) by comparison level, all controllers", "noise of the simulation compared with"),
    "b": ("(b) by evolved level, one simulation", "noise evolved under"),
    "c": ("(c) each at the level it evolved at", "noise evolved under"),
}
BLUES = LinearSegmentedColormap.from_list("scores", ["#fdfdfc", "#56b4e9", "#0072b2", "#00304b"])


def map_figure(name: str) -> Figure:
    """Mean score by evolved level (rows) and level of the simulation compared with (columns)."""
    figure = new_figure(PAGE * 0.75, 3.1, layout="constrained")
    axes = figure.subplots(1, 2)
    means = {
        task: np.array(
            [scopes(name)[task].score[scopes(name)[task].evolved == level].mean() for level in levels]
        )
        for task in TASKS
        for levels in [scopes(name)[task].levels]
    }
    low, high = np.floor(min(m.min() for m in means.values())), 10.0
    for ax, (task, title) in zip(axes, TASKS.items(), strict=True):
        levels, count = scopes(name)[task].levels, len(means[task])
        ax.pcolormesh(means[task], cmap=BLUES, vmin=low, vmax=high)
        for (i, j), value in np.ndenumerate(means[task]):
            colour = "#ffffff" if value >= low + 0.45 * (high - low) else INK
            ax.text(j + 0.5, i + 0.5, f"{value:.1f}", ha="center", va="center", color=colour)
        for i in range(count):
            ax.add_patch(Rectangle((i + 0.05, i + 0.05), 0.9, 0.9, fill=False, edgecolor="#d55e00"))
        labels = [f"{level:g}" for level in levels]
        ax.set_xticks(np.arange(count) + 0.5, labels)
        ax.set_yticks(np.arange(count) + 0.5, labels)
        for labelled in (ax.get_xticklabels(), ax.get_yticklabels()):
            labelled[levels.index(1.0)].set_fontweight("bold")
        ax.set(title=title, xlabel="noise compared with", aspect="equal")
        ax.tick_params(length=0)
        ax.spines[["left", "bottom"]].set_visible(False)
    axes[0].set_ylabel("noise evolved under")
    return figure


def claims_figure(name: str) -> Figure:
    """Scores by level for each claim and task: a dot a controller, means with their intervals."""
    figure = new_figure(PAGE, 4.6, layout="constrained")
    axes = figure.subplots(len(TASKS), 3, sharey=True)
    for row, (task, title) in zip(axes, TASKS.items(), strict=True):
        study = scopes(name)[task]
        for ax, claim in zip(row, PANELS, strict=True):
            for level in study.levels:
                at = study.evolved == level
                scores = study.at(level) if claim == "a" else study.diagonal()[at]
                dots(ax, study, level, study.at(study.robot)[at] if claim == "b" else scores)
            bars(ax, study.levels, curve(study, claim)[0], "mean, 95 % interval")
            levels_axis(ax, study)
            if claim == "c":
                marks = [np.mean(scores) for scores in PAPER[task].values()]
                star = {"marker": "*", "markersize": 9, "markerfacecolor": "#e69f00", "markeredgecolor": INK}
                ax.plot(
                    np.sqrt([*PAPER[task]]),
                    marks,
                    linestyle="none",
                    zorder=6,
                    label="the paper's, by eye",
                    **star,
                )
            ax.set_ylim(-0.3, 10.3)
        row[0].set_ylabel(f"{title}\ncorrespondence score")
    for ax, (title, _) in zip(axes[0], PANELS.values(), strict=True):
        ax.set_title(title, fontsize=8)
    for ax, (_, label) in zip(axes[-1], PANELS.values(), strict=True):
        ax.set_xlabel(label)
    figure.legend(*axes[-1, -1].get_legend_handles_labels(), loc="outside lower center", ncols=2)
    return figure


def fitness_figure(name: str) -> Figure:
    """Fitness in simulation and on the twin, and its drop, by evolved level."""
    figure = new_figure(PAGE, 4.6, layout="constrained")
    axes = figure.subplots(len(TASKS), 2)
    for row, (task, title) in zip(axes, TASKS.items(), strict=True):
        study, (heading, scale, _) = scopes(name)[task], UNITS[task]
        simulated, situated = (study.controllers[c].to_numpy() / scale for c in ("simulated", "situated"))
        spans = []
        for level in study.levels:
            at = study.evolved == level
            dots(row[0], study, level, situated[at])
            dots(row[1], study, level, (simulated - situated)[at])
            spans.append(
                [Span(*(end / scale for end in s)) for s in fitness_spans(study, at, "simulated", "situated")]
            )
        each = list(zip(*spans, strict=True))
        bars(
            row[0],
            study.levels,
            each[0],
            "simulated",
            marker="D",
            linestyle="-",
            shift=-0.015,
            face="#fffffe",
        )
        bars(row[0], study.levels, each[1], "on the twin", linestyle=(0, (2, 1)), marker="s", shift=0.015)
        bars(row[1], study.levels, each[2], "drop")
        row[1].axhline(0, color=MUTED, linewidth=0.7)
        unit = heading.partition(", ")[2]
        row[0].set_ylabel(f"{title}\nfitness{f' ({unit})' if unit else ''}")
        row[1].set_ylabel("drop in fitness, simulated\nless on the twin")
        for ax in row:
            levels_axis(ax, study)
    for ax in axes[-1]:
        ax.set_xlabel("noise evolved under")
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=2)
    return figure


def dots(ax: Axes, study: Study, level: float, values: np.ndarray) -> None:
    """A dot for each controller, spread about its level by the golden ratio so that none hides another."""
    look = noise_styles(study.levels)[level]
    spread = 0.2 * (np.modf(np.arange(len(values)) * 0.6180339887498949)[0] - 0.5)
    ax.plot(
        np.sqrt(level) + spread, values, linestyle="none", marker=look.marker, markersize=1.8, alpha=0.55,
        color=look.colour, markeredgewidth=0.4, zorder=2,
    )  # fmt: skip


def bars(
    ax: Axes, levels: list[float], spans: list[Span], label: str, *, marker: str = "o", shift: float = 0.0,
    linestyle: object = "-", face: str = INK,
) -> None:  # fmt: skip
    """Means joined by a line, with their intervals."""
    value, low, high = np.array(spans).T
    ax.errorbar(
        np.sqrt(levels) + shift, value, yerr=[value - low, high - value], color=INK, marker=marker,
        markersize=4, capsize=2, linewidth=1.4, elinewidth=1, linestyle=linestyle,
        markerfacecolor=face, label=label, zorder=5,
    )  # fmt: skip


def levels_axis(ax: Axes, study: Study) -> None:
    """An axis over the level's root, with a line at the robot's own level."""
    ax.set_xticks(np.sqrt(study.levels), [f"{level:g}" for level in study.levels])
    ax.axvline(np.sqrt(study.robot), color=MUTED, linewidth=0.7, linestyle=(0, (1, 2)), zorder=1)
    ax.grid(axis="y")
    ax.set_axisbelow(True)
