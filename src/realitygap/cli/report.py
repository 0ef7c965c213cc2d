"""`realitygap report`: make a study's page again."""

from __future__ import annotations

import click

from realitygap.cli.options import as_json
from realitygap.cli.output import print_json

__all__ = ["report"]


@click.command()
@click.argument("study", type=click.Path())
@as_json
def report(study: str, json_output: bool) -> None:
    """Make the report of STUDY again.

    STUDY is a folder; its page, figures and tables are made from its database.

    \b
    Example:
        realitygap report out/reproduce
    """
    from realitygap.report.build import build_report

    page = build_report(study)
    if json_output:
        print_json({"report": str(page)})
    else:
        click.echo(f"report {page}")
