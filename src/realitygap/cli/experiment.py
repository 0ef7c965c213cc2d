"""`realitygap experiment`: experiments of many runs, from the first recording to tables and a page."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from realitygap.cli import options
from realitygap.cli.console import note_new, print_json, resumable, table, tell, warn
from realitygap.cli.study import show_shard
from realitygap.work.progress import ProgressLine, counts

if TYPE_CHECKING:
    from collections.abc import Mapping

    from realitygap.experiments.noise import NoiseConfig
    from realitygap.experiments.robots import Place, RobotsConfig
    from realitygap.work.pool import Workers
    from realitygap.work.shard import Shard

__all__ = ["experiment", "show_noise", "show_robots"]

SMALL = {"runs": 2, "starts": 2, "evaluations": 200}
FEW = 5
"""Runs a level below which the robots' table has no scores: their means would say nothing."""


@click.group()
def experiment() -> None:
    """Run an experiment of many runs.

    \b
    Example: which level of noise crosses the reality gap best?
        realitygap experiment noise
    """


@experiment.command()
@options.out("out/noise")
@click.option(
    "--levels",
    metavar="L,L,…",
    help="Noise levels (1 = observed) to evolve at and to compare with [default: 0,0.5,1,2,4].",
)
@options.runs("Runs of each task at each level; the units take turns [default: 40].")
@click.option(
    "--robot",
    metavar="R",
    help="twin, stranger, enki:MODEL, or a body of your own that places itself, file.py:Class: the only unit "
    "[default: twin].",
)
@options.base
@click.option(
    "--units",
    type=click.IntRange(1, 100),
    metavar="N",
    help="Units of the twin, the stranger, or Enki's [default: 3].",
)
@options.starts("Trials of each controller on each unit [default: 8].", least=2)
@options.evaluations
@options.twin_noise()
@options.seed(None, " [default: 1995]")
@click.option("--tasks", metavar="TASK|both", help="obstacle-avoidance or light-seeking [default: both].")
@options.seconds
@options.arena
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
    json_output: bool,
    **settings: Any,
) -> None:
    """Find which noise level crosses the reality gap best.

    Calibrates a simulation to each unit of the robot (the twin: a physics model behind the robot's own serial
    protocol) and evolves controllers in it at every noise level. Each controller drives every unit from the
    same starts; its tracks there are compared with the simulation at every level. Makes tables and a page of
    four figures. With --resume, omitted options keep their saved values.

    \b
    Examples: the full experiment; on a twin twice as noisy; a small one to try; a robot of your own
        realitygap experiment noise
        realitygap experiment noise --twin-noise 2 --out out/noise-2
        realitygap experiment noise --levels 0,1,2 --runs 4 --units 1 --starts 4 --out out/small
        realitygap experiment noise --robot my_robot.py:MyRobot --base my_robot.toml --out out/mine
    """
    from realitygap.experiments.noise import noise_experiment
    from realitygap.work.shard import read_mark

    out = out if shard is None else shard.folder(out)
    config = _noise_config(out, resume, settings)
    if resume:
        note_new(out, config.FILE)
    again = config.resuming(out) + options.unusual(engine)
    with resumable(out, again, config.FILE), ProgressLine() as progress:
        results = noise_experiment(
            out, config, workers=workers, engine=engine, resume=resume, shard=shard, on_progress=progress.show
        )
        if read_mark(out) is not None:
            show_shard(out, {}, json_output=json_output)
            return
    show_noise(out, results, {}, json_output=json_output)


def show_noise(out: Path, results: Path, more: Mapping[str, Any], *, json_output: bool) -> None:
    """Make the page of a noise experiment, and print its table, with `more` parts of the JSON."""
    from realitygap.report.experiment import NoiseData, build_noise_page, noise_summary, noise_table

    with ProgressLine() as progress:
        drawn = counts(progress.show, "making the report", "figures")
        page = build_noise_page(out, on_progress=drawn)
    data = NoiseData.read(out)
    rows = noise_table(data)
    matched = "; ".join(f"{task} {data.part(task).matched_text}" for task in data.tasks)
    facts = {"study": str(out), "results": str(results), "report": str(page), **noise_summary(data), **more}
    words = f"{table(rows.head, rows.rows)}\n\nnoise-matched level: {matched}"
    tell(json_output, facts, f"{words}\n\nresults {results}\nreport  {page}")


def _noise_config(out: Path, resume: bool, settings: dict[str, Any]) -> NoiseConfig:
    """The usual experiment with what was given; or, resumed, the one that is there."""
    from dataclasses import replace

    from realitygap.experiments.noise import NoiseConfig, levels_of, tasks_of

    begun = NoiseConfig.begun(out, resume=resume)
    asked = options.given(settings)
    if asked.get("robot") == "twin":
        if begun.robot is not None:
            raise click.UsageError(f"--robot: expected {begun.robot}, this experiment's robot, got twin.")
        del asked["robot"]
    if asked.get("robot", "enki").partition(":")[0] not in ("stranger", "enki"):
        for key in ("units", "twin_noise"):
            if key in asked:
                name = f"--{key.replace('_', '-')}"
                raise click.UsageError(f"{name}: belongs to the twin; leave it out with a robot of your own.")
        asked["units"] = 1
    elif begun.base is not None and "robot" not in asked:
        raise click.UsageError(
            f"--robot: expected {begun.robot}, the robot of this experiment: a program, "
            "which runs only when you name it."
        )
    for key, read in (("levels", levels_of), ("tasks", tasks_of)):
        if key in asked:
            asked[key] = read(asked[key])
    return replace(begun, **asked)


@experiment.command()
@options.out("out/robots")
@click.option(
    "--robot",
    "robots",
    multiple=True,
    metavar="R",
    help="A robot to include: twin, stranger, enki:MODEL, or a body of your own that places "
    "itself, file.py:Class; may be repeated.",
)
@click.option("--only", is_flag=True, default=None, help="Only those that --robot names.")
@options.base
@click.option("--small", is_flag=True, help="A small version, in minutes: 2 runs, 2 starts, 200 evaluations.")
@click.option("--levels", metavar="L,L,…", help="Noise levels (1 = observed) [default: 0,1,2].")
@options.runs("Runs at each level [default: 6].")
@options.starts("Trials of each controller [default: 4].", least=2)
@options.evaluations
@options.seed(None, " [default: 1995]")
@options.seconds
@options.workers
@options.resume
@options.as_json
def robots(
    out: Path, workers: Workers, small: bool, resume: bool, json_output: bool, **settings: Any
) -> None:
    """Calibrate, evolve and transfer on several robots.

    They are the twin, the robots of EPFL's simulator Enki (its Khepera, e-puck and Thymio II)
    and those that --robot names. Each robot is recorded, and a simulation calibrated to it. Controllers
    that avoid obstacles evolve in it at every noise level, drive the robot and are compared with the
    simulation. Prints one matrix for all: model error over noise, beside that of real robots' readings;
    noise; correspondence by level; and where the simulation is as noisy as the robot. Robots that are
    not installed are left out, unless --robot names them. With --resume, omitted options keep their saved
    values.

    \b
    Examples: a small one to try; a robot of your own beside all others; two of Enki's alone
        realitygap experiment robots --small
        realitygap experiment robots --robot my_robot.py:MyRobot --base my_robot.toml --out out/mine
        realitygap experiment robots --only --robot enki:epuck --robot enki:thymio2 --out out/enki
    """
    from realitygap.experiments.robots import robots_experiment

    asked = _robots_config(out, resume, {**(SMALL if small else {}), **options.given(settings)})
    if resume:
        note_new(out, asked.FILE)
    with resumable(out, asked.resuming(out), asked.FILE), ProgressLine() as progress:
        places = robots_experiment(out, asked, workers=workers, resume=resume, on_progress=progress.show)
    show_robots(out, places, json_output=json_output)


def show_robots(out: Path, places: list[Place], *, json_output: bool) -> None:
    """Make the page of an experiment on several robots, and print its table."""
    from realitygap.experiments.robots import RobotsConfig
    from realitygap.report.experiment import NoiseData, build_robots_page, matrix, noise_summary

    few = RobotsConfig.from_folder(out).runs < FEW
    with ProgressLine() as progress:
        drawn = counts(progress.show, "making the report", "figures")
        page = build_robots_page(out, places, few=few, on_progress=drawn)
    warn(f"{place.robot} is left out: {place.why}" for place in places if place.why)
    if json_output:
        made = [
            {"robot": one.robot, "folder": str(one.folder), **noise_summary(NoiseData.read(one.folder))}
            for one in places
            if not one.why
        ]
        left = [{"robot": one.robot, "why": one.why} for one in places if one.why]
        print_json({"folder": str(out), "report": str(page), "robots": made, "left_out": left})
        return
    rows = matrix(places, few=few)
    click.echo(f"{table(rows.head, rows.rows)}\n\nreport {page}")


def _robots_config(out: Path, resume: bool, given: dict[str, Any]) -> RobotsConfig:
    """The usual one with what was given; or, resumed, the one that is there."""
    from dataclasses import replace

    from realitygap.experiments.noise import levels_of
    from realitygap.experiments.robots import RobotsConfig

    begun = RobotsConfig.begun(out, resume=resume)
    if not given["robots"]:
        del given["robots"]
        if begun.programs:
            raise click.UsageError(
                f"--robot: expected {', '.join(begun.robots)}, the robots of this experiment: programs, "
                "which run only when you name them."
            )
    if "levels" in given:
        given["levels"] = levels_of(given["levels"])
    return replace(begun, **given)
