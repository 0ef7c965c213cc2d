"""`realitygap export`: an evolved individual as source for a robot's own processor."""

from pathlib import Path

import click

from realitygap.cli import option
from realitygap.cli.output import print_json
from realitygap.cli.trust import ask_trust

__all__ = ["export"]


@click.command()
@click.argument("study", type=click.Path())
@click.argument("run")
@click.option(
    "--language", required=True, type=click.Choice(["c99", "micropython", "arduino"]),
    help="c99: a header and a source file; micropython: a module; arduino: a sketch's folder.",
)  # fmt: skip
@click.option(
    "--out", type=click.Path(path_type=Path), required=True, metavar="DIR", help="Folder to write into."
)
@option.individual
@click.option("--name", default="controller", metavar="NAME", help="Prefix of files and functions.")
@option.trust
@option.as_json
def export(
    study: str, run: str, language: str, out: Path, individual: str, name: str, trust: bool, json_output: bool
) -> None:
    """Write an evolved individual as source for a robot's own processor.

    Whole numbers alone, the same to the bit as in the simulation: readings in counts go in, wheel
    commands in the robot's units come out. Test vectors are written beside it. RUN is a number or a
    name, as `realitygap show STUDY` lists them.

    \b
    Examples: for any chip with a C compiler; a sketch to open in Arduino's IDE
        realitygap export out/reproduce 1 --language c99 --out avoider
        realitygap export out/reproduce 1 --language arduino --name avoider --out .
    """
    from realitygap.cli.replay import the_individual
    from realitygap.export.onboard import on_board
    from realitygap.export.source import sizes, write_source
    from realitygap.study.load import load_study

    ask_trust(study, trust)
    loaded = load_study(study)
    one = loaded.run(run)
    who, genes = the_individual(loaded, one, individual)
    board = on_board(one, who, genes, name=name)
    made = write_source(board, language, out)
    source = next((path for path in made if path.suffix == ".c"), None)
    code = sizes(source) if source is not None else {}
    if json_output:
        print_json({
            "study": study, "run": one.id, "individual": who, "name": board.name, "language": language,
            "files": [str(path) for path in made], "state_bytes": board.state_bytes, "code_bytes": code,
        })  # fmt: skip
        return
    for path in made:
        click.echo(f"wrote {path}")
    neurons, links = len(board.thresholds), len(board.sources)
    click.echo(f"{neurons} neurons, {links} links; {board.state_bytes} bytes of state")
    for chip, size in code.items():
        click.echo(f"{chip}: {size} bytes of code and tables")
