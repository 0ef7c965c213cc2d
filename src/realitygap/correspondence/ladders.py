"""Known differences, to try a score on: one robot against itself with one thing made worse, by steps.

Infrared gain (or, for light seekers, light gain) 1 → 0.15 makes a robot less responsive; noise × 1 →
× 8 makes it noisier.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from realitygap.correspondence.exemplars import KINDS, Ruled, kinds_of, live
from realitygap.correspondence.trials import Trial
from realitygap.kernels.rng import substream
from realitygap.tasks.load import load_task
from realitygap.tasks.simulation import Simulation
from realitygap.world.profile import Profile, load_profile

__all__ = ["GAINS", "NOISES", "Behaviour", "behaviours", "with_gain"]

GAINS = (1.0, 0.7, 0.5, 0.35, 0.25, 0.15)
NOISES = (1.0, 1.5, 2.0, 3.0, 4.5, 6.0, 8.0)
"""Factors on the observed noise."""


@dataclass(frozen=True, kw_only=True)
class Behaviour:
    """One hand-written robot: a task, a kind and the seed of its numbers."""

    task: str
    kind: str
    seed: int = 0

    def trials(
        self, count: int = 12, *, noise: float = 1.0, gain: float = 1.0, again: int = 0, starts: int = 0
    ) -> list[Trial]:
        """Its trials from `count` starts, always the same ones for one number `starts`.

        Args:
            count: how many starts.
            noise: the simulation's.
            gain: of what the task feeds.
            again: another number, other noise.
            starts: another number, other starts.
        """
        task = load_task(self.task)
        simulation = Simulation(task, with_gain(load_profile("paper"), gain), noise)
        controller = Ruled(kinds_of(self.task)[self.kind], self.seed, task.feeds)
        made = []
        for k in range(count):
            here = int(substream(np.uint64(1000 + starts), k))
            pose = simulation.start(here)
            stream = int(substream(np.uint64(substream(np.uint64(again), self.seed)), k))
            made.append(live(simulation, controller, stream=stream, pose=pose, start=str(k + 1)))
        return made


def behaviours(seed: int = 0) -> list[Behaviour]:
    """One robot of each of the paper's kinds, by task."""
    return [Behaviour(task=task, kind=kind, seed=seed) for task, kinds in KINDS.items() for kind in kinds]


def with_gain(profile: Profile, gain: float) -> Profile:
    """The robot with all infrared and light sensors' gains changed."""
    infrared, ambient = profile.infrared, profile.ambient
    near = tuple(replace(s, a=s.a * gain, b=s.b * gain) for s in infrared.sensors)
    lit = tuple(replace(s, gain=s.gain * gain) for s in ambient.sensors)
    return replace(
        profile,
        infrared=replace(infrared, sensors=near),
        ambient=replace(ambient, sensors=lit),
    )
