"""`realitygap experiment`: experiments of many runs, from the first recording to tables and a page."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from realitygap.cli import option
from realitygap.cli.failure import resumable
from realitygap.cli.kinds import Whole
from realitygap.cli.notes import note_new
from realitygap.cli.output import table, tell
from realitygap.cli.studies import show_shard
from realitygap.work.progress import ProgressLine, counts

if TYPE_CHECKING:
    from collections.abc import Mapping

    from realitygap.experiments.noise import NoiseConfig
    from realitygap.work.pool import Workers
    from realitygap.work.shard import Shard

__all__ = ["experiment", "show_noise"]


@click.group()
def experiment() -> None:
    """Run a multi-run experiment.

    \b
    Example: which level of noise crosses the reality gap best?
        realitygap experiment noise
    """


@experiment.command()
@option.out("out/noise")
@click.option(
    "--levels",
    metavar="L,L,…",
    help="Noise levels (1 = observed) to evolve at and to compare with [default: 0,0.5,1,2,4].",
)
@option.runs("Runs of each task at each level; the units take turns [default: 40].")
@click.option(
    "--robot", metavar="R",
    help="twin, stranger, enki:MODEL, or a body of your own that places itself, file.py:Class: the only unit "
    "[default: twin].",
)  # fmt: skip
@option.base
@click.option("--units", type=Whole(1, 100), help="Units of the twin, the stranger, or Enki's [default: 3].")
@click.option("--starts", type=Whole(2, 1000), help="Trials of each controller on each unit [default: 8].")
@option.evaluations
@option.twin_noise()
@option.seed(None, " [default: 1995]")
@click.option("--tasks", metavar="TASK|both", help="obstacle-avoidance or light-seeking [default: both].")
@option.seconds
@option.arena
@option.workers
@option.engine
@option.shard
@option.resume
@option.as_json
def noise(
    out: Path,
    workers: Workers,
    engine: str,
    shard: Shard | None,
    resume: bool,
    json_output: bool,
    **options: Any,
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
    from realitygap.experiments.noise_run import noise_experiment
    from realitygap.work.shard import read_mark

    out = out if shard is None else shard.folder(out)
    config = _config(out, resume, options)
    if resume:
        note_new(out, config.FILE)
    again = config.resuming(out) + option.unusual(engine)
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
    facts = {"study": str(out), "results": str(results), "report": str(page), **noise_summary(out), **more}
    words = f"{table(rows.head, rows.rows)}\n\nnoise-matched level: {matched}"
    tell(json_output, facts, f"{words}\n\nresults {results}\nreport  {page}")


def _config(out: Path, resume: bool, options: dict[str, Any]) -> NoiseConfig:
    """The usual experiment with what was given; or, resumed, the one that is there."""
    from dataclasses import replace

    from realitygap.experiments.noise import NoiseConfig, levels_of, tasks_of

    begun = NoiseConfig.begun(out, resume=resume)
    asked = option.given(options)
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
