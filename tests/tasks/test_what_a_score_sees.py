"""The how-to's list of what `path` and `room` hold is the code's."""

import re
from pathlib import Path as File

import numpy as np

from realitygap import Genotype, Simulation
from realitygap.kernels.types import Path, Room

HOW_TO = File(__file__).resolve().parents[2] / "docs" / "how-to-own-parts.md"


def listed(what: str) -> dict[str, str]:
    """Shape by name, as the how-to's table has it."""
    text = HOW_TO.read_text("utf-8")
    return dict(re.findall(rf"^\| `{what}\.(\w+)` \| ([^|]*?) \|", text, re.M))


def test_every_array_is_listed_with_its_shape():
    """In the code's order; a field that is added or renamed has to be told."""
    simulation = Simulation("light", "paper")
    path = simulation.tracks(Genotype.constant(3, 3).networks(), np.zeros((1, 1), np.uint64))
    room, sizes = simulation.task.room(simulation.profile), {"steps": 200, "lamps": 1, "cylinders": 0}
    for what, kind, values in (("path", Path, [one[0, 0] for one in path]), ("room", Room, list(room))):
        shapes = listed(what)
        assert list(shapes) == list(kind._fields)
        for name, value in zip(kind._fields, values, strict=True):
            told = shapes[name]
            expected = () if told == "a number" else tuple(
                sizes[word] if word in sizes else int(word) for word in told.strip("[]").split(", ")
            )  # fmt: skip
            assert np.shape(value) == expected, name
