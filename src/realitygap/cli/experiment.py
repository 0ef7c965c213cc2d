"""`realitygap experiment`: experiments of many runs, from the first recording to tables and a page."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypedDict, Unpack

import click

from realitygap.cli import options
from realitygap.cli.console import link, note_new, resumable, table, tell, warn
from realitygap.cli.study import show_shard
from realitygap.work.progress import ProgressLine, counts

if TYPE_CHECKING:
    from collections.abc import Mapping

    from realitygap.experiments.robots import Place
    from realitygap.work.pool import Workers
    from realitygap.work.shard import Shard

__all__ = ["experiment", "show_noise", "show_robots"]

NARROW = 5
"""Columns of the noise experiment's table that a terminal has room for; the page has them all."""
BESIDE = 3
"""Robots side by side in a terminal; more go below."""
FEW = 5
"""Runs a level below which the robots' table has no scores: their means would say nothing."""


class ExperimentSettings(TypedDict):
    """Options that are settings of either experiment; None: the saved or the usual ones."""

    levels: tuple[float, ...] | None
    runs: int | None
    base: str | None
    starts: int | None
    evaluations: int | None
    seed: int | None
    seconds: float | None


class NoiseSettings(ExperimentSettings):
    """Those of the noise experiment alone."""

    twin_noise: float | None
    tasks: tuple[str, ...] | None
    arena: str | None


@click.group()
def experiment() -> None:
    """Run an experiment of many runs.

    \b
    Example: which level of noise crosses the reality gap best?
        realitygap experiment noise
    """


@experiment.command()
@options.out(default=Path("out/noise"), help="The experiment's folder.")
@options.levels("0,0.5,1,2,4")
@options.runs(help="Runs of each task at each level; the units take turns [default: 40].")
@click.option(
    "--robot",
    "--reality",
    metavar="R",
    help="twin, stranger, enki:MODEL; or as the only unit table:PROFILE (recorded readings, replayed), or a "
    "body of your own that places itself, file.py:Class [default: twin].",
)
@options.base
@click.option(
    "--units",
    type=options.Whole(1, 100),
    metavar="N",
    help="Units of the twin, the stranger, or Enki's [default: 3].",
)
@options.starts(type=options.Whole(2), help="Trials of each controller on each unit [default: 8].")
@options.evaluations
@options.twin_noise
@options.seed(None, " [default: 1995]")
@click.option(
    "--tasks",
    type=options.Parsed("TASK|both", "realitygap.experiments.noise:tasks_of"),
    help="obstacle-avoidance or light-seeking [default: both].",
)
@options.seconds
@options.arena
@click.option(
    "--misfit", is_flag=True, help="Say at which level to evolve, where a model errs as much as this one."
)
@options.workers
@options.engine
@options.shard
@options.resume
@options.as_json
def noise(
    out: Path,
    workers: Workers,
    engine: str,
    shard: Shard | None,
    resume: bool,
    robot: str | None,
    units: int | None,
    misfit: bool,
    **settings: Unpack[NoiseSettings],
) -> None:
    """Find which noise level crosses the reality gap best.

    Calibrates a simulation to each unit of the robot (the twin: a physics model behind the robot's own serial
    protocol) and evolves controllers in it at every noise level. Each controller drives every unit from the
    same starts; its tracks there are compared with the simulation at every level. Makes tables and a page of
    four figures. With --resume, omitted options keep their saved values.

    Examples: the full experiment; on a twin twice as noisy; a small one to try; a robot of your own; one of
    which only a recording is there

    \b
        realitygap experiment noise
        realitygap experiment noise --twin-noise 2 --out out/noise-2
        realitygap experiment noise --levels 0,1,2 --runs 4 --units 1 --starts 4 --out out/small
        realitygap experiment noise --robot my_robot.py:MyRobot --base my_robot.toml --out out/mine
        realitygap experiment noise --reality table:my_table.toml --misfit --out out/table
    """
    from realitygap.experiments.noise import NoiseConfig, noise_experiment
    from realitygap.robots.address import Address
    from realitygap.work.shard import read_mark

    out = out if shard is None else shard.folder(out)
    begun = NoiseConfig.begun(out, resume=resume)
    if robot == "twin" and begun.robot is not None:
        raise click.UsageError(f"--robot: expected {begun.robot}, this experiment's robot, got twin.")
    if robot is None and Address.parse(begun.robot or "twin").kind == "own":
        raise click.UsageError(
            f"--robot: expected {begun.robot}, the robot of this experiment: a program, "
            "which runs only when you name it."
        )
    if robot is not None and robot.partition(":")[0] not in ("twin", "stranger", "enki") and units is None:
        units = 1
    if robot is not None and robot.startswith("table:") and settings["tasks"] is None:
        settings["tasks"] = ("obstacle-avoidance",)  # a table has no light
    own = None if robot == "twin" else robot
    config = replace(begun, **options.given(robot=own, units=units, **settings))
    if resume:
        note_new(out, config.FILE)
    again = config.resuming(out) + options.unusual(engine)
    with resumable(out, again, config.FILE), ProgressLine() as progress:
        results = noise_experiment(
            out, config, workers=workers, engine=engine, resume=resume, shard=shard, on_progress=progress.show
        )
    if read_mark(out) is not None:
        show_shard(out, {})
    else:
        show_noise(out, results, misfit=misfit)


def show_noise(
    out: Path, results: Path, more: Mapping[str, Any] | None = None, *, misfit: bool = False
) -> None:
    """Make the page of a noise experiment, and print its table, with `more` parts of the JSON, and with at
    which level to evolve, where a model has this `misfit`."""
    from realitygap.report.experiment import NoiseData, build_noise_page, noise_summary, noise_table
    from realitygap.report.misfit import advice

    with ProgressLine() as progress:
        drawn = counts(progress.show, "making the report", "figures")
        page = build_noise_page(out, on_progress=drawn)
    data = NoiseData.read(out)
    head, rows = noise_table(data)
    matched = "; ".join(f"{task} {data.part(task).matched_text}" for task in data.tasks)
    where = {"study": str(out), "results": str(results), "report": str(page)}
    narrow = table(head[:NARROW], [row[:NARROW] for row in rows])
    words = f"{narrow}\n\nnoise-matched level: {matched}"
    found = dict(more or {})
    if misfit:
        said = advice(data)
        words += "\n" + "\n".join(one.words for one in said)
        found["evolve_at"] = [{**one._asdict(), "told": one.told} for one in said]
    tell({**where, **noise_summary(data), **found}, f"{words}\n\nresults {results}\nreport  {link(page)}")


@experiment.command()
@options.out(default=Path("out/robots"), help="The experiment's folder.")
@click.option(
    "--robot",
    "named",
    multiple=True,
    metavar="R",
    help="A robot: twin, stranger, enki:MODEL, or a body of your own that places itself, file.py:Class; may "
    "be repeated [default: the twin and, if installed, Enki's].",
)
@options.base
@options.levels("0,1,2")
@options.runs(help="Runs at each level [default: 6].")
@options.starts(type=options.Whole(2), help="Trials of each controller [default: 4].")
@options.evaluations
@options.seed(None, " [default: 1995]")
@options.seconds
@options.workers
@options.resume
@options.as_json
def robots(
    out: Path,
    named: tuple[str, ...],
    workers: Workers,
    resume: bool,
    **settings: Unpack[ExperimentSettings],
) -> None:
    """Calibrate, evolve and transfer on several robots.

    --robot names the robots; without it they are the twin and, if EPFL's simulator Enki is installed, its
    Khepera, e-puck and Thymio II. Each robot is recorded, and a simulation calibrated to it.
    Controllers that avoid obstacles evolve in it at every noise level, drive the robot and are compared with
    the simulation. Prints one matrix for all: model error over noise, beside that of real robots' readings;
    noise; correspondence by level; and where the simulation is as noisy as the robot. With --resume, omitted
    options keep their saved values.

    Examples: a small one to try, in minutes; a robot of your own beside the twin; two of Enki's

    \b
        realitygap experiment robots --runs 2 --starts 2 --evaluations 200
        realitygap experiment robots --robot twin --robot my_robot.py:MyRobot --base my_robot.toml
        realitygap experiment robots --robot enki:epuck --robot enki:thymio2 --out out/enki
    """
    from realitygap.experiments.robots import RobotsConfig, robots_experiment

    begun = RobotsConfig.begun(out, resume=resume)
    if begun.programs and not named:
        raise click.UsageError(
            f"--robot: expected {', '.join(begun.robots)}, the robots of this experiment: name them all "
            "again, since a program among them runs only when you name it."
        )
    config = replace(begun, **options.given(robots=named or None, **settings))
    if resume:
        note_new(out, config.FILE)
    with resumable(out, config.resuming(out), config.FILE), ProgressLine() as progress:
        places = robots_experiment(out, config, workers=workers, resume=resume, on_progress=progress.show)
    show_robots(out, places)


def show_robots(out: Path, places: list[Place]) -> None:
    """Make the page of an experiment on several robots, and print its table."""
    from realitygap.experiments.robots import RobotsConfig
    from realitygap.report.experiment import build_robots_page, matrix, noise_summary, read_robots

    few, robots = RobotsConfig.from_folder(out).runs < FEW, read_robots(places)
    with ProgressLine() as progress:
        drawn = counts(progress.show, "making the report", "figures")
        page = build_robots_page(out, places, robots, few=few, on_progress=drawn)
    warn(f"{place.robot} is left out: {place.why}" for place in places if place.why)
    (head, rows), made = matrix(places, robots, few=few), [one for one in places if not one.why]
    parts = [slice(first, first + BESIDE) for first in range(1, len(head), BESIDE)]
    tables = "\n\n".join(table([head[0], *head[p]], [[row[0], *row[p]] for row in rows]) for p in parts)
    facts = [
        {"robot": one.robot, "folder": str(one.folder), **noise_summary(data)}
        for one, data in zip(made, robots.values(), strict=True)
    ]
    left = [{"robot": one.robot, "why": one.why} for one in places if one.why]
    found = {"folder": str(out), "report": str(page), "robots": facts, "left_out": left}
    tell(found, f"{tables}\n\nreport {link(page)}")
