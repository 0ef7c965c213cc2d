"""`realitygap report`: make the page of a study, or of an experiment, again."""

from pathlib import Path

import click

from realitygap.cli import option
from realitygap.cli.notes import ask_trust
from realitygap.cli.output import tell

__all__ = ["report"]


@click.command()
@click.argument("study", type=click.Path())
@option.trust
@option.as_json
def report(study: str, trust: bool, json_output: bool) -> None:
    """Rebuild the report of STUDY.

    STUDY is a folder; its page, figures and tables are made from its database. The folder of a finished noise
    experiment will do too.

    \b
    Example:
        realitygap report out/reproduce
    """
    from realitygap import api
    from realitygap.experiments.noise import CONFIG
    from realitygap.report.scores import study_tables
    from realitygap.study.load import load_study
    from realitygap.work.pool import opened

    if (Path(study) / CONFIG).is_file():
        from realitygap.cli.experiment import show_noise
        from realitygap.experiments.experiment import RESULTS

        show_noise(Path(study), Path(study) / RESULTS, {}, json_output=json_output)
        return
    ask_trust(study, trust)
    with opened(None, one_thread=True) as pool:
        loaded = load_study(study)
        page = api.report(Path(study), loaded, workers=pool)
    tables = [table.to_dict() for table in study_tables(loaded)]
    tell(json_output, {"report": str(page), "tables": tables}, f"report {page}")
