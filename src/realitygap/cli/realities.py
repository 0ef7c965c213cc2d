"""`realitygap realities`: the whole loop on each reality at hand, and one matrix of them all."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from realitygap.cli import option
from realitygap.cli.failure import resumable
from realitygap.cli.kinds import Whole
from realitygap.cli.notes import note_new
from realitygap.cli.output import print_json, table, warn
from realitygap.work.progress import ProgressLine, counts

if TYPE_CHECKING:
    from realitygap.experiments.realities import Realities
    from realitygap.work.pool import Workers

__all__ = ["realities"]

SMALL = {"runs": 2, "starts": 2, "evaluations": 200}
FEW = 5
"""Runs a level below which the table has no scores: their means would say nothing."""


@click.command()
@option.out("out/realities")
@click.option(
    "--robot", "robots", multiple=True, metavar="R",
    help="A reality to include: twin, stranger, enki:MODEL, or a body of your own that places "
    "itself, file.py:Class; may be repeated.",
)  # fmt: skip
@click.option("--only", is_flag=True, default=None, help="Only those that --robot names.")
@option.base
@click.option("--small", is_flag=True, help="A small version, in minutes: 2 runs, 2 starts, 200 evaluations.")
@click.option("--levels", metavar="L,L,…", help="Noise levels (1 = observed) [default: 0,1,2].")
@option.runs("Runs at each level [default: 6].")
@click.option("--starts", type=Whole(2, 1000), help="Trials of each controller [default: 4].")
@option.evaluations
@option.seed(None, " [default: 1995]")
@option.seconds
@option.workers
@option.resume
@option.as_json
def realities(
    out: Path, workers: Workers, small: bool, resume: bool, json_output: bool, **options: Any
) -> None:
    """Run the whole loop on each available reality.

    The realities are the twin, the robots of EPFL's simulator Enki (its Khepera, e-puck and Thymio II)
    and those that --robot names. Each robot is recorded, and a simulation calibrated to it. Controllers
    that avoid obstacles evolve in it at every noise level, drive the robot and are compared with the
    simulation. Prints one matrix for all: model error over noise, beside that of real robots' readings;
    noise; correspondence by level; and where the simulation is as noisy as the reality. Realities that are
    not installed are left out, unless --robot names them. With --resume, omitted options keep their saved
    values.

    \b
    Examples: a small one to try; a robot of your own beside all others; two of Enki's alone
        realitygap realities --small
        realitygap realities --robot my_robot.py:MyRobot --base my_robot.toml --out out/mine
        realitygap realities --only --robot enki:epuck --robot enki:thymio2 --out out/enki
    """
    from realitygap.experiments.realities import carry_out
    from realitygap.report.experiment import build_realities_page, matrix, noise_summary

    asked = _asked(out, resume, {**(SMALL if small else {}), **option.given(options)})
    if resume:
        note_new(out, asked.FILE)
    with resumable(out, asked.resuming(out), asked.FILE), ProgressLine() as progress:
        places = carry_out(out, asked, workers=workers, resume=resume, on_progress=progress.show)
        few = asked.runs < FEW
        drawn = counts(progress.show, "making the report", "figures")
        page = build_realities_page(out, places, few=few, on_progress=drawn)
    warn(f"{place.robot} is left out: {place.why}" for place in places if place.why)
    if json_output:
        robots = [
            {"robot": one.robot, "folder": str(one.folder), **noise_summary(one.folder)}
            for one in places if not one.why
        ]  # fmt: skip
        left = [{"robot": one.robot, "why": one.why} for one in places if one.why]
        print_json({"folder": str(out), "report": str(page), "realities": robots, "left_out": left})
        return
    rows = matrix(places, few=few)
    click.echo(f"{table(rows.head, rows.rows)}\n\nreport {page}")


def _asked(out: Path, resume: bool, given: dict[str, Any]) -> Realities:
    """The usual one with what was given; or, resumed, the one that is there."""
    from dataclasses import replace

    from realitygap.experiments.noise import levels_of
    from realitygap.experiments.realities import Realities

    begun = Realities.begun(out, resume=resume)
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
