"""Tables 1 and 2 as the paper prints them (§6.1, §6.2), to stand beside ours."""

import csv
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

__all__ = ["PAPER_AVERAGES", "PAPER_ROWS", "PaperRow"]


class PaperRow(NamedTuple):
    """A controller of the paper's, as its judges marked it: scores out of 10."""

    type: str
    behaviour: int
    differences: str
    correspondence: int


def _printed() -> dict[str, dict[float, tuple[PaperRow, ...]]]:
    found: dict[str, dict[float, tuple[PaperRow, ...]]] = {}
    lines = Path(__file__).with_name("paper_tables.csv").read_text("utf-8").splitlines()
    for task, noise, kind, behaviour, differences, correspondence in list(csv.reader(lines))[1:]:
        rows = found.setdefault(task, {})
        row = PaperRow(kind, int(behaviour), differences, int(correspondence))
        rows[float(noise)] = (*rows.get(float(noise), ()), row)
    return found


PAPER_ROWS: Mapping[str, Mapping[float, tuple[PaperRow, ...]]] = _printed()
"""By task and level of noise."""

PAPER_AVERAGES: Mapping[str, Mapping[float, tuple[float, float]]] = {
    "obstacle-avoidance": {0.0: (4.0, 6.2), 1.0: (6.0, 8.0), 2.0: (4.8, 6.8)},
    "light-seeking": {0.0: (6.4, 5.6), 1.0: (6.8, 7.8), 2.0: (5.8, 5.4)},
}
"""Behaviour and correspondence score, as the tables print them."""
