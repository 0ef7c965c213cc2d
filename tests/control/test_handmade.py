"""Controllers made by hand do what their names say, through the network that evolution uses."""

from __future__ import annotations

import pytest

from realitygap.control.controllers import named_controller
from realitygap.control.genotype import Genotype

OPEN = [-10] * 8
LEFT, FRONT, RIGHT, BACK = (0, 1), (2, 3), (4, 5), (6, 7)


def drive(genotype, inputs) -> tuple[int, int]:
    controller = genotype.controller()
    for _ in range(3):
        command = controller.decide(inputs)
    return command.left, command.right


def sensing(*groups, strength: int = 10) -> list[int]:
    inputs = list(OPEN)
    for group in groups:
        for sensor in group:
            inputs[sensor] = strength
    return inputs


@pytest.mark.parametrize(("left", "right"), [(10, -10), (0, 0), (3, 7), (-1, 2)])
def test_constant_is_constant(left, right):
    """A constant controller commands its two numbers from the first step on, whatever it senses."""
    controller = Genotype.constant(left, right).controller()
    for inputs in (OPEN, sensing(LEFT), sensing(FRONT, RIGHT)):
        command = controller.decide(inputs)
        assert (command.left, command.right) == (left, right)


def test_avoiding_vehicle():
    """Straight on in the open, away from a wall at a side, and off on the spot or left head-on."""
    genes = Genotype.braitenberg("proximity")
    assert drive(genes, OPEN) == (8, 8)
    assert drive(genes, sensing(BACK)) == (8, 8)
    for strength in (-6, 0, 10):
        left, right = drive(genes, sensing(LEFT, strength=strength))
        assert left > right
        left, right = drive(genes, sensing(RIGHT, strength=strength))
        assert left < right
        left, right = drive(genes, sensing(FRONT, strength=strength))
        assert left < right
        left, right = drive(genes, sensing(LEFT, FRONT, RIGHT, strength=strength))
        assert left < right


def test_light_seeking_vehicle():
    """On to a lamp ahead, a turn towards one at a side, and a turn to search otherwise."""
    genes = Genotype.braitenberg("ambient")
    assert min(drive(genes, [8, 9, 9, 9, 9, 8, 1, 1])) >= 8
    left, right = drive(genes, [9, 9, 9, 9, 0, 1, 1, 0])
    assert left < right
    left, right = drive(genes, [1, 0, 9, 9, 9, 9, 0, 1])
    assert left > right
    left, right = drive(genes, [8, 1, 2, 2, 1, 8, 9, 9])
    assert 0 < left < right
    assert drive(genes, OPEN) == (-10, 8)


def test_named_controllers(tmp_path):
    """A controller is named as a person names it: constant:L,R, braitenberg, or a file."""
    seeker = Genotype.braitenberg("ambient")
    seeker.save(tmp_path / "mine")
    for spec, genotype in (
        ("constant:5, -5", Genotype.constant(5, -5)),
        ("braitenberg", seeker),
        (str(tmp_path / "mine"), seeker),
    ):
        assert named_controller(spec, "ambient", 8).genotype == genotype
