"""The twin's own functions: right to a few units in the last place, and the same bits everywhere."""

from __future__ import annotations

import math
import os

import numpy as np
import pytest
from numpy.typing import NDArray

from realitygap.twin.arithmetic import arctan2, cos_sin, normals, power, product
from tests.same_everywhere import SETTINGS, digest_of

EVERYWHERE = "2d90c594e353ec11"
"""What every machine gives for the part `arithmetic` of `tests.same_everywhere`."""


def units_off(found: NDArray[np.float64], right: list[float]) -> float:
    """By how many units in the last place, at most."""
    expected = np.array(right)
    return float((np.abs(found - expected) / np.spacing(np.abs(expected))).max())


def test_cosines_and_sines_are_right() -> None:
    """Within two units in the last place of the C library's, in turns of either sense."""
    angles = np.linspace(-700.0, 700.0, 100_003)
    c, s = cos_sin(angles)
    assert units_off(c, [math.cos(v) for v in angles]) <= 2
    assert units_off(s[angles != 0], [math.sin(v) for v in angles if v]) <= 2
    assert [cos_sin(v)[0] for v in angles[:50]] == c[:50].tolist() and cos_sin(0)[0] == 1.0


def test_angles_and_powers_are_right() -> None:
    """Angles of points all round, and powers down to tiny bases; 0 to any power is 0."""
    turn = np.linspace(-math.pi, math.pi, 20_001)[1:-1]
    y, x = np.array([math.sin(v) for v in turn]), np.array([math.cos(v) for v in turn])
    found, right = arctan2(y, x), [math.atan2(b, a) for b, a in zip(y, x, strict=True)]
    assert units_off(found[turn != 0], [v for v in right if v]) <= 3
    assert arctan2([0, 0, 1, -1], [0, -1, 0, 0]).tolist() == [0, math.pi, math.pi / 2, -math.pi / 2]
    base = np.linspace(0.0, 1.0, 5001)
    for exponent in (1.4, 2.6):
        assert power(base, exponent) == pytest.approx([v**exponent for v in base], rel=1e-14)
    assert power(-1.0, 2.6) == 0.0


def test_sums_of_products_are_in_order() -> None:
    """Products of matrices, as a person adds them up."""
    random = np.random.default_rng(2)
    a, b = random.normal(size=(5, 3)), random.normal(size=(3, 4))
    assert product(a, b) == pytest.approx(a @ b)
    (x, y, z), column = a[0], b[:, 0]
    assert product(a, b)[0, 0] == (x * column[0] + y * column[1]) + z * column[2]


def distance_from_normal(draws: NDArray[np.float64]) -> float:
    """The largest difference of the distributions, times √n (Kolmogorov and Smirnov)."""
    ordered = np.sort(draws.ravel())
    law = np.array([0.5 * math.erfc(-v / math.sqrt(2.0)) for v in ordered])
    steps = np.arange(len(law) + 1) / len(law)
    return float(max((steps[1:] - law).max(), (law - steps[:-1]).max()) * math.sqrt(len(law)))


def test_draws_are_normal() -> None:
    """Draws follow the normal law, tails included; one that is 2 % too wide is told from it."""
    draws = normals(np.random.PCG64(7).random_raw(100_000))
    limit = 1.95  # passed by one sample in a thousand
    assert distance_from_normal(draws) < limit
    assert distance_from_normal(1.02 * draws) > limit
    assert distance_from_normal(np.random.default_rng(7).uniform(-1.7, 1.7, 100_000)) > limit
    beyond = [(np.abs(draws) > z).mean() / math.erfc(z / math.sqrt(2.0)) for z in (2.0, 3.0)]
    assert beyond == pytest.approx([1.0, 1.0], abs=0.2)


def test_every_machine_gives_the_same_bits() -> None:
    """The functions' values are these very bits, whatever the processor can do."""
    assert digest_of("arithmetic") == EVERYWHERE


@pytest.mark.skipif(bool(os.environ.get("NUMBA_DISABLE_JIT")), reason="slow without the compiler")
def test_older_processors_give_the_same_readings() -> None:
    """A unit, its sensors, noise and camera, without what newer processors can do: the same bits."""
    digests = {name: digest_of("readings", **SETTINGS[name]) for name in ("as it is", "NumPy", "C library")}
    assert len(set(digests.values())) == 1, digests
