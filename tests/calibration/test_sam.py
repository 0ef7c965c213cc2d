"""Tables of the Khepera community: what is read from them, and every refusal."""

from __future__ import annotations

import numpy as np
import pytest

from realitygap.calibration.load import load_recording
from realitygap.errors import RecordingError

GOOD = "8 8 3 5 2\n" + "".join(
    f"TURN {d}\n" + "".join(f"{b} {d} 7 0 1023 {b * 9} 3 4\n" for b in range(8)) for d in range(3)
) + "END\n"  # fmt: skip


@pytest.fixture
def sam(tmp_path):
    """A table's file with this text."""

    def make(text: str):
        path = tmp_path / "table.sam"
        path.write_text(text, "utf-8")
        return path

    return make


def test_bearings_turn_over_and_distances_become_centimetres(sam):
    """Rows stand clockwise and in mm; recordings count counter-clockwise and in cm."""
    made = load_recording(sam(GOOD), object="wall")
    assert (made.kind, made.object, made.counts.shape) == ("infrared", "wall", (24, 8))
    np.testing.assert_allclose(made.distance_cm[[0, 8, 16]], [0.5, 0.7, 0.9])
    np.testing.assert_allclose(made.bearing_deg[:6], [0, -45, -90, -135, 180, 135])
    assert made.counts[3, 5] == 27 and not made.warnings


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda t: t.replace("8 8 3 5 2", "6 8 3 5 2", 1), "line 1: expected `sensors .* got '6 8 3 5 2'"),
        (lambda t: t[: len(t) // 2], "expected 24 rows of 8"),
        (lambda t: t.replace("0 0 7 0 1023 0 3 4", "0 0 7 0 1023 0 3"), "expected 24 rows of 8"),
        (lambda t: t.replace("1 0 7 0 1023 9 3 4", "1 0 7 0 2000 9 3 4"), "from 0 to 1023"),
    ],
)
def test_a_broken_table_is_refused(sam, change, words):
    """Every fault names the file."""
    path = sam(change(GOOD))
    with pytest.raises(RecordingError, match=words) as caught:
        load_recording(path, object="wall")
    assert str(path) in str(caught.value)


@pytest.mark.parametrize("which", ["made_tables", "tables"])
def test_tables_of_the_other_kind_are_refused(which, request):
    """A light table is no wall's, and a wall's no lamp's."""
    tables = request.getfixturevalue(which)
    with pytest.raises(RecordingError, match="Give --object lamp"):
        load_recording(tables / "light.sam", object="wall")
    with pytest.raises(RecordingError, match="Give --object wall"):
        load_recording(tables / "wall.sam", object="lamp")


def test_the_real_tables(tables):
    """The two tables hold what their page says."""
    wall, light = (load_recording(tables / name) for name in ("wall.sam", "light.sam"))
    assert (wall.object, wall.counts.shape) == ("wall", (3600, 8))
    assert (light.object, light.counts.shape) == ("lamp", (4680, 8))
    assert wall.distance_cm.max() == pytest.approx(4.3) and 480 < light.counts.max() < 500
