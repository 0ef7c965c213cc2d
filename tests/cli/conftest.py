"""How the tests of commands call them."""

import json
import re
from collections.abc import Callable
from typing import Any

import click
import pytest
from click.testing import CliRunner, Result

from realitygap.cli import realitygap


@pytest.fixture
def call() -> Callable[..., Result]:
    """Runs a command in this process, as a shell would; words are turned into text."""

    def run(*words: object, **more: Any) -> Result:
        return CliRunner().invoke(realitygap, [str(word) for word in words], **more)

    return run


@pytest.fixture
def json_of(call: Callable[..., Result]) -> Callable[..., Any]:
    """Runs a command with --json: what it printed, which is one document without NaN."""

    def refuse(constant: str) -> None:
        raise AssertionError(f"{constant} in JSON")

    def run(*words: object) -> Any:
        result = call(*words, "--json")
        assert result.exit_code == 0, result.output
        return json.loads(result.stdout, parse_constant=refuse)

    return run


def _advice_can_be_followed(line: str, words: list[str]) -> None:
    """An option that a message names belongs to the command, or stands with its command in backticks."""
    command: click.Command = realitygap
    for word in words:
        if not isinstance(command, click.Group) or word not in command.commands:
            break
        command = command.commands[word]
    own = {name for param in command.params for name in (*param.opts, *param.secondary_opts)}
    named = set(re.findall(r"(?<![\w-])--[a-z][a-z-]*", re.sub(r"`[^`]*`", "", line)))
    asked = {word.partition("=")[0] for word in words}
    assert named <= own | asked | {"--help"}, f"{line}: {command.name} has no {named - own}"


@pytest.fixture
def refused(call: Callable[..., Result]) -> Callable[..., str]:
    """Runs a command that must be refused: exit code 2, one line on stderr (and notes), no stdout."""

    def run(*words: object) -> str:
        result = call(*words)
        assert (result.exit_code, result.stdout) == (2, ""), result.output
        (line,) = [line for line in result.stderr.splitlines() if not line.startswith("note: ")]
        assert line.startswith("error: ")
        _advice_can_be_followed(line, [str(word) for word in words])
        return line

    return run
