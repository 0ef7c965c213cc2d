"""`realitygap reproduce`: the paper's experiment as a whole, from the robot that is measured to the page."""

from __future__ import annotations

from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from realitygap.cli import option
from realitygap.cli.kinds import Whole
from realitygap.cli.notes import note_few, note_new
from realitygap.cli.studies import Carried, carry_out, show_study

if TYPE_CHECKING:
    from realitygap.cli.progress import ProgressLine
    from realitygap.experiments.reproduction import Reproduction
    from realitygap.study.config import StudyConfig
    from realitygap.study.load import Study
    from realitygap.work.workers import Workers

__all__ = ["carried_out", "reproduce", "requested_by"]

"""Two tasks at three levels of noise."""


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
    from realitygap.experiments.reproduction import ASKED
    from realitygap.study.reader import DATABASE

    requested = requested_by(out, resume, options)
    if not resume:
        note_few(requested.evaluations)
    else:
        note_new(out, DATABASE, ASKED)
    carried = carried_out(
        out, requested, transfer=not no_transfer, workers=workers, engine=engine, resume=resume, watch=watch
    )
    show_study(carried, json_output=json_output)
    click.echo(carried.took, err=True)


def requested_by(out: Path, resume: bool, options: dict[str, Any]) -> Reproduction:
    """The settings: those given, and for the rest the saved or the usual ones."""
    from realitygap.experiments.reproduction import Reproduction, begun

    return replace((begun(out) if resume else None) or Reproduction(), **option.given(options))


def carried_out(
    out: Path,
    requested: Reproduction,
    *,
    transfer: bool,
    workers: Workers,
    engine: str,
    resume: bool,
    watch: bool = False,
) -> Carried:
    """Calibrate, evolve, let the champions drive the twin if `transfer` is set, report; other arguments as of
    `studies.carry_out`."""
    from realitygap.experiments.reproduction import configured, transferred
    from realitygap.work.workers import opened

    def prepare(progress: ProgressLine) -> StudyConfig:
        return configured(out, requested, resume=resume, workers=pool, on_progress=progress.calibrating)

    def then(study: Study, progress: ProgressLine) -> dict[str, Any]:
        made = transferred(study, starts=requested.starts, workers=pool, on_progress=progress.show)
        return {"transfers": [one.to_dict() for one in made]}

    words, last = ("reproduce", then) if transfer else ("reproduce --no-transfer", None)
    words += option.unusual(engine)
    # One pool for all phases: its processes load and compile once. A single worker is this process.
    with nullcontext(1) if workers == 1 else opened(workers, one_thread=True) as pool:
        return carry_out(out, prepare, words=words, workers=pool, engine=engine, resume=resume, then=last,
                         watch=watch)  # fmt: skip
