"""Exemplars: hand-written controllers let loose in the simulation, of many sizes and speeds.

No two exemplars are the same robot: each has its own numbers, its own infrared and light gains and
its own wheels, so that what is learnt of them is the kind and not the unit.

A trial counts where the robot did, for half a second in all, each thing that its kind's definition names:
a two way turner that happens to meet everything at its left turns to the right only, and no judge could
tell it from a one way turner. That is asked of the controller's own commands, never of the track, and says
nothing of how a trial is named; it is the same for the exemplars that names are learnt from and for those
that they are tried on.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from realitygap.correspondence.exemplars.avoiders import AVOIDERS, Draw, Rule, turning
from realitygap.correspondence.exemplars.seekers import SEEKERS
from realitygap.correspondence.trials import Trial
from realitygap.kernels.rng import substream
from realitygap.simulation.body import SimulatedBody
from realitygap.simulation.simulation import Simulation
from realitygap.tasks.load import load_task
from realitygap.values import Command, Pose, Readings
from realitygap.world.profile import Profile, load_profile

__all__ = ["KINDS", "Behaviour", "Ruled", "exemplar", "kinds_of", "live", "shows"]

KINDS = {"obstacle-avoidance": AVOIDERS, "light-seeking": SEEKERS}
"""The paper's kinds of behaviour, by task (tables 1 and 2)."""
DRAWS = 50
"""An exemplar is drawn so often at most; one in three lacks its evidence where that is rarest."""
EVIDENCE_STEPS = 5
"""Half a second of commands."""

DONE: dict[str, Callable[[float, float], bool]] = {
    "forward": lambda left, right: left + right > 0,
    "back": lambda left, right: left + right < 0,
    "straight": lambda left, right: left == right > 0,
    "turn": lambda left, right: left != right,
    "left": lambda left, right: right > left,
    "right": lambda left, right: left > right,
}
"""What a step's commands do, by name."""
EVIDENCE: dict[str, dict[str, tuple[str, ...]]] = {
    "obstacle-avoidance": {
        "one way turner": ("straight", "turn"),
        "two way turner": ("straight", "left", "right"),
        "wall follower": ("forward", "turn"),
        "one way looper": ("turn",),
    },
    "light-seeking": {
        "three point turner": ("straight", "back", "forward"),
        "straight looper": ("straight", "turn"),
        "two way turner": ("forward", "left", "right"),
        "bobber": ("forward", "back"),
    },
}
"""By task and kind, what its definition names; a kind that is not here shows itself in any trial."""


def standing(draw: Draw) -> Rule:
    """Stands."""
    return lambda _: Command(left=0, right=0)


def spinning(draw: Draw) -> Rule:
    """Turns on the spot."""
    spin = int(draw.choice([-1, 1])) * int(draw.integers(1, 11))
    return lambda _: turning(int(draw.integers(-1, 2)), spin)


def random_walker(draw: Draw) -> Rule:
    """Wheels that change by chance, every step or every second or so."""
    lasts, pace = draw.uniform(1, 15), draw.uniform(0, 5)
    bias = draw.uniform(0, 4)
    now = Command(left=0, right=0)

    def rule(_: NDArray[np.float64]) -> Command:
        nonlocal now
        if draw.random() < 1 / lasts:
            turn = draw.uniform(-1, 1) * (3 + pace)
            now = turning(draw.uniform(-pace, pace) + bias, turn)
        return now

    return rule


def blind(draw: Draw) -> Rule:
    """Drives on until it meets a wall, and goes on pushing."""
    pace, bend = int(draw.integers(2, 11)) * int(draw.choice([-1, 1])), int(draw.integers(-1, 2))
    return lambda _: turning(pace, bend if abs(pace) > 5 else 0)


NOBODIES: dict[str, Callable[[Draw], Rule]] = {
    "standing": standing,
    "spinning": spinning,
    "random walker": random_walker,
    "blind": blind,
}
"""Exemplars of "none of these": robots that take no notice of anything, or do not move."""


class Ruled:
    """A rule as a controller that drives any body: readings in, wheel commands out.

    Args:
        feeds: "proximity" or "ambient".
        make: draws the rule; `seed` names the draw, so that every reset gives the same robot.

    Attributes:
        commands: what it said since its last reset.
    """

    def __init__(self, make: Callable[[Draw], Rule], seed: int, feeds: str) -> None:
        self._make, self._seed, self._feeds = make, seed, feeds
        self.reset()

    def reset(self) -> None:
        """Before a trial."""
        self._rule = self._make(np.random.default_rng(self._seed))
        self.commands: list[Command] = []

    def decide(self, readings: Readings) -> Command:
        """One step of 100 ms."""
        self.commands.append(
            self._rule(readings.proximity if self._feeds == "proximity" else readings.ambient)
        )
        return self.commands[-1]


def kinds_of(task: str) -> dict[str, Callable[[Draw], Rule]]:
    """What a task's exemplars are drawn from: the paper's kinds and the nobodies."""
    return {**KINDS[task], **NOBODIES}


def live(
    simulation: Simulation,
    controller: Ruled,
    *,
    stream: int,
    pose: Pose | None = None,
    seconds: float | None = None,
    start: str = "1",
) -> Trial:
    """A trial of a hand-written controller in the simulation."""
    body = SimulatedBody(simulation, stream=stream)
    body.reset(pose)
    controller.reset()
    steps = round((simulation.task.seconds if seconds is None else seconds) * 10)
    poses = [body.pose]
    begun = body.clock.now()
    for k in range(steps):
        body.act(controller.decide(body.sense()))
        body.clock.sleep_until(begun + (k + 1) * 0.1)
        poses.append(body.pose)
    return Trial(
        x=np.array([p.x for p in poses]), y=np.array([p.y for p in poses]),
        heading=np.unwrap([p.heading for p in poses]), start=start, source="simulation",
    )  # fmt: skip


def another_unit(profile: Profile, draw: Draw) -> Profile:
    """Another robot of the same make: each sensor's gain and each wheel a little its own.

    Infrared gains differ most, by cover and surface: a Khepera may feel a wall at a third of the
    distance at which another does.
    """
    gains = draw.uniform(0.9, 1.1, 32)
    gains[:16] *= np.exp(draw.uniform(np.log(0.15), np.log(1.4)))
    gains[16:] *= draw.uniform(0.75, 1.25)
    infrared, ambient, wheels = profile.infrared, profile.ambient, profile.wheels
    near = [replace(s, a=s.a * g, b=s.b * g) for s, g in zip(infrared.sensors, gains, strict=False)]
    lit = [replace(s, gain=s.gain * g**2) for s, g in zip(ambient.sensors, gains[16:], strict=False)]
    left, right = wheels.speed_per_unit_cm_s
    slip = draw.normal(1.0, 0.01, 2)
    return replace(
        profile,
        name=f"{profile.name}, another unit",
        infrared=replace(infrared, sensors=tuple(near)),
        ambient=replace(ambient, sensors=tuple(lit)),
        wheels=replace(wheels, speed_per_unit_cm_s=(left * slip[0], right * slip[1])),
    )


def exemplar(task: str, kind: str, seed: int, noise: float, *, marked: bool = True) -> Trial:
    """One exemplar's trial; everything about it follows from its seed.

    Args:
        marked: draw again, robot and start, until the trial contains its kind's evidence (`EVIDENCE`).
    """
    draw = np.random.default_rng([seed, len(kind), *kind.encode()])
    todo = load_task(task)
    for _ in range(DRAWS):
        simulation = Simulation(todo, another_unit(load_profile("paper"), draw), noise)
        controller = Ruled(kinds_of(task)[kind], int(draw.integers(2**31)), todo.feeds)
        trial = live(simulation, controller, stream=int(draw.integers(2**62)), start=str(seed))
        if not marked or shows(task, kind, controller.commands):
            return trial
    raise RuntimeError(
        f"no {kind} in {DRAWS} draws showed its evidence"
    )  # fails a maker's check, not a user's


@dataclass(frozen=True, kw_only=True)
class Behaviour:
    """One hand-written robot: a task, a kind and the seed of its numbers."""

    task: str
    kind: str
    seed: int = 0

    def trials(
        self, count: int = 12, *, profile: Profile | None = None, noise: float = 1.0, again: int = 0,
        starts: int = 0,
    ) -> list[Trial]:  # fmt: skip
        """Its trials from `count` starts, always the same ones for one number `starts`.

        Args:
            count: how many starts.
            profile: the robot, by default the paper's.
            noise: the simulation's.
            again: another number, other noise.
            starts: another number, other starts.
        """
        task = load_task(self.task)
        simulation = Simulation(task, profile or load_profile("paper"), noise)
        controller = Ruled(kinds_of(self.task)[self.kind], self.seed, task.feeds)
        noises = np.uint64(substream(np.uint64(again), self.seed))
        made = []
        for k in range(count):
            pose = simulation.start(int(substream(np.uint64(1000 + starts), k)))
            stream = int(substream(noises, k))
            made.append(live(simulation, controller, stream=stream, pose=pose, start=str(k + 1)))
        return made


def shows(task: str, kind: str, commands: Sequence[Command]) -> bool:
    """Whether a trial's commands hold all that makes its kind."""
    wheels = [(c.left, c.right) for c in commands]
    return all(
        sum(DONE[thing](*pair) for pair in wheels) >= EVIDENCE_STEPS for thing in EVIDENCE[task].get(kind, ())
    )
