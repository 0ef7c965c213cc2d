"""What a person should know, or is asked, before a command starts."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from realitygap.cli.failure import is_begun
from realitygap.cli.output import at_terminal

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

__all__ = ["ask_trust", "note", "note_few", "note_new", "note_versions"]


def note(text: str) -> None:
    """Print a note, one line on stderr."""
    click.echo(f"note: {text}", err=True)


def note_new(folder: Path, *files: str) -> None:
    """Note that there is nothing to resume in a folder, which has none of the files that would say what."""
    if not is_begun(folder, *files):
        note(
            f"--resume: nothing was begun in {folder}; starting there, with the usual settings for all that "
            "is not given"
        )


def note_versions(found: Iterable[Mapping[str, Iterable[str]]]) -> None:
    """Note what differed between the machines that made shards: bits may differ too."""
    from realitygap.api import different_versions

    for said in different_versions(found):
        note(said)


def note_few(evaluations: int, population: int = 64) -> None:
    """Note that a run has fewer evaluations than the population (the paper's has 64)."""
    if evaluations < population:
        note(
            f"{evaluations} evaluations are fewer than the population's {population}: all individuals are "
            "random and none is bred"
        )


def ask_trust(study: str, trust: bool) -> None:
    """Ask once, before a study's task files are run, whether they may be.

    Without a terminal nothing is agreed to: whatever would run a file refuses it.

    Raises:
        click.Abort: the answer is no.
    """
    from realitygap.study.folder import agree, programs

    found = [] if trust else programs(Path(study))
    if found and not at_terminal():
        return
    for file in found:
        click.echo(
            f"{study} was made elsewhere. To simulate its task, this program must run: {file}", err=True
        )
    if found:
        click.confirm("Do you trust its author?", abort=True, err=True)
    agree(Path(study))
