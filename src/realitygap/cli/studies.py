"""What `reproduce` and `evolve` have in common: carry a study out, make its report, say where it is."""

from __future__ import annotations

import shlex
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import click

from realitygap.cli.failure import resumable
from realitygap.cli.output import print_json, table, tell
from realitygap.cli.progress import ProgressLine
from realitygap.cli.show import describe, print_runs
from realitygap.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from realitygap.report.scores import ScoreTable
    from realitygap.study.config import StudyConfig
    from realitygap.study.load import Study
    from realitygap.work.shard import Shard
    from realitygap.work.workers import Workers

    Then = Callable[[Study, ProgressLine], dict[str, Any]]

__all__ = ["carry_out", "reported", "show_shard", "show_study"]

SCORES = ("behaviour", "correspondence")


class Carried(NamedTuple):
    """A study that was carried out, its report's page (None for a shard), its tables of scores, more parts of
    the JSON, and how long each phase took, in words."""

    folder: Path
    study: Study
    page: Path | None
    tables: Sequence[ScoreTable]
    more: Mapping[str, Any]
    took: str


def carry_out(
    folder: Path,
    config: StudyConfig | Callable[[ProgressLine], StudyConfig],
    *,
    words: str,
    workers: Workers,
    engine: str,
    resume: bool,
    shard: Shard | None = None,
    then: Then | None = None,
    watch: bool = False,
) -> Carried:
    """Run or continue the study in `folder`, then report on it; the result, for `show_study`.

    Args:
        folder: the study's, or the shard's.
        config: what to do, or who finds that out first; a study that is there must have been made with it.
        words: how this command is called, up to its options: what to type to resume.
        workers: processes; one a core if None.
        engine: what evolution's trials run on.
        resume: continue what is there.
        shard: which share of the study, without a report; None continues a shard that is there.
        then: what is done between the study and its report; it gives further parts of the JSON.
        watch: keep a page up to date that shows how evolution goes; refused for a shard.

    Raises:
        UsageError: a shard is to be watched.
        StoppedError: on Ctrl-C, saying how to continue.
    """
    from realitygap.experiments.reproduction import ASKED
    from realitygap.study.reader import DATABASE
    from realitygap.study.runner import run_study
    from realitygap.work.shard import read_mark

    part = shard is not None or read_mark(folder) is not None
    if part and watch:
        raise UsageError("watch: a shard has no page. Leave it out.")
    again = f"realitygap {words} --out {shlex.quote(str(folder))} --resume"
    with resumable(folder, again, DATABASE, ASKED), ProgressLine() as progress, ExitStack() as stack:
        requested, show = config(progress) if callable(config) else config, progress.show
        if watch:
            from realitygap.report.watch import Watch

            seen = stack.enter_context(Watch(folder, show))
            click.echo(f"watch {seen.page.resolve().as_uri()}", err=True)
            show = seen.show
        study = run_study(
            folder, requested, workers=workers, engine=engine, resume=resume, shard=shard, on_progress=show
        )
        if part:
            return Carried(folder, study, None, (), {}, progress.took())
        more = {} if then is None else then(study, progress)
        return reported(folder, study, workers, progress, more)


def reported(
    folder: Path, study: Study, workers: Workers, progress: ProgressLine, more: Mapping[str, Any]
) -> Carried:
    """Score a study's runs and make its page; `more` are further parts of the JSON."""
    from realitygap.report.build import build_report
    from realitygap.report.scores import study_tables
    from realitygap.transfer.score_rows import marks_of

    marks = marks_of(study, workers=workers, on_progress=progress.marks)
    page = build_report(folder, workers=workers, on_progress=progress.report)
    return Carried(folder, study, page, study_tables(study, marks), more, progress.took())


def show_shard(folder: Path, more: Mapping[str, Any], *lines: str, json_output: bool) -> None:
    """Print what a shard did, where it is, and how all of them are put together."""
    from realitygap.work.shard import read_mark, whole_of

    mark = read_mark(folder)
    assert mark is not None
    each = whole_of(folder)
    facts = {"study": str(folder), "shard": str(mark.shard), **more}
    merging = f"realitygap merge {shlex.quote(str(folder.with_name(each.name)))}-shard-*-of-{mark.shard.of}"
    tell(json_output, facts, *lines, f"\nshard {mark.shard} in {folder}\nwhen all are done: {merging}")


def show_study(carried: Carried, *, json_output: bool) -> None:
    """Print a study's runs and scores, and where it and its report are; for a shard the finished runs, and
    how to merge all shards."""
    folder, study, page, tables, more, _ = carried
    if page is None:
        done = [run for run in study.runs if run.finished]
        if not json_output:
            print_runs(done)
        show_shard(folder, {"runs": [describe(study, run) for run in done]}, json_output=json_output)
        return
    if json_output:
        runs = [describe(study, run) for run in study.runs]
        told = [table.to_dict() for table in tables]
        print_json({"study": str(folder), "report": str(page), "runs": runs, "tables": told, **more})
        return
    print_runs(study.runs)
    _print_scores(tables)
    click.echo(f"\nstudy  {folder}\nreport {page}")


def _print_scores(tables: Sequence[ScoreTable]) -> None:
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
        click.echo(table(head, [[*row, *("–",) * (len(head) - len(row))] for row in rows]))
