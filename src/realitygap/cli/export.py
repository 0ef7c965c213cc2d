"""`realitygap export`: a study's tables, or an evolved individual as source for a robot's own processor."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click
from click.core import ParameterSource

from realitygap.cli import option
from realitygap.cli.estimate import ask_trust
from realitygap.cli.output import print_json, tell

if TYPE_CHECKING:
    from realitygap.study.load import Study

__all__ = ["export"]

OF_SOURCE = ("run", "individual", "name")
"""What only goes with --language."""


@click.command()
@click.argument("study", type=click.Path())
@click.argument("run", required=False)
@click.option(
    "--format", "kind", type=click.Choice(["parquet", "csv"]),
    help="Tables of all runs, a file each: runs, evaluations, tests, trials, scores.",
)  # fmt: skip
@click.option(
    "--language", type=click.Choice(["c99", "micropython", "arduino"]),
    help="Source of RUN's controller. c99: a header and a source file; micropython: a module; "
    "arduino: a sketch's folder.",
)  # fmt: skip
@click.option(
    "--out", type=click.Path(path_type=Path), required=True, metavar="DIR", help="Folder to write into."
)
@option.individual
@click.option("--name", default="controller", metavar="NAME", help="Prefix of files and functions.")
@option.trust
@option.as_json
def export(
    study: str,
    run: str | None,
    kind: str | None,
    language: str | None,
    out: Path,
    individual: str,
    name: str,
    trust: bool,
    json_output: bool,
) -> None:
    """Write STUDY as tables, or the controller of one RUN as source.

    With --format: the whole study for pandas, R, DuckDB or a spreadsheet; what each column is stands in
    docs/tables-and-logs.md.

    With --language: an evolved individual of RUN for a robot's own processor. Whole numbers alone, the
    same to the bit as in the simulation: readings in counts go in, wheel commands in the robot's units
    come out. Test vectors are written beside it. RUN is a number or a name, as `realitygap show STUDY`
    lists them; --individual and --name go with it.

    \b
    Examples: all tables; a controller for any chip with a C compiler; a sketch for Arduino's IDE
        realitygap export out/reproduce --format parquet --out tables
        realitygap export out/reproduce 1 --language c99 --out avoider
        realitygap export out/reproduce 1 --language arduino --name avoider --out .
    """
    from realitygap.study.load import load_study

    _refuse_mixed(run, kind, language)
    ask_trust(study, trust)
    loaded = load_study(study)
    if kind is not None:
        _tables(loaded, kind, out, json_output)
    else:
        assert run is not None and language is not None
        _source(loaded, run, language, out, individual, name, json_output)


def _refuse_mixed(run: str | None, kind: str | None, language: str | None) -> None:
    """See that one thing is asked for, with what goes with it."""
    if (kind is None) == (language is None):
        raise click.UsageError(
            "expected --format (the study's tables) or --language (RUN's controller): one."
        )
    if language is not None and run is None:
        raise click.UsageError("--language: expected the RUN whose controller it is, as in STUDY 1.")
    context = click.get_current_context()
    for key in OF_SOURCE:
        if kind is not None and context.get_parameter_source(key) is ParameterSource.COMMANDLINE:
            said = "RUN" if key == "run" else f"--{key}"
            raise click.UsageError(f"{said}: goes with --language; --format {kind} is of the whole study.")


def _tables(study: Study, kind: str, out: Path, json_output: bool) -> None:
    from realitygap.export.tables import write_tables

    made = write_tables(study, kind, out)
    rows = {path.stem: count for path, count in made.items()}
    facts = {"study": str(study.folder), "format": kind, "files": [str(path) for path in made], "rows": rows}
    tell(json_output, facts, *(f"wrote {path}: {count} rows" for path, count in made.items()))


def _source(
    study: Study, run: str, language: str, out: Path, individual: str, name: str, json_output: bool
) -> None:
    from realitygap.cli.replay import the_individual
    from realitygap.export.onboard import on_board
    from realitygap.export.source import sizes, write_source

    one = study.run(run)
    who, genes = the_individual(one, individual)
    board = on_board(one, who, genes, name=name)
    made = write_source(board, language, out)
    source = next((path for path in made if path.suffix == ".c"), None)
    code = sizes(source) if source is not None else {}
    if json_output:
        print_json({
            "study": str(study.folder), "run": one.id, "individual": who, "name": board.name,
            "language": language, "files": [str(path) for path in made], "state_bytes": board.state_bytes,
            "code_bytes": code,
        })  # fmt: skip
        return
    for path in made:
        click.echo(f"wrote {path}")
    neurons, links = len(board.thresholds), len(board.sources)
    click.echo(f"{neurons} neurons, {links} links; {board.state_bytes} bytes of state")
    for chip, size in code.items():
        click.echo(f"{chip}: {size} bytes of code and tables")
