"""`realitygap robot check` and `realitygap robot serve`."""

from __future__ import annotations

import json

from click.testing import CliRunner

from realitygap.cli.robot import robot
from realitygap.errors import LineError, UsageError
from tests.robots.conftest import Bench


def at(twin):
    """Options for a twin behind its line."""
    return ["--robot", f"serial:{twin.device}"]


def test_a_check_tells_all_as_json_and_moves_nothing_unasked(bench: Bench) -> None:
    """Versions, readings, counters, LEDs, the loop; nobody agreed, so it stands."""
    twin = bench.twin()
    result = CliRunner().invoke(robot, ["check", *at(twin), "--seconds", "1", "--json"])
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
    result = CliRunner().invoke(robot, ["check", *at(twin), "--yes", "--profile", "thymio"])
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
