"""How well a smooth curve reads a place that was left out of a Thymio's series, for docs/readings.md.

    python -m docs.figures.uneven_series ../shared/data/thymio

Each place between the first and the last lit one is read by a Gaussian process through the other places of
the same series: one sensor, one room, one stay. Length scale and noise are those that leave the least error
on these very places, so one that is chosen beforehand does worse; other kinds of curves are not tried.
"""

from __future__ import annotations

import csv
import sys
from pathlib import Path

import numpy as np

from realitygap.values import Floats

DARK, FULL = 1090.0, 4500.0
"""Counts: readings below do not exist, or flicker; the full scale."""
SETTLED = 2
"""The first readings of a row may show the distance before."""
LENGTHS, NOISES = np.linspace(0.1, 2.0, 40), 10.0 ** np.arange(-6, 1, 0.5)
STRAIGHT = 1e4
"""Prior variance of a constant and a slope over the readings': both are free."""


def series_of(file: Path) -> tuple[Floats, Floats]:
    """Distances (cm) and mean readings of the lit places, the nearest first."""
    rows = [row for row in csv.reader(file.open(encoding="ascii")) if row]
    found = sorted(
        (float(row[0].removesuffix("cm")), np.mean([float(v) for v in row[1 + SETTLED :]])) for row in rows
    )
    return np.array([(d, mean) for d, mean in found if DARK < mean < FULL]).T


def left_out(x: Floats, y: Floats, length: float, noise: float) -> Floats:
    """Errors at each place of a Gaussian process through all others (Rasmussen and Williams 2006, 5.12)."""
    straight = np.stack([np.ones_like(x), x])
    shape = np.exp(-0.5 * ((x[:, None] - x) / length) ** 2) + STRAIGHT * straight.T @ straight
    inverse = np.linalg.inv(shape + noise * np.eye(len(x)))
    return inverse @ y / np.diag(inverse)


def least(d: Floats, y: Floats) -> Floats:
    """The least errors at the places between the ends, over all lengths and noises."""
    tried = [left_out(np.log(d + 1.0), y, length, noise)[1:-1] for length in LENGTHS for noise in NOISES]
    return min(tried, key=lambda errors: float(errors @ errors))


def main() -> None:
    """Print the table."""
    files = sorted(Path(sys.argv[1]).glob("sensor*.csv")) if len(sys.argv) == 2 else []
    if not files:
        sys.exit(f"expected one folder with sensor*.csv.\n\n{__doc__}")
    errors = {}
    for file in files:
        errors[file.stem] = least(*series_of(file)) / FULL * 100.0
        told = " ".join(f"{error:+.1f}" for error in errors[file.stem])
        print(f"{file.stem}: {np.sqrt(np.mean(errors[file.stem] ** 2)):.2f} % of the full scale ({told})")
    every = np.concatenate(list(errors.values()))
    print(f"all {len(every)} places: {np.sqrt(np.mean(every**2)):.2f} %")


if __name__ == "__main__":
    main()
