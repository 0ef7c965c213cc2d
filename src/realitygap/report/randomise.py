"""The picture of an experiment on measuring or randomising: outcomes over hours of work."""

import math
from collections.abc import Sequence
from pathlib import Path
from textwrap import fill

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from realitygap.experiments.randomise.plan import KNOWN, NOISES
from realitygap.experiments.randomise.results import HOURS, OUTCOMES, Outcome, compared_in
from realitygap.report.style import PAGE, new_figure, noise_styles, save_figure, styled
from realitygap.world.noise import noise_name

__all__ = ["draw_outcomes", "outcomes_figure"]

PICTURE = "outcomes"
LABELS = {"correspondence": ("correspondence", 10.5), "fitness_situated": ("situated fitness", 1.0)}
"""Axis labels, and upper limits: no outcome exceeds them, though intervals of few units may."""
NOISE_APART, RANDOMISED_APART = 0.32, 0.16


def draw_outcomes(results: Path) -> Path:
    """Draw each condition's outcomes into the tables' folder, as SVG and PNG; returns the SVG's path."""
    with styled():
        save_figure(outcomes_figure(compared_in(results)[0]), results, PICTURE)
    return results / f"{PICTURE}.svg"


def outcomes_figure(found: Sequence[Outcome]) -> Figure:
    """Means with their intervals over hours of work, a panel an outcome."""
    figure = new_figure(PAGE, 2.9, layout="constrained")
    for ax, outcome in zip(figure.subplots(1, len(OUTCOMES)), OUTCOMES, strict=True):
        _draw(ax, [one for one in found if one.outcome == outcome])
        label, top = LABELS[outcome]
        ax.set_ylabel(label)
        ax.set_ylim(0, top)
    handles, labels = figure.axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=len(labels))
    return figure


def _draw(ax: Axes, found: Sequence[Outcome]) -> None:
    """One outcome, a column for each state of knowledge: colour and shape show the noise, hollow is
    randomised."""
    styles, places = noise_styles(NOISES), list(KNOWN)
    for i, noise in enumerate(NOISES):
        for randomised in (False, True):
            mine = [one for one in found if one.condition[1:] == (randomised, noise)]
            aside = (i - 0.5) * NOISE_APART + (randomised - 0.5) * RANDOMISED_APART
            look, name = styles[noise], noise_name(noise) + " noise" + ", randomised" * randomised
            ax.errorbar(
                [places.index(one.condition.known) + aside for one in mine], [one.mean for one in mine],
                yerr=[one.high - one.mean if math.isfinite(one.high) else 0.0 for one in mine],
                fmt=look.marker, color=look.colour, capsize=2, markersize=4, label=name,
                markerfacecolor="none" if randomised else look.colour,
            )  # fmt: skip
    labels = [f"{fill(name, 9)}\n{HOURS[name]:g} h" for name in places]
    ax.set_xticks(range(len(places)), labels, fontsize=6)
    ax.set_xlabel("what the simulation knows of the unit, hours of work")
