"""Notebook displays of studies, runs, calibrations, robots, arenas and networks."""

from __future__ import annotations

import base64
import html
import math
import os
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from markupsafe import Markup
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from realitygap.control.genotype import Genotype
from realitygap.errors import NoSuchNameError, StudyError
from realitygap.files import atomic_write
from realitygap.report.build import figures_of
from realitygap.report.calibration import calibration_figures, write_calibration_page
from realitygap.report.drawing import robot_figure, room_figure
from realitygap.report.drive import Driven, drive_json
from realitygap.report.evolution import WHO, Paths, mean_of, parts_of, unit_of
from realitygap.report.network import network_figure
from realitygap.report.page import Figures, rendered
from realitygap.report.player import player_data, player_json, replay_data
from realitygap.report.style import save_figure, styled
from realitygap.report.transfers import pairs_of
from realitygap.simulation.simulation import Simulation
from realitygap.study.load import Run, Study
from realitygap.values import Pose
from realitygap.world.arena import Arena
from realitygap.world.robot import Profile, load_profile

if TYPE_CHECKING:
    from realitygap.calibration.calibrate import Calibration

__all__ = [ "arena_html", "network_html", "of_calibration", "of_study", "profile_html",
    "replayed", "run_html", "shown_calibration", "shown_study", "study_html",
]  # fmt: skip

NEW = "champion’s test score (mean of new trials ± 95 % interval)"
NO_DRIVE = Markup("")
MOST_ROWS = 30
"""Runs shown in a study's table."""


class Shown:
    """A self-contained page in a notebook's cell, in an isolated frame so many pixels high."""

    def __init__(self, page: str, height: int) -> None:
        self.html, self.height = page, height

    def save(self, path: str | Path) -> None:
        """Write the page to a file."""
        atomic_write(path, self.html)

    def _repr_html_(self) -> str:
        style = f"width: 100%; height: {self.height}px; border: 0; resize: vertical; overflow: auto"
        return f'<iframe sandbox="allow-scripts" style="{style}" srcdoc="{html.escape(self.html)}"></iframe>'


class Gallery(Mapping[str, Figure]):
    """The figures of a page by name, each drawn by Matplotlib when first needed."""

    def __init__(self, figures: Figures) -> None:
        self._figures = figures

    def __getitem__(self, name: str) -> Figure:
        if name not in self._figures:
            raise NoSuchNameError("figures", name, self)
        if "inline" in os.environ.get("MPLBACKEND", ""):  # shows figures once it is loaded
            import matplotlib.pyplot

            matplotlib.pyplot.switch_backend(os.environ["MPLBACKEND"])
        with styled():
            return self._figures[name].draw()

    def __iter__(self) -> Iterator[str]:
        return iter(self._figures)

    def __len__(self) -> int:
        return len(self._figures)

    def __repr__(self) -> str:
        return f"<{len(self)} figures: {', '.join(self)}>"


def of_study(study: Study) -> Gallery:
    return Gallery(figures_of(study))


def of_calibration(made: Calibration) -> Gallery:
    return Gallery(calibration_figures(made))


def shown_study(study: Study, height: int) -> Shown:
    """The page's player: each run's simulated robot, and the one that it drove."""
    parts = parts_of(study)
    pairs = pairs_of(study, parts)
    data = player_data(study, parts, pairs, Paths(study))
    if data is None:
        raise StudyError(f"{study.folder}: no run has started: there is nothing to show yet.")
    return _player(data, study.config.title or study.folder.name, height)


def replayed(
    run: Run,
    who: str | int,
    *,
    noise: str | float | None = None,
    pose: Pose | None = None,
    seed: int = 0,
    seconds: float | None = None,
    profile: Profile | str | None = None,
    live: bool = False,
    height: int = 1150,
) -> Shown:
    """The player with one simulated trial of a run's controller, to be driven if `live`; arguments as of
    `Run.replay`."""
    name, genes = run.individual(who)
    robot, level = profile or run.study.profile, run.noise if noise is None else noise
    simulation = Simulation(run.study.task(run.task), robot, level)
    networks = run.study.networks(run.task, genes)
    driven = simulation.trajectory(networks, stream=seed, pose=pose, seconds=seconds)
    slots, title = run.study.slots(run.task, genes), f"{run.name}, {name}"
    told = [Driven(simulation.task, simulation.profile, {title: slots})]
    drive = drive_json(told if live and not simulation.task.spread else [])
    return _player(replay_data(simulation, slots, driven, title), title, height, drive)


def shown_calibration(made: Calibration, height: int) -> Shown:
    with tempfile.TemporaryDirectory(prefix="realitygap-") as folder:
        page = write_calibration_page(made, Path(folder) / "page.html")
        return Shown(page.read_text("utf-8"), height)


def study_html(study: Study) -> str:
    """A study's runs as a table."""
    rows = [
        (run.name, run.evaluations, _best(run), _fitness(run, run.tests.get(("champion", run.noise), ())),
         "finished" if run.finished else "unfinished")
        for run in study.runs[:MOST_ROWS]
    ]  # fmt: skip
    title = study.config.title or study.folder.name
    runs = f"{len(study.runs)} run{'s' * (len(study.runs) != 1)}"
    said = f"{title}: {runs}, seed {study.config.seed}, profile {study.profile.name}"
    head = ("run", "evaluations", "best during evolution", NEW, "")
    return _face(said, rows, head=head, more=len(study.runs) - len(rows))


def run_html(run: Run) -> str:
    """A run's results, and the network of its champion, or of the best so far."""
    genes = run.fittest if run.champion is None else run.champion
    facts = [
        ("task", run.task), ("noise", run.noise_name), ("evaluations", run.evaluations),
        ("best during evolution", _best(run)),
        *((f"test score of the {WHO[who]} at noise {noise:g}", _fitness(run, scores))
          for (who, noise), scores in run.tests.items()),
    ]  # fmt: skip
    if genes is None:
        return _face(run.name, facts)
    task, slots = run.study.facts(run.task), run.study.slots(run.task, genes)
    draw = partial(network_figure, slots, run.study.profile, feeds=task["feeds"], sensors=task["sensors"])
    return _face(run.name, facts, draw, f"The network of {run.name}")


def profile_html(profile: Profile) -> str:
    """A robot, from above."""
    near, light = (len(profile.channel(kind).sensors) for kind in ("infrared", "ambient"))
    facts = [
        ("infrared sensors", near), ("light sensors", light), ("step", f"{profile.period_s:g} s"),
        ("radius", f"{profile.body.radius_cm:g} cm"), ("track", f"{profile.wheels.track_cm:g} cm"),
    ]  # fmt: skip
    return _face(profile.name, facts, partial(robot_figure, profile), f"The robot {profile.name}")


def arena_html(arena: Arena) -> str:
    """An arena, to scale."""
    width, depth = arena.size_cm
    return _face(draw=partial(room_figure, arena), alt=f"The arena {arena.name}, {width:g} × {depth:g} cm")


def network_html(genotype: Genotype) -> str:
    """A network on a Khepera's first sensors; in words if it has too many inputs."""
    inputs, profile = genotype.inputs, load_profile("paper")
    said = f"{inputs} inputs, {len(genotype.neurons)} neurons"
    if inputs > len(profile.infrared.sensors):
        return _face(said)
    draw = partial(network_figure, genotype, profile, feeds="proximity", sensors=range(inputs))
    return _face(draw=draw, alt=f"A network: {said}")


def _player(data: Mapping[str, object], title: str, height: int, drive: Markup | None = NO_DRIVE) -> Shown:
    facts = {
        "title": title, "player": Markup(player_json(dict(data))), "drive": drive, "drive_first": True,
    }  # fmt: skip
    return Shown(rendered("notebook.html.j2", facts), height)


def _face(
    caption: str = "", rows: Sequence[Sequence[object]] = (), draw: Callable[[], Figure] | None = None,
    alt: str = "", *, head: Sequence[str] = (), more: int = 0,
) -> str:  # fmt: skip
    """A table and a figure; as an image, whose ids are its own whatever else a notebook shows."""
    svg = ""
    if draw is not None:
        with styled():
            svg = base64.b64encode(save_figure(draw(), None, "figure").encode()).decode()
    facts = {"caption": caption, "rows": rows, "svg": svg, "alt": alt, "head": head, "more": more}
    return rendered("face.html.j2", facts)


def _best(run: Run) -> str:
    return _fitness(run, () if run.best_fitness is None else [run.best_fitness])


def _fitness(run: Run, scores: ArrayLike) -> str:
    """The mean of scores with its 95 % interval, in the task's unit."""
    facts, mean = run.study.facts(run.task), mean_of(scores)
    if mean is None:
        return "–"
    scale, unit = facts["fitness_scale"], unit_of(facts["fitness_unit"])
    text = f"{mean.value / scale:.4g}"
    if math.isfinite(mean.half):
        text += f" ± {mean.half / scale:.2g}"
        text = f"({text})" if unit else text
    return f"{text} {unit}".rstrip()
