"""Arenas: the paper's two, what the kernels get, what stands where, and every refusal by key."""

from dataclasses import replace

import numpy as np
import pytest

from realitygap.errors import ConfigError
from realitygap.world.arena import Arena, Cylinder, Lamp, load_arena

ROOM = Arena(
    name="room",
    size_cm=(60, 40),
    walls=((30, 0, 30, 20),),
    cylinders=(Cylinder(x_cm=45, y_cm=20, radius_cm=5),),
    lamps=(Lamp(x_cm=60, y_cm=20), Lamp(x_cm=10, y_cm=0, line_deg=0, brightness=0.5)),
)


def test_the_papers_arenas():
    """50 × 50 cm with four cylinders of radius 4 cm; 110 × 70 cm with one lamp (§4)."""
    avoidance, light = load_arena("obstacle-avoidance"), load_arena("Light seeking")
    assert avoidance.size_cm == (50, 50) and light.size_cm == (110, 70)
    assert {c.radius_cm for c in avoidance.cylinders} == {4.0} and len(avoidance.cylinders) == 4
    assert light.lamps[0].weights == Lamp(x_cm=0, y_cm=0).weights == (4.19, 4.24, 8.24, 4.24, 4.19)
    assert light.lamps[0].offset == Lamp(x_cm=0, y_cm=0).offset == -4.15  # §3.3, as all five weights


def test_kernel_arrays():
    """Lamp points lie on the lamp's line about its centre; weights and offset carry the brightness."""
    arena = ROOM.to_kernel()
    np.testing.assert_array_equal(arena.lamp_points[0, :, 0], 60.0)
    np.testing.assert_array_equal(arena.lamp_points[0, :, 1], [15, 17.5, 20, 22.5, 25])
    np.testing.assert_array_equal(arena.lamp_points[1, :, 0], [5, 7.5, 10, 12.5, 15])
    np.testing.assert_array_equal(arena.lamp_weights[1] * 2, arena.lamp_weights[0])
    np.testing.assert_array_equal(arena.lamp_offset, [-4.15, -4.15 / 2])
    askew = Lamp(x_cm=20, y_cm=10, line_deg=0, weights=(1, 2, 3, 4, 5), brightness=2.0)
    lit = replace(ROOM, lamps=(askew,)).to_kernel()
    np.testing.assert_array_equal(lit.lamp_points[0, :, 0], [15, 17.5, 20, 22.5, 25])
    np.testing.assert_array_equal(lit.lamp_weights, [[2, 4, 6, 8, 10]])
    np.testing.assert_array_equal(arena.segments, [[30, 0, 30, 20]])


def test_kernel_arrays_have_one_type():
    """An empty room's arrays have the types and ranks of a full one's: one kernel serves both."""
    empty = replace(ROOM, walls=(), cylinders=(), lamps=()).to_kernel()
    for name, full in ROOM.to_kernel()._asdict().items():
        value = getattr(empty, name)
        if not isinstance(full, float | int):
            assert value.dtype == full.dtype and value.ndim == full.ndim, name
            assert value.flags.c_contiguous and full.flags.c_contiguous, name


@pytest.mark.parametrize(
    ("x", "y", "told"),
    [
        (15, 20, None),
        (30, 23, None),
        (37, 20, None),
        (37.2, 20, "the cylinder at (45, 20)"),
        (2, 20, "the wall at x = 0"),
        (58, 30, "the wall at x = 60"),
        (15, 38, "the wall at y = 40"),
        (28, 10, "the wall from (30, 0) to (30, 20)"),
        (30, 22, "the wall from (30, 0) to (30, 20)"),
        (-5, 20, "the outside of the room (60 by 40 cm)"),
    ],
)
def test_what_a_disc_overlaps(x, y, told):
    """A disc of 2.9 cm overlaps what is nearer than that, and the words name it."""
    assert ROOM.obstacle_at(x, y, 2.9) == told


def test_round_trip(tmp_path):
    """An arena written as TOML reads back equal."""
    for arena in (ROOM, load_arena("obstacle-avoidance"), load_arena("light-seeking")):
        file = tmp_path / "copy.toml"
        file.write_text(arena.to_toml(), encoding="utf-8")
        assert load_arena(file) == arena


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"size_cm": (1.1, 0.7)}, r"size_cm: expected sides of 5 cm or more, got \[1\.1, 0\.7\]"),
        ({"size_cm": 50}, r"size_cm: expected a list in square brackets, got 50"),
        ({"walls": [[0, 0, 70, 0]]}, r"walls\[0\]: expected both ends inside the room \(60 by 40 cm\)"),
        ({"cylinders": [{"x_cm": 3, "y_cm": 20, "radius_cm": 4}]}, r"cylinders\[0\]: expected the whole cyl"),
        ({"cylinders": [{"x_cm": 9, "y_cm": 20}]}, r"cylinders\[0\]\.radius_cm: missing"),
        ({"lamps": [{"x_cm": 61, "y_cm": 20}]}, r"lamps\[0\]: expected all five points inside"),
        (
            {"lamps": [{"x_cm": 9, "y_cm": 9, "colour": 1}]},
            r"lamps\[0\]\.colour: unknown key\. Known keys: x_cm",
        ),
        ({"reflectance": -0.1}, r"reflectance: expected a number from 0 to 10, got -0\.1"),
    ],
)
def test_wrong_values_are_refused_by_key(change, told):
    """A wrong value is refused by its key, from Python and (the same code) from a file."""
    with pytest.raises(ConfigError, match=told):
        replace(ROOM, **change)


def test_surfaces_that_differ_are_told(tmp_path):
    """A reflectance is written where it is not 1, for robots' stand-ins too, and reads back."""
    assert "reflectance" not in ROOM.to_toml() and "reflectance" not in ROOM.plain()
    dark = replace(ROOM, cylinders=(replace(ROOM.cylinders[0], reflectance=0.2),))
    assert dark.plain()["reflectance"] == dark.to_kernel().reflectance.tolist() == [1.0, 0.2]
    (tmp_path / "dark.toml").write_text(dark.to_toml())
    assert load_arena(tmp_path / "dark.toml") == dark


def test_a_file_is_named(tmp_path):
    """A refusal of a file's value begins with the file's name."""
    file = tmp_path / "mine.toml"
    file.write_text('name = "mine"\nsize_cm = [50, 50]\ncylinder = []\n')
    with pytest.raises(ConfigError, match=r"mine\.toml: cylinder: unknown key\. Did you mean 'cylinders'\?"):
        load_arena(file)
    with pytest.raises(ConfigError, match=r"unknown arena 'moon'\. Known: light-seeking, obstacle-avoidance"):
        load_arena("moon")
