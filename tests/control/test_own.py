"""Controllers of one's own: Python on the command line, networks written by hand."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from realitygap.cli import realitygap
from realitygap.control.controllers import named_controller, own_controller
from realitygap.control.genotype import Genotype
from realitygap.errors import GenotypeError, UsageError

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
AVOIDER = (EXAMPLES / "avoider.toml").read_text("utf-8")


def test_a_written_network_decides_as_it_says():
    """In the open both wheels go at 10; each side, and what is ahead, does what the file's comments say."""
    network = Genotype.load(EXAMPLES / "avoider.toml").controller()
    for near, wheels in (((), (10, 10)), ((1,), (10, -10)), ((4,), (-10, 10)), ((3,), (-10, 10))):
        network.reset()
        for _ in range(2):
            command = network.decide([10 if i in near else -10 for i in range(8)])
        assert (command.left, command.right) == wheels


@pytest.mark.parametrize(
    ("was", "becomes", "told"),
    [
        ("weight = -1", "weight = 9", r"left.links\[0\].weight: expected a whole number from -4 to 4, got 9"),
        (
            "from = 4",
            "from = 8",
            r"left.links\[0\].from: expected an input or a neuron: 0, .*7, left, right",
        ),
        ('from = "ahead"', 'from = "a"', r"left.links\[1\].from: .*ahead; got 'a'"),
        ("threshold = 10", "treshold = 1", "treshold: unknown key. Did you mean 'threshold'"),
        ("delay = 1", "delay = 5", r"hidden.ahead.links\[1\].delay|ahead.links\[1\].delay: .* 0 to 4, got 5"),
        ("inputs = 8", "inputs = 3", "inputs: expected the task's 8, got 3"),
        ("[right]", "[right", "not a TOML file"),
        ("hidden.ahead", "hidden.left", "hidden: expected other names than the motors'"),
    ],
)
def test_a_wrong_network_is_refused_by_its_key(tmp_path, was, becomes, told):
    """One line names the file, the key, what was expected and what came."""
    file = tmp_path / "mine.toml"
    file.write_text(AVOIDER.replace(was, becomes, 1))
    with pytest.raises(GenotypeError, match=f"mine.toml: (.|\n)*{told}"):
        Genotype.load(file, 8)


def test_functions_classes_and_objects_decide(tmp_path):
    """Each drives; a class's reset is called, and a function needs none."""
    file = tmp_path / "mine.py"
    file.write_text(
        "def steady(inputs):\n    return 3, -4\n\n\n"
        "class Counting:\n    def reset(self):\n        self.n = 0\n\n"
        "    def decide(self, inputs):\n        self.n += 1\n        return self.n, len(inputs)\n\n\n"
        "def odd(inputs):\n    return 11, -2.6\n\n\n"
        "def broken(inputs):\n    return 1 / 0\n"
    )
    steady, counting = (named_controller(f"{file}:{name}", "", 8) for name in ("steady", "Counting"))
    assert (steady.decide([0]).left, steady.decide([0]).right) == (3, -4)
    for _ in range(2):
        counting.reset()
        assert [counting.decide([0] * 8).left for _ in range(3)] == [1, 2, 3]
    assert own_controller(lambda inputs: np.array([2, 2])).decide([]).left == 2
    odd = own_controller(f"{file}:odd")
    with pytest.warns(UserWarning, match=r"mine.py: decide: .* got \(11, -2.6\): .* rounded and clipped"):
        command = odd.decide([0])
    assert (command.left, command.right) == (10, -3) == (odd.decide([0]).left, odd.decide([0]).right)
    for wrong in ((math.nan, 0), (True, 1), {1, 2}, (1,), None):
        with pytest.raises(UsageError, match=r"decide: expected \(left, right\), whole numbers"):
            own_controller(lambda _, wrong=wrong: wrong).decide([0])
    with pytest.raises(UsageError, match=r"mine.py, line 19: decide fails with ZeroDivisionError"):
        own_controller(f"{file}:broken").decide([0])
    with pytest.raises(UsageError, match=r"controller: .*expected 'none' in it. It has steady"):
        own_controller(f"{file}:none")


@pytest.mark.parametrize("name", ["own_controller.py:avoid", "own_controller.py:Homing", "avoider.toml"])
def test_the_command_line_takes_them(name):
    """`simulate` drives the examples' controllers, and ends well."""
    task, pose = ("light", "15,35,0") if "Homing" in name else ("avoidance", "25,25,90")
    words = ["simulate", task, "--controller", str(EXAMPLES / name), "--pose", pose]
    result = CliRunner().invoke(realitygap, [*words, "--seconds", "5"])
    assert result.exit_code == 0, result.output
    assert "score" in result.stdout
