"""What a command will cost and whose programs it runs: noted or asked before it starts."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

import click

from realitygap.cli.failure import is_begun
from realitygap.cli.output import at_terminal

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from realitygap.work.workers import Workers

__all__ = ["ask_trust", "consider", "note", "note_new", "note_versions"]

EVALUATIONS_A_SECOND = 1000
"""Of one core: two trials of twenty seconds each, tests included (docs/benchmarks.md)."""
TRIALS_A_SECOND = 2.5
"""Of one core: watched trials of twenty seconds on the twin (the same)."""
DAY_S = 86400.0
POPULATION = 64
"""Of the paper's grid."""
LONG_S = DAY_S / 2
"""From this long on, the work is confirmed first."""


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
    seen: dict[str, dict[str, None]] = {}
    for one in found:
        for name, values in one.items():
            seen.setdefault(name, {}).update(dict.fromkeys(values))
    for name, values in seen.items():
        if len(values) > 1 and name != "platform":
            note(f"the shards were made with different {name}: {', '.join(map(str, values))}")


def consider(
    *, runs: int = 0, evaluations: int = 0, trials: int = 0, workers: Workers, population: int = POPULATION
) -> None:
    """Note how long a large amount of work takes; on a terminal, ask first.

    Args:
        runs: of evolution; evaluations: of each.
        trials: on the twin.
        workers: processes; one a core if None.
        population: individuals that a run starts with.

    Raises:
        click.Abort: the answer is no.
    """
    if runs and evaluations < population:
        note(
            f"{evaluations} evaluations are fewer than the population's {population}: all individuals are "
            "random and none is bred"
        )
    hands = (workers if isinstance(workers, int) else os.cpu_count()) or 1
    seconds = runs * evaluations / EVALUATIONS_A_SECOND / max(1, min(runs, hands))
    seconds += trials / TRIALS_A_SECOND / max(1, min(trials, hands))
    if seconds < LONG_S:
        return
    much = f"{seconds / 3600:.0f} hours" if seconds < 2 * DAY_S else f"{seconds / DAY_S:,.0f} days"
    work = {"evaluations": runs * evaluations, "trials on robots": trials}
    said = " and ".join(f"{count:,} {what}" for what, count in work.items() if count)
    note(f"{said}: about {much} on this machine")
    if at_terminal():
        click.confirm("Start?", abort=True, err=True)


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
