"""The page of a noise experiment, and the one that puts several robots side by side: figures and a table."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple, Self

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from numpy.typing import NDArray

from realitygap.calibration.noise import LIMITS
from realitygap.calibration.unit import PROFILE
from realitygap.errors import StudyError
from realitygap.experiments.experiment import RESULTS
from realitygap.experiments.noise import FIGURES, calibration_folder
from realitygap.experiments.robots import Place, RobotsConfig
from realitygap.files import read_table, read_toml, to_csv
from realitygap.report import style
from realitygap.report.calibration import REAL
from realitygap.report.evolution import mean_of
from realitygap.report.page import Figures, OnProgress, report_folder, write_page
from realitygap.report.scores import PAPER_ROWS
from realitygap.report.style import INK, MUTED, PAGE, new_figure, noise_key, noise_styles, number
from realitygap.robots.address import Address
from realitygap.tasks import load_task
from realitygap.values import Floats
from realitygap.world.robot import load_profile, noise_name

__all__ = [
    "NoiseData", "build_noise_page", "build_robots_page", "matrix", "noise_summary", "noise_table",
    "read_robots",
]  # fmt: skip

FEWEST = 3
"""Runs for an interval."""
FAILED = 6.0
"""Below this score a controller did something else on the robot than in simulation: "hit or miss" (§6.1)."""
AGAIN = "Let the experiment finish (realitygap experiment noise --resume), or copy its results again."
READINGS = {
    "a real Khepera (readings only)": {
        "infrared": (REAL["infrared"], "8.0 to 8.7", "23.8"), "ambient": (REAL["ambient"], "4.1", "4.3"),
    },
    "a real Thymio II (readings only)": {"infrared": ("10.8", "1.8", "7.4")},
}  # fmt: skip
"""Of real robots' published readings: model error over noise, error in % of scale, noise (counts)."""
CHANNELS = {"infrared": "proximity", "ambient": "ambient light"}

_HEAT = LinearSegmentedColormap.from_list("scores", ["#fdfdfc", "#56b4e9", "#0072b2", "#00304b"])
_DARK = 0.6
"""Share of the scale from which a cell's number is white."""


class Span(NamedTuple):
    """A mean with its 95 % interval over runs (Student's t); NaN for too few of them."""

    value: float
    low: float = math.nan
    high: float = math.nan

    @classmethod
    def of(cls, values: Floats) -> Self:
        """Of the known ones of some values."""
        known = values[np.isfinite(values)]
        mean = mean_of(known)
        if mean is None or len(known) < FEWEST:
            return cls(math.nan if mean is None else mean.value)
        return cls(mean.value, mean.value - mean.half, mean.value + mean.half)

    def within(self, low: float, high: float) -> Self:
        """The interval cut at a scale's ends."""
        return type(self)(self.value, max(self.low, low), min(self.high, high))

    def text(self, places: int = 2, scale: float = 1.0) -> str:
        """As displayed: 8.5 (8.1 to 8.9)."""
        value, low, high = (_number(v / scale, places) for v in self)
        return value if math.isnan(self.low) else f"{value} ({low} to {high})"


def _means(values: Floats) -> Floats:
    """Means of the known values along the first axis; NaN where none is known."""
    known = np.isfinite(values).sum(axis=0)
    sums = np.nansum(values, axis=0)
    means: Floats = np.divide(sums, known, out=np.full_like(sums, np.nan), where=known > 0)
    return means


def _number(value: float, places: int) -> str:
    return "–" if math.isnan(value) else number(value, places)


@dataclass(frozen=True, kw_only=True, eq=False)
class NoiseData:
    """The results of a noise experiment: n controllers, compared at L levels.

    Attributes:
        levels: [L], rising.
        task, evolved, simulated, situated: [n]; the last two are fitness at the own level and on the robot.
        score: [n, L], correspondence score 0 to 10 against the simulation at each level.
        noisiness: [n, L], positive if the robot's turning is noisier than the simulation's at that level.
        ratios, noises: model error over noise, and noise (counts), of each unit, by channel.
        settings: as in study.toml.
    """

    levels: Floats
    task: NDArray[np.str_]
    evolved: Floats
    simulated: Floats
    situated: Floats
    score: Floats
    noisiness: Floats
    ratios: Mapping[str, Floats]
    noises: Mapping[str, Floats]
    settings: Mapping[str, Any]

    @classmethod
    def read(cls, out: str | Path) -> Self:
        """From a finished experiment's folder.

        Raises:
            StudyError: its results are missing or broken: names the file and the line.
        """
        folder = Path(out) / RESULTS
        settings = read_toml(
            folder / "study.toml", StudyError, f"It holds the results. {AGAIN}", broken=AGAIN
        )
        levels = np.array(sorted(map(float, settings["levels"])))
        whole = ("task", "run", "evolved_level")
        needs = [*whole, "fitness_simulated", "fitness_situated"]
        rows = read_table(folder / "controllers.csv", StudyError, needs=needs, cure=AGAIN)
        cells = read_table(
            folder / "cells.csv", StudyError, needs=[*whole, "comparison_level", *FIGURES], cure=AGAIN
        )
        if not rows.rows or len(cells.rows) != len(rows.rows) * len(levels):
            raise StudyError(
                f"{cells.path}: expected each controller of controllers.csv at every level. {AGAIN}"
            )
        fits = read_table(
            folder / "calibration.csv", StudyError, needs=["channel", "ratio", "noise"], cure=AGAIN
        )
        channels = np.array(fits.texts("channel"))
        by = {key: fits.numbers(key, empty=True) for key in ("ratio", "noise")}
        known = {c: np.isfinite(by["ratio"]) & (channels == c) for c in CHANNELS if c in channels}
        shape = (len(rows.rows), len(levels))  # written controller by controller, level by level
        return cls(
            levels=levels,
            task=np.array(rows.texts("task")),
            evolved=rows.numbers("evolved_level"),
            simulated=rows.numbers("fitness_simulated", empty=True),
            situated=rows.numbers("fitness_situated", empty=True),
            score=cells.numbers("score", empty=True).reshape(shape),
            noisiness=cells.numbers("noisiness", empty=True).reshape(shape),
            ratios={c: by["ratio"][rows_of] for c, rows_of in known.items()},
            noises={c: by["noise"][rows_of] for c, rows_of in known.items()},
            settings=settings,
        )

    @property
    def tasks(self) -> list[str]:
        """In order of appearance."""
        return list(dict.fromkeys(self.task.tolist()))

    @property
    def robot(self) -> int:
        """Place of the robot's own level, 1, or the one nearest to it (by roots)."""
        return int(np.abs(np.sqrt(self.levels) - 1.0).argmin())

    @property
    def own(self) -> Floats:
        """[n] scores against the simulation at the level at which each controller evolved (the diagonal)."""
        places = np.abs(self.evolved[:, None] - self.levels).argmin(axis=1)
        diagonal: Floats = self.score[np.arange(len(self.score)), places]
        return diagonal

    def part(self, task: str) -> Self:
        """One task's controllers."""
        names = ("task", "evolved", "simulated", "situated", "score", "noisiness")
        return replace(self, **{name: getattr(self, name)[self.task == task] for name in names})

    def at(self, level: float) -> NDArray[np.bool_]:
        """[n] which evolved at a level; tables hold five digits."""
        found: NDArray[np.bool_] = np.isclose(self.evolved, level, rtol=1e-4)
        return found

    @property
    def matched(self) -> float:
        """The noise-matched level, where mean noisiness passes zero, linear in the level's root; or NaN."""
        curve, root = _means(self.noisiness), np.sqrt(self.levels)
        below = np.flatnonzero((curve[:-1] > 0) & (curve[1:] <= 0))
        if not len(below):
            return math.nan
        i = int(below[0])
        return float((root[i] + curve[i] / (curve[i] - curve[i + 1]) * (root[i + 1] - root[i])) ** 2)

    @property
    def matched_text(self) -> str:
        """The same in words, also beyond the levels."""
        curve = _means(self.noisiness)
        if math.isfinite(self.matched):
            return _number(self.matched, 2)
        if (curve > 0).all() or (curve < 0).all():
            return f"> {self.levels[-1]:g}" if curve[0] > 0 else f"< {self.levels[0]:g}"
        return "–"


Table = tuple[Sequence[str], Sequence[Sequence[str]]]
"""A table's head and rows, of texts."""


def _spans(part: NoiseData, level: float) -> tuple[dict[str, Span], int]:
    """Means of a task's controllers that evolved at a level, by their names; and their number."""
    at = part.at(level)
    drop = part.simulated - part.situated
    scores = {"score": part.score[:, part.robot], "score_at_own_level": part.own}
    fitness = {"fitness_simulated": part.simulated, "fitness_situated": part.situated, "drop": drop}
    spans = {key: Span.of(values[at]).within(0, 10) for key, values in scores.items()}
    return spans | {key: Span.of(values[at]) for key, values in fitness.items()}, int(at.sum())


def noise_table(data: NoiseData) -> Table:
    """A row for each task and evolved level."""
    level, rows = f"{data.levels[data.robot]:g}", []
    for task in data.tasks:
        part, unit = data.part(task), load_task(task).fitness_scale
        for evolved in data.levels.tolist():
            spans, count = _spans(part, evolved)
            score, own, *fitness = spans.values()
            judged = part.score[part.at(evolved), part.robot]
            failed = 100 * float(_means(np.where(np.isnan(judged), np.nan, judged < FAILED)))
            texts = [*(one.text(1) for one in (score, own)), _number(failed, 0)]
            texts += [one.text(3, unit) for one in fitness]
            rows.append([task, f"{evolved:g}", str(count), *texts])
    head = (
        "task", "evolved at", "runs", f"score at {level}", "score at own level", "failures, %",
        "fitness, simulated", "fitness on the robot", "drop",
    )  # fmt: skip
    return head, rows


# Figures


def _titled(task: str) -> str:
    return task.replace("-", " ").capitalize()


def map_figure(data: NoiseData) -> Figure:
    """Mean score of every cell, evolved by compared level; the diagonal is framed, the robot's level bold."""
    tasks, count = data.tasks, len(data.levels)
    figure = new_figure(min(PAGE, 3.4 * len(tasks)), 3.1, layout="constrained")
    parts = [data.part(task) for task in tasks]
    every = [np.array([_means(p.score[p.at(level)]) for level in p.levels]) for p in parts]
    low = np.floor(np.nanmin(every))
    high = max(np.ceil(np.nanmax(every)), low + 1)
    labels, ticks = [f"{level:g}" for level in data.levels], np.arange(count) + 0.5
    for ax, task, means in zip(figure.subplots(1, len(tasks), squeeze=False)[0], tasks, every, strict=True):
        ax.pcolormesh(np.arange(count + 1), np.arange(count + 1), means, cmap=_HEAT, vmin=low, vmax=high)
        for i, j in np.ndindex(means.shape):
            colour = "#ffffff" if means[i, j] >= low + _DARK * (high - low) else "#1b1d22"
            text = _number(float(means[i, j]), 1)
            ax.text(j + 0.5, i + 0.5, text, ha="center", va="center", color=colour, fontsize=8)
        for i in range(count):
            frame = Rectangle((i + 0.05, i + 0.05), 0.9, 0.9, fill=False, edgecolor="#d55e00", linewidth=1.3)
            ax.add_patch(frame)
        ax.set(xticks=ticks, yticks=ticks, xlabel="noise compared with", title=_titled(task))
        ax.set_xticklabels(labels)
        ax.set_yticklabels(labels)
        for names in (ax.get_xticklabels(), ax.get_yticklabels()):
            names[data.robot].set_fontweight("bold")
        ax.set_aspect("equal")
        ax.tick_params(length=0)
        ax.spines[["left", "bottom"]].set_visible(False)
    figure.axes[0].set_ylabel("noise evolved under")
    return figure


def scores_figure(data: NoiseData) -> Figure:
    """A row a task: score by comparison level, by evolved level, and at the own level."""
    figure = new_figure(PAGE, 2.35 * len(data.tasks) + 0.35, layout="constrained")
    axes = figure.subplots(len(data.tasks), 3, squeeze=False, sharey=True)
    for row, task in zip(axes, data.tasks, strict=True):
        part = data.part(task)
        columns = [(level, part.score[:, k]) for k, level in enumerate(part.levels)]
        _panel(row[0], part, columns)
        _panel(row[1], part, _by_evolved(part, part.score[:, part.robot]))
        _panel(row[2], part, _by_evolved(part, part.own))
        paper = PAPER_ROWS.get(task, {})
        means = [np.mean([one.correspondence for one in rows]) for rows in paper.values()]
        row[2].plot(
            np.sqrt([*paper]), means, "*", markersize=9, markerfacecolor="#e69f00", markeredgecolor=INK,
            markeredgewidth=0.6, zorder=6, label="the paper's averages (by eye)",
        )  # fmt: skip
        row[0].set_ylabel(f"{_titled(task)}\ncorrespondence score")
        row[0].set_ylim(-0.3, 10.3)
    level = f"{data.levels[data.robot]:g}"
    titles = ("all, by comparison level", f"by evolved level, compared at {level}", "each at its own level")
    labels = ("noise of the simulation", "noise evolved under", "noise evolved under")
    for k in range(3):
        axes[0][k].set_title(titles[k])
        axes[-1][k].set_xlabel(labels[k])
    _legend(figure)
    return figure


def fitness_figure(data: NoiseData, who: str) -> Figure:
    """Two panels a task: fitness in simulation and on the robot, and its drop, by evolved level."""
    figure = new_figure(PAGE, 2.2 * len(data.tasks) + 0.35, layout="constrained")
    axes = figure.subplots(len(data.tasks), 2, squeeze=False)
    for (both, drop), task in zip(axes, data.tasks, strict=True):
        part, known = data.part(task), load_task(task)
        unit = f" ({known.fitness_unit})" if known.fitness_unit else ""
        scale = known.fitness_scale
        _panel(both, part, _by_evolved(part, part.situated / scale), f"on the {who}", aside=0.012)
        _bars(both, _by_evolved(part, part.simulated / scale), "simulated", marker="s", line=(0, (2, 1)),
              aside=-0.012)  # fmt: skip
        _panel(drop, part, _by_evolved(part, (part.simulated - part.situated) / scale))
        drop.axhline(0, color=MUTED, linewidth=0.7)
        both.set(ylabel=f"{_titled(task)}\nfitness{unit}", xlabel="noise evolved under")
        drop.set(ylabel=f"drop in fitness{unit}", xlabel="noise evolved under")
    _legend(figure)
    return figure


def noisiness_figure(data: NoiseData, who: str) -> Figure:
    """A panel a task: how much noisier the robot's turning is than the simulation's at each level."""
    figure = new_figure(PAGE, 2.6, layout="constrained")
    for ax, task in zip(figure.subplots(1, len(data.tasks), squeeze=False)[0], data.tasks, strict=True):
        part = data.part(task)
        _noisiness(ax, part)
        ax.set_title(_titled(task))
    figure.axes[0].set_ylabel(f"noisiness of the {who}\n(log2 of the ratio of jitter)")
    _legend(figure)
    return figure


def robots_figure(robots: Mapping[str, NoiseData]) -> Figure:
    """A column for each robot: correspondence above, noisiness below, by comparison level."""
    figure = new_figure(PAGE, 4.4, layout="constrained")
    axes = figure.subplots(2, len(robots), squeeze=False, sharey="row")
    for (above, below), (name, data) in zip(axes.T, robots.items(), strict=True):
        _panel(above, data, [(level, data.score[:, k]) for k, level in enumerate(data.levels)])
        _noisiness(below, data)
        above.set_title(name)
        above.set_ylim(-0.3, 10.3)
    axes[0][0].set_ylabel("correspondence score")
    axes[1][0].set_ylabel("noisiness of the robot\n(log2 of the ratio of jitter)")
    _legend(figure)
    return figure


Columns = Sequence[tuple[float, Floats]]
"""Levels, and the values at each."""


def _by_evolved(data: NoiseData, values: Floats) -> Columns:
    return [(level, values[data.at(level)]) for level in data.levels.tolist()]


def _panel(
    ax: Axes, data: NoiseData, columns: Columns, label: str = "mean, 95 %", aside: float = 0.0
) -> None:
    """A dot for each controller, and the means with intervals, over the level's root, which spreads small
    levels."""
    looks = noise_styles(data.levels.tolist())
    for level, values in columns:
        known, look = values[np.isfinite(values)], looks[level]
        spread = 0.05 + 0.08 * np.modf(np.arange(len(known)) * 0.618034)[0]  # so that none hides another
        ax.plot(np.sqrt(level) + spread, known, look.marker, color=look.colour, markersize=2, alpha=0.55,
                markeredgewidth=0, zorder=2)  # fmt: skip
    ax.set_xticks(np.sqrt(data.levels), [f"{level:g}" for level in data.levels])
    ax.axvline(np.sqrt(data.levels[data.robot]), color=MUTED, linewidth=0.7, linestyle=(0, (1, 2)), zorder=1)
    ax.grid(axis="y")
    ax.set_axisbelow(True)
    _bars(ax, columns, label, aside=aside)


def _noisiness(ax: Axes, data: NoiseData) -> None:
    _panel(ax, data, [(level, data.noisiness[:, k]) for k, level in enumerate(data.levels)])
    ax.axhline(0, color=INK, linewidth=0.8)
    ax.set_xlabel("noise of the simulation")


def _bars(
    ax: Axes, columns: Columns, label: str, *, marker: str = "o", line: Any = "-", aside: float = 0.0
) -> None:
    """Means joined by a line, with their intervals."""
    value, _, high = np.array([Span.of(values) for _, values in columns]).T
    ax.errorbar(
        np.sqrt([level for level, _ in columns]) + aside, value, yerr=np.nan_to_num(high - value), color=INK,
        marker=marker, markersize=4, capsize=2, linewidth=1.4, elinewidth=1, linestyle=line, label=label,
        zorder=5, markerfacecolor=style.PAPER,
    )  # fmt: skip


def _legend(figure: Figure) -> None:
    """One legend, below, of what all panels name."""
    found: dict[str, Any] = {}
    for ax in figure.axes:
        found |= dict(zip(*reversed(ax.get_legend_handles_labels()), strict=True))
    figure.legend(list(found.values()), list(found), loc="outside lower center", ncols=len(found))


# Pages


def build_noise_page(out: str | Path, *, on_progress: OnProgress | None = None) -> Path:
    """Write the page of a finished noise experiment into its folder `report/`; return its path.

    Raises:
        StudyError: results are missing or broken: names the file and the line.
    """
    data, figures = NoiseData.read(out), Figures()
    who, (head, rows) = "robot" if "robot" in data.settings else "twin", noise_table(data)
    for name, draw, alt in (
        ("noise-map", partial(map_figure, data), "Mean correspondence by evolved and compared level"),
        ("noise-scores", partial(scores_figure, data), "Correspondence score by level"),
        ("noise-fitness", partial(fitness_figure, data, who), "Fitness and its drop by evolved level"),
        ("noise-noisiness", partial(noisiness_figure, data, who), "Noisiness by compared level"),
    ):
        figures.add(name, draw, f"{alt}. The table has the figures.")
    facts = {
        "data": data, "settings": data.settings, "cards": figures, "key": _key(data), "head": head,
        "rows": rows, "failed": FAILED,
        "matched": [(_titled(task), data.part(task).matched_text) for task in data.tasks],
        "misfits": _misfits(data), "real": REAL, "who": who,
        "text": (Path(out) / RESULTS / "study.toml").read_text("utf-8"),
    }  # fmt: skip
    tables = {"levels": to_csv([head, *rows])}
    target = report_folder(Path(out)) / "index.html"
    return write_page(target, "noise.html.j2", figures, facts, on_progress, tables=tables)


def _key(data: NoiseData) -> list[tuple[str, str, str]]:
    names = {level: noise_name(level) for level in data.levels.tolist()}
    return noise_key({v: n if n == f"{v:g}" else f"{n} ({v:g})" for v, n in names.items()})


def _misfits(data: NoiseData) -> list[dict[str, Any]]:
    """Of each channel the median of model error over noise, and how many units are beyond the limit."""
    return [
        {
            "channel": CHANNELS[channel], "median": float(np.median(ratios)),
            "units_beyond_limit": int((ratios > LIMITS[channel]).sum()), "units": len(ratios),
            "limit": LIMITS[channel],
        }
        for channel, ratios in data.ratios.items() if len(ratios)
    ]  # fmt: skip


def noise_summary(data: NoiseData) -> dict[str, Any]:
    """The findings of a finished noise experiment, ready for JSON."""
    found = {}
    for task in data.tasks:
        part = data.part(task)
        rows = []
        for level in part.levels.tolist():
            spans, count = _spans(part, level)
            means = _means(part.score[part.at(level)]).tolist()
            by_level = {f"{k:g}": v for k, v in zip(part.levels, means, strict=True)}
            known = {key: span._asdict() for key, span in spans.items()}
            rows.append({"evolved_level": level, "runs": count, **known, "score_by_level": by_level})
        found[task] = {"levels": rows, "noise_matched_level": part.matched}
    return {"robot_level": float(data.levels[data.robot]), "settings": dict(data.settings), "tasks": found,
            "model_error_over_noise": _misfits(data)}  # fmt: skip


# Several robots


def _named(place: Place) -> str:
    """The displayed name: for a robot of your own the file's name, without its folder."""
    return Path(place.robot).name if Address.parse(place.robot).kind == "own" else place.robot


def read_robots(places: Sequence[Place]) -> dict[str, NoiseData]:
    """The results of all robots that were tried, by name."""
    return {_named(place): NoiseData.read(place.folder) for place in places if not place.why}


def _own_noise(robot: str) -> dict[str, float]:
    """Published noise of a simulated robot, counts."""
    from realitygap.robots.enki import MODELS
    from realitygap.twin.noise import AMBIENT_COUNTS, PROXIMITY_COUNTS

    address = Address.parse(robot)
    if address.kind == "enki":
        return {"infrared": load_profile(MODELS[address.rest.partition(":")[0]].profile).noise.proximity}
    twins = {"infrared": PROXIMITY_COUNTS, "ambient": AMBIENT_COUNTS}
    return twins if address.kind in ("twin", "stranger") else {}


def _share(place: Place, channel: str) -> float:
    """Model error of unit 1 over the sensor's full scale; NaN if the channel is not calibrated."""
    profile = load_profile(calibration_folder(place.folder, 1) / PROFILE)
    errors = [fit.model_error for fit in profile.provenance.fits if fit.channel == channel]
    return errors[0] / profile.channel(channel).top if errors else math.nan


def matrix(places: Sequence[Place], robots: Mapping[str, NoiseData], *, few: bool) -> Table:
    """All robots side by side, and the real tables beside them; means of scores unless runs are too `few`."""
    tried = [place for place in places if not place.why]
    levels = [f"{level:g}" for level in next(iter(robots.values())).levels]
    beside = ["–"] * len(READINGS)
    rows: dict[str, list[str]] = {}
    for channel, name in CHANNELS.items():
        if not any(channel in data.ratios for data in robots.values()):
            continue
        ratios, noises = (
            [_number(getattr(data, key).get(channel, [math.nan])[0], 1) for data in robots.values()]
            for key in ("ratios", "noises")
        )
        shares = [_number(100 * _share(one, channel), 1) for one in tried]
        own = [_number(_own_noise(one.robot).get(channel, math.nan), 1) for one in tried]
        real = list(zip(*(known.get(channel, ("–",) * 3) for known in READINGS.values()), strict=True))
        rows[f"{name}: error / noise"] = [*ratios, *real[0]]
        rows[f"{name}: error, % of scale"] = [*shares, *real[1]]
        rows[f"{name}: noise, counts"] = [*noises, *real[2]]
        rows[f"{name}: its own noise"] = [*own, *beside]
    if not few:
        for k, level in enumerate(levels):
            means = [Span.of(data.score[:, k]).value for data in robots.values()]
            rows[f"score at {level}"] = [*(_number(v, 1) for v in means), *beside]
        for level in levels:
            means = [Span.of(data.own[data.at(float(level))]).value for data in robots.values()]
            rows[f"as evolved at {level}"] = [*(_number(v, 1) for v in means), *beside]
    rows["noise-matched level"] = [*(data.matched_text for data in robots.values()), *beside]
    return ["", *robots, *READINGS], [[name, *row] for name, row in rows.items()]


def build_robots_page(
    folder: str | Path, places: Sequence[Place], robots: Mapping[str, NoiseData], *, few: bool,
    on_progress: OnProgress | None = None,
) -> Path:  # fmt: skip
    """Write the page of an experiment on several robots into its folder `report/`, and each one's own; `few`
    is as of `matrix`.

    Raises:
        StudyError: results are missing or broken.
    """
    figures, (head, rows) = Figures(), matrix(places, robots, few=few)
    for place in places:
        if not place.why:
            build_noise_page(place.folder)
    alt = "Correspondence and noisiness on each robot, by compared level. The table has the means."
    figures.add("levels", partial(robots_figure, robots), alt)
    facts = {
        "head": head, "rows": rows, "few": few,
        "robots": {_named(one): one.folder.name for one in places if not one.why},
        "left_out": [place for place in places if place.why], "cards": figures,
        "key": _key(next(iter(robots.values()))),
        "text": (Path(folder) / RobotsConfig.FILE).read_text("utf-8"),
    }  # fmt: skip
    target = report_folder(Path(folder)) / "index.html"
    tables = {"robots": to_csv([head, *rows])}
    return write_page(target, "robots.html.j2", figures, facts, on_progress, tables=tables)
