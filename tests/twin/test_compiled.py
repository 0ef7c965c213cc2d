"""The twin's compiled millisecond."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable

from realitygap.twin.body import TwinBody
from realitygap.twin.wheels import SETTLED_MS
from tests.twin.rooms import CROWDED
from tests.twin.slow_body import SlowBody


def rest(body: TwinBody) -> None:
    """Set down, and left standing until it rests."""
    body.set_speed(0, 0)
    body.place(60.0, 20.0, 1.0)
    body.advance(SETTLED_MS + 7)


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
    rest,
    lambda body: body.set_pwm(0, 0),
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
            asked = body.pulses(), body.speeds(), body.on_target()
            known.append((body.time_ms, *asked, body.proximity(), body.ambient(), body.truth()))
    states = body.states()
    return [*known, (states.time_ms.tobytes(), states.pose.tobytes())]


def test_compiled_as_plain() -> None:
    """The compiled loop lives as the plain one, to the last bit, whatever is asked of it."""
    for settings, part in (({"unit": 1, "seed": 5}, 61), ({"unit": 4, "noise": 2.0, "substeps": 2}, 17)):
        assert lived(TwinBody(CROWDED, **settings), part) == lived(SlowBody(CROWDED, **settings), part)  # type: ignore[arg-type]


def test_answers_are_whole_numbers() -> None:
    """What the protocol puts into its answers is Python's own integers."""
    body = TwinBody(CROWDED, unit=1)
    body.set_speed(5, 5)
    body.advance(30)
    for number in (*body.pulses(), *body.speeds()):
        assert type(number) is int


ONCE = """
import numpy as np
from realitygap.twin.body import TwinBody
body = TwinBody({"size_cm": [50, 50], "cylinders": [[10, 40, 3]], "lamps": [[50, 20]]}, unit=1, seed=3)
body.set_speed(9, -4)
body.advance(400)
print(body.pulses(), body.proximity(), body.ambient(), body.states().pose.tobytes().hex())
"""


def test_the_same_where_nothing_compiles() -> None:
    """With the compiler off the same loop runs in Python, with the same bits."""
    said = [
        subprocess.run(
            [sys.executable, "-c", ONCE],
            env={**os.environ, "NUMBA_DISABLE_JIT": off},
            capture_output=True,
            check=True,
        ).stdout
        for off in ("0", "1")
    ]
    assert said[0] == said[1] != b""
