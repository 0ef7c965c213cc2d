"""Names of robots on the twin: hand-written controllers of each kind, one trial of each on each of two units.

The seekers were written for the paper's light: its readings tell a lamp that is touched from one a metre off,
and its side sensors see what is ahead. The twin's do neither, so whoever wrote a seeker for the twin would
feel the lamp by infrared, and look ahead with the oblique sensors.
"""

from __future__ import annotations

import tempfile
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from studies.correspondence.kinds import KINDS, Ruled, shows
from studies.correspondence.ladders import setting_for
from studies.correspondence.naming import named

from realitygap.correspondence.names import namer
from realitygap.correspondence.trials import read_trials
from realitygap.robots.address import Address
from realitygap.robots.drive import drive
from realitygap.simulation.simulation import Simulation
from realitygap.tasks.load import load_task
from realitygap.values import Command, Readings
from realitygap.world.robot import load_profile

UNITS = (1, 2)
DRAWS = 20
"""Controller and start are drawn so often at most, until a trial shows its kind's evidence, as exemplars."""
TOUCHED = 500.0
"""Infrared counts of a wall or a lamp that is almost touched."""
GLARING, LIFTED = 50.0, 20.0
"""Ambient counts below and above what the seekers take for a lamp that is almost touched."""
NARROW = ("three point turner", "straight looper")
"""Kinds that look ahead with the side sensors."""


@dataclass
class ByReadings:
    """A hand-written controller that takes a step's readings as its inputs."""

    ruled: Ruled
    narrow: bool

    def reset(self) -> None:
        """Before a trial."""
        self.ruled.reset()

    def decide(self, inputs: list[int]) -> Command:
        """One step of 100 ms."""
        proximity, light = np.array(inputs, float).reshape(2, 8)
        light = np.where(proximity.max() > TOUCHED, GLARING, light + LIFTED)
        if self.narrow:
            light[[0, 5]] = light[[1, 4]]
        return self.ruled.decide(Readings(proximity=proximity, ambient=light))


def names_on_the_twin(task_name: str) -> pd.DataFrame:
    """What the kinds of a task are called on the twin: columns unit, kind, name, confidence."""
    task, setting = load_task(task_name), setting_for(task_name)
    simulation, names = Simulation(task, load_profile("paper")), namer(setting)
    made = []
    for unit in UNITS:
        with (
            tempfile.TemporaryDirectory() as folder,
            closing(Address.parse(f"twin:{unit}").open(kinds=("proximity", "ambient"))) as body,
        ):
            for k, (kind, make) in enumerate(KINDS[task_name].items()):
                for i in range(DRAWS):
                    states = Path(folder) / f"{k} {i}.csv"
                    ruled = Ruled(make, 500 + 100 * unit + 7 * k + i, task.feeds)
                    body.enter(task.arena.plain(), unit, None)
                    body.reset(simulation.start(10 * unit + i))
                    body.film(states)
                    drive(
                        body, ByReadings(ruled, kind in NARROW), seconds=20.0,
                        inputs=lambda r: [*map(int, r.proximity), *map(int, r.ambient)],
                    )  # fmt: skip
                    body.film(None)
                    if shows(task_name, kind, ruled.commands):
                        one = named([kind], names.name([read_trials(states)[0]], setting))
                        made.append(one.assign(unit=unit))
                        break
    return pd.concat(made, ignore_index=True)
