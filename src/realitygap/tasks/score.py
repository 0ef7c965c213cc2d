"""A task's score: compiled, and tried before it is used."""

import inspect
import math
import random
import re
import traceback
from collections.abc import Callable
from copy import deepcopy
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from realitygap.errors import TaskError
from realitygap.kernels.types import Path, Room
from realitygap.world.arena import Arena

__all__ = ["CompiledScore", "Score", "example", "reason", "tried"]


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
        return self.around(_take)

    def around(self, loop: Callable[..., None]) -> Callable[..., None]:
        """A loop that calls `score`, compiled with this one."""
        from realitygap.compiled import compiled, naming

        made: Callable[..., None] = compiled(naming(loop, score=self.compiled), home=self.plain)
        return made

    def failure(self, error: Exception, path: Path, room: Room) -> TaskError:
        """What failed in the score; machine code knows no lines, so plain Python runs it again."""
        try:
            with np.errstate(all="ignore"):
                self.plain(Path(*map(np.copy, path)), room)
        except Exception as again:
            error = again
        file = inspect.getfile(self.plain)
        own = [at.lineno for at in traceback.extract_tb(error.__traceback__) if at.filename == file]
        where = f"{file}, line {own[-1]}" if own else _where(self.plain)
        told = f"{type(error).__name__}: {error}".rstrip(": ")
        there = f"{path.x.size} rows, the room {len(room.lamps)} lamps and {len(room.cylinders)} cylinders"
        cure = f"This path has {there}." if isinstance(error, IndexError) else "Correct that line."
        return TaskError(f"{where}: the score fails with {told}. {cure}")


def _take(paths: Any, room: Any, scores: Any) -> None:
    for t in range(scores.shape[0]):
        p = paths[t]
        scores[t] = score(Path(p[0], p[1], p[2], p[3], p[4], p[5]), room)  # type: ignore[name-defined]  # noqa: F821


def compile_score(score: Score) -> CompiledScore:
    """`score` compiled by Numba for (Path, Room), or as it is where the compiler is off.

    Raises:
        TaskError: it draws at random, prints, does not compile or returns no float; names file and line.
    """
    from realitygap.compiled import frozen

    try:
        told = frozen(score)  # numbers that it uses may have changed
    except (OSError, TypeError):  # a function without a file
        told = ()
    return _compiled(score, told)


@lru_cache(maxsize=64)
def _compiled(score: Score, told: tuple[str, ...]) -> CompiledScore:
    """The score with what it uses, `told`."""
    _refuse_unrepeatable(score, set())
    import numba

    from realitygap.compiled import compiled

    if numba.config.DISABLE_JIT:
        return CompiledScore(score, score)
    made = compiled(score, boundscheck=True)
    types = tuple(numba.typeof(value) for value in example())
    try:
        made.compile(types)
    except Exception as error:  # Numba's own errors, and those it lets through (a name NumPy lacks)
        raise TaskError(f"{_where(score, error)}: the score cannot be compiled: {reason(error)}") from None
    returned = made.overloads[types].signature.return_type
    if returned != numba.float64:
        raise TaskError(
            f"{_where(score)}: score: expected a function that returns a float, it returns {returned}. "
            "Return one number from every branch, as float(…)."
        )
    return CompiledScore(score, made)


def _refuse_unrepeatable(function: Any, seen: set[Any]) -> None:
    """A score is a function of path and room: nothing in it, or in what it calls, is drawn at random.

    Compiled functions that it calls check their indices too from then on.
    """
    from realitygap.compiled import used

    seen.add(function)
    for line, found, name in used(function):
        where = f"{inspect.getfile(function)}, line {line}"
        own = getattr(found, "__self__", None)
        drawn = isinstance(own, random.Random | np.random.RandomState | np.random.Generator)
        if drawn or found is random or found is np.random:
            cure = "The same path must give the same score; a trial's chance is in its noise."
            raise TaskError(f"{where}: a score draws nothing at random: remove `{name}`. {cure}")
        plain = getattr(found, "py_func", None)
        if plain is not None and plain not in seen:
            found.targetoptions.setdefault("boundscheck", True)
            _refuse_unrepeatable(plain, seen)


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
ALIKE = 1e-6
"""Sums may be taken in another order."""


def tried(score: Score, arena: Arena, steps: int) -> CompiledScore:
    """The compiled score, unless it fails on an example in its arena, or is another there as plain Python.

    Raises:
        TaskError: names the user's file and line.
    """
    made = compile_score(score)
    _try(made, arena, steps)
    return made


@lru_cache(maxsize=64)
def _try(made: CompiledScore, arena: Arena, steps: int) -> None:
    there, rows = arena.to_kernel(), min(steps, LONGEST)
    room = Room(
        lamps=there.lamp_centre, size=there.size, cylinders=there.cylinders, top_speed=8.0, radius=2.9
    )
    x, y, heading, left, right = np.random.default_rng(1995).uniform(-1.0, 1.0, (5, rows))
    path = Path(
        x=room.size[0] * abs(x), y=room.size[1] * abs(y), heading=9.0 * heading, left=16.0 * left,
        right=16.0 * right, contact=np.round(abs(x)),
    )  # fmt: skip
    found, where = [], _where(made.plain)
    for score in (made.plain, made.compiled):  # Ctrl-C stops a score without end in plain Python alone
        now = deepcopy((path, room))
        try:
            found.append(_value(score, *now))
        except LookupError as error:
            if rows < steps:  # perhaps there is such a row in a whole path
                return
            raise made.failure(error, path, room) from None
        except Exception as error:
            raise made.failure(error, path, room) from None
        for name, part, one, before in zip(("path", "room"), ("x", "lamps"), now, (path, room), strict=True):
            if not all(map(np.array_equal, one, before)):
                cure = f"Work on a copy, as in {name}.{part}.copy()."
                raise TaskError(f"{where}: the score changes the {name} that it is given. {cure}")
    plain, compiled = found
    if not math.isclose(plain, compiled, rel_tol=ALIKE, abs_tol=ALIKE) and np.isfinite(found).any():
        told = f"{where}: the score gives {compiled} compiled and {plain} as plain Python on the same path."
        raise TaskError(f"{told} Look for whole numbers beyond 64 bits, or names that change their value.")


def _value(score: Score, path: Path, room: Room) -> float:
    """What a score gives; a failed sum is as good as no number."""
    try:
        with np.errstate(all="ignore"):
            return float(score(path, room))
    except (ArithmeticError, ValueError):
        return math.nan
