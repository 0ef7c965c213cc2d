"""Colours that carry text stand out enough (WCAG 2.2: 4.5 for text)."""

from __future__ import annotations

import re
from importlib.resources import files

import pytest

CSS = files("realitygap.report").joinpath("templates", "page.css").read_text("utf-8")
NAMES = 0.8
"""The opacity of a neuron's name (player.css)."""

Colour = tuple[float, float, float]


def _themes(text: str) -> list[dict[str, Colour]]:
    """The colours of the light and of the dark theme."""
    blocks = re.findall(r"color-scheme: (?:light|dark);[^}]*?(?=}|{%)", text, re.DOTALL)
    found = [dict(re.findall(r"--([\w-]+): #([0-9a-f]{6})", block)) for block in blocks[:2]]
    return [{name: _colour(value) for name, value in one.items()} for one in found]


def _colour(text: str) -> Colour:
    red, green, blue = (int(text[k : k + 2], 16) / 255 for k in (0, 2, 4))
    return red, green, blue


def _contrast(a: Colour, b: Colour) -> float:
    """The ratio of two colours' relative luminances, as WCAG defines it."""

    def luminance(colour: Colour) -> float:
        linear = (c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in colour)
        return sum(w * c for w, c in zip((0.2126, 0.7152, 0.0722), linear, strict=True))

    low, high = sorted((luminance(a), luminance(b)))
    return (high + 0.05) / (low + 0.05)


@pytest.mark.parametrize("glow", ["above", "below"])
@pytest.mark.parametrize("theme", [0, 1], ids=["light", "dark"])
def test_a_neurons_name_is_read_while_it_is_lit(theme: int, glow: str) -> None:
    """Also at the opacity that names have."""
    colours = _themes(CSS)[theme]
    ink, ground = colours["ink"], colours[glow]
    red, green, blue = (NAMES * a + (1 - NAMES) * b for a, b in zip(ink, ground, strict=True))
    assert _contrast((red, green, blue), ground) >= 4.5
