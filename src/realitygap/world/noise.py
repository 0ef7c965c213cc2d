"""Noise levels (§6): a factor on every observed deviation."""

import math

from realitygap.errors import ConfigError

__all__ = ["NOISE_LEVELS", "noise_level", "noise_name"]

NOISE_LEVELS = {"zero": 0.0, "observed": 1.0, "double": 2.0}
"""The paper's three levels."""
LARGEST = 10.0
"""Beyond it the wheels' noise, a share of their speed, drives the speed control itself unstable."""


def noise_level(value: str | float) -> float:
    """A noise level from its name or number.

    Args:
        value: "zero", "observed", "double", or a number from 0 to 10 (as a number or as text).

    Raises:
        ConfigError: anything else.
    """
    text = str(value).strip().lower()
    if text in NOISE_LEVELS:
        return NOISE_LEVELS[text]
    try:
        level = math.nan if isinstance(value, bool) else float(text)
    except ValueError:
        level = math.nan
    if not 0 <= level <= LARGEST:
        raise ConfigError(
            f"noise: expected {', '.join(NOISE_LEVELS)} or a number from 0 to {LARGEST:g} (1 = observed), "
            f"got {value!r}."
        )
    return level + 0.0


def noise_name(level: float) -> str:
    """The name of a noise level: the paper's, or the number itself."""
    return next((name for name, value in NOISE_LEVELS.items() if value == level), f"{level:g}")
