"""Names of robots on the twin: hand-written controllers through the serial line, in virtual time."""

from contextlib import ExitStack
from dataclasses import dataclass

import numpy as np
import pytest

from realitygap.correspondence.names import namer
from realitygap.correspondence.reading import read_trials
from realitygap.robots.clock import VirtualClock
from realitygap.robots.khepera.body import Khepera, KheperaBody
from realitygap.robots.loop import drive
from realitygap.simulation.simulation import Simulation
from realitygap.tasks.load import load_task
from realitygap.twin.process import start_twin
from realitygap.values import Readings
from realitygap.world.profile import load_profile
from tests.correspondence.ladders import setting_for
from tests.exemplars.kinds import KINDS, Ruled, shows

UNITS = (1, 2)
DRAWS = 20
TOUCHED = 500.0
"""Infrared counts of a wall or a lamp that is almost touched."""
GLARING, LIFTED = 50.0, 20.0
"""Ambient counts below and above what the seekers take for a lamp that is almost touched."""


@dataclass
class ByReadings:
    """A hand-written controller that takes a step's readings as its inputs.

    The seekers were written for the paper's light: its readings tell a lamp that is touched from one a
    metre off, and its side sensors see what is ahead. The twin's do neither, so a person who wrote a
    seeker for the twin would feel the lamp by infrared, and look ahead with the oblique sensors.
    """

    ruled: Ruled
    narrow: bool

    def reset(self):
        self.ruled.reset()

    def decide(self, inputs):
        proximity, light = np.array(inputs, float).reshape(2, 8)
        light = np.where(proximity.max() > TOUCHED, GLARING, light + LIFTED)
        if self.narrow:
            light[[0, 5]] = light[[1, 4]]
        return self.ruled.decide(Readings(proximity=proximity, ambient=light))


def films(task, kinds, unit, folder):
    """A film of each kind of controller on one twin unit; the sealed states are the tracks.

    As with the exemplars, controller and start are drawn again where a trial did not show its kind's
    mark: a two way turner that turned one way only, a looper that never saw the lamp.
    """
    arena = task.arena
    room = {
        "size_cm": list(arena.size_cm),
        "cylinders": [[c.x_cm, c.y_cm, c.radius_cm] for c in arena.cylinders],
        "lamps": [[lamp.x_cm, lamp.y_cm] for lamp in arena.lamps],
    }
    simulation = Simulation(task, load_profile("paper"))
    made = {}
    with ExitStack() as stack:
        twin = stack.enter_context(start_twin(room, unit=unit, seed=unit))
        clock = VirtualClock(twin.channel)
        stack.callback(clock.close)
        khepera = stack.enter_context(Khepera.connect(twin.device, clock=clock))
        body = KheperaBody(khepera, kinds=("proximity", "ambient"), carry=twin.place)
        for k, (kind, make) in enumerate(kinds.items()):
            for i in range(DRAWS):
                body.reset(simulation.start(10 * unit + i))
                path = folder / f"{kind} {unit} {i}.csv"
                ruled = Ruled(make, 500 + 100 * unit + 7 * k + i, task.feeds)
                controller = ByReadings(ruled, kind in ("three point turner", "straight looper"))
                clock.settle()
                twin.film(path)
                drive(
                    body, controller, seconds=20.0, clock=clock,
                    inputs=lambda r: [*map(int, r.proximity), *map(int, r.ambient)],
                )  # fmt: skip
                clock.settle()
                twin.film(None)
                if shows(task.name, kind, ruled.commands):
                    made[kind] = read_trials(path)[0]
                    break
    return made


@pytest.mark.parametrize("name", KINDS)
def test_twin_tracks_get_their_names(name, tmp_path):
    """Robots of the twin's physics, two units, are named by the simulation's exemplars: 7 of 8 or more."""
    made = [film for unit in UNITS for film in films(load_task(name), KINDS[name], unit, tmp_path).items()]
    setting = setting_for(name)
    named = namer(setting).name([trial for _, trial in made], setting)
    wrong = [(kind, found) for (kind, _), found in zip(made, named, strict=True) if kind != found.name]
    assert len(made) == 8 and len(wrong) <= 1, wrong
