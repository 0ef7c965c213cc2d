"""Rooms for the twin's tests, and where the real robot's tables may lie."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

OPEN = {"size_cm": [200, 200]}
"""Nothing but a floor."""
CROWDED = {
    "size_cm": [80, 60],
    "cylinders": [[20, 20, 4], [55, 40, 6]],
    "walls": [[40, 10, 45, 35]],
    "lamps": [[80, 30]],
}

ARENAS = {
    "obstacle-avoidance": {
        "size_cm": [50.0, 50.0],
        "cylinders": [[15.0, 15.0, 4.0], [35.0, 15.0, 4.0], [15.0, 35.0, 4.0], [35.0, 35.0, 4.0]],
        "walls": [],
        "lamps": [],
    },
    "light-seeking": {"size_cm": [110.0, 70.0], "cylinders": [], "walls": [], "lamps": [[110.0, 35.0]]},
}
"""Those of the paper's two tasks."""


def table(name: str) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """A real table [distances, bearings, 8] and its distances (mm), or the test is skipped."""
    root = Path(os.environ.get("REALITYGAP_DATA", Path(__file__).parents[2].parent / "shared" / "data"))
    path = next((p for p in (root / "khepera" / name, root / name) if p.is_file()), None)
    if path is None:
        pytest.skip(f"{name} of the real robot is not here: set REALITYGAP_DATA to the folder that holds it")
    lines = path.read_text(encoding="ascii").splitlines()
    sensors, bearings, distances, first, step = (int(v) for v in lines[0].split())
    numbers = [[int(v) for v in line.split()] for line in lines[1:] if line[:1] not in "TE"]
    readings = np.array(numbers).reshape(distances, bearings, sensors)
    return readings, first + step * np.arange(distances, dtype=np.float64)
