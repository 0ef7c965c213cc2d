"""Known differences, to try a score on: one robot against itself with one thing made worse, by steps.

Infrared gain 1 → 0.15 makes a robot less responsive, and so does light gain where a controller waits for
a certain light; noise × 1 → × 8 makes it noisier. Controllers that only compare two sides do not heed a
light gain. Steering does for all light seekers what the gain does for these: of the turn that it means
to make, the robot makes 1 → 0.15.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from realitygap.correspondence.exemplars.kinds import KINDS, Ruled, kinds_of, live
from realitygap.correspondence.trials import Trial
from realitygap.kernels.rng import substream
from realitygap.simulation.simulation import Simulation
from realitygap.tasks.load import load_task
from realitygap.world.profile import Profile, load_profile

__all__ = [
    "COMPARERS", "GAINS", "NOISES", "Behaviour", "behaviours", "ladders_of", "with_gain", "with_steering",
]  # fmt: skip

GAINS = (1.0, 0.7, 0.5, 0.35, 0.25, 0.15)
NOISES = (1.0, 1.5, 2.0, 3.0, 4.5, 6.0, 8.0)
"""Factors on the observed noise."""
COMPARERS = ("two way turner", "bobber")
"""Light seekers that compare two sides: their gain is no ladder."""


@dataclass(frozen=True, kw_only=True)
class Behaviour:
    """One hand-written robot: a task, a kind and the seed of its numbers."""

    task: str
    kind: str
    seed: int = 0

    def trials(
        self, count: int = 12, *, noise: float = 1.0, gain: float = 1.0, steering: float = 1.0,
        again: int = 0, starts: int = 0,
    ) -> list[Trial]:  # fmt: skip
        """Its trials from `count` starts, always the same ones for one number `starts`.

        Args:
            count: how many starts.
            noise: the simulation's.
            gain: of the sensors.
            steering: share of a turn that the robot makes.
            again: another number, other noise.
            starts: another number, other starts.
        """
        task = load_task(self.task)
        profile = with_steering(with_gain(load_profile("paper"), gain), steering)
        simulation = Simulation(task, profile, noise)
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


def ladders_of(behaviour: Behaviour) -> tuple[str, ...]:
    """What a behaviour's ladders are made of: "noise", and "gain" and "steering" where it heeds them."""
    if behaviour.task == "obstacle-avoidance":
        return ("gain", "noise")
    return ("steering", "noise") if behaviour.kind in COMPARERS else ("gain", "steering", "noise")


def with_steering(profile: Profile, share: float) -> Profile:
    """The robot with a wider track, so that it makes a `share` of the turn that its wheels mean."""
    return replace(profile, wheels=replace(profile.wheels, track_cm=profile.wheels.track_cm / share))


def with_gain(profile: Profile, gain: float) -> Profile:
    """The robot with all infrared and light sensors' gains changed."""
    infrared, ambient = profile.infrared, profile.ambient
    near = tuple(replace(s, a=s.a * gain, b=s.b * gain) for s in infrared.sensors)
    lit = tuple(replace(s, gain=s.gain * gain) for s in ambient.sensors)
    return replace(profile, infrared=replace(infrared, sensors=near), ambient=replace(ambient, sensors=lit))
