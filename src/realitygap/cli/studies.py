"""What `reproduce` and `evolve` have in common: carry a study out, make its report, say where it is."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import click

from realitygap.cli.failure import StoppedError
from realitygap.cli.output import print_json, print_table
from realitygap.cli.progress import ProgressLine
from realitygap.cli.show import describe, print_runs
from realitygap.errors import StudyInterruptedError

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from realitygap.report.scores import ScoreTable
    from realitygap.study.config import StudyConfig
    from realitygap.study.load import Study
    from realitygap.work.workers import Workers

    Then = Callable[[Study, ProgressLine], dict[str, Any]]

__all__ = ["carry_out", "interrupted_config", "print_scores", "show_study"]

SCORES = ("behaviour", "correspondence")


class Carried(NamedTuple):
    """A study that was carried out, its report's page, its tables of scores, and more parts of the JSON."""

    folder: Path
    study: Study
    page: Path
    tables: Sequence[ScoreTable]
    more: Mapping[str, Any]


def carry_out(
    folder: Path,
    config: StudyConfig | Callable[[ProgressLine], StudyConfig],
    *,
    words: str,
    workers: Workers,
    resume: bool,
    then: Then | None = None,
) -> Carried:
    """Run or continue the study in `folder`, then report on it; what came of it, for `show_study`.

    Args:
        folder: the study's.
        config: what to do, or who finds that out first; a study that is there must have been made with it.
        words: how this command is called, up to its options: what to type to resume.
        workers: processes; one a core if None.
        resume: continue what is there.
        then: what is done between the study and its report; it gives further parts of the JSON.

    Raises:
        StoppedError: on Ctrl-C, saying how to go on.
    """
    from realitygap.report.build import build_report
    from realitygap.report.scores import study_tables
    from realitygap.study.runner import run_study
    from realitygap.transfer.score_rows import marks_of

    try:
        with ProgressLine() as progress:
            requested = config(progress) if callable(config) else config
            study = run_study(folder, requested, workers=workers, resume=resume, on_progress=progress.show)
            more = {} if then is None else then(study, progress)
            marks_of(study, on_progress=progress.marks)
            page = build_report(folder, workers=workers, on_progress=progress.report)
            tables = study_tables(study)
    except (KeyboardInterrupt, StudyInterruptedError):
        again = f"realitygap {words} --out {shlex.quote(str(folder))} --resume"
        raise StoppedError(f"stopped; what is done is kept in {folder}; resume with `{again}`") from None
    return Carried(folder, study, page, tables, more)


def show_study(carried: Carried, *, json_output: bool) -> None:
    """Print a study's runs and scores, and where it and its report are."""
    folder, study, page, tables, more = carried
    if json_output:
        runs = [describe(study, run) for run in study.runs]
        told = [table.to_dict() for table in tables]
        print_json({"study": str(folder), "report": str(page), "runs": runs, "tables": told, **more})
        return
    print_runs(study.runs)
    print_scores(tables)
    click.echo(f"\nstudy  {folder}\nreport {page}")


def print_scores(tables: Sequence[ScoreTable]) -> None:
    """Tables 1 and 2 by their averages."""
    rows = [
        [
            table.task, one.name, table.kind or "–",
            *("–" if mean is None else f"{mean.value:.1f}" for mean in map(one.mean, SCORES)),
            *(f"{value:g}" for value in one.paper_average or ()),
        ]
        for table in tables for one in table.classes if one.marks
    ]  # fmt: skip
    if rows:
        click.echo()
        paper = tuple(f"paper's {name}" for name in SCORES)
        head = ("scores, 0 to 10", "noise", "on", *SCORES, *paper)
        print_table(head, [[*row, *("–",) * (len(head) - len(row))] for row in rows])


def interrupted_config(folder: Path, resume: bool) -> StudyConfig | None:
    """What the study in `folder` was made with, if it is to be resumed and there is one."""
    from realitygap.study.folder import exists, own_config

    return own_config(folder) if resume and exists(folder) else None
