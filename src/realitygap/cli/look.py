"""`realitygap look`: what the columns of anybody's log seem to be, and the MAP.toml that says so."""

from pathlib import Path

import click

from realitygap.cli import options
from realitygap.cli.console import table, tell, warn

__all__ = ["look"]

NAMED = 8
"""Columns of no use that are named."""


@click.command()
@click.argument("log", type=click.Path())
@click.option("--map", "said", metavar="MAP", help="Guess nothing: show the log as this MAP.toml says.")
@click.option(
    "--out", type=options.OutFile(".toml"), help="The MAP.toml to write [default: MAP.toml beside LOG]."
)
@options.as_json
def look(log: str, said: str | None, out: Path | None) -> None:
    """Say what the columns of LOG seem to be.

    LOG is a table of numbers that any program wrote: any separator, names or none. Prints what each column
    seems to be, and why; draws it; and writes a MAP.toml, which `calibrate`, `score` and `classify` take in
    place of a recording or a track. Correct it where it is wrong, and answer each "?" in it.

    \b
    Examples: look, edit MAP.toml, look again, and fit
        realitygap look run.csv
        realitygap look run.csv --map MAP.toml
        realitygap calibrate MAP.toml --base thymio --out robot.toml
    """
    from realitygap.errors import RecordingError
    from realitygap.files import atomic_write
    from realitygap.logs.cuts import many
    from realitygap.logs.look import findings
    from realitygap.logs.look import look as guess
    from realitygap.logs.mapped import read_map
    from realitygap.report.log import draw_log

    if said and out is not None:
        raise click.UsageError("--map writes no MAP.toml: give it without --out.")
    target = Path(said) if said else out or Path(log).with_name("MAP.toml")
    picture = target.with_suffix(".png")
    if said:
        read = read_map(said)
        lines = [f"{said}: {read.kind}, {many(len(read.run), 'row')}, {many(len(read.names), 'run')}"]
        lines += [*read.notes, *findings(read.columns, read.run, read.lines)]
        draw_log(picture, read.columns, read.run, target.name)
        tell({"map": said, "picture": str(picture), "notes": lines}, *lines, f"saved {picture}")
        return
    made = guess(log)
    if out is None and target.exists():
        raise RecordingError(
            f"{target}: there is one already. Look as it says (--map {target}), or give --out."
        )
    atomic_write(target, made.to_toml(target))
    draw_log(picture, made.columns, made.run, made.log.path.name)
    names, notes = made.log.names, [*made.log.notes, *made.findings]
    if made.unused:
        notes.insert(0, f"not used: {', '.join(made.unused[:NAMED])}{' …' * (len(made.unused) > NAMED)}")
    columns = [{**vars(one), "columns": [names[k] for k in one.columns]} for one in made.guesses]
    facts = {"log": log, "map": str(target), "picture": str(picture), "kind": made.kind, "notes": notes}
    rows = [
        (" ".join(one["columns"])[-24:], one["name"], one["unit"], "−" if one["sign"] < 0 else "")
        for one in columns
    ]
    tell(
        facts | {"asked": made.asked, "columns": columns},
        f"{made.log.path.name}: {len(made.run)} rows of {len(names)} values separated by "
        f"{made.log.separator}, {f'names in line {made.log.head}' if made.log.head else 'no names'}",
        table(("column", "seems to be", "unit", "sign"), rows),
        *(f"  {one.name}: {one.why}" for one in made.guesses),
        *notes,
        f"saved {target}, {picture}",
    )
    warn(f"asked: {key} in {target}: {what}" for key, what in made.asked.items())
