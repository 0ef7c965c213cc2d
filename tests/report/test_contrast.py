"""Colours that carry text stand out enough (WCAG 2.2: 4.5 for text)."""

import re
from importlib.resources import files

import numpy as np
import pytest

CSS = files("realitygap.report").joinpath("templates", "page.css").read_text("utf-8")
NAMES = 0.8
"""The opacity of a neuron's name (player.css)."""


def _luminance(colour: np.ndarray) -> float:
    """Relative, as WCAG defines it."""
    linear = np.where(colour <= 0.04045, colour / 12.92, ((colour + 0.055) / 1.055) ** 2.4)
    return float(linear @ (0.2126, 0.7152, 0.0722))


@pytest.mark.parametrize("glow", ["above", "below"])
@pytest.mark.parametrize("theme", ["light", "dark"])
def test_a_neurons_name_is_read_while_it_is_lit(theme: str, glow: str) -> None:
    """Also at the opacity that names have."""
    block = re.search(rf"color-scheme: {theme};[^}}]*?(?=}}|{{%)", CSS, re.DOTALL)[0]
    found = dict(re.findall(r"--([\w-]+): #([0-9a-f]{6})", block))
    ink, ground = (np.array(list(bytes.fromhex(found[name]))) / 255 for name in ("ink", glow))
    low, high = sorted(map(_luminance, (NAMES * ink + (1 - NAMES) * ground, ground)))
    assert (high + 0.05) / (low + 0.05) >= 4.5
