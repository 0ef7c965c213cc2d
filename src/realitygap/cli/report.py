"""`realitygap report`: make a study's page again."""

import click

from realitygap.cli import option
from realitygap.cli.estimate import ask_trust
from realitygap.cli.output import tell
from realitygap.cli.progress import ProgressLine

__all__ = ["report"]


@click.command()
@click.argument("study", type=click.Path())
@option.trust
@option.as_json
def report(study: str, trust: bool, json_output: bool) -> None:
    """Rebuild the report of STUDY.

    STUDY is a folder; its page, figures and tables are made from its database.

    \b
    Example:
        realitygap report out/reproduce
    """
    from realitygap.report.build import build_report
    from realitygap.report.scores import study_tables
    from realitygap.study.load import load_study
    from realitygap.transfer.score_rows import marks_of

    ask_trust(study, trust)
    with ProgressLine() as progress:
        loaded = load_study(study)
        marks_of(loaded, on_progress=progress.marks)
        page = build_report(study, workers=None, on_progress=progress.report)
        tables = study_tables(loaded)
    tell(json_output, {"report": str(page), "tables": [t.to_dict() for t in tables]}, f"report {page}")
