"""`realitygap list`, `best`, `compare`, `figures` and `open`: what there is, and what came out."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from realitygap.cli import options
from realitygap.cli.console import as_json, link, load_trusted, note, table, tell
from realitygap.cli.fitness import Fitness
from realitygap.cli.study import run_facts, run_lines
from realitygap.errors import RealityGapError

if TYPE_CHECKING:
    from collections.abc import Iterator

    from realitygap.study.load import Study

__all__ = ["best", "compare", "figures", "listed", "open_page"]

DEEP = 4
"""Folders below which studies are looked for."""


@click.command(name="list")
@click.argument(
    "what", required=False, type=click.Choice(["profiles", "arenas", "tasks", "robots", "studies"])
)
@click.argument("folder", required=False, type=click.Path(path_type=Path, exists=True, file_okay=False))
@options.as_json
def listed(what: str | None, folder: Path | None) -> None:
    """List what there is: profiles, arenas, tasks, robots' addresses, studies.

    Studies are those in FOLDER (default: here) and below it.

    \b
    Examples: everything; the studies below a folder
        realitygap list
        realitygap list studies out
    """
    kinds: dict[str, Any] = {
        "profiles": _profiles,
        "arenas": _arenas,
        "tasks": _tasks,
        "robots": _robots,
        "studies": lambda: _studies(folder or Path()),
    }
    found = {kind: dict(make()) for kind, make in kinds.items() if what in (None, kind)}
    lines = [
        f"{kind}\n{table(('', ''), rows.items()).partition(chr(10))[2] if rows else 'none here'}\n"
        for kind, rows in found.items()
    ]
    tell(found, "\n".join(lines).rstrip())


def _profiles() -> Iterator[tuple[str, str]]:
    from realitygap.world.robot import load_profile, profile_names

    for name in profile_names():
        robot = load_profile(name)
        near, light = len(robot.infrared.sensors), len(robot.ambient.sensors)
        yield name, f"radius {robot.body.radius_cm:.3g} cm, {near} infrared and {light} light sensors"


def _arenas() -> Iterator[tuple[str, str]]:
    from realitygap.world.arena import load_arena
    from realitygap.world.toml import shipped

    for name in shipped("arenas"):
        arena = load_arena(name)
        parts = {"cylinder": arena.cylinders, "wall": arena.walls, "lamp": arena.lamps}
        counts = (f", {len(some)} {part}{'s' * (len(some) != 1)}" for part, some in parts.items() if some)
        yield name, f"{arena.size_cm[0]:g} × {arena.size_cm[1]:g} cm{''.join(counts)}"


def _tasks() -> Iterator[tuple[str, str]]:
    from realitygap.tasks import TASKS, load_task

    for name in TASKS:
        task = load_task(name)
        yield name, f"fed {task.feeds}, {task.seconds:g} s, arena {task.arena.name}"
    yield "FILE.py", "a task of your own"


def _robots() -> Iterator[tuple[str, str]]:
    from realitygap.robots.address import ADDRESSES

    yield from ADDRESSES.items()


def _studies(folder: Path) -> Iterator[tuple[str, str]]:
    from realitygap.study.load import load_study
    from realitygap.study.store import DATABASE

    for place, inner, files in os.walk(folder):
        depth = len(Path(place).relative_to(folder).parts)
        inner[:] = sorted(name for name in inner if not name.startswith(".")) if depth < DEEP else []
        if DATABASE not in files:
            continue
        inner.clear()
        try:
            study = load_study(place)
        except RealityGapError as error:
            yield place, str(error)
            continue
        tasks = ", ".join(dict.fromkeys(run.task for run in study.runs))
        done = sum(run.finished for run in study.runs)
        yield place, f"{tasks}: {done} of {len(study.runs)} runs finished"


@click.command()
@options.study
@options.verbose
@options.as_json
def best(study: Path, verbose: bool) -> None:
    """Show the best run of each task and noise level of STUDY.

    The best has the highest test score; while none is finished, the best fitness so far. Wherever a RUN is
    taken, best names it: best, best:TASK, best:LEVEL or best:TASK/LEVEL.

    \b
    Example: the best light seeker, moving
        realitygap best out/reproduce
        realitygap replay out/reproduce best:light --picture best.gif
    """
    from realitygap.study.load import load_study

    loaded = load_study(study)
    begun = [run for run in loaded.runs if run.best_fitness is not None]
    keys = dict.fromkeys(f"{run.task}/{run.noise_name}" for run in begun)
    runs = [loaded.run(f"best:{key}") for key in keys]
    tasks = {run.task: loaded.run(f"best:{run.task}") for run in runs}
    facts = {task: run_facts(loaded, run) for task, run in tasks.items()}
    lines = run_lines(loaded, runs, verbose) if runs else ["no run has begun"]
    tell(
        {"study": str(study), "best": facts, "runs": [run_facts(loaded, run) for run in runs]},
        *lines,
        "",
        *(_best_line(loaded, task) for task in tasks),
    )


def _best_line(study: Study, task: str) -> str:
    run, fitness = study.run(f"best:{task}"), Fitness(study)
    seen, test = fitness.both(run)
    figure = f"best during evolution {seen}" if test == "–" else f"test score {test}"
    return f"best: run {run.id}, {run.name}: {figure}{fitness.unit(task)}"


@click.command()
@click.argument("first", metavar="STUDY", type=options.StudyPath())
@click.argument("second", metavar="STUDY", type=options.StudyPath())
@click.option(
    "--picture", type=options.OutFile(".png", ".svg", ".pdf"), help="Draw both to FILE (.png, .svg or .pdf)."
)
@options.as_json
def compare(first: Path, second: Path, picture: Path | None) -> None:
    """Compare the test scores of two studies.

    Of each task at each noise level that both have, or at the only one that each has: the means over runs,
    their difference with a 95 % interval, and Welch's t-test. Champions that evolved at different noise are
    compared as tested at observed noise.

    \b
    Example:
        realitygap compare out/first out/quiet --picture compared.svg
    """
    from realitygap.report.compare import compare_figure, contrasts
    from realitygap.report.evolution import mean_of
    from realitygap.report.style import write_figure
    from realitygap.study.load import load_study
    from realitygap.world.robot import noise_name

    studies = load_study(first), load_study(second)
    found = contrasts(*studies)
    names = (str(first), str(second))
    lines = []
    for one in found:
        rows = [
            (name, noise_name(level), len(values), one.text(mean_of(values)))
            for name, level, values in zip(names, one.noise, one.values, strict=True)
        ]
        unit = f" ({one.unit})" if one.unit else ""
        lines += [
            f"{one.task}: test score at {noise_name(one.tested)} noise{unit}, mean of runs ± 95 %",
            table(("study", "evolved at", "runs", "test score"), rows),
            f"{one.verdict}\n",
        ]
    if picture is not None:
        write_figure(lambda: compare_figure(found, names), picture)
        lines.append(f"picture {link(picture)}")
    facts = {"a": names[0], "b": names[1], "contrasts": [one.to_dict() for one in found]}
    tell(facts, "\n".join(lines).rstrip())


@click.command()
@options.study
@click.argument("names", metavar="[NAME]...", nargs=-1)
@click.option(
    "--format", "kind", type=click.Choice(["pdf", "svg", "png"]), default="pdf", help="Of the files."
)
@click.option("--width", type=options.Width(), help="Of all figures, as in 8.4cm; text keeps its size.")
@click.option("--out", type=click.Path(path_type=Path), metavar="DIR", help="[default: STUDY/figures]")
@options.as_json
def figures(study: Path, names: tuple[str, ...], kind: str, width: float | None, out: Path | None) -> None:
    """Write the figures of STUDY's report for a paper.

    All of them, or those with a NAME. PDFs have their fonts embedded; text in SVGs is drawn.

    \b
    Example: for a column of 8.4 cm
        realitygap figures out/reproduce --format pdf --width 8.4cm
    """
    from realitygap.report.build import figures_of
    from realitygap.report.style import write_figure

    found = figures_of(load_trusted(study))
    for name in names:
        if name not in found:
            raise click.BadParameter(f"expected one of {', '.join(found)}, got {name!r}.", param_hint="NAME")
    folder = study / "figures" if out is None else out
    folder.mkdir(parents=True, exist_ok=True)
    made = {name: folder / f"{name}.{kind}" for name in names or found}
    for name, file in made.items():
        write_figure(found[name].draw, file, width)
        if not as_json():
            click.echo(f"wrote {file}")
    tell({name: str(file) for name, file in made.items()}, f"{len(made)} figures in {link(folder)}")


@click.command(name="open")
@options.study
@options.as_json
def open_page(study: Path) -> None:
    """Open the report of STUDY in a browser.

    It is made if it is missing. The address is printed too. The folder of an experiment will do as well.

    \b
    Example:
        realitygap open out/reproduce
    """
    import webbrowser

    from realitygap.cli.evolve import report

    page = study / "report" / "index.html"
    if not page.is_file():
        note("there is no report yet: it is made first")
        click.get_current_context().invoke(report, study=study)
    opened = webbrowser.open(link(page))
    tell({"report": str(page), "opened": opened}, link(page))
