"""The section of a study's page on the calibration behind its simulation (§3.2.1)."""

from collections.abc import Sequence
from functools import partial
from itertools import cycle
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from realitygap.calibration.judge import LIMITS, Judgement, judge
from realitygap.calibration.load import load_recording
from realitygap.errors import UsageError
from realitygap.report.calibration import REAL
from realitygap.report.lead import twin_unit
from realitygap.report.page import Figures, Words
from realitygap.report.style import GRID, INK, MUTED, PAGE, new_figure
from realitygap.study.load import Study
from realitygap.world.robot import Profile

__all__ = ["calibrated_part"]

CHANNELS = {"infrared": "infrared proximity", "ambient": "ambient light", "wheels": "wheels"}
UNITS = {"infrared": "counts", "ambient": "counts", "wheels": "cm/s"}
BINS = 12
"""Number of ranges of a wheel's speed in which the model's error is averaged."""
FEWEST = 20
"""Steps needed in a range for its average to be drawn."""


def calibrated_part(study: Study, figures: Figures) -> dict[str, object] | None:
    """The section for a study's page: source, accuracy, and a figure if the recordings are available.

    None if the robot's profile was not fitted to recordings.
    """
    where = study.profile.provenance
    if not where.fits:
        return None
    rows = []
    for fit in where.fits:
        values = (fit.rmse, fit.held_out_rmse, fit.model_error, fit.noise)
        places = 3 if fit.channel == "wheels" else 1
        over = fit.ratio > LIMITS.get(fit.channel, np.inf)
        rows.append([
            CHANNELS.get(fit.channel, fit.channel), fit.form, UNITS.get(fit.channel, ""),
            *(f"{value:.{places}f}" if value else "–" for value in values),
            f"{fit.ratio:.2f}{' ▲' if over else ''}" if fit.ratio else "–",
        ])  # fmt: skip
    found = _judged(study)
    figure = None
    if found:
        caption = (
            "The calibrated model’s own error over the noise’s deviation, sensor by sensor; above the broken "
            "line model error exceeds noise. Right: how much faster the model’s wheels turn "
            "than the robot’s, in twelve parts of their range."
        )
        words = Words("Model error over noise, by channel.", caption)
        figure = figures.add("calibration", partial(_errors_figure, found), words)
    return {
        "said": _said(study, bool(found)), "rows": rows, "figure": figure, "real": _real(study.profile),
        "sensors": [_ratios(one) for one in found if one.kind in LIMITS],
        "limits": " and ".join(f"{value:g} for {CHANNELS[kind]}" for kind, value in LIMITS.items()),
    }  # fmt: skip


def _real(profile: Profile) -> str:
    """How accurate such a fit is for a real robot; nothing beside that robot's own profile."""
    ratios = " and ".join(f"{ratio} in {CHANNELS[channel]}" for channel, ratio in REAL.items())
    beside = f"On the tables of a real Khepera the error over noise is {ratios}."
    counted = "Counted on places held out, where readings are neither dark nor saturated."
    return counted if profile.name == "khepera" else f"{beside} {counted}"


def _said(study: Study, kept: bool) -> str:
    """The source of the constants, in words."""
    profile = study.profile
    where = profile.provenance
    unit = twin_unit(profile)
    robot = (
        f"unit {unit} of the twin, a physics stand-in for the robot (pseudo-reality), through its serial line"
        if unit
        else f"the robot of profile {profile.name}"
    )
    readings = sum(int(file.readings) for file in where.files)
    return (
        f"The simulation’s constants were fitted to {len(where.files)} recordings "
        f"({readings:,} values) of {robot}.".replace(",", "\u202f", 1)
        + (" The recordings are in the study’s folder." if kept else "")
    )


def _judged(study: Study) -> list[Judgement]:
    """The study's profile judged by its own recordings, if it has them."""
    home = study.folder / "calibration"
    own = (study.folder / "profile.toml").read_bytes()
    for unit in sorted(home.glob("*/robot.toml")):
        if unit.read_bytes() != own:
            continue
        folders = sorted(path for path in unit.parent.glob("recordings/*") if path.is_dir())
        try:
            return [judge(load_recording(folder), study.profile) for folder in folders]
        except UsageError:
            return []
    return []


def _ratios(one: Judgement) -> list[str]:
    """A recording's model error over noise, sensor by sensor."""
    limit = LIMITS[one.kind]
    name = Path(one.source).name.replace("-", ", ")
    return [name, *(f"{m.lit_ratio:.2f}{' ▲' if m.lit_ratio > limit else ''}" for m in one.per_sensor)]


def _errors_figure(found: Sequence[Judgement]) -> Figure:
    """A panel a channel: error over noise for each sensor, and the wheels' error over their speed."""
    kinds = [kind for kind in CHANNELS if any(one.kind == kind for one in found)]
    figure = new_figure(PAGE, 2.4, layout="constrained")
    for kind, ax in zip(kinds, figure.subplots(1, len(kinds), squeeze=False)[0], strict=True):
        here = [one for one in found if one.kind == kind]
        if kind in LIMITS:
            _sensors(ax, here, LIMITS[kind])
        else:
            _wheels(ax, here[0])
        ax.set_title(CHANNELS[kind])
        ax.grid(True, color=GRID, lw=0.5)
    return figure


def _sensors(ax: Axes, here: Sequence[Judgement], limit: float) -> None:
    """A dot for each sensor and recording, with the line that it should be below."""
    for one, look in zip(here, cycle("osD^"), strict=False):
        shown = [(m.sensor, m.lit_ratio) for m in one.per_sensor if np.isfinite(m.lit_ratio)]
        name = Path(one.source).name.rpartition("-")[2]
        ax.plot(*np.array(shown).reshape(-1, 2).T, look, ms=4, color=INK, mfc="none", label=name)
    ax.axhline(limit, color=MUTED, lw=1.0, ls=(0, (4, 2)))
    top = max([limit, *(m.lit_ratio for one in here for m in one.per_sensor if np.isfinite(m.lit_ratio))])
    ax.set(ylim=(0, 1.12 * top), xlabel="sensor", ylabel="model error over noise")
    ax.set_xticks(range(len(here[0].per_sensor)))
    if len(here) > 1:
        ax.legend(fontsize=6.5)


def _wheels(ax: Axes, one: Judgement) -> None:
    """The mean error of each wheel in ranges of its speed."""
    ax.axhline(0, color=MUTED, lw=0.8)
    edges = np.linspace(one.model.min(), one.model.max(), BINS + 1)
    for wheel, (name, look) in enumerate((("left", "o"), ("right", "s"))):
        speed, off = one.model[:, wheel], one.model[:, wheel] - one.counts[:, wheel]
        part = np.clip(np.digitize(speed, edges) - 1, 0, BINS - 1)
        parts = [k for k in range(BINS) if (part == k).sum() >= FEWEST]
        means = [(speed[part == k].mean(), off[part == k].mean()) for k in parts]
        x, y = np.array(means).reshape(-1, 2).T
        ax.plot(x, y, look, ls="-", lw=0.8, ms=3, color=INK, mfc="none", label=name)
    ax.set(xlabel="speed, cm/s", ylabel="model − measured, cm/s")
    ax.legend(fontsize=6.5)
