"""Twins without physics, and lines that lose things."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest

from realitygap.robots.clock import Clock, RealClock, VirtualClock
from realitygap.robots.khepera.body import Khepera
from realitygap.twin.process import TwinProcess, start_twin
from tests.robots.pump import Faults, Pump

ROOT = Path(__file__).parents[2]
BODY = "tests.robots.kinematic:KinematicBody"
ARENA = {"size_cm": [50.0, 50.0]}
STALL_S = 10.0
"""Lines are given up so late here: the computer may stand still for a second or two."""


class Bench:
    """Sets up twins, pumps and drivers, and takes them down."""

    def __init__(self, stack: ExitStack) -> None:
        self._stack = stack

    def twin(self, **settings: Any) -> TwinProcess:
        return self._stack.enter_context(start_twin(ARENA, **{"unit": 1, "body": BODY, **settings}))

    def pump(self, twin: TwinProcess, faults: Faults | None = None) -> Pump:
        return self._stack.enter_context(Pump(twin.device, faults or Faults()))

    def khepera(self, device: str, clock: Clock | None = None, **settings: Any) -> Khepera:
        clock = clock or RealClock()
        self._stack.callback(clock.close)
        khepera = Khepera.connect(device, clock=clock, **{"give_up_s": STALL_S, **settings})
        self._stack.callback(khepera.abandon)
        return khepera

    def virtual(self, **settings: Any) -> tuple[TwinProcess, Khepera]:
        twin = self.twin(**settings)
        return twin, self.khepera(twin.device, VirtualClock(twin.channel), baud=settings.get("baud", 38400))


@pytest.fixture
def bench(monkeypatch: pytest.MonkeyPatch) -> Iterator[Bench]:
    """Twins run in processes of their own, which must find the tests' bodies."""
    paths = [str(ROOT), str(ROOT / "src"), os.environ.get("PYTHONPATH", "")]
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(filter(None, paths)))
    with ExitStack() as stack:
        yield Bench(stack)
