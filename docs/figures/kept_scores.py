"""Writes what the page of a reproduction shows of the kept study beside its own averages.

`python docs/figures/kept_scores.py` takes from docs/noise-level/default/cells.csv each run's correspondence
score against the simulation at the level that it was evolved at, at the paper's three levels of noise.
"""

from __future__ import annotations

import csv
from pathlib import Path

from realitygap.report.few_runs import KEPT_FILE
from realitygap.world.noise import NOISE_LEVELS

CELLS = Path(__file__).resolve().parent.parent / "noise-level" / "default" / "cells.csv"


def table() -> str:
    """The file's text: a row a run, in the order of the kept study's table."""
    lines = ["task,noise,score"]
    for row in csv.DictReader(CELLS.read_text("utf-8").splitlines()):
        level = float(row["evolved_level"])
        if level in NOISE_LEVELS.values() and level == float(row["comparison_level"]):
            lines.append(f"{row['task']},{level:g},{row['score']}")
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    KEPT_FILE.write_text(table(), encoding="utf-8")
    print(f"wrote {KEPT_FILE}")
