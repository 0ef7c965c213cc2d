"""How a command speaks: tables, JSON, notes, questions; and how it ends: in one line and an exit code.

0 done; 1 not the user's doing; 2 something that the user can fix; 130 stopped by Ctrl-C. Never a traceback.
"""

from __future__ import annotations

import errno
import json
import math
import os
import re
import sys
import traceback
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn, TextIO

import click

from realitygap.cli.options import JSON
from realitygap.errors import RealityGapError, RealityGapWarning, StudyInterruptedError

if TYPE_CHECKING:
    from realitygap.study.load import Study

__all__ = [
    "Commands", "StoppedError", "as_json", "ask_trust", "at_terminal", "guarded", "link", "load_trusted",
    "note", "note_few", "note_new", "print_json", "resumable", "shown", "table", "tell", "warn",
]  # fmt: skip

DEBUG = "REALITYGAP_DEBUG"
"""Set to 1 in the environment, this shows the traceback of a failure."""

STOPPED = 130
"""Exit code after Ctrl-C."""

NUMBER = re.compile(r"[-+]?[\d.,]+(e[-+]?\d+)?%?( ± [\d.]+)?|–|inf|")


class StoppedError(RealityGapError):
    """Ctrl-C where there is more to say than "stopped"."""

    exit_code = STOPPED


class Commands(click.Group):
    """The group of all commands, which end as this file says."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Commands in the order in which a person meets them."""
        return list(self.commands)

    def main(self, args: Sequence[str] | None = None, *more: Any, **extra: Any) -> NoReturn:
        """Run the command that the arguments name, and exit."""
        extra["standalone_mode"] = False
        path = self._path(sys.argv[1:] if args is None else args)
        sys.exit(guarded(lambda: super(Commands, self).main(args, *more, **extra), path))

    def _path(self, words: Sequence[str]) -> str:
        """The command that the words begin with."""
        command: click.Command = self
        path = "realitygap"
        for word in words:
            if not isinstance(command, click.Group) or word not in command.commands:
                break
            command, path = command.commands[word], f"{path} {word}"
        return path


def guarded(work: Callable[[], Any], path: str = "realitygap") -> int:
    """Carry out `work`, the command `path`; the exit code, after a line on stderr if it failed."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("once", RealityGapWarning)
            warnings.showwarning = partial(_show_warning, warnings.showwarning)
            result = work()
        sys.stdout.flush()
        return result if isinstance(result, int) else 0
    except click.exceptions.NoArgsIsHelpError as group:
        click.echo(group.format_message())
        return 0
    except BrokenPipeError:
        _close(sys.stdout)  # whoever read our output has seen enough
        return 1
    except (Exception, KeyboardInterrupt) as failure:
        line, code = _described(failure, path)
        if os.environ.get(DEBUG, "") not in ("", "0"):
            with suppress(OSError):  # a full disk under stderr
                traceback.print_exc()
    with suppress(OSError):  # a full disk under stderr
        click.echo(" ".join(line.splitlines()), err=True)
    try:
        sys.stdout.flush()
    except OSError:  # it is full: the interpreter would try it once more
        _close(sys.stdout)
    return code


def _show_warning(usual: Callable[..., None], message: Warning, category: type[Warning], *where: Any) -> None:
    """One of ours as a line, others as usual."""
    if issubclass(category, RealityGapWarning):
        warn([str(message).rstrip(".")])
    else:
        usual(message, category, *where)


def _described(failure: BaseException, path: str) -> tuple[str, int]:
    """The line that says what went wrong, and the exit code."""
    if isinstance(failure, click.Abort) and isinstance(failure.__cause__, RealityGapError | EOFError):
        failure = failure.__cause__  # click makes its own of every KeyboardInterrupt, and of an EOFError
    if isinstance(failure, RealityGapError):
        return f"{'error: ' * (failure.exit_code != STOPPED)}{failure}", failure.exit_code
    if isinstance(failure, click.UsageError):
        where = failure.ctx.command_path if failure.ctx else path
        return f"error: {failure.format_message()} (see `{where} --help`)", 2
    if isinstance(failure, click.ClickException):
        return f"error: {failure.format_message()}", 2
    if isinstance(failure, click.Abort | KeyboardInterrupt):
        return "stopped", STOPPED
    if isinstance(failure, ModuleNotFoundError) and failure.name in ("fcntl", "pty", "termios", "tty"):
        here = f"there is no module {failure.name!r} here"
        return f"error: realitygap needs Linux or macOS ({here}). On Windows install it in WSL.", 2
    if isinstance(failure, ValueError) and "valid value for backend" in str(failure):  # Matplotlib's
        return f"error: MPLBACKEND: {failure}. Name a backend of Matplotlib's, or unset it.", 2
    if isinstance(failure, OSError) and failure.strerror:
        where = f": {failure.filename}" if failure.filename else ""
        return f"error: {failure.strerror}{where}", 2 if where or failure.errno == errno.ENOSPC else 1
    if isinstance(failure, MemoryError):
        return "error: not enough memory; ask for less at a time, or use fewer workers", 2
    detail = f"{type(failure).__name__}: {failure}" if str(failure) else type(failure).__name__
    return f"error: unexpected {detail} ({DEBUG}=1 shows where; please report it)", 1


def _close(stream: TextIO) -> None:
    """Point stdout or stderr at nothing, so that flushing it at exit cannot fail again."""
    with suppress(OSError, ValueError):  # not a real file, as in tests
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


@contextmanager
def resumable(folder: Path, again: str, *files: str) -> Iterator[None]:
    """On Ctrl-C say that finished work is kept in the folder, and which command continues it.

    `files`: of which the folder has one as soon as settings are kept there, so that `again` needs none.

    Raises:
        StoppedError: says both; or that the work had not begun.
    """
    try:
        yield
    except (KeyboardInterrupt, StudyInterruptedError):
        if not _is_begun(folder, files):
            raise StoppedError(f"stopped before the work in {folder} began; give the command again") from None
        raise StoppedError(f"stopped; finished work is kept in {folder}; resume with `{again}`") from None


def _is_begun(folder: Path, files: Sequence[str]) -> bool:
    return any((folder / file).is_file() for file in files)


def print_json(value: Any) -> None:
    """`value` on stdout as one JSON document."""
    click.echo(json.dumps(_plain(value), allow_nan=False))


def _plain(value: Any) -> Any:
    """`value` as JSON knows it: arrays become lists, what is not finite becomes null."""
    if isinstance(value, Mapping):
        return {str(key): _plain(inner) for key, inner in value.items()}
    if hasattr(value, "tolist"):
        return _plain(value.tolist())
    if isinstance(value, list | tuple):
        return [_plain(inner) for inner in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def as_json() -> bool:
    """Whether the running command prints JSON."""
    return bool(click.get_current_context().meta.get(JSON))


def tell(value: Any, *lines: str) -> None:
    """What a command found on stdout: `value` as JSON if it was asked for, or in lines of plain text."""
    if as_json():
        print_json(value)
        return
    for line in lines:
        click.echo(line)


def link(path: Path) -> str:
    """A file as a terminal makes it clickable."""
    return path.resolve().as_uri()


def shown(value: float | None, form: str = ".3g") -> str:
    """A number as it is printed; a dash if there is none."""
    return "–" if value is None or math.isnan(value) else format(float(value), form)


def table(head: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Columns that line up: numbers to the right, words to the left."""
    lines = [list(head), *([str(cell) for cell in row] for row in rows)]
    columns = []
    for column in zip(*lines, strict=True):
        width, words = max(map(len, column)), not all(map(NUMBER.fullmatch, column[1:]))
        columns.append([cell.ljust(width) if words else cell.rjust(width) for cell in column])
    return "\n".join("  ".join(line).rstrip() for line in zip(*columns, strict=True))


def warn(warnings: Iterable[str]) -> None:
    """Print what a person should know, a line each on stderr."""
    for warning in warnings:
        click.echo(f"warning: {warning}", err=True)


def note(text: str) -> None:
    """Print a note, one line on stderr."""
    click.echo(f"note: {text}", err=True)


def note_new(folder: Path, *files: str) -> None:
    """Note that there is nothing to resume in a folder, which has none of the files that would say what."""
    if not _is_begun(folder, files):
        note(
            f"--resume: nothing was begun in {folder}; starting there, with the usual settings for all that "
            "is not given"
        )


def note_few(evaluations: int, population: int = 64) -> None:
    """Note that a run has fewer evaluations than the population (the paper's has 64)."""
    if evaluations < population:
        note(
            f"{evaluations} evaluations are fewer than the population's {population}: all individuals are "
            "random and none is bred"
        )


def at_terminal() -> bool:
    """Whether somebody can answer a question."""
    return sys.stdin.isatty() and sys.stderr.isatty()


def load_trusted(folder: Path) -> Study:
    """A study; before its programs are run, a person at a terminal is asked whether they may be."""
    from realitygap.study.load import load_study

    ask_trust(folder)
    return load_study(folder)


def ask_trust(study: Path) -> None:
    """Ask once, before a study's task files are run, whether they may be.

    Without a terminal nothing is agreed to: whatever would run a file refuses it.

    Raises:
        click.Abort: the answer is no.
    """
    from realitygap.study.folder import trust_programs, untrusted_programs

    found = untrusted_programs(study)
    if found and not at_terminal():
        return
    for file in found:
        click.echo(
            f"{study} was made elsewhere. To simulate its task, this program must run: {file}", err=True
        )
    if found:
        click.confirm("Do you trust its author?", abort=True, err=True)
        trust_programs(study)
