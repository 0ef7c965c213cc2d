"""`realitygap reproduce`: the paper's thirty runs, and the page about them."""

from __future__ import annotations

from pathlib import Path

import click

from realitygap.cli.options import as_json, evaluations_option, runs_option, seed_option, workers_option
from realitygap.cli.studies import carry_out, interrupted_config

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
@click.option("--resume", is_flag=True, help="Continue an interrupted study to exactly the same result.")
@as_json
def reproduce(
    out: Path,
    runs: int | None,
    evaluations: int | None,
    seed: int | None,
    workers: int | None,
    resume: bool,
    json_output: bool,
) -> None:
    """Make the paper's runs, and the page about them.

    Evolves both tasks at all three levels of noise, as the paper does, and reports on them. With
    --resume what is not given is as it was.

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
    carry_out(out, config, words="reproduce", workers=workers, resume=resume, json_output=json_output)
