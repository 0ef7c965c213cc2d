"""Twins without physics, in process and served, and lines that lose things."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack
from typing import Any

import pytest

from realitygap.robots.khepera import KheperaBody
from realitygap.robots.twin import TwinLine
from realitygap.twin.firmware import Firmware
from tests.robots.kinematic import KinematicBody
from tests.robots.pump import Faults, Pump
from tests.served import ROOT, Served

__all__ = ["ARENA", "BODY", "ROOT", "STALL_S", "Bench", "bench"]

BODY = "tests.robots.kinematic:KinematicBody"
ARENA = {"size_cm": [50.0, 50.0]}
STALL_S = 10.0
"""Lines are given up so late here: the computer may stand still for a second or two."""


class Bench:
    """Sets up twins, pumps and drivers, and takes them down."""

    def __init__(self, stack: ExitStack) -> None:
        self._stack = stack

    def twin(self, **settings: Any) -> Served:
        """In real time, in a process of its own."""
        return self._stack.enter_context(Served(ARENA, **{"unit": 1, "body": BODY, **settings}))

    def pump(self, twin: Served, faults: Faults | None = None) -> Pump:
        return self._stack.enter_context(Pump(twin.device, faults or Faults()))

    def khepera(self, device: str, **settings: Any) -> KheperaBody:
        khepera = KheperaBody.connect(device, **{"give_up_s": STALL_S, **settings})
        self._stack.callback(khepera.abandon)
        return khepera

    def virtual(
        self, *, noise: float = 1.0, seed: int = 0, baud: int = 38400, **settings: Any
    ) -> KheperaBody:
        """In this process, in time of its own."""
        firmware = Firmware(
            KinematicBody(ARENA, unit=1, noise=noise, seed=seed), baud=baud, name="twin unit 1"
        )
        return KheperaBody(TwinLine(firmware), carry=firmware.place, **settings)


@pytest.fixture
def bench() -> Iterator[Bench]:
    with ExitStack() as stack:
        yield Bench(stack)
