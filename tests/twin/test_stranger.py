"""The stranger: what it has beside the twin, and that it is the twin without it."""

from __future__ import annotations

import numpy as np
import pytest

from realitygap.twin import stranger
from realitygap.twin.body import TwinBody
from realitygap.twin.stranger import StrangerBody
from tests.twin.rooms import ARENAS, CROWDED, OPEN

AVOIDANCE = ARENAS["obstacle-avoidance"]


def driven(body: TwinBody, steps: int = 12) -> list[object]:
    """What is read on a drive of some steps."""
    known: list[object] = []
    for k in range(steps):
        body.set_speed(8, 8 - 3 * (k % 3))
        body.advance(100)
        known += [body.proximity(), body.ambient(), body.pulses(), body.truth()]
    return known


@pytest.mark.parametrize("room", ARENAS)
def test_without_its_oddities_it_is_the_twin(monkeypatch: pytest.MonkeyPatch, room: str) -> None:
    """It reads and drives as the twin to the bit where nothing is odd, lamp or none, and otherwise not."""
    arena = ARENAS[room]
    nothing = {"REFLECTANCE_SPREAD": 0.0, "CYLINDER_REFLECTANCE": 1.0, "PLACED_M": 0.0, "LATEST_MS": 0,
               "SAG_PER_S": 0.0, "LAMP_INFRARED": 0.0, "CROSSTALK": 0.0, "CHARGE": (1.0, 1.0)}  # fmt: skip
    with monkeypatch.context() as quiet:
        for name, value in {**nothing, "LAMP_PARTS": 1, "LAMP_RADIUS": 0.0}.items():
            quiet.setattr(stranger, name, value)
        same, twin = StrangerBody(arena, unit=3, seed=4), TwinBody(arena, unit=3, seed=4)
        same._slip.ground[:] = twin._slip.ground
        assert driven(same) == driven(twin)
    assert driven(StrangerBody(arena, unit=3, seed=4)) != driven(TwinBody(arena, unit=3, seed=4))


def test_a_seed_makes_the_same_stranger() -> None:
    """Same unit, seed and calls: the same bits; another seed or unit: others."""
    first, again, seed, unit = (
        driven(StrangerBody(AVOIDANCE, unit=u, seed=s), 4) for u, s in ((1, 5), (1, 5), (1, 6), (2, 5))
    )
    assert first == again
    assert first != seed
    assert first != unit


def test_a_hand_places_it_to_a_millimetre() -> None:
    """Where it is put down differs from where it was meant to be by a millimetre, the heading by nothing."""
    body, off = StrangerBody(OPEN, unit=1, seed=3), []
    for _ in range(200):
        body.place(100.0, 90.0, 0.5)
        x, y, heading = body.truth()
        assert heading == pytest.approx(0.5)
        off += [x - 100.0, y - 90.0]
    assert 0.085 < np.std(off) < 0.115
    body.place(2.76, 50.0, 0.0)
    assert body.truth()[0] >= 2.74  # and never into a wall


def test_commands_take_effect_within_a_step() -> None:
    """A wheel begins to turn 0 to 100 ms after the command, in the order of the commands."""
    waits = []
    for seed in range(40):
        body = StrangerBody(OPEN, unit=1, seed=seed)
        body.set_speed(60, 60)
        waits.append(next(t for t in range(0, 200, 5) if body.advance(5) or max(body.pulses()) > 0))
    assert min(waits) < 30 < 80 < max(waits) <= 120
    body.set_speed(0, 0)
    body.set_speed(-20, -20)
    body.advance(600)
    assert max(body.speeds()) < 0


def test_neighbours_and_the_lamp_shine_into_a_sensor() -> None:
    """With crosstalk a sensor reads more beside one that sees a wall; a lamp adds to what is thrown back."""
    room = {**CROWDED, "size_cm": [80, 60]}
    body = StrangerBody(room, unit=2, noise=0.0, seed=1)
    body.place(76.2, 30.0, 0.0)
    bright = np.array(body.proximity())
    calm = StrangerBody({**room, "lamps": []}, unit=2, noise=0.0, seed=1)
    calm.place(76.2, 30.0, 0.0)
    dim = np.array(calm.proximity())
    assert (bright >= dim).all()
    assert bright.sum() > dim.sum()
    calm._sensors.crosstalk = 0.3
    assert (np.array(calm.proximity()) >= dim).all()
    assert np.array(calm.proximity()).sum() > dim.sum()
