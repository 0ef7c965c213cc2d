"""`realitygap look`: what the columns of anybody's log seem to be, and the MAP.toml that says so."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from realitygap.cli import options
from realitygap.cli.console import table, tell, warn

if TYPE_CHECKING:
    from collections.abc import Iterator

    from realitygap.logs.look import Look
    from realitygap.logs.mapped import Mapped

__all__ = ["look"]

NAMED = 8
"""Columns of no use that are named."""


@click.command()
@click.argument("log", type=click.Path())
@click.option("--map", "said", metavar="MAP", help="Guess nothing: show the log as this MAP.toml says.")
@click.option(
    "--out", type=options.OutFile(".toml"), help="The MAP.toml to write [default: MAP.toml beside LOG]."
)
@click.option(
    "--picture",
    type=options.OutFile(".png", ".svg", ".pdf"),
    help="Draw the log there [default: beside the MAP.toml, .png].",
)
@options.as_json
def look(log: str, said: str | None, out: Path | None, picture: Path | None) -> None:
    """Say what the columns of LOG seem to be.

    LOG is a table of numbers that any program wrote: any separator, names or none. Prints what each
    column seems to be, and why; draws it; and writes a MAP.toml, which `calibrate`, `score` and `classify`
    take in place of a recording or a track. Correct it where it is wrong, and answer each "?" in it.

    \b
    Examples: look, edit MAP.toml, look again, and fit
        realitygap look run.csv
        realitygap look run.csv --map MAP.toml
        realitygap calibrate MAP.toml --base thymio --out robot.toml
    """
    from realitygap.errors import RecordingError
    from realitygap.files import atomic_write
    from realitygap.logs.look import look as guess
    from realitygap.logs.mapped import read_map
    from realitygap.report.log import draw_log

    if said is not None:
        read = read_map(said)
        target = picture or Path(said).with_suffix(".png")
        draw_log(target, read.columns, read.run, Path(said).name)
        lines = list(_mapped_lines(read))
        tell({"map": said, "picture": str(target), "notes": lines}, *lines, f"saved {target}")
        return
    made = guess(log)
    target = out or Path(log).with_name("MAP.toml")
    if out is None and target.exists():
        raise RecordingError(
            f"{target}: there is one already. Look as it says (--map {target}), or give --out."
        )
    drawing = picture or target.with_suffix(".png")
    atomic_write(target, made.to_toml(target))
    draw_log(drawing, made.columns, made.run, made.log.path.name)
    facts = {**made.to_dict(), "map": str(target), "picture": str(drawing)}
    tell(facts, *_lines(made), f"saved {target}, {drawing}")
    warn(f"asked: {key} in {target}: {what}" for key, what in made.asked.items())


def _lines(made: Look) -> Iterator[str]:
    log = made.log
    names = f"names in line {log.head}" if log.head else "no names"
    size = f"{len(log.values)} rows of {len(log.names)} values"
    yield f"{log.path.name}: {size} separated by {log.separator}, {names}"
    rows = [
        (" ".join(log.names[k] for k in g.columns)[-24:], g.name, g.unit, "−" if g.sign < 0 else "")
        for g in made.guesses
    ]
    yield table(("column", "seems to be", "unit", "sign"), rows)
    for guess in made.guesses:
        yield f"  {guess.name}: {guess.why}"
    if made.unused:
        named = ", ".join(log.names[k] for k in made.unused[:NAMED])
        more = len(made.unused) - NAMED
        yield f"not used: {named}{f' and {more} more' if more > 0 else ''}"
    yield from log.notes
    yield from made.findings


def _mapped_lines(read: Mapped) -> Iterator[str]:
    from realitygap.logs.cuts import many
    from realitygap.logs.look import findings

    yield f"{read.path}: {read.kind}, {many(len(read.run), 'row')}, {many(len(read.names), 'run')}"
    yield from read.notes
    yield from findings(read.columns, read.run, read.lines)
