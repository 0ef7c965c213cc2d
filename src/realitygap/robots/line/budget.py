"""What a step of 100 ms can carry at a baud rate, and the refusal of one that is too slow."""

from __future__ import annotations

from typing import NamedTuple

from realitygap.errors import BaudError, UsageError
from realitygap.robots.body import KINDS
from realitygap.robots.line.protocol import Dialect, Request

__all__ = ["STEP_MS", "Budget", "step_budget"]

STEP_MS = 100.0
"""Length of one step."""

_READS = {"proximity": Request("N"), "ambient": Request("O")}


class Budget(NamedTuple):
    """What is asked at each step, and the time that it and the speed command take at most, ms."""

    reads: tuple[Request, ...]
    ms: float


def step_budget(dialect: Dialect, kinds: tuple[str, ...], baud: int | None, *, turns: bool = True) -> Budget:
    """The commands of one step: the sensors, then (if `turns`) counters and measured speeds where they fit.

    Without sensors it is the counters alone: one question, which takes a body no further in its time.
    Times are the worst case: command and answer one after the other, every number at its longest.

    Raises:
        BaudError: sensors and speed command alone take longer than a step; shows the arithmetic.
        UsageError: an unknown kind, or none.
    """
    if not (kinds or turns) or not set(kinds) <= set(KINDS):
        raise UsageError(f"a robot's sensors are {' and '.join(KINDS)}; got {list(kinds)}")
    fastest = Request("D", (-dialect.top, -dialect.top))  # the longest of the commands that a network gives

    def ms(rate: int | None, *asked: Request) -> float:
        return dialect.wire_ms(dialect.characters(*asked, fastest), rate)

    read = [kind for kind in KINDS if kind in kinds]
    reads = tuple(_READS[kind] for kind in read)
    if ms(baud, *reads) > STEP_MS:
        count = dialect.characters(*reads, fastest)
        enough = next(rate for rate in dialect.rates if ms(rate, *reads) <= STEP_MS)
        one = ", or read one kind of sensors" if len(reads) > 1 and ms(baud, reads[0]) <= STEP_MS else ""
        raise BaudError(
            f"{baud} baud cannot carry a {STEP_MS:g} ms loop with {' and '.join(read)} readings: "
            f"{' + '.join(one.letter for one in reads)} + D are up to {count} characters of "
            f"{dialect.bits} bits, {count} × {dialect.bits} / {baud} s = {ms(baud, *reads):.0f} ms; "
            f"set the robot to {enough} baud or more{one}"
        )
    tells = (dialect.counters, *dialect.measured) if kinds else (dialect.counters,)
    for tell in map(Request, tells if turns else ()):
        if ms(baud, *reads, tell) <= STEP_MS:
            reads = (*reads, tell)
    return Budget(reads, ms(baud, *reads))
