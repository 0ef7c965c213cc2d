"""What `reproduce`, `evolve` and `merge` have in common: they say what a study came to, and where it is."""

from __future__ import annotations

import shlex
from typing import TYPE_CHECKING, Any

import click

from realitygap.cli.output import print_json, table, tell
from realitygap.cli.show import describe, print_runs

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from realitygap.report.scores import ScoreTable
    from realitygap.study.load import Study

__all__ = ["show_shard", "show_study"]

SCORES = ("behaviour", "correspondence")


def show_shard(folder: Path, more: Mapping[str, Any], *lines: str, json_output: bool) -> None:
    """Print what a shard did, where it is, and how all of them are put together."""
    from realitygap.work.shard import read_mark, whole_of

    mark = read_mark(folder)
    assert mark is not None
    each = whole_of(folder)
    facts = {"study": str(folder), "shard": str(mark.shard), **more}
    merging = f"realitygap merge {shlex.quote(str(folder.with_name(each.name)))}-shard-*-of-{mark.shard.of}"
    tell(json_output, facts, *lines, f"\nshard {mark.shard} in {folder}\nwhen all are done: {merging}")


def show_study(
    folder: Path, study: Study, page: Path | None, more: Mapping[str, Any] | None = None, *, json_output: bool
) -> None:
    """Print a study's runs and scores, and where it and its page are; for a shard, which has none, the
    finished runs, and how to merge all shards. `more` are further parts of the JSON."""
    from realitygap.report.scores import study_tables

    if page is None:
        done = [run for run in study.runs if run.finished]
        if not json_output:
            print_runs(done)
        show_shard(folder, {"runs": [describe(study, run) for run in done]}, json_output=json_output)
        return
    tables = study_tables(study)
    if json_output:
        runs, rows = [describe(study, run) for run in study.runs], [table.to_dict() for table in tables]
        facts = {"study": str(folder), "report": str(page), "runs": runs, "tables": rows}
        print_json({**facts, **(more or {})})
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
