"""Exemplars: hand-written controllers let loose in the simulation, of many sizes and speeds.

No two exemplars are the same robot: each has its own numbers, its own infrared and light gains, its own
wheels, size, speed and start, and often another room, so that what is learnt of them is the kind and not the
robot.

A trial counts where the robot did, for half a second in all, each thing that its kind's definition names:
a two way turner that happens to meet everything at its left turns to the right only, and no judge could
tell it from a one way turner. That is asked of the controller's own commands, never of the track, and says
nothing of how a trial is named; it is the same for the exemplars that names are learnt from and for those
that they are tried on.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np
from studies.correspondence.avoiders import AVOIDERS, Draw, Rule
from studies.correspondence.seekers import SEEKERS
from studies.correspondence.wide import FAMILIES

from realitygap.correspondence.names import LARGE, tells
from realitygap.correspondence.trials import Trial
from realitygap.errors import TaskError
from realitygap.kernels.rng import substream
from realitygap.simulation.body import SimulatedBody
from realitygap.simulation.simulation import Simulation
from realitygap.tasks.load import load_task
from realitygap.tasks.task import Start, Task
from realitygap.values import Command, Pose, Readings
from realitygap.world.arena import Arena, load_arena
from realitygap.world.robot import Profile, load_profile

KINDS = {"obstacle-avoidance": AVOIDERS, "light-seeking": SEEKERS}
"""The paper's kinds of behaviour, by task (tables 1 and 2)."""
LARGE_ARENA = "obstacle-avoidance-large"
LASTS_S = 20.0, 60.0
"""How long a large robot is watched: in its room it meets less in a minute than a small one in 20 s."""
DRAWS = 300
"""An exemplar is drawn so often at most: some begin where something stands, some lack their evidence."""
EVIDENCE_STEPS = 5
"""Half a second of commands."""

DONE: dict[str, Callable[[float, float], bool]] = {
    "forward": lambda left, right: left + right > 0,
    "back": lambda left, right: left + right < 0,
    "straight": lambda left, right: 8 * abs(left - right) <= left + right > 0,
    "turn": lambda left, right: left != right,
    "left": lambda left, right: right > left,
    "right": lambda left, right: left > right,
    "hard left": lambda left, right: right - left > 2,
    "hard right": lambda left, right: left - right > 2,
}
"""What a step's commands do, by name; a smooth avoider is never quite straight, and always turns a little."""
EVIDENCE: dict[str, dict[str, tuple[str, ...]]] = {
    "obstacle-avoidance": {
        "one way turner": ("straight", "turn"),
        "two way turner": ("straight", "hard left", "hard right"),
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
        fed = readings.proximity if self._feeds == "proximity" else readings.ambient
        self.commands.append(self._rule(fed[AS_EIGHT[len(fed)]]))
        return self.commands[-1]


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
        body.put_out(controller.decide(body.sense()))
        body.clock.sleep_until(begun + (k + 1) * 0.1)
        poses.append(body.pose)
    return Trial(
        x=np.array([p.x for p in poses]), y=np.array([p.y for p in poses]),
        heading=np.unwrap([p.heading for p in poses]), start=start, source="simulation",
    )  # fmt: skip


def _another_robot(profile: Profile, draw: Draw) -> Profile:
    """A robot of other size and speed, each sensor's place and gain and each wheel a little its own.

    Infrared gains differ most, by cover and surface: a Khepera may feel a wall at a third of the
    distance at which another does.
    """
    gains = draw.uniform(0.9, 1.1, 32)
    gains[:16] *= np.exp(draw.uniform(np.log(0.15), np.log(1.4)))
    gains[16:] *= draw.uniform(0.75, 1.25)
    infrared, ambient, wheels = profile.infrared, profile.ambient, profile.wheels
    size, turned = draw.uniform(0.9, 1.4), draw.normal(0.0, 4.0, len(infrared.sensors))
    near = [
        replace(
            s, x_cm=s.x_cm * size, y_cm=s.y_cm * size, direction_deg=s.direction_deg + t, a=s.a * g, b=s.b * g
        )
        for s, g, t in zip(infrared.sensors, gains, turned, strict=False)
    ]
    lit = [replace(s, gain=s.gain * g**2) for s, g in zip(ambient.sensors, gains[16:], strict=False)]
    left, right = draw.uniform(0.7, 1.7) * draw.normal(1.0, 0.01, 2) * wheels.speed_per_unit_cm_s
    track = wheels.track_cm * size * draw.uniform(0.9, 1.05)
    return replace(
        profile,
        name=f"{profile.name}, another robot",
        body=replace(profile.body, radius_cm=profile.body.radius_cm * size),
        infrared=replace(infrared, sensors=tuple(near)),
        ambient=replace(ambient, sensors=tuple(lit)),
        wheels=replace(wheels, track_cm=track, speed_per_unit_cm_s=(float(left), float(right))),
    )


AS_EIGHT = {7: [0, 1, 2, 2, 3, 4, 6, 5], 8: [*range(8)]}
"""Which of a robot's sensors stand for a Khepera's eight, by how many it has: of five ahead and two behind
the middle one stands for both that look straight on."""


def _large_robot(paper: Profile, draw: Draw) -> Profile:
    """A robot of two to three times the size, which sees so much farther: a disk with a Khepera's sensors, or
    as a Thymio an angular body with its axle behind the middle, and nothing that looks to the side."""
    if draw.random() < 0.3:
        shape, size = paper, draw.uniform(1.9, 3.2)
        body = replace(paper.body, radius_cm=paper.body.radius_cm * size)
    else:
        shape, size = load_profile("thymio"), draw.uniform(0.75, 1.15)
        outline = tuple((float(x * size), float(y * size)) for x, y in shape.body.outline_cm)
        body = replace(shape.body, radius_cm=shape.body.radius_cm * size, outline_cm=outline)
    farther, law = draw.uniform(1.3, 4.0), paper.infrared
    gains = np.exp(draw.uniform(np.log(0.7), np.log(1.4), 8))
    turned = draw.normal(0.0, 4.0, 8)
    sensors = tuple(
        replace(
            law.sensors[0], x_cm=s.x_cm * size, y_cm=s.y_cm * size, direction_deg=s.direction_deg + by,
            a=law.sensors[0].a * farther * g,
        )
        for s, g, by in zip(shape.infrared.sensors, gains, turned, strict=False)
    )  # fmt: skip
    left, right = draw.uniform(0.7, 2.0) * draw.normal(1.0, 0.01, 2) * paper.wheels.speed_per_unit_cm_s
    track = shape.wheels.track_cm * size * draw.uniform(0.8, 1.1)
    wheels = replace(paper.wheels, track_cm=track, speed_per_unit_cm_s=(float(left), float(right)))
    infrared, ambient = replace(law, sensors=sensors), replace(paper.ambient, sensors=())
    return replace(paper, name="a large robot", body=body, wheels=wheels, infrared=infrared, ambient=ambient)


def _elsewhere(task: Task, draw: Draw) -> Task:
    """A task that begins anywhere, two times in five in another room; where a lamp is, as it is.

    Raises:
        TaskError: something stands where it begins.
    """
    if task.arena.lamps:
        return task
    arena, (width, depth) = task.arena, task.arena.size_cm
    if draw.random() < 0.4:
        x, y = draw.uniform(0.9, 1.8, 2)
        width, depth = float(width * x), float(depth * y)
        moved = [
            replace(c, x_cm=float(c.x_cm * x), y_cm=float(c.y_cm * y), radius_cm=float(draw.uniform(2, 6)))
            for c in arena.cylinders if draw.random() < 0.6
        ]  # fmt: skip
        arena = replace(arena, size_cm=(width, depth), cylinders=tuple(moved))
    start = Start(x_cm=float(draw.uniform(0, width)), y_cm=float(draw.uniform(0, depth)))
    return replace(task, arena=arena, start=start)


def family_of(of: str, kind: str, seed: int) -> int:
    """Which of its kind's families an exemplar of a set is of: they take turns."""
    return seed % len(FAMILIES[of][kind])


def exemplar(
    task: str, kind: str, seed: int, noise: float, *, marked: bool = True, large: bool = False
) -> tuple[Trial, Arena]:
    """One exemplar's trial, and where it was; everything about it follows from its seed.

    Args:
        task: a task of the paper's.
        kind: of behaviour, or of nobody.
        seed: names the exemplar.
        noise: the simulation's.
        marked: draw again, robot and start, until the trial contains its kind's evidence (`EVIDENCE`).
        large: of a robot too large for the paper's arena, in the large one, for up to a minute; of obstacle
            avoidance. Its evidence is in its track, too (`tells`).
    """
    draw = np.random.default_rng([seed, len(kind), *kind.encode(), *([1] if large else [])])
    home, robot = load_task(task), _large_robot if large else _another_robot
    home = replace(home, arena=load_arena(LARGE_ARENA)) if large else home
    of = f"{task}{LARGE}" if large else task
    make = FAMILIES[of][kind][family_of(of, kind, seed)]
    for _ in range(DRAWS):
        with suppress(TaskError):
            todo = _elsewhere(home, draw)
            simulation = Simulation(todo, robot(load_profile("paper"), draw), noise)
            controller = Ruled(make, int(draw.integers(2**31)), todo.feeds)
            stream, seconds = int(draw.integers(2**62)), draw.uniform(*LASTS_S) if large else None
            trial = live(simulation, controller, stream=stream, seconds=seconds, start=str(seed))
            trial = replace(trial, radius_cm=simulation.profile.body.radius_cm)
            seen = shows(task, kind, controller.commands) and (
                not large or tells(trial, todo.arena).get(kind, True)
            )
            if not marked or seen:
                return trial, todo.arena
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
        controller = Ruled(KINDS[self.task][self.kind], self.seed, task.feeds)
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
