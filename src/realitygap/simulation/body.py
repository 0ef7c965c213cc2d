"""The simulated robot as a body: what a controller drives, as it drives a twin or a Khepera.

Time goes on with the body's own clock, in the simulation's steps: the profile's period.
"""

from collections.abc import Callable
from functools import cached_property
from typing import Any

import numpy as np

from realitygap.compiled import entry_for
from realitygap.control.controllers import as_controller
from realitygap.control.genotype import NetworkController
from realitygap.errors import UsageError
from realitygap.kernels import trial as loop
from realitygap.kernels.trial import new_record, new_robots, new_scratch
from realitygap.kernels.types import Path
from realitygap.robots.body import KINDS, Body, Channel, Odometry, SteppedClock
from realitygap.robots.drive import Controller
from realitygap.simulation.simulation import Simulation
from realitygap.track import Trajectory
from realitygap.values import Command, Floats, Pose, Readings, as_stream, fed
from realitygap.world.robot import TOP_INPUT

__all__ = ["SimulatedBody", "drive_simulated", "network_inputs"]

PULSES_PER_S = 100.0
"""Pulses a second of a wheel at one unit: a Khepera's, for profiles that tell no pulses."""
MOST = 127
"""Largest output, tenths of the top command: beyond it (a Khepera's largest command) none is heard."""
STAND_STEPS = 20
"""Steps that the wheels may take to come to rest."""
ONE, NOWHERE = np.zeros(1, np.int64), np.zeros((0, 3))
"""The only robot; it does not begin anew."""


class SimulatedBody(Body):
    """The robot of a simulation, which any controller may drive.

    Its commands are the robot's own units, as in its profile and as of every body. Driven by its task's
    network with `network_inputs` and `put_out`, it lives the same trial, to the bit, as
    `Simulation.trajectory` with the same stream; by `act`, as a robot does, which takes whole units. Each
    reset begins that trial's noise anew.

    Args:
        simulation: task, robot, noise and arena.
        stream: names the noise, and where the robot stands at first.
        kinds: the sensors that are read: "proximity", "ambient" or both; by default what the task feeds.

    Attributes:
        clock: the body's time; it moves when the clock does.
        stream: the noise's; a change counts from the next reset.

    Raises:
        UsageError: a kind of sensors that there is not.
    """

    counts_turns = True
    clock: SteppedClock

    def __init__(
        self, simulation: Simulation, *, stream: int = 0, kinds: tuple[str, ...] | None = None
    ) -> None:
        read = simulation.task.kinds if kinds is None else kinds
        if not read or not set(read) <= set(KINDS):
            raise UsageError(f"kinds: expected a tuple of {', '.join(KINDS)} or both, got {read!r}.")
        self.simulation = simulation
        self.stream = stream
        self.kinds = tuple(kind for kind in KINDS if kind in read)
        robot, trial = simulation.robot, simulation.trial
        parts = ((kind, simulation.profile.channel(kind)) for kind in self.kinds)
        self.channels = tuple(
            Channel(name=kind, sensors=len(part.sensors), high=int(part.top))
            for kind, part in parts
            if part.sensors
        )
        whole = not set(self.kinds) <= set(simulation.task.kinds)
        self._scratch = new_scratch(robot, trial, whole=whole)
        self._robots = new_robots(1, 0, self._scratch)
        self.period_s = simulation.profile.period_s
        wheels, told = simulation.profile.wheels, simulation.profile.provenance.pulses_per_mm
        self._pulses_per_unit = [
            self.period_s * (10.0 * told[w] * wheels.speed_per_unit_cm_s[w] if told else PULSES_PER_S)
            for w in range(2)
        ]
        self.clock = SteppedClock(self._step, self.period_s)
        self._set_down(simulation.start(stream))

    @property
    def pose(self) -> Pose:  # type: ignore[override]
        """Where the robot is."""
        x, y, heading = map(float, self._robots.pose[0])
        return Pose.reached(x, y, heading)

    @property
    def wheels(self) -> tuple[float, float]:
        """What the wheels do, the robot's units."""
        speeds, units = self._robots.wheel[0, :, 0].tolist(), self._world.robot.wheels.speed_per_unit.tolist()
        return speeds[0] / units[0], speeds[1] / units[1]

    @property
    def odometry(self) -> Odometry:
        """As read with the last `sense`."""
        return self._odometry

    def reset(self, pose: Pose | None = None) -> None:
        """Stand, counters at zero, at `pose` (None: where it is); the noise begins anew.

        Raises:
            UsageError: something stands there.
        """
        self._set_down(self.pose if pose is None else pose)

    def sense(self) -> Readings:
        """What the sensors read now, counts; empty for a kind that is not read."""
        fed, readings, unfed = self.simulation.task.kinds, self._robots.readings[0], self._robots.unfed[0]
        self._odometry = self._wheel_counts()
        near = len(self.simulation.profile.infrared.sensors) if fed[0] == KINDS[0] else 0
        kept = {}
        for kind, now in zip(KINDS, (readings[:near], readings[near:]), strict=True):
            read = now if kind in fed else unfed
            kept[kind] = read.copy() if kind in self.kinds else np.empty(0)
        return Readings(**kept)

    def act(self, command: Command) -> None:
        """Wheel speeds from now on, in the robot's own units.

        Raises:
            UsageError: no whole units, or many times the profile's top command.
        """
        self._give(command, self.simulation.profile.wheels.top_command / TOP_INPUT)

    def put_out(self, outputs: Command) -> None:
        """Wheel speeds from now on, as a network puts them out: −10 … 10 of the top command.

        Raises:
            UsageError: no whole numbers, or many times that.
        """
        self._give(outputs, 1.0)

    def _give(self, command: Command, unit: float) -> None:
        """A command of which so much is a tenth of the top one."""
        most = int(MOST * unit)
        for name, value in (("left", command.left), ("right", command.right)):
            if not -most <= value <= most or value != int(value):
                robot = f"profile {self.simulation.profile.name!r}"
                raise UsageError(
                    f"command: {name}: expected a whole number of ±{most}, for the top command of {robot} is "
                    f"{TOP_INPUT * unit:g}, got {value!r}."
                )
        self._commands[:] = command.left / unit, command.right / unit

    def stop(self) -> None:
        """Stand; the clock goes on until the wheels rest."""
        self.act(Command(left=0, right=0))
        for _ in range(STAND_STEPS):
            if not self._robots.wheel[0, :, 0].any():
                return
            self.clock.sleep_until(self.clock.now() + self.period_s)

    def close(self) -> None:
        """Stand."""
        self.stop()

    def _set_down(self, pose: Pose) -> None:
        free, stream = self.simulation.require_free(pose), as_stream(self.stream)
        self._world, self._commands = self.simulation.world_of(int(stream)), np.zeros((1, 2))
        self._robots.stream[0] = stream
        self._advance(np.array([[free.x, free.y, free.heading]], float))
        self._pulses = [0.0, 0.0]
        self._odometry = self._wheel_counts()
        self.clock.begin_step()

    @cached_property
    def _entry(self) -> Callable[..., Any]:
        """Of the kernel that every step calls: the types of what it is given stay."""
        given = self._world, self._robots, ONE, NOWHERE, self._commands, self._scratch
        return entry_for(loop.advance, *given)

    def __getstate__(self) -> dict[str, Any]:
        return {name: kept for name, kept in vars(self).items() if name != "_entry"}

    def _advance(self, starts: Floats) -> None:
        self._entry(self._world, self._robots, ONE, starts, self._commands, self._scratch)

    def _step(self) -> None:
        self._advance(NOWHERE)
        for i, speed in enumerate(self.wheels):
            self._pulses[i] += self._pulses_per_unit[i] * speed

    def _wheel_counts(self) -> Odometry:
        (left, right), speeds = self._pulses, self.wheels
        return Odometry((round(left), round(right)), (round(speeds[0]), round(speeds[1])))


def network_inputs(simulation: Simulation) -> Callable[[Readings], list[int]]:
    """What makes a network's inputs −10 … 10 of a body's readings, as the simulation makes them."""
    task, profile = simulation.task, simulation.profile
    sensors = task.of(profile).sensors
    return lambda readings: profile.inputs(fed(readings, task.feeds).tolist(), task.feeds, sensors)


def drive_simulated(
    simulation: Simulation,
    controller: Controller | Callable[..., Any],
    *,
    stream: int = 0,
    pose: Pose | None = None,
    seconds: float | None = None,
) -> tuple[Trajectory, float]:
    """One simulated trial under any controller, and its score: under a network's the bits of
    `Simulation.trajectory`.

    Args:
        simulation: task, robot, noise and arena.
        controller: has decide(inputs), inputs as a network's of the task, and perhaps reset(); or a function.
        stream: the trial's.
        pose: where it starts; by default where the stream says.
        seconds: how long it lasts; by default the task's length.

    Raises:
        UsageError: a pose that is not free, a wrong length, a controller or a command that is none.
    """
    if type(controller) is NetworkController:  # a subclass may decide otherwise
        networks = controller.genotype.networks()
        return simulation.trajectory(networks, stream=stream, pose=pose, seconds=seconds)
    body, make = SimulatedBody(simulation, stream=stream, kinds=KINDS), network_inputs(simulation)
    if pose is not None:
        body.reset(pose)
    steps = simulation.trial.steps if seconds is None else simulation.steps_of(seconds)
    record = new_record(simulation.robot, len(simulation.trial.channels), steps)
    body._robots = body._robots._replace(path=np.zeros((1, len(Path._fields), steps)))
    driver = as_controller(controller)
    driver.reset()
    for k in range(steps):
        readings = body.sense()
        record.pose[k] = body._robots.pose[0]
        record.proximity[k], record.ambient[k] = readings.proximity, readings.ambient
        record.inputs[k] = make(readings)
        command = driver.decide(record.inputs[k].tolist())
        body.put_out(command)
        body.clock.sleep_until(body.clock.now() + body.period_s)
        record.commands[k] = command.left, command.right
        record.wheels[k] = body.wheels
    return simulation.told(record, Path(*body._robots.path[0]))
