"""What `reproduce` and `evolve` have in common: carry a study out, make its report, say where it is."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from realitygap.cli.failure import StoppedError
from realitygap.cli.output import print_json
from realitygap.cli.progress import ProgressLine
from realitygap.cli.show import describe, print_runs
from realitygap.errors import StudyInterruptedError

if TYPE_CHECKING:
    from collections.abc import Callable

    from realitygap.study.config import StudyConfig
    from realitygap.study.load import Study

    Then = Callable[[Study, ProgressLine], dict[str, Any]]

__all__ = ["carry_out", "interrupted_config"]


def carry_out(
    folder: Path,
    config: StudyConfig,
    *,
    words: str,
    workers: int | None,
    resume: bool,
    json_output: bool,
    then: Then | None = None,
) -> None:
    """Run or continue the study in `folder`, then report on it.

    Args:
        folder: the study's.
        config: what to do; a study that is there must have been made with the same.
        words: how this command is called, up to its options: what to type to resume.
        workers: processes; one a core if None.
        resume: continue what is there.
        json_output: print JSON.
        then: what is done between the study and its report; it gives further parts of the JSON.

    Raises:
        StoppedError: on Ctrl-C, saying how to go on.
    """
    from realitygap.report.build import build_report
    from realitygap.study.runner import run_study

    try:
        with ProgressLine() as progress:
            study = run_study(folder, config, workers=workers, resume=resume, on_progress=progress.study)
            more = {} if then is None else then(study, progress)
            page = build_report(folder, on_progress=progress.report)
    except (KeyboardInterrupt, StudyInterruptedError):
        again = f"realitygap {words} --out {shlex.quote(str(folder))} --resume"
        raise StoppedError(f"stopped; what is done is kept in {folder}; resume with `{again}`") from None
    if json_output:
        runs = [describe(study, run) for run in study.runs]
        print_json({"study": str(folder), "report": str(page), "runs": runs, **more})
        return
    print_runs(study.runs)
    click.echo(f"\nstudy  {folder}\nreport {page}")


def interrupted_config(folder: Path, resume: bool) -> StudyConfig | None:
    """What the study in `folder` was made with, if it is to be resumed and there is one."""
    from realitygap.study.config import StudyConfig
    from realitygap.study.folder import CONFIG, exists

    if not resume or not exists(folder):
        return None
    return StudyConfig.from_toml(folder / CONFIG)
