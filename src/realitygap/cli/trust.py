"""Whether a program that came with somebody else's study may be run."""

from pathlib import Path

import click

from realitygap.cli.output import at_terminal

__all__ = ["ask_trust"]


def ask_trust(study: str, trust: bool) -> None:
    """See to it once, before a study's task files are run, that they may be.

    Where nobody can answer, nothing is agreed to: whoever would run a file refuses it.

    Raises:
        click.Abort: the answer is no.
    """
    from realitygap.study.folder import agree, programs

    found = [] if trust else programs(Path(study))
    if found and not at_terminal():
        return
    for file in found:
        click.echo(
            f"{study} was made elsewhere. To simulate its task, this program has to run: {file}", err=True
        )
    if found:
        click.confirm("Do you trust who wrote it?", abort=True, err=True)
    agree(Path(study))
