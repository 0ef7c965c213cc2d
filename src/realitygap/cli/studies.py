"""What `reproduce` and `evolve` have in common: carry a study out, make its report, say where it is."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from realitygap.cli.failure import StoppedError
from realitygap.cli.output import print_json
from realitygap.cli.progress import ProgressLine
from realitygap.cli.show import describe, print_runs

if TYPE_CHECKING:
    from realitygap.study.config import StudyConfig

__all__ = ["carry_out"]


def carry_out(
    folder: Path, config: StudyConfig | None, *, workers: int | None, resume: bool, json_output: bool
) -> None:
    """Run or continue the study in `folder`, then report on it.

    Raises:
        StoppedError: on Ctrl-C, saying how to go on.
    """
    from realitygap.study.load import load_study
    from realitygap.study.runner import run_study

    try:
        with ProgressLine() as progress:
            run_study(folder, config, workers=workers, resume=resume, on_progress=progress)
        page = _report(folder)
    except KeyboardInterrupt:
        command = click.get_current_context().command_path
        again = f"{command} --out {folder} --resume"
        raise StoppedError(f"stopped; what is done is kept in {folder}; resume with `{again}`") from None
    study = load_study(folder)
    if json_output:
        runs = [describe(study, run) for run in study.runs]
        print_json({"study": str(folder), "report": str(page), "runs": runs})
        return
    print_runs(study.runs)
    click.echo(f"\nstudy  {folder}\nreport {page}")


def _report(folder: Path) -> Path:
    """The study's page."""
    from realitygap.report.build import build_report

    click.echo("making the report", err=True)
    return build_report(folder)
