"""Controllers for tests of the loop."""

from __future__ import annotations

from collections.abc import Sequence

from realitygap.values import Command, Readings


class Constant:
    """The same command at each step; fails at step `fails_at`."""

    def __init__(self, left: int = 5, right: int = 4, fails_at: int = -1) -> None:
        self.command = Command(left=left, right=right)
        self.fails_at = fails_at
        self.steps = 0

    def reset(self) -> None:
        self.steps = 0

    def decide(self, inputs: Sequence[int]) -> Command:
        if self.steps == self.fails_at:
            raise RuntimeError("the controller broke")
        self.steps += 1
        return self.command


class Wary(Constant):
    """Turns as its inputs say: so that noise in the readings shows in the path."""

    def decide(self, inputs: Sequence[int]) -> Command:
        return Command(left=max(-10, min(10, 5 + sum(inputs[:4]) % 3)), right=5)


def bands(readings: Readings) -> list[int]:
    """Readings as inputs −10..10."""
    counts = [*readings.proximity, *readings.ambient]
    return [max(-10, min(10, int(value / 51.15) - 10)) for value in counts]
