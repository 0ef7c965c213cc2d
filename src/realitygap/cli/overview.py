"""`realitygap list`, `best`, `compare`, `figures` and `open`: what there is, and what came out."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import click

from realitygap.cli import options
from realitygap.cli.console import link, load_trusted, note, table, tell
from realitygap.cli.fitness import Fitness
from realitygap.cli.study import run_facts, run_lines
from realitygap.errors import RealityGapError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator

__all__ = ["best", "compare", "figures", "listed", "open_page"]

DEEP = 4
"""Folders below which studies are looked for."""


@click.command(name="list")
@click.argument(
    "what", required=False, type=click.Choice(["profiles", "arenas", "tasks", "robots", "studies"])
)
@click.argument("folder", default=".", type=click.Path(exists=True, file_okay=False))
@options.as_json
def listed(what: str | None, folder: str) -> None:
    """List profiles, arenas, tasks, robots' addresses, studies.

    Studies are those in FOLDER (omitted: here) and below it.

    \b
    Examples: everything; the studies below a folder
        realitygap list
        realitygap list studies out
    """
    from realitygap.robots.address import ADDRESSES

    makers: dict[str, Callable[[], Iterable[tuple[str, str]]]] = {
        "profiles": _profiles, "arenas": _arenas, "tasks": _tasks, "robots": ADDRESSES.items,
        "studies": partial(_studies, folder),
    }  # fmt: skip
    found = {kind: dict(make()) for kind, make in makers.items() if what in (None, kind)}
    rows = {kind: list(some.items()) or [("none here", "")] for kind, some in found.items()}
    tell(found, "\n\n".join(f"{kind}\n{table(some[0], some[1:])}" for kind, some in rows.items()))


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
        wide, deep, parts = *arena.size_cm, (arena.cylinders, arena.walls, arena.lamps)
        counts = zip(("cylinders", "inner walls", "lamps"), map(len, parts), strict=True)
        yield name, f"{wide:g} × {deep:g} cm" + "".join(f", {part}: {n}" for part, n in counts if n)


def _tasks() -> Iterator[tuple[str, str]]:
    from realitygap.tasks import TASKS, load_task

    for task in map(load_task, TASKS):
        yield task.name, f"fed {task.feeds}, {task.seconds:g} s, arena {task.arena.name}"
    yield "FILE.py", "a task of your own"


def _studies(folder: str) -> Iterator[tuple[str, str]]:
    from realitygap.study.load import load_study
    from realitygap.study.store import DATABASE

    files = (file for deep in range(DEEP + 1) for file in Path(folder).glob("*/" * deep + DATABASE))
    for place in sorted(str(file.parent) for file in files):
        try:
            study = load_study(place)
            tasks = ", ".join(dict.fromkeys(run.task for run in study.runs))
            done = sum(run.finished for run in study.runs)
            yield place, f"{tasks}: {done} of {len(study.runs)} runs finished"
        except RealityGapError as error:
            yield place, str(error)


@click.command()
@options.study
@options.as_json
def best(study: Path) -> None:
    """Show the best run of each task and noise level of STUDY.

    The best has the highest test score; while none is finished, the best fitness so far. Wherever a RUN is
    taken, it is called best, best:TASK, best:LEVEL or best:TASK/LEVEL.

    \b
    Example: the best light seeker, moving
        realitygap best out/reproduce
        realitygap replay out/reproduce best:light --picture best.gif
    """
    from realitygap.study.load import load_study

    loaded = load_study(study)
    begun = [run for run in loaded.runs if run.best_fitness is not None]
    if not begun:
        tell({"study": str(study), "best": [], "runs": []}, "no run has begun")
        return
    keys = dict.fromkeys(run.task for run in begun), dict.fromkeys(f"{r.task}/{r.noise_name}" for r in begun)
    of_tasks, runs = ([loaded.run(f"best:{key}") for key in some] for some in keys)
    best_of, facts = ([run_facts(loaded, one) for one in some] for some in (of_tasks, runs))
    fitness = Fitness(loaded)
    lines = (f"best: run {run.id}, {run.name}: {fitness.sentence(run)}" for run in of_tasks)
    found = {"study": str(study), "best": best_of, "runs": facts}
    tell(found, *run_lines(loaded, runs), "", *lines)


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

    found, names, lines = contrasts(load_study(first), load_study(second)), (str(first), str(second)), []
    for one in found:
        rows = [
            (name, noise_name(level), len(values), one.text(mean_of(values)))
            for name, level, values in zip(names, one.noise, one.values, strict=True)
        ]
        said = "no interval: it takes two runs of each study"
        if one.difference is not None:
            sure = f"{'not ' * (not one.p < 0.05)}significant"
            said = f"difference {one.text(one.difference)}: {sure} (Welch's t-test, p = {one.p:.2g})"
        head = ("study", "evolved at", "runs", "test score")
        lines += [f"{one.title}, mean of runs ± 95 %", table(head, rows), said, ""]
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
@click.option("--width", type=options.WIDTH, help="Of all figures, as in 8.4cm; text keeps its size.")
@options.out(help="[default: STUDY/figures]")
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

    found, folder = figures_of(load_trusted(study)), out or study / "figures"
    if others := set(names) - set(found):
        expected = f"expected some of {', '.join(found)}, got {others.pop()!r}."
        raise click.BadParameter(expected, param_hint="NAME")
    folder.mkdir(parents=True, exist_ok=True)
    made = {name: folder / f"{name}.{kind}" for name in names or found}
    for name, file in made.items():
        write_figure(found[name].draw, file, width)
    tell({name: str(file) for name, file in made.items()}, *map(str, made.values()))


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

    from realitygap.cli.evolve import made_page

    page = study / "report" / "index.html"
    if not page.is_file():
        loaded = load_trusted(study)
        note("there is no report yet: it is made first")
        page = made_page(study, loaded)
    tell({"report": str(page), "opened": webbrowser.open(link(page))}, link(page))
