"""What a calibration shows: its own page, the section on it in a study's page, and their figures (§3.2.1)."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from functools import partial
from itertools import cycle, product
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from realitygap.calibration.judge import LIMITS, Judgement, judge
from realitygap.calibration.load import load_recording
from realitygap.calibration.recordings import WheelRecording, cylinder_radius
from realitygap.errors import UsageError
from realitygap.report.page import Figures, OnProgress, write_page
from realitygap.report.style import GRID, INK, MUTED, PAGE, new_figure
from realitygap.study.load import Study
from realitygap.values import Floats

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.collections import Collection
    from matplotlib.figure import Figure

    from realitygap.calibration.calibrate import Calibration, ChannelFit
    from realitygap.calibration.law import Law
    from realitygap.calibration.wheels import WheelFit
    from realitygap.world.robot import Profile

__all__ = [
    "REAL", "TITLES", "calibrated_part", "calibration_figures", "curves_figure", "look_of",
    "write_calibration_page",
]  # fmt: skip

TITLES = {"infrared": "Infrared proximity", "ambient": "Ambient light", "wheels": "Wheels"}
REAL = {"infrared": "3.4 to 3.7", "ambient": "3.9"}
"""Model error over noise of fits to a real Khepera's tables of a wall and a lamp, in either form
(`python benchmarks/real_khepera.py`); what simulated robots' errors are to be read beside."""
COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7")
MARKS = ("o", "s", "^", "D")
LINES = ("-", "--", ":")
"""For the curves of the first recording, the second, the third."""
AXES = {
    "bearing": ("bearing of the object off the one that the sensor answers most to, degrees", "counts"),
    "distance": ("distance, cm", "counts"),
    "poses": ("measured, counts", "model, counts"),
}
"""What readings are drawn over (`look_of`)."""
SHOWN = 4
"""Distances whose curves are shown."""
BINS = 12
"""Ranges of a wheel's speed in which the model's error is averaged."""
FEWEST = 20
"""Steps needed in a range for its average to be drawn."""


def write_calibration_page(made: Calibration, target: Path, on_progress: OnProgress | None = None) -> Path:
    """Write the page of a calibration, which stands alone, and return its path."""
    facts = {
        "profile": made.profile, "where": made.profile.provenance, "warnings": made.warnings,
        "channels": made.channels, "wheels": made.wheels, "titles": TITLES, "limits": LIMITS, "real": REAL,
        "look_of": look_of,
    }  # fmt: skip
    return write_page(target, "calibration.html.j2", calibration_figures(made), facts, on_progress)


def calibration_figures(made: Calibration) -> Figures:
    """All figures of a calibration's page by name, not yet drawn."""
    figures = Figures()
    for fit in made.channels:
        what = f"Sensors of {fit.source.split('/')[-1]}"
        figures.add(f"{fit.kind}-curves", partial(curves_figure, fit), f"{what}: measured and fitted.")
        figures.add(f"{fit.kind}-maps", partial(maps_figure, fit), f"{what}: residuals.")
        if fit.measured:
            alt = f"{what}: noise against a normal distribution."
            figures.add(f"{fit.kind}-noise", partial(noise_figure, fit), alt)
    driven = [r for r in made.recordings if isinstance(r, WheelRecording)]
    if made.wheels is not None and driven:
        if made.wheels.rmse:
            draw = partial(steps_figure, made.wheels, driven[0])
            figures.add("wheels-steps", draw, "Speed steps, measured and modelled.")
        if (law := made.wheels.law) is not None and len(law.holds):
            alt = "Settled speed over command, measured and fitted."
            figures.add("wheels-law", partial(law_figure, made.wheels.profile, law), alt)
        if made.wheels.odometry is not None and len(made.wheels.odometry.ways):
            figures.add("wheels-slip", partial(slip_figure, made.wheels), "Camera minus counters.")
    return figures


def calibrated_part(study: Study, figures: Figures) -> dict[str, Any] | None:
    """The section for a study's page: accuracy, and a figure if the recordings are in the study's folder.

    None if the robot's profile was not fitted to recordings.
    """
    if not study.profile.provenance.fits:
        return None
    own, judged, figure = (study.folder / "profile.toml").read_bytes(), list[Judgement](), None
    units = sorted((study.folder / "calibration").glob("*/robot.toml"))
    unit = next((unit.parent for unit in units if unit.read_bytes() == own), study.folder)
    with suppress(UsageError):
        folders = sorted(path for path in unit.glob("recordings/*") if path.is_dir())
        judged = [judge(load_recording(folder), study.profile) for folder in folders]
    if judged:
        draw = partial(errors_figure, judged)
        figure = figures.add("calibration", draw, "Model error over noise, by channel.")
    sensors = [(Path(one.source).name, one) for one in judged if one.kind in LIMITS]
    return {"figure": figure, "sensors": sensors, "titles": TITLES, "limits": LIMITS, "real": REAL}


# Figures


def errors_figure(found: Sequence[Judgement]) -> Figure:
    """A panel a channel: error over noise for each sensor, and the wheels' error over their speed."""
    kinds = [kind for kind in TITLES if any(one.kind == kind for one in found)]
    figure = new_figure(PAGE, 2.4, layout="constrained")
    for kind, ax in zip(kinds, figure.subplots(1, len(kinds), squeeze=False)[0], strict=True):
        here = [one for one in found if one.kind == kind]
        if kind in LIMITS:  # a dot for each sensor and recording, with the line that it should be below
            for one, look in zip(here, cycle("osD^"), strict=False):
                shown = [(m.sensor, m.lit_ratio) for m in one.per_sensor if np.isfinite(m.lit_ratio)]
                name = Path(one.source).name.rpartition("-")[2]
                ax.plot(*np.array(shown).reshape(-1, 2).T, look, ms=4, color=INK, mfc="none", label=name)
            ax.axhline(LIMITS[kind], color=MUTED, lw=1.0, ls=(0, (4, 2)))
            ratios = [m.lit_ratio for one in here for m in one.per_sensor if np.isfinite(m.lit_ratio)]
            top = 1.12 * max([LIMITS[kind], *ratios])
            ax.set(ylim=(0, top), xlabel="sensor", ylabel="model error over noise")
            ax.set_xticks(range(len(here[0].per_sensor)))
        else:
            _wheels(ax, here[0])
        if kind not in LIMITS or len(here) > 1:
            ax.legend(fontsize=6.5)
        ax.set_title(TITLES[kind])
        ax.grid(True, color=GRID, lw=0.5)
    return figure


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


def curves_figure(fit: ChannelFit) -> Figure:
    """Measured dots and fitted curves over bearing or distance, or model against measured, by sensor."""
    live, look = _live(fit), look_of(fit)
    figure, panels = _panels(len(live), *AXES[look])
    for k, axes in zip(live, panels, strict=True):
        if look == "bearing":
            _curves_over_bearing(fit, k, axes)
        elif look == "distance":
            _over_distance(fit, k, axes, left=False)
        else:
            top = fit.profile.channel(fit.kind).top
            axes.plot([0, top], [0, top], color=MUTED, lw=0.8)
            dots = axes.scatter(fit.counts[:, k], fit.model[:, k], s=3, color=COLOURS[0], lw=0, alpha=0.4)
            dots.set_rasterized(True)
            both = np.stack([fit.counts, fit.model])
            ends = float(np.nanmin(both)) - 10, float(np.nanmax(both)) + 10
            axes.set(xlim=ends, ylim=ends)
        axes.set_title(f"sensor {k}")
    if look == "bearing":
        recordings = list(_by_recording(fit))
        for name, line in zip(recordings if recordings[1:] else [], cycle(LINES)):
            panels[0].plot([], [], line, color=INK, lw=1.0, label=_named(name))
        handles, labels = panels[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside upper center", ncols=SHOWN + 2, markerscale=2.5)
    return figure


def maps_figure(fit: ChannelFit) -> Figure:
    """Model minus measured over distance and bearing, a panel a sensor and recording; or over distance."""
    look, live, off = look_of(fit), _live(fit), fit.model - fit.counts
    recordings = _by_recording(fit) if look == "bearing" else {"": np.ones(len(off), bool)}
    pairs = product(recordings, live)
    shown = [(name, k) for name, k in pairs if np.isfinite(off[recordings[name], k]).any()]
    off_by = "model minus measured, counts"
    over = (
        ("distance, cm", off_by) if look == "distance" else ("bearing of the object, degrees", "distance, cm")
    )
    figure, panels = _panels(len(shown), *over)
    scale = max(float(np.nanpercentile(np.abs(off), 99)), 1.0)
    drawn: list[Collection] = []
    for axes, (name, k) in zip(panels, shown, strict=True):
        axes.set_title(f"sensor {k}" + (f"\n{_named(name)}" if len(recordings) > 1 else ""))
        if look == "distance":
            _over_distance(fit, k, axes, left=True)
            continue
        if look == "bearing":
            distance, bearing, table = _table(fit, off[:, k], recordings[name])
            drawn.append(axes.pcolormesh(bearing, distance, table, shading="nearest"))
        else:
            drawn.append(axes.scatter(fit.bearing_deg, fit.distance_cm, c=off[:, k], s=5, lw=0))
        drawn[-1].set(cmap="PuOr", clim=(-scale, scale), rasterized=True)
        axes.set_xticks([-180, -90, 0, 90, 180])
    if drawn:
        figure.colorbar(drawn[-1], ax=panels, shrink=0.8, aspect=30, pad=0.02).set_label(off_by)
    return figure


def noise_figure(fit: ChannelFit) -> Figure:
    """Noise against a normal, and its deviation over the reading."""
    figure = new_figure(PAGE, 2.5, layout="constrained")
    left, right = figure.subplots(1, 2)
    x = np.linspace(-5, 5, 201)
    left.plot(x, np.exp(-(x**2) / 2) / np.sqrt(2 * np.pi), color=INK, lw=1.0, label="normal")
    shown = [estimate for estimate in fit.noise if estimate.channel != "proximity_dark"]
    for estimate, colour, mark in zip(shown, COLOURS, MARKS, strict=False):
        density, edges = np.histogram(estimate.values, bins=np.arange(-5.125, 5.2, 0.25), density=True)
        middle = (edges[1:] + edges[:-1]) / 2
        seen = density > 0
        name = f"{estimate.channel}: {estimate.deviation:.3g} counts"
        left.plot(middle[seen], density[seen], mark, ms=3.5, color=colour, label=name)
        levels, sizes = np.reshape(estimate.bins, (-1, 2)).T
        right.plot(levels, sizes, mark + "-", ms=4, lw=0.8, color=colour)
        right.axhspan(estimate.low, estimate.high, color=colour, alpha=0.15, lw=0)
    left.set(yscale="log", ylim=(1e-4, 2), xlabel="noise, in standard deviations", ylabel="density")
    left.legend(loc="lower center", fontsize=6.5)
    right.set(xlabel="reading, counts", ylabel="deviation, counts")
    if not any(estimate.bins for estimate in shown):
        right.set(xlabel="too few readings to show it by the reading", xticks=[])
    right.set_ylim(0, 1.25 * max([e.high for e in shown] + [s for e in shown for _, s in e.bins]))
    for axes in (left, right):
        axes.grid(True, color=GRID, lw=0.5)
    return figure


def steps_figure(fit: WheelFit, recording: WheelRecording) -> Figure:
    """Step responses of the left wheel: measured dots over the model."""
    trials = [rows for rows in recording.trials("step") if len(rows) > 8][:8] or recording.trials()[:8]
    figure, panels = _panels(len(trials), "time, s", "speed of the left wheel, cm/s")
    for rows, axes in zip(trials, panels, strict=True):
        t = recording.t_s[rows] + recording.period_s
        wheels = fit.profile.wheels
        asked = wheels.proportional(recording.commands[rows])[:, 0] * wheels.speed_per_unit_cm_s[0]
        axes.step(recording.t_s[rows], asked, where="post", color=MUTED, lw=0.8, label="asked for")
        axes.plot(t, fit.model[rows, 0], color=COLOURS[1], lw=1.0, label="model")
        axes.plot(t, fit.measured[rows, 0], "o", ms=2.2, color=COLOURS[0], mew=0, label="measured")
        axes.grid(True, color=GRID, lw=0.5)
        axes.set_title(f"trial {int(recording.trial[rows[0]])}")
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=3)
    return figure


def law_figure(profile: Profile, law: Law) -> Figure:
    """Settled speeds, a dot a hold of a command, and the law that was fitted."""
    figure = new_figure(PAGE, 2.6, layout="constrained")
    axes, wheels = figure.subplots(), profile.wheels
    wheel, command, speed, _ = law.holds.T
    reach = np.abs(command).max()
    asked = np.linspace(-reach, reach, 401)
    settled = wheels.proportional(np.stack([asked, asked], 1)) * np.array(wheels.speed_per_unit_cm_s)
    for w, name in enumerate(("left", "right")):
        axes.plot(asked, settled[:, w], LINES[w], lw=1.0, color=COLOURS[w], label=f"{name} wheel, fitted")
        here, label = wheel == w, f"{name} wheel, measured"
        axes.plot(command[here], speed[here], MARKS[w], ms=3, mew=0, alpha=0.5, color=COLOURS[w], label=label)
    axes.grid(True, color=GRID, lw=0.5)
    axes.set(xlabel="command, the robot's units", ylabel="settled speed, cm/s")
    axes.legend(fontsize=6.5)
    return figure


def slip_figure(fit: WheelFit) -> Figure:
    """The camera's excess over the counters, over the distance between two pictures."""
    assert fit.odometry is not None
    figure = new_figure(PAGE, 2.6, layout="constrained")
    axes = figure.subplots()
    for w, name in enumerate(("left", "right")):
        axes.plot(
            fit.odometry.ways[:, w], 10 * fit.odometry.beyond[:, w], MARKS[w], ms=3, mew=0, color=COLOURS[w],
            label=f"{name} wheel", alpha=0.7,
        )  # fmt: skip
    axes.axhline(0, color=MUTED, lw=0.8)
    axes.grid(True, color=GRID, lw=0.5)
    axes.set(xlabel="way by the counters, cm", ylabel="camera minus counters, mm")
    axes.legend()
    return figure


def _panels(count: int, x: str, y: str) -> tuple[Figure, list[Axes]]:
    """`count` panels, four a row, and the names of their axes."""
    rows = max(1, -(-count // 4))
    figure = new_figure(PAGE, 0.6 + 1.55 * rows, layout="constrained")
    grid = figure.subplots(rows, 4, sharex="all", sharey="all", squeeze=False)
    panels = list(grid.ravel())
    for spare in panels[count:]:
        spare.set_visible(False)
    figure.supxlabel(x, fontsize=8)
    figure.supylabel(y, fontsize=8)
    return figure, panels[:count]


def _live(fit: ChannelFit) -> list[int]:
    return [k for k in range(len(fit.counts[0])) if k not in fit.dead]


def look_of(fit: ChannelFit) -> Literal["bearing", "distance", "poses"]:
    """What readings are drawn over: bearings, if the same were recorded at each of a few distances; distance,
    if each sensor has one bearing in each recording; or nothing (poses all over an arena)."""
    if not np.isfinite(fit.bearing_deg).all():
        return "poses"
    known, parts = np.isfinite(fit.counts), _by_recording(fit).values()
    if all(len(np.unique(fit.bearing_deg[known[:, k] & rows])) <= 1 for k in _live(fit) for rows in parts):
        return "distance"
    places = len(np.unique(np.stack([fit.distance_cm, fit.bearing_deg], 1), axis=0))
    distances, bearings = len(np.unique(fit.distance_cm)), len(np.unique(fit.bearing_deg))
    return "bearing" if distances > 1 and places >= 0.9 * distances * bearings else "poses"


def _by_recording(fit: ChannelFit) -> dict[str, NDArray[np.bool_]]:
    """Rows of each recording by its name."""
    return {str(name): fit.name == name for name in dict.fromkeys(fit.name)}


def _curves_over_bearing(fit: ChannelFit, k: int, axes: Axes) -> None:
    known = np.isfinite(fit.counts[:, k])
    distances = np.unique(fit.distance_cm[known])
    lively = [d for d in distances if np.ptp(fit.counts[known & (fit.distance_cm == d), k]) > 60]
    lively = lively or list(distances)
    picked = [lively[i] for i in np.unique(np.linspace(0, len(lively) - 1, SHOWN).round().astype(int))]
    answer = fit.model[:, k] if fit.kind == "infrared" else fit.model[:, k].max() - fit.model[:, k]
    middle = np.degrees(np.angle(answer @ np.exp(1j * np.radians(fit.bearing_deg))))
    reach = 90 if fit.kind == "infrared" else 180
    turned = (fit.bearing_deg - middle + 180.0) % 360.0 - 180.0
    for distance, colour, mark in zip(picked, COLOURS, MARKS, strict=False):
        at = fit.distance_cm == distance
        name = ("near", "", "", "far")[picked.index(distance)] if len(picked) == SHOWN else ""
        _dots(axes, turned[at], fit.counts[at, k], mark, colour, f"{name} {distance:.1f} cm".strip())
        for rows, line in zip(_by_recording(fit).values(), cycle(LINES)):
            axes.plot(*_means(turned[rows & at], fit.model[rows & at, k]), line, color=colour, lw=1.0)
    axes.set(xlim=(-reach, reach), xticks=(-reach, -reach // 2, 0, reach // 2, reach))
    axes.grid(True, color=GRID, lw=0.5)


def _over_distance(fit: ChannelFit, k: int, axes: Axes, *, left: bool) -> None:
    """Readings and the model's curve, or the residuals if `left`, of each recording with information from a
    sensor."""
    known = np.isfinite(fit.counts[:, k])
    some = {name: rows & known for name, rows in _by_recording(fit).items() if (rows & known).any()}
    for (name, rows), colour, mark in zip(some.items(), cycle(COLOURS), cycle(MARKS)):
        distance, counts, model = fit.distance_cm[rows], fit.counts[rows, k], fit.model[rows, k]
        _dots(axes, distance, model - counts if left else counts, mark, colour, _named(name))
        if not left:
            axes.plot(*_means(distance, model), color=colour, lw=1.0)
    if left:
        axes.axhline(0, color=MUTED, lw=0.8)
    axes.grid(True, color=GRID, lw=0.5)
    axes.legend(fontsize=6, markerscale=2.5)


def _dots(axes: Axes, x: Floats, counts: Floats, mark: str, colour: str, label: str) -> None:
    axes.plot(x, counts, mark, ms=1.6, mew=0, color=colour, alpha=0.7, rasterized=True, label=label)


def _means(x: Floats, values: Floats) -> tuple[Floats, Floats]:
    """The distinct x, and the mean of the values at each."""
    found, i = np.unique(x, return_inverse=True)
    return found, np.bincount(i, values) / np.bincount(i)


def _named(name: str) -> str:
    """An object in words."""
    radius = cylinder_radius(name)
    return f"cylinder of {radius:g} cm" if radius else name


def _table(fit: ChannelFit, values: Floats, rows: NDArray[np.bool_]) -> tuple[Floats, Floats, Floats]:
    """Distances, bearings, and the mean of `values` of those rows at each pair."""
    rows = rows & np.isfinite(values)
    distance, i = np.unique(fit.distance_cm[rows], return_inverse=True)
    bearing, j = np.unique(fit.bearing_deg[rows], return_inverse=True)
    total, many = np.zeros((len(distance), len(bearing))), np.zeros((len(distance), len(bearing)))
    np.add.at(total, (i, j), values[rows])
    np.add.at(many, (i, j), 1)
    return distance, bearing, np.where(many > 0, total / np.maximum(many, 1), np.nan)
