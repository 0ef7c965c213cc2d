"""What a step of 100 ms can carry at a baud rate, and the refusal of one that is too slow."""

from __future__ import annotations

from typing import NamedTuple

from realitygap.errors import BaudError, UsageError
from realitygap.robots.body import KINDS
from realitygap.robots.khepera.protocol import BAUD_RATES, BITS_PER_CHARACTER, Request, characters, wire_ms

__all__ = ["STEP_MS", "Budget", "step_budget"]

STEP_MS = 100.0
"""Length of one step."""

_READS = {"proximity": Request("N"), "ambient": Request("O")}
_TELLS = (Request("H"), Request("E"))
_FASTEST = Request("D", (-10, -10))
"""The longest of the commands that a network gives."""


class Budget(NamedTuple):
    """What is asked at each step, and the time that it and the speed command take at most, ms."""

    reads: tuple[Request, ...]
    ms: float


def step_budget(kinds: tuple[str, ...], baud: int, *, turns: bool = True) -> Budget:
    """The commands of one step: the sensors, then (if `turns`) counters and measured speeds where they fit.

    Without sensors it is the counters alone: one question, which takes a body no further in its time.
    Times are the worst case: command and answer one after the other, every number at its longest.

    Raises:
        BaudError: sensors and speed command alone take longer than a step; shows the arithmetic.
        UsageError: an unknown kind, or none.
    """
    if not (kinds or turns) or not set(kinds) <= set(KINDS):
        raise UsageError(f"a robot's sensors are {' and '.join(KINDS)}; got {list(kinds)}")
    reads = tuple(_READS[kind] for kind in KINDS if kind in kinds)
    if _ms(reads, baud) > STEP_MS:
        raise BaudError(_refusal(reads, tuple(kind for kind in KINDS if kind in kinds), baud))
    for tell in _TELLS[: 2 if kinds else 1] if turns else ():
        if _ms((*reads, tell), baud) <= STEP_MS:
            reads = (*reads, tell)
    return Budget(reads, _ms(reads, baud))


def _ms(reads: tuple[Request, ...], baud: int) -> float:
    return wire_ms(sum(map(characters, (*reads, _FASTEST))), baud)


def _refusal(reads: tuple[Request, ...], kinds: tuple[str, ...], baud: int) -> str:
    count = sum(map(characters, (*reads, _FASTEST)))
    enough = next(rate for rate in BAUD_RATES if _ms(reads, rate) <= STEP_MS)
    one = ", or read one kind of sensors" if len(kinds) > 1 and _ms(reads[:1], baud) <= STEP_MS else ""
    return (
        f"{baud} baud cannot carry a {STEP_MS:g} ms loop with {' and '.join(kinds)} readings: "
        f"{' + '.join(read.letter for read in reads)} + D are up to {count} characters of "
        f"{BITS_PER_CHARACTER} bits, {count} × {BITS_PER_CHARACTER} / {baud} s = "
        f"{wire_ms(count, baud):.0f} ms; set the robot to {enough} baud or more{one}"
    )
