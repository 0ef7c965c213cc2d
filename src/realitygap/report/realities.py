"""The matrix of realities: accuracy of each calibrated simulation, and controllers' scores there."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from realitygap.calibration.unit_folder import PROFILE
from realitygap.experiments.folder import RESULTS
from realitygap.experiments.noise.plan import calibration_folder
from realitygap.experiments.realities import ASKED, Place
from realitygap.report.noise.asides import CHANNELS
from realitygap.report.noise.facts import NoiseFacts, Span, gather_facts, points
from realitygap.report.noise.figures import legend, panel
from realitygap.report.noise.report import build_noise_report
from realitygap.report.noise.results import read_results
from realitygap.report.noise.tables import NoiseTable, Number, Row
from realitygap.report.page import Figures, OnProgress, Steps, Words, noise_key, report_folder, write_page
from realitygap.report.style import INK, PAGE, new_figure
from realitygap.robots.address import Address
from realitygap.world.noise import noise_name
from realitygap.world.profile import load_profile

__all__ = ["Reality", "build_realities_report", "matrix", "read_realities", "realities_summary"]

CAPTION = (
    "One column for each reality. Error / noise: the calibrated model's error, on readings that were not "
    "fitted and are neither dark nor saturated, over the noise's deviation there; below it the error in "
    "% of the full scale. Noise: as measured, and the reality's own where its makers state it, counts. "
    "Correspondence, 0 to 10: with the simulation at each level; as evolved: of each level's controllers "
    "with the simulation that they evolved in. Noisiness passes zero: the level at which the simulation is "
    "as noisy as the reality in how the robot turns (< or >: beyond the levels tried)."
)
BY_LEVEL = (
    "Correspondence, and how much noisier the robot's turning is than the simulation's, by the level "
    "compared with: a dot for each controller, lines through the means. Above zero the reality is noisier."
)


FIGURES = {"error_over_noise": ("error / noise", 1, 1.0), "error_over_full_scale": ("% of scale", 2, 0.01),
           "noise": ("noise", 1, 1.0), "own_noise": ("its own", 1, 1.0)}  # fmt: skip
"""For each channel: heading, decimals and unit in the matrix."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Reality:
    """The results of one reality.

    Attributes:
        robot: its address; folder: of its experiment.
        facts: scores by level.
        channels: FIGURES of each recorded one; noise in counts, `own_noise` only if it is stated.
    """

    robot: str
    folder: Path
    facts: NoiseFacts
    channels: Mapping[str, Mapping[str, float]]

    @property
    def name(self) -> str:
        """The displayed name: for a robot of your own the file's name, without its folder."""
        return Path(self.robot).name if Address.parse(self.robot).kind == "own" else self.robot

    @property
    def zero(self) -> str:
        """The zero crossing of noisiness, in words: outside the levels it is "< 0" or "> 2"."""
        curve = self.facts.headline.noisiness
        if math.isfinite(curve.top.value):
            return str(Number(span=curve.top))
        known = curve.means[np.isfinite(curve.means)]
        if not len(known) or (known > 0).any() == (known < 0).any():
            return "–"
        return f"> {curve.levels[-1]:g}" if (known > 0).all() else f"< {curve.levels[0]:g}"

    def to_dict(self) -> dict[str, object]:
        """Ready for JSON."""
        scope = self.facts.headline
        levels = [f"{level:g}" for level in self.facts.data.levels]
        return {
            "robot": self.robot, "folder": str(self.folder), "channels": self.channels,
            "correspondence": dict(zip(levels, scope.curves["a"].means, strict=True)),
            "correspondence_as_evolved": dict(zip(levels, scope.curves["c"].means, strict=True)),
            "noisiness": dict(zip(levels, scope.noisiness.means, strict=True)),
            "noisiness_passes_zero_at": scope.noisiness.top.value,
        }  # fmt: skip


def read_realities(places: Sequence[Place]) -> list[Reality]:
    """The results of all realities that were tried.

    Raises:
        StudyError: results are missing or broken.
    """
    return [_read(place.robot, place.folder) for place in places if not place.why]


def _read(robot: str, folder: Path) -> Reality:
    results = read_results(folder / RESULTS)
    profile, own = load_profile(calibration_folder(folder, 1) / PROFILE), _own_noise(robot)
    channels = {
        one.channel: {
            "error_over_noise": one.ratio, "noise": one.noise, "own_noise": own.get(one.channel, math.nan),
            "error_over_full_scale": one.model_error / profile.channel(one.channel).top,
        }
        for one in results.calibration
    }  # fmt: skip
    return Reality(robot=robot, folder=folder, facts=gather_facts(results.data), channels=channels)


def _own_noise(robot: str) -> dict[str, float]:
    """Published noise of a simulated reality, counts."""
    from realitygap.enki.unit import MODELS
    from realitygap.twin.noise import AMBIENT_COUNTS, PROXIMITY_COUNTS

    address = Address.parse(robot)
    if address.kind == "enki":
        published = load_profile(MODELS[address.rest.partition(":")[0]].profile)
        return {"infrared": published.noise.proximity}
    return (
        {"infrared": PROXIMITY_COUNTS, "ambient": AMBIENT_COUNTS}
        if address.kind in ("twin", "stranger")
        else {}
    )


def matrix(realities: Sequence[Reality]) -> NoiseTable:
    """All realities side by side."""
    levels = [f"{level:g}" for level in realities[0].facts.data.levels]
    some = [channel for channel in CHANNELS if any(channel in one.channels for one in realities)]
    head = [f"{CHANNELS[channel]}: {title}" for channel in some for title, *_ in FIGURES.values()]
    head += [f"corr. at {level}" for level in levels] + [f"as evolved at {level}" for level in levels]
    titles = (*head, "noisiness passes zero")
    columns = [_figures(one, some) for one in realities]
    return NoiseTable(
        name="realities", title=CAPTION, head=("", *(one.name for one in realities)),
        rows=tuple(zip(titles, *columns, strict=True)),
    )  # fmt: skip


def _figures(one: Reality, channels: Sequence[str]) -> Row:
    cells = [
        Number(span=Span(one.channels.get(channel, {}).get(key, math.nan) / unit), places=places)
        for channel in channels for key, (_, places, unit) in FIGURES.items()
    ]  # fmt: skip
    for key in ("a", "c"):
        cells += [Number(span=Span(mean), places=1) for mean in one.facts.headline.curves[key].means]
    return (*cells, one.zero)


def levels_figure(realities: Sequence[Reality]) -> Figure:
    """A column for each reality: correspondence above, noisiness below, by comparison level."""
    figure = new_figure(PAGE, 4.4, layout="constrained")
    axes = figure.subplots(2, len(realities), squeeze=False, sharey="row")
    for (above, below), one in zip(axes.T, realities, strict=True):
        scope, data = one.facts.headline, one.facts.data
        level, score = points(data, "a")
        panel(above, data, level, score, scope.curves["a"])
        panel(below, data, level, data.noisiness.ravel(), scope.noisiness)
        above.set_title(one.name, fontsize=8)
        above.set_ylim(-0.3, 10.3)
        below.axhline(0, color=INK, linewidth=0.8)
        below.set_xlabel("compared with noise")
    axes[0][0].set_ylabel("correspondence score")
    axes[1][0].set_ylabel("noisiness of the reality\n(log2 of the ratio of jitter)")
    legend(figure, axes)
    return figure


def build_realities_report(
    folder: str | Path, places: Sequence[Place], *, on_progress: OnProgress | None = None
) -> Path:
    """Write the page of an experiment on realities into its folder `report/`, and a page of each of them.

    Args:
        folder: the experiment's.
        places: realities that were tried, and those left out.
        on_progress: called with parts done, parts in all, and the name of the next one.

    Raises:
        StudyError: results are missing or broken.
        OSError: a page cannot be written.
    """
    realities, figures = read_realities(places), Figures()
    target, table = report_folder(Path(folder)) / "index.html", matrix(realities)
    step = Steps(on_progress, len(realities) + 2)
    for one in realities:
        step(one.name)
        build_noise_report(one.folder)
    said = Words(f"{BY_LEVEL} The table has the means.", BY_LEVEL)
    figures.add("levels", partial(levels_figure, realities), said)
    levels = {level: noise_name(level) for level in realities[0].facts.data.levels.tolist()}
    facts = {
        "table": table,
        "realities": [(one.name, one.folder.name) for one in realities],
        "left_out": [place for place in places if place.why],
        "cards": figures,
        "key": noise_key(levels),
        "text": (Path(folder) / ASKED).read_text("utf-8"),
    }
    tables = {table.name: table.csv()}
    return write_page(target, "realities.html.j2", figures, facts, step, tables=tables)


def realities_summary(places: Sequence[Place]) -> dict[str, object]:
    """Results of an experiment on realities, ready for JSON."""
    left = [{"robot": place.robot, "why": place.why} for place in places if place.why]
    return {"realities": [one.to_dict() for one in read_realities(places)], "left_out": left}
