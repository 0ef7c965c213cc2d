"""How a command ends: in one clear line on stderr and an exit code.

0 done; 1 not the user's doing; 2 something that the user can fix; 130 stopped by Ctrl-C. Never a
traceback.
"""

import errno
import os
import sys
import traceback
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, NoReturn, TextIO

import click

from realitygap.errors import RealityGapError, StudyInterruptedError

__all__ = ["Commands", "StoppedError", "is_begun", "resumable"]

DEBUG = "REALITYGAP_DEBUG"
"""Set to 1 in the environment, this shows the traceback of a failure."""

STOPPED = 130
"""Exit code after Ctrl-C."""

LONGEST = 1300
"""Most characters of a message."""

_FULL = {errno.ENOSPC, errno.EDQUOT}
_OF_POSIX = ("fcntl", "pty", "termios", "tty")
_NOT_MENDABLE = {errno.EIO, errno.ENOMEM, errno.EBADF, errno.EINVAL}
_OF_A_PATH = (FileExistsError, FileNotFoundError, IsADirectoryError, NotADirectoryError, PermissionError)


class StoppedError(RealityGapError):
    """Ctrl-C where there is more to say than "stopped"."""

    exit_code = STOPPED


@contextmanager
def resumable(folder: Path, again: str, *files: str) -> Iterator[None]:
    """On Ctrl-C say that finished work is kept in the folder, and which command continues it.

    Args:
        folder: of the work.
        again: the command.
        files: of which the folder has one as soon as settings are kept there, so that the command needs none.

    Raises:
        StoppedError: says both; or that the work had not begun.
    """
    try:
        yield
    except (KeyboardInterrupt, StudyInterruptedError):
        if not is_begun(folder, *files):
            raise StoppedError(f"stopped before the work in {folder} began; give the command again") from None
        raise StoppedError(f"stopped; finished work is kept in {folder}; resume with `{again}`") from None


def is_begun(folder: Path, *files: str) -> bool:
    """Whether a folder has one of the files that say what is done in it."""
    return any((folder / file).is_file() for file in files)


class Commands(click.Group):
    """A group of commands, all of which end as this file says."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Commands in the order in which a person meets them."""
        return list(self.commands)

    def main(self, args: Sequence[str] | None = None, *more: Any, **extra: Any) -> NoReturn:
        """Run the command that the arguments name, and exit."""
        extra["standalone_mode"] = False
        words = _spread(sys.argv[1:] if args is None else args)
        sys.exit(guarded(lambda: super(Commands, self).main(words, *more, **extra)))


def guarded(work: Callable[[], Any]) -> int:
    """Carry out `work`; the exit code, after a line on stderr if it failed."""
    try:
        result = work()
        sys.stdout.flush()
    except Exception as failure:
        if os.environ.get(DEBUG, "") not in ("", "0"):
            with suppress(OSError):  # a full disk under stderr
                traceback.print_exc()
        return explain(failure)
    except KeyboardInterrupt:
        return explain(click.Abort())
    return result if isinstance(result, int) else 0


def explain(failure: Exception) -> int:
    """Say on stderr what went wrong; the exit code that goes with it."""
    if isinstance(failure, BrokenPipeError):
        _close(sys.stdout)  # whoever read our output has seen enough
        return 1
    line, code = _describe(failure)
    line = " ".join(line.splitlines())
    said = line if len(line) <= LONGEST else f"{line[:800]}…{line[-400:]}"  # of a damaged file, say
    for stream, text in ((sys.stderr, said), (sys.stdout, "")):
        try:
            click.echo(text, stream, nl=bool(text))
        except OSError:  # it is full: the interpreter would try it once more
            _close(stream)
    return code


def _describe(failure: Exception) -> tuple[str, int]:
    """The line that says what went wrong, and the exit code."""
    if isinstance(failure, click.Abort) and isinstance(failure.__cause__, RealityGapError | EOFError):
        failure = failure.__cause__  # click makes its own of every KeyboardInterrupt, and of an EOFError
    if isinstance(failure, RealityGapError):
        return str(failure) if failure.exit_code == STOPPED else f"error: {failure}", failure.exit_code
    if isinstance(failure, click.UsageError):
        where = failure.ctx.command_path if failure.ctx else "realitygap"
        return f"error: {failure.format_message()} (see `{where} --help`)", 2
    if isinstance(failure, click.ClickException):
        return f"error: {failure.format_message()}", 2
    if isinstance(failure, click.Abort):
        return "stopped", STOPPED
    if isinstance(failure, ModuleNotFoundError) and failure.name in _OF_POSIX:
        here = f"there is no module {failure.name!r} here"
        return f"error: realitygap needs Linux or macOS ({here}). On Windows install it in WSL.", 2
    if isinstance(failure, OSError):
        what = failure.strerror or str(failure) or type(failure).__name__
        where = f": {failure.filename}" if failure.filename else ""
        code = 1 if failure.errno in _NOT_MENDABLE else 2
        full = ". Free some space, or take another place; what was saved is kept."
        cure = full if failure.errno in _FULL else ""
        if where and (isinstance(failure, _OF_A_PATH) or failure.errno == errno.EROFS):
            cure = ". Check the path and its rights, or take another."
        return f"error: {what}{where}{cure}", code
    if _from_sqlite(failure):
        return f"error: the study's database cannot be used: {failure}", 2
    if isinstance(failure, MemoryError):
        return "error: not enough memory; ask for less at a time, or use fewer workers", 2
    detail = f"{type(failure).__name__}: {failure}" if str(failure) else type(failure).__name__
    return f"error: unexpected {detail} ({DEBUG}=1 shows where; please report it)", 1


def _from_sqlite(failure: Exception) -> bool:
    """Whether the database raised it (without importing it for those who never use one)."""
    sqlite3 = sys.modules.get("sqlite3")
    return sqlite3 is not None and isinstance(failure, sqlite3.Error)


def _close(stream: TextIO) -> None:
    """Point stdout or stderr at nothing, so that flushing it at exit cannot fail again."""
    with suppress(OSError, ValueError):  # not a real file, as in tests
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


def _spread(words: Sequence[str]) -> list[str]:
    """`--pose 25,25,90` as the three words that Click takes."""
    made: list[str] = []
    left = 0
    for word in words:
        name, _, joined = word.partition("=")
        if name == "--pose":
            made, left, word = [*made, name], 3, joined
        if left and not word.startswith("--"):
            numbers = [number for number in word.split(",") if number]
            made, left = [*made, *numbers], left - len(numbers)
        else:
            made, left = [*made, word], 0
    return made
