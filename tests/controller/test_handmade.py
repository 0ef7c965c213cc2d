"""Controllers made by hand do what their names say, through the network that evolution uses."""

from __future__ import annotations

import pytest

from realitygap.control.controllers import named_controller
from realitygap.control.genotype import Genotype
from realitygap.errors import UsageError

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


@pytest.mark.parametrize("value", [11, -11, 2.5, True, "3", None])
def test_wrong_constants_are_refused(value):
    """A command that is no whole number of −10 to 10 is refused, with the number."""
    with pytest.raises(UsageError, match=r"the right command of a constant controller: .* -10 to 10"):
        Genotype.constant(0, value)


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


@pytest.mark.parametrize("feeds", ["proximity", "ambient"])
def test_handmade_genotypes_are_genotypes(feeds):
    """A vehicle is in range and survives its text form."""
    genotype = Genotype.braitenberg(feeds)
    assert Genotype.parse(str(genotype)) == genotype


def test_vehicles_that_cannot_be_built():
    """Another feed or another number of sensors is refused with the reason."""
    with pytest.raises(UsageError, match=r'"proximity" or "ambient", got .sound.'):
        Genotype.braitenberg("sound")
    with pytest.raises(UsageError, match="eight sensors; this task feeds 6"):
        named_controller("braitenberg", "proximity", 6)


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


@pytest.mark.parametrize(
    ("spec", "message"),
    [
        ("constant", "expected constant:L,R"),
        ("constant:1", "expected constant:L,R"),
        ("constant:1.5,2", "expected constant:L,R"),
        ("constant:99,0", "left command .* got 99"),
        ("nowhere.txt", "constant:L,R, braitenberg, FILE.py:NAME, or a file .* no file 'nowhere.txt'"),
        ("x" * 5000, "no file"),
        ("a\0b", "no file"),
        (".", "cannot read the genotype"),
    ],
)
def test_controllers_that_are_none_are_refused(spec, message):
    """Anything else is refused with what a controller may be."""
    with pytest.raises(UsageError, match=message):
        named_controller(spec, "proximity", 8)


def test_files_keep_their_own_slots(tmp_path):
    """A genotype file with other slots or link fields than usual still drives."""
    small = Genotype.written(8, [(-4, []), (-2, [])], slots=12, links=3)
    small.save(tmp_path / "small")
    assert named_controller(str(tmp_path / "small"), "proximity", 8).genotype == small
