"""`realitygap report`: make a study's page again, or the answer of some arms of the second study of noise."""

from pathlib import Path

import click

from realitygap.cli import option
from realitygap.cli.estimate import ask_trust
from realitygap.cli.output import table, tell
from realitygap.cli.progress import ProgressLine

__all__ = ["report"]


@click.command()
@click.argument("studies", metavar="STUDY…", nargs=-1, required=True, type=click.Path())
@click.option(
    "--out", type=click.Path(path_type=Path), help="Folder for the page of several arms [default: STUDY]."
)
@option.trust
@option.as_json
def report(studies: tuple[str, ...], out: Path | None, trust: bool, json_output: bool) -> None:
    """Rebuild the report of STUDY.

    STUDY is a folder; its page, figures and tables are made from its database. For arms of the second
    study of noise, one or several, the page has the planned analysis: verdicts by arm, and together.

    \b
    Examples: a study; an arm; all arms together
        realitygap report out/reproduce
        realitygap report out/noise-2/E
        realitygap report out/noise-2/E out/noise-2/T --out out/noise-2
    """
    from realitygap.report.noise.arms import arm_folder

    if len(studies) > 1 or arm_folder(studies[0]) is not None:
        _answer(studies, out or Path(studies[0]), json_output=json_output)
        return
    if out is not None:
        raise click.UsageError("--out: belongs to arms of the second study of noise; leave it out.")
    from realitygap.report.build import build_report
    from realitygap.report.scores import study_tables
    from realitygap.study.load import load_study
    from realitygap.transfer.score_rows import marks_of
    from realitygap.work.workers import opened

    study = studies[0]
    ask_trust(study, trust)
    with ProgressLine() as progress, opened(None, one_thread=True) as pool:
        loaded = load_study(study)
        marks = marks_of(loaded, workers=pool, on_progress=progress.marks)
        page = build_report(study, workers=pool, on_progress=progress.report)
        tables = study_tables(loaded, marks)
    tell(json_output, {"report": str(page), "tables": [t.to_dict() for t in tables]}, f"report {page}")


def _answer(folders: tuple[str, ...], out: Path, *, json_output: bool) -> None:
    """Judge arms, write their page, and print the verdicts."""
    from realitygap.report.noise.second import answer_summary, answer_tables, build_answer, read_arms

    with ProgressLine() as progress:
        arms = read_arms(folders)
        page = build_answer(arms, out, on_progress=progress.report)
    if not json_output:
        verdicts = answer_tables(arms)["verdicts"]
        click.echo(table(verdicts.head, verdicts.texts()))
    summary = answer_summary(arms)
    heads = "\n".join(f"({name}) {text}" for name, text in summary["headlines"].items())
    tell(json_output, {"report": str(page), **summary}, f"\n{heads}\n\nreport {page}")
