"""The compiled loop of a twin that drives many trials."""

from __future__ import annotations

from collections.abc import Callable

import numba
import pytest

from realitygap.twin.body import TwinBody
from realitygap.twin.compiled import CompiledBody, body_for_many
from tests.twin.rooms import CROWDED

compiler = pytest.mark.skipif(bool(numba.config.DISABLE_JIT), reason="the compiler is off")

ORDERS: tuple[Callable[[TwinBody], None], ...] = (
    lambda body: body.set_speed(12, 9),
    lambda body: body.set_speed_gains(2000, 900, 40),
    lambda body: body.set_position(-200, 350),
    lambda body: body.set_profile(15, 40, 30, 200),
    lambda body: body.set_position_gains(2500, 30, 3000),
    lambda body: body.set_position(400, 100),
    lambda body: body.set_pulses(7, -7),
    lambda body: body.set_pwm(90, -40),
    lambda body: body.place(30.0, 45.0, 2.0),
    lambda body: body.set_speed(-127, -100),
    lambda body: body.set_speed(3, 2),
)
"""All that changes what the wheels do."""

Numbers = list[tuple[object, ...]]


def lived(body: TwinBody, milliseconds: int) -> Numbers:
    """All that can be known of a body after each of the orders."""
    known: Numbers = []
    for order in ORDERS:
        order(body)
        for part in (1, milliseconds, 3):
            body.advance(part)
            asked = body.pulses(), body.speeds(), body.errors(), body.on_target()
            known.append((body.time_ms, *asked, body.proximity(), body.ambient(), body.truth()))
    states = body.states()
    return [*known, (states.time_ms.tobytes(), states.pose.tobytes())]


@compiler
def test_compiled_as_plain() -> None:
    """The compiled loop lives as the plain one, to the last bit, whatever is asked of it."""
    for settings, part in (({"unit": 1, "seed": 5}, 61), ({"unit": 4, "noise": 2.0, "substeps": 2}, 17)):
        compiled = body_for_many(CROWDED, **settings)
        assert isinstance(compiled, CompiledBody)
        assert lived(compiled, part) == lived(TwinBody(CROWDED, **settings), part)  # type: ignore[arg-type]


@compiler
def test_answers_are_whole_numbers() -> None:
    """What the protocol puts into its answers is Python's own integers in both bodies."""
    body = body_for_many(CROWDED, unit=1)
    body.set_speed(5, 5)
    body.advance(30)
    for number in (*body.pulses(), *body.speeds(), *body.errors()):
        assert type(number) is int


def test_plain_where_nothing_compiles(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where nothing can be compiled the plain body serves."""
    monkeypatch.setattr("numba.config.DISABLE_JIT", 1)
    assert type(body_for_many(CROWDED, unit=1)) is TwinBody
