"""Noise levels: names, numbers and refusals."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from realitygap.errors import ConfigError
from realitygap.world.robot import noise_level, noise_name


def test_the_papers_levels_have_names():
    """Zero, observed and double are 0, 1 and 2 times the observed deviation (§6)."""
    assert [noise_level(name) for name in ("zero", "Observed", " double ")] == [0.0, 1.0, 2.0]
    assert [noise_name(level) for level in (0, 1, 2)] == ["zero", "observed", "double"]


@given(st.floats(0, 10))
def test_any_number_is_a_level(level):
    """Any number from 0 to 10 is a level, as a number and as text; its name reads back to it."""
    assert noise_level(level) == noise_level(repr(level)) == level
    assert noise_level(noise_name(level)) == pytest.approx(level, rel=1e-5)


@pytest.mark.parametrize("wrong", ["loud", "", "-1", -0.5, "nan", 10.5, "inf", float("inf"), True, None])
def test_anything_else_is_refused(wrong):
    """An unknown name, a negative or a non-finite number is refused, and the names are listed."""
    with pytest.raises(ConfigError, match=r"noise: expected zero, observed, double or a number"):
        noise_level(wrong)
