"""Controllers made by hand do what their names say, through the network that evolution uses."""

from __future__ import annotations

import numpy as np
import pytest

from realitygap.control.genotype import (
    Layout,
    braitenberg,
    check_genes,
    constant,
    controller_genes,
    from_text,
    save_genotype,
    to_text,
)
from realitygap.control.network import NetworkController
from realitygap.errors import UsageError

OPEN = [-10] * 8
LEFT, FRONT, RIGHT, BACK = (0, 1), (2, 3), (4, 5), (6, 7)


def drive(genes, inputs) -> tuple[int, int]:
    controller = NetworkController(genes, Layout())
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
    genes = constant(left, right, Layout())
    controller = NetworkController(genes, Layout())
    for inputs in (OPEN, sensing(LEFT), sensing(FRONT, RIGHT)):
        command = controller.decide(inputs)
        assert (command.left, command.right) == (left, right)


@pytest.mark.parametrize("value", [11, -11, 2.5, True, "3", None])
def test_wrong_constants_are_refused(value):
    """A command that is no whole number of −10 to 10 is refused, with the number."""
    with pytest.raises(UsageError, match=r"the right command of a constant controller: .* -10 to 10"):
        constant(0, value, Layout())


def test_avoiding_vehicle():
    """Straight on in the open, away from a wall at a side, and off on the spot or left head-on."""
    genes = braitenberg("proximity", Layout())
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
    genes = braitenberg("ambient", Layout())
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
    genes = braitenberg(feeds, Layout())
    check_genes(genes, Layout())
    assert (from_text(to_text(genes)) == genes).all()


@pytest.mark.parametrize(
    ("feeds", "layout", "message"),
    [
        ("sound", Layout(), '"proximity" or "ambient", got .sound.'),
        ("proximity", Layout(inputs=6), "eight sensors; this task feeds 6"),
        ("ambient", Layout(links=2), "needs 6 link fields a slot; the layout has 2"),
    ],
)
def test_vehicles_that_cannot_be_built(feeds, layout, message):
    """Another feed, another number of sensors or too few links is refused with the reason."""
    with pytest.raises(UsageError, match=message):
        braitenberg(feeds, layout)


def test_named_controllers(tmp_path):
    """A controller is named as a person names it: constant:L,R, braitenberg, or a file."""
    layout = Layout()
    assert (controller_genes("constant:5, -5", "proximity", layout) == constant(5, -5, layout)).all()
    seeker = braitenberg("ambient", layout)
    assert (controller_genes("braitenberg", "ambient", layout) == seeker).all()
    save_genotype(tmp_path / "mine", seeker)
    assert (controller_genes(str(tmp_path / "mine"), "ambient", layout) == seeker).all()


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
        controller_genes(spec, "proximity", Layout())


def test_files_keep_their_own_slots(tmp_path):
    """A genotype file with other slots or link fields than the task's layout still drives."""
    layout = Layout(slots=12, links=3)
    genes = constant(4, 2, layout)
    save_genotype(tmp_path / "small", genes, layout)
    loaded = controller_genes(str(tmp_path / "small"), "proximity", Layout())
    assert loaded.shape == layout.shape and loaded.dtype == np.int8
