"""`realitygap robot check` and `realitygap twin serve`."""

from __future__ import annotations

import json

import pytest
from click.testing import CliRunner

from realitygap.cli.robot import robot
from realitygap.errors import LineError, UsageError
from realitygap.world.arena import load_arena
from tests.robots.conftest import Bench


def at(twin):
    """Options for a twin behind its line."""
    return ["--robot", f"serial:{twin.device}"]


def test_a_check_tells_all_as_json_and_moves_nothing_unasked(bench: Bench) -> None:
    """Versions, readings, counters, LEDs, the loop; nobody agreed, so it stands."""
    twin = bench.twin()
    args = [
        "check",
        "--robot",
        f"serial:{twin.device}",
        "--seconds",
        "1",
        "--json",
    ]
    result = CliRunner().invoke(robot, args)
    assert result.exit_code == 0, result.output
    facts = json.loads(result.stdout)
    assert facts["bios"] == "5.02" and len(facts["proximity"]) == len(facts["ambient"]) == 8
    assert facts["counters"] == [0, 0] and facts["movement"] is None
    assert facts["loop"]["steps"] == 10


def test_a_check_moves_with_consent(bench: Bench) -> None:
    """--yes: 4 cm/s for half a second, about 250 pulses; at 9600 baud it says what does not fit."""
    twin = bench.twin(baud=9600)
    args = ["check", *at(twin), "--seconds", "1"]
    result = CliRunner().invoke(robot, [*args, "--baud", "any", "--yes"])
    assert result.exit_code == 0, result.output
    assert "moved: counters 2" in result.stdout and "118 ms" in result.stdout


def test_a_check_refuses_the_profile_of_another_robot(bench: Bench) -> None:
    """A Thymio's commands would send a Khepera off at 86 cm/s instead of 4: it only stands."""
    twin = bench.twin()
    args = [
        "check",
        "--robot",
        f"serial:{twin.device}",
        "--yes",
        "--profile",
        "thymio",
    ]
    result = CliRunner().invoke(robot, args)
    assert isinstance(result.exception, UsageError)
    assert "7 proximity sensors (profile 'thymio'); this robot has 8" in str(result.exception)
    assert "moved" not in result.stdout


def test_a_check_of_nobody_says_what_to_look_at(bench: Bench) -> None:
    """A device on which nobody answers."""
    pump = bench.pump(bench.twin())
    pump.silent = True
    result = CliRunner().invoke(robot, ["check", "--robot", f"serial:{pump.device}"])
    assert isinstance(result.exception, LineError)
    assert "check that it is switched on" in str(result.exception)


@pytest.mark.parametrize("name", ["obstacle-avoidance", "light-seeking"])
def test_an_arena_goes_to_the_twin_as_plain_numbers(name: str) -> None:
    """No name, no law of light: sizes and places in cm."""
    plain = load_arena(name).plain()
    assert json.loads(json.dumps(plain)) == plain
    assert set(plain) == {"size_cm", "cylinders", "walls", "lamps"}
