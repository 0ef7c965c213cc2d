"""The twin's physics: what a wheeled robot on a table does."""

from __future__ import annotations

import math
import os
import subprocess
import sys

import numpy as np
import pytest

from realitygap.errors import ConfigError
from realitygap.twin import body as physics
from realitygap.twin.body import SETTLED_MS, TwinBody
from tests.twin.rooms import ARENAS, CROWDED, OPEN

PULSES_PER_CM = 120


def tilt_deg(body: TwinBody) -> float:
    """How far the body leans."""
    q = body._qpos[3:7]
    return math.degrees(math.acos(min(1.0, 1 - 2 * (q[1] ** 2 + q[2] ** 2))))


def test_rests_until_it_is_told_to_move() -> None:
    """A robot that was set down rests once it has settled, to the last bit; its sensors' noise goes on; told
    to drive, it drives as one that never rested; pushed, or told to stand after a drive, it does not rest."""
    body = TwinBody(OPEN, unit=3)
    body.place(100, 100, 0.5)
    body.advance(SETTLED_MS - 1)
    settling = body.truth()
    body.advance(1)
    rests = body.truth()
    readings = []
    for _ in range(20):
        body.advance(100)
        readings.append(body.proximity())
    assert settling != rests
    assert body.truth() == rests
    assert len(set(map(tuple, readings))) == len(readings)
    drives = TwinBody(OPEN, unit=3)
    drives.place(100, 100, 0.5)
    for one in (body, drives):
        begins = one.pulses()
        one.set_speed(5, 5)
        one.advance(2000)
        assert one.pulses() == pytest.approx([begins[side] + 1000 for side in range(2)], abs=20)
        one.set_speed(0, 0)
        one.advance(1000)
    assert math.dist(body.truth()[:2], drives.truth()[:2]) < 0.1
    stopped = body.truth()
    body.advance(1000)
    assert body.truth() != stopped
    body.place(100, 100, 0.5)
    body.set_pwm(0, 0)
    body.advance(1000)
    wanders = body.truth()
    body.advance(1000)
    assert body.truth() != wanders


@pytest.mark.parametrize("speed", [-10, -3, 1, 5, 10])
def test_drives_straight(speed: int) -> None:
    """Without noise a robot drives as far as its pulses say, straight but for its unequal wheels."""
    body = TwinBody(OPEN, unit=3, noise=0.0)
    body.place(100, 100, 0.5)
    body.set_speed(speed, speed)
    body.advance(3000)
    x, y, heading = body.truth()
    way = math.hypot(x - 100, y - 100)
    assert body.pulses() == pytest.approx((speed * 300, speed * 300), abs=3 + abs(speed) * 10)
    assert way == pytest.approx(abs(sum(body.pulses())) / 2 / PULSES_PER_CM, rel=0.015, abs=0.02)
    assert abs(heading - 0.5) < math.radians(15) * way / 100 + 0.005
    assert body.speeds() == pytest.approx((speed, speed), abs=1)


def test_turns_in_place() -> None:
    """Wheels turning against each other turn the robot and leave its centre where it was."""
    body = TwinBody(OPEN, unit=2, noise=0.0)
    body.place(100, 100, 0.0)
    body.set_speed(-3, 3)
    body.advance(2000)
    x, y, heading = body.truth()
    left, right = body.pulses()
    assert math.hypot(x - 100, y - 100) < 0.1
    assert heading == pytest.approx((right - left) / PULSES_PER_CM / 5.3, rel=0.02)


def deepest_cm(speed: int, heading: float, unit: int = 1, run_up_cm: float = 0.0) -> float:
    """How far a robot goes into a cylinder straight ahead, or aslant (`heading`) into a wall."""
    room = {"size_cm": [60, 60], "cylinders": [[30, 30, 4]]} if heading == 0.0 else OPEN
    body = TwinBody(room, unit=unit)
    start = (22.5, 30) if heading == 0.0 else (197 - 1.5 * math.cos(heading), 100)
    body.place(start[0] - run_up_cm, start[1], heading)
    body.set_speed(speed, speed)
    worst = math.inf
    for _ in range(2500 if speed < 15 else 1000):
        body.advance(1)
        x, y, _ = body.truth()
        gap = math.hypot(x - 30, y - 30) - 4 - 2.75 if heading == 0.0 else 200 - x - 2.75
        worst = min(worst, gap)
        assert tilt_deg(body) < 2.0, "it climbs"
    return -worst


TOO_DEEP_CM = 0.035
"""Half as much again as the deepest (0.023 cm) of 72 meetings of six units at 40 and 192 mm/s."""


@pytest.mark.parametrize("speed", [1, 5, 15, 24])
@pytest.mark.parametrize("heading", [0.0, 0.7])
def test_collides_without_sinking_in(speed: int, heading: float) -> None:
    """From 8 to 200 mm/s a robot touches what it meets and goes no third of a millimetre into it."""
    assert 0.0 < deepest_cm(speed, heading) < TOO_DEEP_CM


def test_a_softer_contact_is_found_out(monkeypatch: pytest.MonkeyPatch) -> None:
    """The deepest of four meetings passes; with walls and bodies that give way too easily it does not."""
    meetings = [(0.0, 2, 0.3), (0.0, 4, 0.3), (0.7, 1, 0.0), (0.7, 3, 0.3)]
    deepest = [deepest_cm(24, *meeting) for meeting in meetings]
    monkeypatch.setattr(physics, "CONTACT", physics.CONTACT.replace('solref="0.002', 'solref="0.008'))
    softer = [deepest_cm(24, *meeting) for meeting in meetings]
    assert max(deepest) < TOO_DEEP_CM < max(softer)


@pytest.mark.parametrize("noise", [0.0, 1.0])
def test_half_the_step_same_behaviour(noise: float) -> None:
    """Physics at half the time step ends at the same place, noise and a brush with a wall included."""
    ends = []
    for substeps in (1, 2):
        body = TwinBody(OPEN, unit=5, noise=noise, seed=2, substeps=substeps)
        body.place(170, 150, 0.6)
        for left, right in [(6, 6), (8, 3), (-5, 5), (6, 7)] * 2:
            body.set_speed(left, right)
            body.advance(700)
        ends.append(body.truth())
    assert math.hypot(ends[0][0] - ends[1][0], ends[0][1] - ends[1][1]) < 0.15
    assert abs(ends[0][2] - ends[1][2]) < 0.03


def test_same_calls_same_bits() -> None:
    """Same unit, seed, arena and calls: the same bits. Another seed or unit: another path."""

    def live(unit: int, seed: int, read: bool) -> tuple[object, ...]:
        body = TwinBody(CROWDED, unit=unit, seed=seed)
        body.set_speed(7, 5)
        for _ in range(10):
            body.advance(100)
            if read:
                body.proximity(), body.ambient()
        return body.truth(), body.proximity(), body.ambient(), body.pulses()

    first = live(1, 4, True)
    assert live(1, 4, True) == first
    assert live(1, 4, False) == first, "asking the sensors changes nothing"
    assert live(1, 5, True) != first
    assert live(2, 4, True) != first


def test_hand_puts_it_down() -> None:
    """A hand places the robot at rest and leaves its counters; no hand puts it into a cylinder."""
    body = TwinBody(CROWDED, unit=0)
    body.set_speed(5, 5)
    body.advance(200)
    pulses = body.pulses()
    body.set_speed(0, 0)
    body.place(70, 50, -2.0)
    assert body.truth() == pytest.approx((70, 50, -2.0))
    assert body.pulses() == pulses
    body.advance(300)
    assert body.truth()[:2] == pytest.approx((70, 50), abs=0.1)
    for x, y in [(20, 20), (1, 30), (-5, 20), (42.5, 22.5)]:
        with pytest.raises(ConfigError, match="does not fit"):
            body.place(x, y, 0.0)


def test_stays_in_its_room_whatever_it_is_told() -> None:
    """Full speed, full voltage and sudden turns among obstacles never put it through or on top of one."""
    body = TwinBody(CROWDED, unit=4, noise=2.0)
    generator = np.random.default_rng(1)
    for _ in range(60):
        left, right = (int(v) for v in generator.integers(-127, 128, 2))
        (body.set_pwm if generator.random() < 0.3 else body.set_speed)(left, right)
        body.advance(250)
        x, y, _ = body.truth()
        assert 2.6 < x < 77.4 and 2.6 < y < 57.4
        assert all(math.hypot(x - cx, y - cy) > r + 2.6 for cx, cy, r in CROWDED["cylinders"])
        assert tilt_deg(body) < 20


@pytest.mark.parametrize(("unit", "seed", "speeds"), [(1, 2, (4, 5)), (4, 0, (5, 5))])
def test_pressing_on_a_cylinder_throws_nobody(unit: int, seed: int, speeds: tuple[int, int]) -> None:
    """With a cylinder for the robot's body MuJoCo threw it here, after 7.0 and 2.2 s."""
    body = TwinBody(ARENAS["obstacle-avoidance"], unit=unit, seed=seed)
    body.place(25, 25, 0.5)
    body.set_speed(*speeds)
    last = body.truth()
    for _ in range(80):
        body.advance(100)
        now = body.truth()
        assert math.dist(now[:2], last[:2]) < 1.0
        last = now


ONCE = """
from realitygap.twin.body import TwinBody
body = TwinBody({"size_cm": [50, 50], "cylinders": [[10, 40, 3]], "lamps": [[50, 20]]}, unit=1, seed=3)
body.set_speed(9, -4)
body.advance(400)
print(*body.pulses(), *body.proximity(), *body.ambient())
"""


def test_the_same_where_nothing_compiles() -> None:
    """With the compiler off the same control and sensors run in Python; what is read are whole numbers."""
    said = [
        subprocess.run(
            [sys.executable, "-c", ONCE],
            env={**os.environ, "NUMBA_DISABLE_JIT": off},
            capture_output=True,
            check=True,
        ).stdout
        for off in ("0", "1")
    ]
    one, two = (np.array([int(word) for word in words.split()]) for words in said)
    assert np.abs(one - two).max() <= 1
