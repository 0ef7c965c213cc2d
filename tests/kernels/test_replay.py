"""A look-up table replayed: judged by the slow reference, and in mirrors."""

from __future__ import annotations

import numpy as np

from realitygap.kernels.infrared import replay
from realitygap.world.arena import Arena
from realitygap.world.sensors import LookUp
from tests.kernels.reference import look_up as reference
from tests.kernels.scenes import RADIUS, full_room, random_arena, random_pose

TOP = 1023.0


def random_table(random: np.random.Generator, *, sensors: int = 8, bearings: int = 24) -> LookUp:
    """A table with no sense in it: other distances for walls and cylinders, most of it far from dark."""

    def one() -> tuple[list[float], list[list[float]]]:
        at = np.cumsum(random.uniform(0.2, 2.0, random.integers(2, 9)))
        return at.tolist(), random.uniform(0, 600, (sensors, len(at) * bearings)).tolist()

    (wall_cm, wall), (cylinder_cm, cylinder) = one(), one()
    nothing = random.uniform(0, 9, sensors).tolist()
    return LookUp(nothing=nothing, wall_cm=wall_cm, wall=wall, cylinder_cm=cylinder_cm, cylinder=cylinder)


def replayed(table: LookUp, arena: Arena, pose) -> np.ndarray:
    """[P] what the kernel makes of it."""
    x, y, heading = pose
    out = np.full(len(table.nothing), np.nan)
    there = np.array([x, y, heading, np.cos(heading), np.sin(heading)])
    replay(table.to_kernel(), RADIUS, TOP, arena.to_kernel(), there, out)
    return out


def test_agrees_with_the_reference():
    """In rooms of all kinds, those with a grid too, every sensor reads what the slow reference reads."""
    random, seen = np.random.default_rng(11), 0
    for number in range(120):
        arena = full_room(random) if number % 6 == 0 else random_arena(random)
        pose = random_pose(random, arena)
        if pose is None:
            continue
        table = random_table(random)
        expected = reference.readings(table, RADIUS, TOP, arena, pose)
        np.testing.assert_allclose(replayed(table, arena, pose), expected, atol=1e-4)
        seen += not np.allclose(expected, table.nothing)
    assert seen > 50, "the scenes are too empty to judge anything"


def mirrored(rows, sensors: int, distances: int) -> list[list[float]]:
    """A table's rows with left and right exchanged, bearings and sensors."""
    cube = np.array(rows).reshape(sensors, distances, -1)
    return np.roll(cube[::-1, :, ::-1], 1, axis=2).reshape(sensors, -1).tolist()


def test_mirror_images_read_mirror_images():
    """In a mirrored room a mirrored table gives mirrored readings."""
    random = np.random.default_rng(12)
    for _ in range(40):
        arena, table = random_arena(random), random_table(random)
        pose = random_pose(random, arena)
        if pose is None:
            continue
        depth = arena.size_cm[1]
        other = LookUp(
            nothing=table.nothing[::-1], wall_cm=table.wall_cm, cylinder_cm=table.cylinder_cm,
            wall=mirrored(table.wall, 8, len(table.wall_cm)),
            cylinder=mirrored(table.cylinder, 8, len(table.cylinder_cm)),
        )  # fmt: skip
        room = Arena(
            name="mirrored", size_cm=arena.size_cm,
            cylinders=[{**vars(c), "y_cm": depth - c.y_cm} for c in arena.cylinders],
            walls=[(a, depth - b, c, depth - d) for a, b, c, d in arena.walls],
        )  # fmt: skip
        x, y, heading = pose
        there = replayed(other, room, (x, depth - y, -heading))
        np.testing.assert_allclose(there[::-1], replayed(table, arena, pose), atol=1e-6)
