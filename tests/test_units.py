"""Units convert once: where a person types or reads, and where a profile's degrees reach a model."""

from __future__ import annotations

import ast
from pathlib import Path

import realitygap

SOURCE = Path(realitygap.__file__).parent
NAMES = {"degrees", "radians", "deg2rad", "rad2deg"}

CONVERT = {
    # the ground: poses and tracks, for all others
    "values.py": (2, "a pose as a person writes and reads it"),
    "track.py": (5, "a track's CSV and JSON; and kept scores' last bit (settled)"),
    # a robot's constants and an arena's are in degrees, as their TOML has them
    "world/rays.py": (3, "a sensor's direction becomes a unit vector"),
    "world/sensor_checks.py": (2, "directions that were given in radians are refused"),
    "tasks/task.py": (1, "a task's range of start headings becomes the kernels'"),
    "calibration/forward.py": (2, "the rig's turn and bearings, which are fitted in a profile's degrees"),
    "calibration/checks.py": (3, "bearings against a profile's directions"),
    "calibration/recorder/plans.py": (2, "a bearing that is told to a person becomes a pose"),
    "calibration/recorder/record.py": (1, "a recording's CSV"),
    "calibration/recordings/files.py": (2, "a recording's CSV"),
    "calibration/recordings/recording.py": (2, "where a robot stood whose sensor looked straight at a wall"),
    "calibration/wheels/odometry.py": (1, "drift, told in degrees a metre"),
    # descriptors are in the degrees that people can just tell apart
    "correspondence/descriptors.py": (3, "turn rates and bearings, deg/s and deg"),
    "correspondence/distances.py": (1, "a constant, written in degrees"),
    "correspondence/evidence.py": (2, "how far a track turned and what lies ahead, deg/s and deg"),
    "correspondence/reading.py": (1, "a heading that was given in radians is recognised"),
    # libraries that ask for degrees
    "report/robots.py": (1, "matplotlib's wedges"),
    "report/watch.py": (1, "SVG's turns"),
    "film/fit.py": (1, "what a picture shows from corner to corner, for a warning"),
    "film/sheet.py": (1, "the line to a robot's front, on a printed page"),
    "report/arenas.py": (1, "points round a compass"),
    "report/calibration_figures.py": (2, "a figure's axis in degrees"),
    "twin/render.py": (1, "MuJoCo's field of view"),
    # the twin shares no code with the simulation
    "twin/unit.py": (4, "constants of the population, written in degrees"),
    "twin/eyes.py": (1, "the sensors' places, written in degrees"),
    "twin/server.py": (1, "the sealed file's CSV"),
}
"""Files that convert, how often at most, and what for: where `Pose` and `Track` do not serve."""


def conversions(text: str) -> int:
    """How many places in a file's text turn degrees into radians, or back."""
    found = 0
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Attribute):
            found += node.attr in NAMES
        elif isinstance(node, ast.ImportFrom):
            found += any(alias.name in NAMES for alias in node.names)
        elif isinstance(node, ast.BinOp) and isinstance(node.op, ast.Mult | ast.Div):
            sides = [ast.unparse(side) for side in (node.left, node.right)]
            found += any(s in ("180", "180.0") for s in sides) and any(s.endswith("pi") for s in sides)
    return found


def test_every_way_to_convert_is_seen():
    """Calls, imported names and π / 180 are counted, words and other numbers are not."""
    assert conversions("import math\nx = math.radians(3) + np.rad2deg(y)") == 2
    assert conversions("from math import degrees") == 1
    assert conversions("x = h * (180.0 / np.pi) + math.pi / 180") == 2
    assert conversions("degrees = 180.0 - x % 360.0\nmath.pi / 2") == 0


def test_units_convert_where_they_may():
    """Degrees become radians, and radians degrees, in the files of the list, and in no other place."""
    found = {
        file.relative_to(SOURCE).as_posix(): conversions(file.read_text(encoding="utf-8"))
        for file in SOURCE.rglob("*.py")
    }
    found = {name: count for name, count in found.items() if count}
    assert sorted(found) == sorted(CONVERT)
    assert {name: count for name, count in found.items() if count > CONVERT[name][0]} == {}
