"""The contract of a body, on a serial line: to a twin's time and to real time."""

from __future__ import annotations

from contextlib import AbstractContextManager, nullcontext

import pytest

from realitygap.robots.body import Body, Clock
from realitygap.robots.khepera import KheperaBody
from realitygap.testing import BodyContract
from tests.robots.conftest import Bench


class TestVirtualSerialBody(BodyContract):
    """A body on the line of a twin in this process."""

    pulses_per_unit = 100.0
    bench: Bench

    @pytest.fixture(autouse=True)
    def _at_the_bench(self, bench: Bench) -> None:
        self.bench = bench

    def opened(self) -> AbstractContextManager[tuple[Body, Clock]]:
        firmware, khepera = self.bench.virtual()
        body = KheperaBody(khepera, kinds=("proximity", "ambient"), carry=firmware.place)
        return nullcontext((body, khepera.clock))


class TestRealSerialBody(TestVirtualSerialBody):
    """The same in real time."""

    def opened(self) -> AbstractContextManager[tuple[Body, Clock]]:
        twin = self.bench.twin()
        khepera = self.bench.khepera(twin.device)
        return nullcontext((KheperaBody(khepera, carry=twin.place), khepera.clock))
