"""A task's score: compiled, and tried before it is used."""

import inspect
import math
import random
import re
import traceback
from collections.abc import Callable, Iterator
from contextlib import suppress
from copy import deepcopy
from functools import cached_property, lru_cache
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from realitygap.errors import TaskError
from realitygap.kernels.params import Path, Room
from realitygap.outside import frozen, used
from realitygap.world.arena import Arena

__all__ = ["CompiledScore", "Score", "compile_score", "compiled_in", "example", "reason", "tried"]


Score = Callable[[Any, Any], float]
"""What a user writes: (Path, Room) → a number, larger is better."""


class CompiledScore:
    """A score as it is called: compiled; an error in it names the user's file and line.

    Attributes:
        plain: the user's function.
        compiled: Numba's; the user's own where the compiler is off.
    """

    def __init__(self, plain: Score, compiled: Any) -> None:
        self.plain, self.compiled = plain, compiled

    def __call__(self, path: Path, room: Room) -> float:
        try:
            return self.compiled(path, room)  # type: ignore[no-any-return]
        except Exception as error:
            raise self.failure(error, path, room) from None

    def over(self, paths: NDArray[np.float64], room: Room) -> NDArray[np.float64]:
        """The scores of paths [T, 6, steps], the rows of each as in Path: one compiled loop."""
        scores = np.empty(len(paths))
        try:
            self._loop(paths, room, scores)
        except Exception:
            for rows in paths:
                self(Path(*rows), room)  # tells the first that fails
            raise
        return scores

    @cached_property
    def _loop(self) -> Callable[..., None]:
        score = self.compiled

        def take(paths: Any, room: Any, scores: Any) -> None:
            for t in range(scores.shape[0]):
                p = paths[t]
                scores[t] = score(Path(p[0], p[1], p[2], p[3], p[4], p[5]), room)

        return self.around(take)

    def around(self, loop: Callable[..., None]) -> Callable[..., None]:
        """A loop that encloses the compiled score, compiled as the score is."""
        from realitygap.kernels.jit import SHELF

        if self.compiled is self.plain:  # the compiler is off
            return loop
        made: Callable[..., None] = SHELF.compiled(loop, like=self.compiled, error_model="numpy")
        return made

    def failure(self, error: Exception, path: Path, room: Room) -> TaskError:
        """What failed in the score; machine code knows no lines, so plain Python runs it again."""
        try:
            with np.errstate(all="ignore"):
                self.plain(Path(*map(np.copy, path)), room)
        except Exception as again:
            error = again
        file, stack = inspect.getfile(self.plain), traceback.extract_tb(error.__traceback__)
        own = [frame.lineno for frame in stack if frame.filename == file]
        where = f"{file}, line {own[-1]}" if own else _where(self.plain)
        told = f"{type(error).__name__}: {error}".rstrip(": ")
        there = f"{path.x.size} rows, the room {len(room.lamps)} lamps and {len(room.cylinders)} cylinders"
        cure = f"This path has {there}." if isinstance(error, IndexError) else "Correct that line."
        return TaskError(f"{where}: the score fails with {told}. {cure}")


def compile_score(score: Score) -> CompiledScore:
    """`score` compiled by Numba for (Path, Room), or as it is where the compiler is off.

    Raises:
        TaskError: it draws at random, prints, does not compile or returns no float; names file and line.
    """
    return _compiled(score, compiled_in(score))


def compiled_in(score: Score) -> tuple[str, ...]:
    """The numbers and arrays that a score uses besides its arguments, as texts: they may have changed."""
    with suppress(OSError, TypeError):
        return frozen(score)
    return ()


@lru_cache(maxsize=64)
def _compiled(score: Score, told: tuple[str, ...]) -> CompiledScore:
    """The score with what it uses, `told`."""
    _refuse_unrepeatable(score, set())
    import numba

    from realitygap.kernels.jit import SHELF

    if numba.config.DISABLE_JIT:
        return CompiledScore(score, score)
    compiled = SHELF.compiled(score, error_model="numpy", boundscheck=True)
    types = tuple(numba.typeof(value) for value in example())
    try:
        compiled.compile(types)
    except Exception as error:  # Numba's own errors, and those it lets through (a name NumPy lacks)
        raise TaskError(f"{_where(score, error)}: the score cannot be compiled: {reason(error)}") from None
    returned = compiled.overloads[types].signature.return_type
    if returned != numba.float64:
        raise TaskError(
            f"{_where(score)}: score: expected a function that returns a float, it returns "
            f"{_named(returned)}. Return one number from every branch, as float(…)."
        )
    return CompiledScore(score, compiled)


def _refuse_unrepeatable(function: Any, seen: set[Any]) -> None:
    """A score is a function of path and room: nothing in it, or in what it calls, is drawn or printed.

    Compiled functions that it calls check their indices too from then on.
    """
    seen.add(function)
    for line, found, name in used(function):
        where = f"{inspect.getfile(function)}, line {line}"
        if found is print:
            raise TaskError(f"{where}: a score is called a thousand times: remove `print`.")
        if _is_random(found):
            cure = "The same path must give the same score; a trial's chance is in its noise."
            raise TaskError(f"{where}: a score draws nothing at random: remove `{name}`. {cure}")
        plain = getattr(found, "py_func", None)
        if plain is not None and plain not in seen:
            found.targetoptions.setdefault("boundscheck", True)
            _refuse_unrepeatable(plain, seen)


def _is_random(found: Any) -> bool:
    """Whether it is Python's or NumPy's module of random numbers, or something out of them."""
    sources = (random, np.random)
    own = getattr(found, "__self__", None)
    drawn = isinstance(own, random.Random | np.random.RandomState | np.random.Generator)
    return found in sources if isinstance(found, ModuleType) else drawn


def example() -> tuple[Path, Room]:
    """A path and a room of the types that every score meets."""
    row = np.zeros(2)
    path = Path(x=row, y=row, heading=row, left=row, right=row, contact=row)
    room = Room(
        lamps=np.zeros((1, 2)), size=np.ones(2), cylinders=np.zeros((1, 3)), top_speed=8.0, radius=2.9
    )
    return path, room


def _where(score: Score, error: Any = None) -> str:
    line = getattr(getattr(error, "loc", None), "line", None) or score.__code__.co_firstlineno
    return f"{inspect.getfile(score)}, line {line}"


def _named(returned: Any) -> str:
    """A type of Numba's in a Python user's words."""
    text = str(returned)
    if text == "none":
        return "nothing"
    if text.startswith("OptionalType"):
        return "nothing from some branches"
    return "int" if text.startswith(("Literal[int]", "int", "uint")) else text


def reason(error: Exception) -> str:
    """The line of Numba's report that says what is wrong, and what a score may use."""
    dull = ("Failed in", "During:", "File ", "<source", "This error", "-", "^", ">>>", "def ")
    plain = re.sub(r"\x1b\[[0-9;]*m", "", str(error))
    unknown = re.search(r"Unknown attribute '(\w+)' of type (Path|Room)\(", plain)
    if unknown:
        fields = Path._fields if unknown[2] == "Path" else Room._fields
        has = f"{', '.join(fields[:-1])} and {fields[-1]}"
        return f"there is no {unknown[2].lower()}.{unknown[1]}: {unknown[2].lower()} has {has}."
    lines = [line.strip() for line in plain.splitlines()]
    told = [line for line in lines if line and not line.startswith(dull)]
    first = next((line for line in told if "rror" in line or "nknown" in line or "No " in line), "")
    return f"{(first or (told or ['unknown'])[0]).rstrip('.')}. It may use numbers, math and NumPy only."


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
