"""`realitygap reproduce`: the paper's experiment as a whole, from the robot that is measured to the page."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from realitygap.cli import option
from realitygap.cli.failure import resumable
from realitygap.cli.kinds import Whole
from realitygap.cli.notes import note_few, note_new
from realitygap.cli.studies import show_study
from realitygap.work.progress import ProgressLine

if TYPE_CHECKING:
    from realitygap.work.pool import Workers

__all__ = ["reproduce"]


@click.command()
@option.out("out/reproduce")
@option.profile(None, "  [default: a profile calibrated first, to unit 1 of the twin]")
@option.runs("Runs for each task and noise level [default: 5].")
@option.evaluations
@option.seed(None, " [default: 1995]")
@click.option("--starts", type=Whole(1, 10**6), help="Trials of each champion on the twin [default: 8].")
@option.workers
@option.engine
@click.option(
    "--no-transfer",
    is_flag=True,
    help="Stop before the transfer: no trials on the twin. Resuming without it makes them.",
)
@option.watch
@option.resume
@option.as_json
def reproduce(
    out: Path,
    workers: Workers,
    engine: str,
    no_transfer: bool,
    watch: bool,
    resume: bool,
    json_output: bool,
    **options: Any,
) -> None:
    """Repeat the paper's experiment and write a page about it.

    First, as in the paper, it records the readings of unit 1 of the twin (pseudo-reality: a physics model
    behind the robot's own serial protocol) and fits the simulation to them. It evolves both tasks in that
    simulation at all three noise levels, has every champion drive the unit, and films one of each kind.
    It scores the runs and writes a page about them. --profile paper uses the printed constants and records
    nothing. With --resume, omitted options keep their saved values.

    \b
    Example:
        realitygap reproduce --out out/reproduce
    """
    from realitygap import api
    from realitygap.experiments.reproduction import ASKED
    from realitygap.study.store import DATABASE
    from realitygap.transfer.record import load_transfers

    requested = api.reproduction(out, resume, options)
    if not resume:
        note_few(requested.evaluations)
    else:
        note_new(out, DATABASE, ASKED)
    again = f"reproduce{' --no-transfer' * no_transfer}{option.unusual(engine)} --out {shlex.quote(str(out))}"
    with resumable(out, f"realitygap {again} --resume", DATABASE, ASKED), ProgressLine() as progress:
        study, page = api.carry_out(
            out, requested, workers=workers, engine=engine, resume=resume, watch=watch,
            transfer=not no_transfer, on_progress=progress.show,
        )  # fmt: skip
        took = progress.took()
    made = {} if no_transfer else {"transfers": [one.to_dict() for one in load_transfers(out)]}
    show_study(out, study, page, made, json_output=json_output)
    click.echo(took, err=True)
