"""`realitygap study`: studies of a question, from the first recording to the answer."""

from __future__ import annotations

import shlex
from pathlib import Path

import click

from realitygap.cli.failure import StoppedError
from realitygap.cli.kinds import SECONDS, Finite, Whole
from realitygap.cli.options import as_json, evaluations_option, runs_option, seed_option, workers_option
from realitygap.cli.output import print_json
from realitygap.cli.progress import ProgressLine
from realitygap.errors import RobotStoppedError, StudyInterruptedError

__all__ = ["study"]


@click.group()
def study() -> None:
    """Answer a question with as many runs as it takes.

    \b
    Example: does a simulation as noisy as the robot cross the gap best?
        realitygap study noise
    """


@study.command()
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    default=Path("out/noise"),
    show_default=True,
    metavar="DIR",
    help="The study's folder.",
)
@click.option(
    "--levels",
    default="0,0.5,1,2,4",
    show_default=True,
    metavar="L,L,…",
    help="Levels of noise (1 = observed): to evolve at, and to compare with.",
)
@runs_option("Runs for each task and level, over all seed sets [default: 40].")
@click.option(
    "--seed-sets",
    type=Whole(1, 100),
    default=2,
    show_default=True,
    metavar="N",
    help="Sets of runs, each with seeds of its own.",
)
@click.option(
    "--units", type=Whole(1, 100), default=3, show_default=True, metavar="N", help="Units of the twin."
)
@click.option(
    "--starts",
    type=Whole(2, 1000),
    default=8,
    show_default=True,
    metavar="N",
    help="Trials of each controller on each unit.",
)
@evaluations_option
@click.option(
    "--twin-noise", type=Finite(0, 10), default=1.0, show_default=True, help="Dial on the twin's whole noise."
)
@seed_option(1995)
@click.option(
    "--tasks",
    default="both",
    show_default=True,
    metavar="TASK|both",
    help="obstacle-avoidance, light-seeking, or both.",
)
@click.option("--seconds", type=SECONDS, metavar="S", help="Length of a trial [default: the task's own].")
@workers_option
@click.option("--resume", is_flag=True, help="Continue an interrupted study to exactly the same result.")
@as_json
def noise(
    out: Path,
    levels: str,
    runs: int | None,
    seed_sets: int,
    units: int,
    starts: int,
    evaluations: int | None,
    twin_noise: float,
    seed: int,
    tasks: str,
    seconds: float | None,
    workers: int | None,
    resume: bool,
    json_output: bool,
) -> None:
    """Ask which level of noise crosses the reality gap best.

    Calibrates a simulation to each unit of the twin (pseudo-reality: a physics model behind the
    robot's own serial protocol), evolves controllers in it at every level of noise, lets each drive
    every unit from the same starts, and holds what it did there against the simulation at every
    level. The claims that this is to judge were written down first. With --resume give the same
    options again.

    \b
    Examples: all of it; the same on a twin twice as noisy; a small one, to try
        realitygap study noise
        realitygap study noise --twin-noise 2 --out out/noise-2
        realitygap study noise --levels 0,1,2 --runs 4 --units 1 --starts 4 --out out/small
    """
    from realitygap.report.noise import build_noise_report, noise_summary
    from realitygap.study.noise.config import NoiseConfig, levels_of, tasks_of
    from realitygap.study.noise.run import noise_study

    config = NoiseConfig(
        levels=levels_of(levels),
        runs=40 if runs is None else runs,
        seed_sets=seed_sets,
        units=units,
        starts=starts,
        evaluations=1000 if evaluations is None else evaluations,
        twin_noise=twin_noise,
        seed=seed,
        tasks=tasks_of(tasks),
        seconds=seconds,
    )
    try:
        with ProgressLine() as progress:
            results = noise_study(out, config, workers=workers, resume=resume, on_progress=progress.noise)
            page = build_noise_report(out, on_progress=progress.report)
    except (KeyboardInterrupt, StudyInterruptedError, RobotStoppedError):
        raise StoppedError(_stopped(out)) from None
    summary = noise_summary(out)
    if json_output:
        print_json({"study": str(out), "results": str(results), "report": str(page), **summary})
        return
    click.echo(f"{summary['paragraph']}\n\nresults {results}\nreport  {page}")


def _stopped(out: Path) -> str:
    """What to do next; the options that were given are those on the user's screen."""
    again = f"realitygap study noise --out {shlex.quote(str(out))} --resume"
    return f"stopped; what is done is kept in {out}; resume with `{again}` and the same options"
