"""`realitygap export`: a study's tables, a trial's log, a controller as source for a robot's processor."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click
from click.core import ParameterSource

from realitygap.cli import option
from realitygap.cli.kinds import Whole
from realitygap.cli.notes import ask_trust
from realitygap.cli.output import tell

if TYPE_CHECKING:
    from realitygap.study.load import Run, Study

__all__ = ["export"]

GOES_WITH = {"tables": (), "log": ("individual", "robot", "start"), "source": ("individual", "name")}
"""Options that belong to each use; a log and a source are of one RUN."""
USES = {"parquet": "tables", "csv": "tables", "rerun": "log", "mcap": "log"}


@click.command()
@click.argument("study", type=click.Path())
@click.argument("run", required=False)
@click.option(
    "--format", "kind", type=click.Choice(list(USES)),
    help="parquet, csv: tables of all runs, a file each (runs, evaluations, tests, trials, scores); rerun, "
    "mcap: the log of one of RUN's trials on a robot.",
)  # fmt: skip
@click.option(
    "--language", type=click.Choice(["c99", "micropython", "arduino", "e-puck2"]),
    help="Source of RUN's controller. c99: a header and a source file; micropython: a module; "
    "arduino: a sketch's folder; e-puck2: a project on its maker's library.",
)  # fmt: skip
@click.option(
    "--out", type=click.Path(path_type=Path), required=True, metavar="DIR", help="Folder to write into."
)
@option.individual
@click.option("--robot", metavar="ROBOT", help="The trial's robot: its folder in transfer/, such as twin-1.")
@click.option("--start", type=Whole(1, 10**6), help="Which trial, from 1 [default: the first].")
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
    robot: str | None,
    start: int | None,
    name: str,
    trust: bool,
    json_output: bool,
) -> None:
    """Write STUDY as tables, a trial of one RUN as a log, or its controller as source.

    With --format parquet or csv: the whole study for pandas, R, DuckDB or a spreadsheet.
    The documentation's page How to look at results describes each column.

    With --format rerun or mcap: one trial of RUN on a robot, the simulated robot beside the situated one
    on one time line, for Rerun's viewer or Foxglove: arena, rays, readings, network, film. --individual,
    --robot and --start choose the trial.

    With --language: an evolved individual of RUN for a robot's own processor. It uses whole numbers only, and
    is the same to the bit as in the simulation: readings in counts go in, wheel commands in the robot's
    units come out. Test vectors are written beside it. RUN is a number or a name, as `realitygap show STUDY`
    lists them; --individual and --name apply too.

    \b
    Examples: all tables; a log; a controller for any chip with a C compiler; a sketch for Arduino's IDE
        realitygap export out/reproduce --format parquet --out tables
        realitygap export out/reproduce 1 --format rerun --out logs
        realitygap export out/reproduce 1 --language c99 --out avoider
        realitygap export out/reproduce 1 --language arduino --name avoider --out .
    """
    from realitygap.study.load import load_study

    use = _use(run, kind, language)
    ask_trust(study, trust)
    loaded = load_study(study)
    if use == "tables":
        _tables(loaded, str(kind), out, json_output)
    elif use == "log":
        _log(loaded.run(str(run)), str(kind), out, (individual, robot, start), json_output)
    else:
        _source(loaded, str(run), str(language), out, individual, name, json_output)


def _use(run: str | None, kind: str | None, language: str | None) -> str:
    """What is asked for: one thing, with what goes with it."""
    if (kind is None) == (language is None):
        raise click.UsageError(
            "expected one of --format (the study's tables, or the log of a trial of RUN) and --language "
            "(the controller of RUN)."
        )
    use, said = USES.get(str(kind), "source"), f"--format {kind}" if language is None else "--language"
    if use == "tables" and run is not None:
        raise click.UsageError(f"RUN: {said} covers the whole study. Leave {run!r} out.")
    if use != "tables" and run is None:
        raise click.UsageError(f"{said}: expected a RUN, as in STUDY 1.")
    context = click.get_current_context()
    for key in dict.fromkeys(key for keys in GOES_WITH.values() for key in keys):
        given = context.get_parameter_source(key) is ParameterSource.COMMANDLINE
        if given and key not in GOES_WITH[use]:
            raise click.UsageError(f"--{key}: does not go with {said}. Leave it out.")
    return use


def _log(
    run: Run, kind: str, out: Path, which: tuple[str, str | None, int | None], json_output: bool
) -> None:
    from realitygap.export.logs import trial_log, write_log

    one = trial_log(run, *which)
    path = write_log(one, kind, out)
    facts = {
        "study": str(run.study.folder), "run": run.id, "format": kind, "file": str(path), "trial": one.name,
    }  # fmt: skip
    tell(json_output, facts, f"wrote {path}: {path.stat().st_size:,} bytes")


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
    from realitygap.export.onboard import on_board, sizes, write_source

    one = study.run(run)
    who, genes = the_individual(one, individual)
    board = on_board(one, who, genes, name=name)
    made = write_source(board, language, out)
    source = next((path for path in made if path.suffix == ".c"), None)
    code = sizes(source) if source is not None else {}
    facts = {
        "study": str(study.folder), "run": one.id, "individual": who, "name": board.name,
        "language": language, "files": [str(path) for path in made], "state_bytes": board.state_bytes,
        "code_bytes": code,
    }  # fmt: skip
    neurons, links = len(board.thresholds), len(board.sources)
    tell(
        json_output,
        facts,
        *(f"wrote {path}" for path in made),
        f"{neurons} neurons, {links} links; {board.state_bytes} bytes of state",
        *(f"{chip}: {size} bytes of code and tables" for chip, size in code.items()),
    )
