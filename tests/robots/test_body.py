"""The contract of a body, on a serial line: to a twin's time and to real time."""

from __future__ import annotations

import pytest

from realitygap.robots.body import Body, SerialBody
from realitygap.robots.clock import Clock
from tests.robots.conftest import Bench
from tests.robots.contract import BodyContract


class TestVirtualSerialBody(BodyContract):
    """A body on a pseudo-terminal, under the virtual clock."""

    @pytest.fixture
    def body(self, bench: Bench) -> Body:
        twin, khepera = bench.virtual()
        return SerialBody(khepera, kinds=("proximity", "ambient"), carry=twin.place)

    @pytest.fixture
    def clock(self, body: SerialBody) -> Clock:
        return body.khepera.clock


class TestRealSerialBody(TestVirtualSerialBody):
    """The same in real time."""

    @pytest.fixture
    def body(self, bench: Bench) -> Body:
        twin = bench.twin(clock="real")
        return SerialBody(bench.khepera(twin.device), carry=twin.place)
