"""What commands print: JSON without NaN, and small tables in plain text."""

import json
import math
import sys
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Self

import click

__all__ = ["Figure", "at_terminal", "plain", "print_json", "shown", "table", "tell", "warn"]


def plain(value: Any) -> Any:
    """`value` as JSON knows it: arrays become lists, what is not finite becomes null."""
    if isinstance(value, Mapping):
        return {str(key): plain(inner) for key, inner in value.items()}
    if hasattr(value, "tolist"):
        return plain(value.tolist())
    if isinstance(value, list | tuple):
        return [plain(inner) for inner in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def print_json(value: Any) -> None:
    """`value` on stdout as one JSON document."""
    click.echo(json.dumps(plain(value), allow_nan=False))


def tell(json_output: bool, value: Any, *lines: str) -> None:
    """What a command found on stdout: `value` as JSON, or in lines of plain text."""
    if json_output:
        print_json(value)
        return
    for line in lines:
        click.echo(line)


def warn(warnings: Iterable[str]) -> None:
    """Print what a person should know, a line each on stderr."""
    for warning in warnings:
        click.echo(f"warning: {warning}", err=True)


class Figure(float):
    """A number of a table as it is shown, such as ".2f"; a dash if there is none."""

    def __new__(cls, value: float | None, form: str) -> Self:
        """Like a float, which it is."""
        made = super().__new__(cls, math.nan if value is None else value)
        made.form = form
        return made

    form: str

    def __str__(self) -> str:
        return "–" if math.isnan(self) else format(float(self), self.form)


def shown(value: float | None) -> str:
    """Three significant digits, or a dash."""
    return str(Figure(value, ".3g"))


def table(head: Sequence[str], rows: Sequence[Sequence[object]]) -> str:
    """Columns that line up: numbers to the right, words to the left."""
    cells = [[str(cell) for cell in row] for row in rows]
    widths = [max(map(len, column)) for column in zip(head, *cells, strict=True)]
    right = [bool(rows) and not isinstance(row_cell, str) for row_cell in (rows[0] if rows else head)]
    lines = []
    for line in ([*head], *cells):
        text = [
            cell.rjust(width) if to_right else cell.ljust(width)
            for cell, width, to_right in zip(line, widths, right, strict=True)
        ]
        lines.append("  ".join(text).rstrip())
    return "\n".join(lines)


def at_terminal() -> bool:
    """Whether somebody can answer a question."""
    return sys.stdin.isatty() and sys.stderr.isatty()
