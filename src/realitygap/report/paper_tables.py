"""Tables 1 and 2 as the paper prints them (§6.1, §6.2), to stand beside ours."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

__all__ = ["PAPER_AVERAGES", "PAPER_ROWS", "PaperRow"]


class PaperRow(NamedTuple):
    """A controller of the paper's, as its judges marked it: scores out of 10."""

    type: str
    behaviour: int
    differences: str
    correspondence: int


PAPER_ROWS: Mapping[str, Mapping[float, tuple[PaperRow, ...]]] = {
    "obstacle-avoidance": {
        0.0: (
            PaperRow("one way turner", 5, "a little noisier", 8),
            PaperRow("wall follower", 3, "qualitatively similar", 7),
            PaperRow("one way turner", 4, "noisier", 5),
            PaperRow("one way turner", 3, "a little noisier", 7),
            PaperRow("one way looper", 5, "noisier", 4),
        ),
        1.0: (
            PaperRow("two way turner", 8, "a little noisier", 8),
            PaperRow("one way looper", 5, "very similar", 9),
            PaperRow("wall follower", 4, "a little noisier", 7),
            PaperRow("wall follower", 6, "very similar", 9),
            PaperRow("wall follower", 7, "a little noisier", 7),
        ),
        2.0: (
            PaperRow("one way turner", 4, "a little less responsive", 8),
            PaperRow("two way turner", 8, "slightly less noisy", 8),
            PaperRow("one way looper", 4, "less responsive", 5),
            PaperRow("one way turner", 5, "less responsive", 6),
            PaperRow("wall follower", 3, "less responsive", 7),
        ),
    },
    "light-seeking": {
        0.0: (
            PaperRow("three point turner", 6, "noisier", 4),
            PaperRow("straight looper", 4, "loops more", 6), PaperRow("two way turner", 6, "similar", 8),
            PaperRow("two way turner", 8, "noisier", 4),
            PaperRow("two way turner", 8, "a little noisier", 6),
        ),
        1.0: (
            PaperRow("straight looper", 5, "a little noisier", 8),
            PaperRow("two way turner", 8, "a little noisier", 6),
            PaperRow("two way turner", 9, "very similar", 9),
            PaperRow("two way turner", 7, "a little noisier", 6),
            PaperRow("bobber", 5, "observably identical", 10),
        ),
        2.0: (
            PaperRow("two way turner", 7, "much noisier", 2), PaperRow("bobber", 5, "less noisy", 6),
            PaperRow("straight looper", 3, "less noisy", 7), PaperRow("two way turner", 8, "less noisy", 6),
            PaperRow("bobber", 6, "less noisy", 6),
        ),
    },
}  # fmt: skip
"""By task and level of noise."""

PAPER_AVERAGES: Mapping[str, Mapping[float, tuple[float, float]]] = {
    "obstacle-avoidance": {0.0: (4.0, 6.2), 1.0: (6.0, 8.0), 2.0: (4.8, 6.8)},
    "light-seeking": {0.0: (6.4, 5.6), 1.0: (6.8, 7.8), 2.0: (5.8, 5.4)},
}
"""Behaviour and correspondence score, as the tables print them."""
