"""A task's score tried on example paths before it is used: compiled and as plain Python.

The paths lie at the extremes of the task's own room: at rest, all over it, in contact, at its lamps
and cylinders. Shorter paths and rooms with no lamp or three are tried too; there both must agree,
but an index out of range is no fault: the task has no such path.
"""

import math
from collections.abc import Iterator
from copy import deepcopy
from functools import lru_cache

import numpy as np

from realitygap.errors import TaskError
from realitygap.kernels.params import Path, Room
from realitygap.tasks.scoring import CompiledScore, Score, compile_score, compiled_in
from realitygap.world.arena import Arena

__all__ = ["tried"]

LONGEST = 2000
"""Rows of the longest example: plain Python is slow."""
SHORT = (1, 2, 7)
FEW = 3
ALIKE = 1e-6
"""Sums may be taken in another order."""
TOP_CM_S, RADIUS_CM = 8.0, 2.9


def tried(score: Score, arena: Arena, steps: int) -> CompiledScore:
    """The compiled score, unless it fails on an example.

    Raises:
        TaskError: names the user's file and line.
    """
    return _tried(score, compiled_in(score), arena, steps)


@lru_cache(maxsize=64)
def _tried(score: Score, told: tuple[str, ...], arena: Arena, steps: int) -> CompiledScore:
    """The score with what it uses, `told`."""
    made = compile_score(score)
    own = _room(arena)
    other = own._replace(lamps=np.zeros((0, 2)), cylinders=np.zeros((0, 3)))
    several = own._replace(lamps=np.full((3, 2), 7.0), cylinders=np.full((3, 3), 9.0))
    for room in (own, other, several):
        for rows in (min(steps, LONGEST), *SHORT):
            for path in _paths(rows, own):
                _try(made, path, room, must=room is own and rows == steps)
    return made


def _room(arena: Arena) -> Room:
    there = arena.to_kernel()
    return Room(
        lamps=there.lamp_centre, size=there.size, cylinders=there.cylinders, top_speed=TOP_CM_S,
        radius=RADIUS_CM,
    )  # fmt: skip


def _paths(rows: int, room: Room) -> Iterator[Path]:
    even, chance = np.linspace(0.0, 1.0, rows), np.random.default_rng(1995)
    width, depth = room.size
    still, ones = np.zeros(rows), np.ones(rows)
    for x, y in (room.size / 2.0, *room.lamps[:FEW], *room.cylinders[:FEW, :2]):
        yield Path(x=ones * x, y=ones * y, heading=still, left=still, right=still, contact=still)
    yield Path(
        x=even * width, y=depth - even * depth, heading=100.0 * even - 50.0, left=TOP_CM_S * ones,
        right=-TOP_CM_S * ones, contact=ones,
    )  # fmt: skip
    x, y, heading, left, right = chance.uniform(-1.0, 1.0, (5, rows))
    yield Path(
        x=width * abs(x), y=depth * abs(y), heading=9.0 * heading, left=2.0 * TOP_CM_S * left,
        right=2.0 * TOP_CM_S * right, contact=np.round(abs(x)),
    )  # fmt: skip


def _try(made: CompiledScore, path: Path, room: Room, *, must: bool) -> None:
    """As plain Python, then compiled twice: three times the same, and nothing changed.

    Ctrl-C stops plain Python only, so that a score without end hangs there.
    """
    given = [deepcopy((path, room)) for _ in range(3)]
    plain = _told(made.plain, *given[2])
    first, again = _told(made.compiled, *given[0]), _told(made.compiled, *given[1])
    if must and isinstance(plain, LookupError):
        raise made.failure(plain, path, room)
    for name, part, now, before in zip(("path", "room"), ("x", "lamps"), given[0], (path, room), strict=True):
        if not all(map(np.array_equal, now, before)):
            cure = f"Work on a copy, as in {name}.{part}.copy()."
            _refuse(made, f"changes the {name} that it is given", cure)
    if not _alike(first, again):
        _refuse(made, f"gives {first} and then {again} on the same path", "It must depend on nothing else.")
    if not _alike(first, plain):
        if isinstance(plain, Exception):
            raise made.failure(plain, path, room)
        cure = "Look for whole numbers beyond 64 bits, or for names that change their value."
        _refuse(made, f"gives {first} compiled and {plain} as plain Python on the same path", cure)


def _told(score: Score, path: Path, room: Room) -> float | Exception:
    """What a score gives, or the error that it fails with."""
    try:
        with np.errstate(all="ignore"):
            return float(score(path, room))
    except Exception as error:
        return error


def _alike(one: float | Exception, other: float | Exception) -> bool:
    """Whether two ways to take a score come to the same; a failed sum is as good as no number."""
    if isinstance(one, Exception) and isinstance(other, Exception):
        return True
    a, b = (math.nan if isinstance(x, ArithmeticError | ValueError) else x for x in (one, other))
    if isinstance(a, Exception) or isinstance(b, Exception):
        return False
    if not (math.isfinite(a) and math.isfinite(b)):
        return not math.isfinite(a) and not math.isfinite(b)
    return math.isclose(a, b, rel_tol=ALIKE, abs_tol=ALIKE)


def _refuse(made: CompiledScore, what: str, cure: str) -> None:
    code = made.plain.__code__
    raise TaskError(f"{code.co_filename}, line {code.co_firstlineno}: the score {what}. {cure}")
