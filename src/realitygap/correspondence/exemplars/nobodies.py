"""Exemplars of "none of these": robots that take no notice of anything, or do not move."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from realitygap.correspondence.exemplars.avoiders import Draw, Rule, _turn
from realitygap.values import Command

__all__ = ["NOBODIES"]


def standing(draw: Draw) -> Rule:
    """Stands."""

    def rule(_: NDArray[np.float64]) -> Command:
        return Command(left=0, right=0)

    return rule


def spinning(draw: Draw) -> Rule:
    """Turns on the spot."""
    spin = int(draw.choice([-1, 1])) * int(draw.integers(1, 11))

    def rule(_: NDArray[np.float64]) -> Command:
        return _turn(int(draw.integers(-1, 2)), spin)

    return rule


def random_walker(draw: Draw) -> Rule:
    """Wheels that change by chance, every step or every second or so."""
    lasts, pace = draw.uniform(1, 15), draw.uniform(0, 5)
    bias = draw.uniform(0, 4)
    now = Command(left=0, right=0)

    def rule(_: NDArray[np.float64]) -> Command:
        nonlocal now
        if draw.random() < 1 / lasts:
            turn = draw.uniform(-1, 1) * (3 + pace)
            now = _turn(draw.uniform(-pace, pace) + bias, turn)
        return now

    return rule


def blind(draw: Draw) -> Rule:
    """Drives on until it meets a wall, and goes on pushing."""
    pace, bend = int(draw.integers(2, 11)) * int(draw.choice([-1, 1])), int(draw.integers(-1, 2))

    def rule(_: NDArray[np.float64]) -> Command:
        return _turn(pace, bend if abs(pace) > 5 else 0)

    return rule


NOBODIES: dict[str, Callable[[Draw], Rule]] = {
    "standing": standing,
    "spinning": spinning,
    "random walker": random_walker,
    "blind": blind,
}
