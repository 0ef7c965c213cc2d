"""What every command does: help with an example, a quick start, one line at the end whatever goes wrong."""

from __future__ import annotations

import errno
import subprocess
import sys

import click
import pytest

import realitygap as package
from realitygap.cli import realitygap
from realitygap.cli.console import StoppedError, guarded
from realitygap.errors import RealityGapError, StudyError

HEAVY = ("numba", "matplotlib", "mujoco", "cv2", "serial", "rich", "sqlite3", "jinja2", "av", "filelock")


def every(group: click.Group, *path: str):
    """Each command and group below a group, by its words."""
    for name, command in group.commands.items():
        yield (*path, name), command
        if isinstance(command, click.Group):
            yield from every(command, *path, name)


COMMANDS = dict(every(realitygap))


@pytest.mark.parametrize("words", COMMANDS, ids=" ".join)
def test_every_command_has_help_with_an_example(call, words):
    """`--help` says what the command does, shows an example that names it, and cuts no summary."""
    result = call(*words, "--help")
    assert result.exit_code == 0
    assert f"realitygap {' '.join(words)}" in result.stdout.split("Example")[1]
    assert "..." not in result.stdout.partition("Commands:")[2]


@pytest.mark.parametrize("words", [(), *(w for w, c in COMMANDS.items() if isinstance(c, click.Group))])
def test_a_group_alone_shows_its_help(call, words):
    """With its commands, a line each."""
    result = call(*words)
    assert (result.exit_code, result.stderr) == (0, "")
    assert result.stdout == call(*words, "--help").stdout


def test_the_version(call):
    """`--version` tells the package's version; each of its public names can be had."""
    assert package.__version__ in call("--version").stdout
    assert all(getattr(package, name) is not None for name in package.__all__)
    with pytest.raises(AttributeError, match="load_stuby"):
        _ = package.load_stuby


@pytest.mark.parametrize(
    "code",
    [
        "import realitygap",
        "from realitygap.cli import realitygap\ntry: realitygap(['-h'])\nexcept SystemExit: 0",
    ],
    ids=["import", "help"],
)
def test_a_start_loads_nothing_heavy(code):
    """No compiler, plots or database."""
    code += f"\nimport sys; print(sorted(set(sys.modules) & {{*{HEAVY!r}}}))"
    made = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert made.stdout.splitlines()[-1] == "[]"


@pytest.mark.parametrize(
    ("failure", "code", "says"),
    [
        (StudyError("no study in my  folder"), 2, "error: no study in my  folder"),
        (RealityGapError("not your doing"), 1, "error: not your doing"),
        (
            PermissionError(errno.EACCES, "Permission denied", "my  out"),
            2,
            "error: Permission denied: my  out",
        ),
        (OSError(errno.ENOSPC, "No space left on device"), 2, "error: No space left on device"),
        (OSError(errno.EIO, "Input/output error"), 1, "error: Input/output error"),
        (StoppedError("stopped; resume with `x`"), 130, "stopped; resume with `x`"),
        (click.Abort(), 130, "stopped"),
        (KeyboardInterrupt(), 130, "stopped"),
        (ZeroDivisionError("two\nlines"), 1, "error: unexpected ZeroDivisionError: two lines"),
    ],
    ids=lambda value: type(value).__name__ if isinstance(value, BaseException) else None,
)
def test_every_failure_ends_in_one_line_and_a_code(capsys, failure, code, says):
    """Whatever goes wrong, stderr gets one line, and the exit code tells whose turn it is."""

    def work() -> None:
        raise failure

    assert guarded(work) == code
    (said,) = capsys.readouterr().err.splitlines()
    assert said.startswith(says)


IN_COMPILED_CODE = """
import ctypes, os, signal, sys, time
import realitygap.cli
from realitygap.cli.console import guarded
from realitygap.__main__ import main
def work():
    press = ctypes.CFUNCTYPE(None)(lambda: os.kill(os.getpid(), signal.SIGINT))
    press()
    time.sleep(30)
realitygap.cli.main = lambda: sys.exit(guarded(work))
main()
"""


def test_ctrl_c_ends_a_command_in_one_line():
    """Compiled code drops what its callbacks raise: it is pressed once more."""
    code = [sys.executable, "-c", IN_COMPILED_CODE]
    made = subprocess.run(code, capture_output=True, text=True, timeout=60)
    assert (made.stdout, made.stderr, made.returncode) == ("", "stopped\n", 130)
