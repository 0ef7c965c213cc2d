"""`realitygap reproduce`: the paper's thirty runs, their champions on the twin, and the page about both."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from realitygap.cli.options import as_json, evaluations_option, runs_option, seed_option, workers_option
from realitygap.cli.studies import carry_out, interrupted_config

if TYPE_CHECKING:
    from realitygap.cli.progress import ProgressLine
    from realitygap.study.load import Study

__all__ = ["reproduce"]


@click.command()
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    default=Path("out/reproduce"),
    show_default=True,
    metavar="DIR",
    help="The study's folder.",
)
@runs_option("Runs for each task and level of noise [default: 5].")
@evaluations_option
@seed_option(None, " [default: 1995]")
@workers_option
@click.option("--no-transfer", is_flag=True, help="Evolve and report only: no trials on the twin.")
@click.option("--resume", is_flag=True, help="Continue an interrupted study to exactly the same result.")
@as_json
def reproduce(
    out: Path,
    runs: int | None,
    evaluations: int | None,
    seed: int | None,
    workers: int | None,
    no_transfer: bool,
    resume: bool,
    json_output: bool,
) -> None:
    """Make the paper's runs, and the page about them.

    Evolves both tasks at all three levels of noise, as the paper does, lets every champion drive
    the twin (pseudo-reality: a physics model behind the robot's own serial protocol), films one of
    each kind, and reports on all that. With --resume what is not given is as it was.

    \b
    Example:
        realitygap reproduce --out out/reproduce
    """
    from realitygap.study.config import StudyConfig

    begun = interrupted_config(out, resume) or StudyConfig.reproduction()
    config = StudyConfig.reproduction(
        runs=begun.runs if runs is None else runs,
        evaluations=begun.evaluations if evaluations is None else evaluations,
        seed=begun.seed if seed is None else seed,
    )
    carry_out(
        out,
        config,
        words="reproduce --no-transfer" if no_transfer else "reproduce",
        workers=workers,
        resume=resume,
        json_output=json_output,
        then=None if no_transfer else lambda study, progress: _transferred(study, progress, workers),
    )


def _transferred(study: Study, progress: ProgressLine, workers: int | None) -> dict[str, Any]:
    """Every champion on the twin, those filmed that figures 3 and 5 show."""
    from realitygap.study.transfer import transfer
    from realitygap.study.transfer_choice import shown_runs

    film = [run.id for run in shown_runs(study)]
    made = transfer(study, robots=("twin:1",), film=film, workers=workers, on_progress=progress.transfer)
    return {"transfers": [one.to_dict() for one in made]}
