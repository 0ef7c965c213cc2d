"""One contract for every body: simulated, the twin behind its line, and a serial one (tests/robots)."""

from __future__ import annotations

import pickle
from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace

import numpy as np
import pytest

from realitygap.control.encoding import Variation
from realitygap.control.genotype import Genotype
from realitygap.errors import UsageError
from realitygap.kernels.rng import substream
from realitygap.robots.body import Body, Clock
from realitygap.robots.drive import drive
from realitygap.robots.khepera import KheperaBody
from realitygap.robots.twin import TwinLine
from realitygap.simulation.body import SimulatedBody, network_inputs
from realitygap.simulation.simulation import Simulation
from realitygap.tasks import Start, load_task
from realitygap.testing import BodyContract
from realitygap.twin.body import TwinBody
from realitygap.twin.firmware import Firmware
from realitygap.twin.stranger import StrangerBody
from realitygap.values import Command, Pose
from realitygap.world.arena import Arena
from realitygap.world.robot import load_profile

PAPER = load_profile("paper")
MIDDLE = Pose.from_degrees(25, 25, 90)
EMPTY = Arena(name="empty", size_cm=(50, 50), walls=(), cylinders=())
NAMES = ("avoidance", "light")


def _room() -> Simulation:
    """The paper's robot in an empty room."""
    task = replace(load_task("avoidance"), arena=EMPTY, start=Start(x_cm=25, y_cm=25))
    return Simulation(task, PAPER, "observed")


class TestSimulatedBody(BodyContract):
    """The body over the kernels."""

    pulses_per_unit = 100.0

    def opened(self) -> AbstractContextManager[tuple[Body, Clock]]:
        body = SimulatedBody(_room(), stream=5, kinds=("proximity", "ambient"))
        return nullcontext((body, body.clock))


class TestTwinBody(BodyContract):
    """The physics, through driver and line."""

    pulses_per_unit = 100.0
    physics = TwinBody

    def opened(self) -> AbstractContextManager[tuple[Body, Clock]]:
        body = self.physics({"size_cm": [50.0, 50.0]}, unit=1, seed=2)
        firmware = Firmware(body, baud=38400, name="twin unit 1")
        line = TwinLine(firmware)
        body = KheperaBody(line, kinds=("proximity", "ambient"), carry=firmware.place)
        return nullcontext((body, line))


class TestStranger(TestTwinBody):
    """Another physics behind the same line, whose commands take effect late."""

    physics = StrangerBody


def _genes(k: int) -> np.ndarray:
    return Variation(start_neurons=0.2).random(substream(np.uint64(31), k))


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("noise", ["zero", "observed", 2.7])
@pytest.mark.parametrize("pose", [None, Pose.from_degrees(22, 28, 140)])
def test_the_body_lives_the_simulations_trial(name: str, noise: str | float, pose: Pose | None) -> None:
    """Driven by the network it has the trajectory's bits: poses, readings, inputs, commands, wheels."""
    simulation = Simulation(load_task(name), PAPER, noise)
    inputs = network_inputs(simulation)
    for k in range(4):
        genes = _genes(k)
        stream = int(substream(np.uint64(32), k))
        wanted, _ = simulation.trajectory(Genotype.decode(genes, 8), stream=stream, pose=pose)
        body = SimulatedBody(simulation, stream=stream, kinds=("ambient", "proximity"))
        controller = Genotype(genes, 8).controller()
        body.reset(pose)
        for step in range(len(wanted.t)):
            at = body.pose
            assert (at.x, at.y, at.heading) == (wanted.x[step], wanted.y[step], wanted.heading[step])
            readings = body.sense()
            assert np.array_equal(readings.proximity, wanted.proximity[step])
            assert np.array_equal(readings.ambient, wanted.ambient[step])
            fed = inputs(readings)
            assert fed == wanted.inputs[step].tolist()
            command = controller.decide(fed)
            assert [command.left, command.right] == wanted.commands[step].tolist()
            body.act(command)
            body.clock.sleep_until(body.clock.now() + 0.1)
            assert np.array_equal(body.wheels, wanted.wheels[step])
        assert body.pose == wanted.end


@pytest.mark.parametrize("name", NAMES)
def test_the_control_loop_drives_it_as_the_kernels_do(name: str) -> None:
    """`robot.loop.drive` records the trajectory's own readings, inputs and commands, none late."""
    simulation = Simulation(load_task(name), PAPER, "observed")
    wanted, _ = simulation.trajectory(Genotype.decode(_genes(9), 8), stream=33, seconds=5)
    body = SimulatedBody(simulation, stream=33)
    controller, inputs = Genotype(_genes(9), 8).controller(), network_inputs(simulation)
    made = drive(body, controller, seconds=5, clock=body.clock, inputs=inputs)
    fed = simulation.task.feeds
    assert np.array_equal(getattr(made, fed), getattr(wanted, fed))
    assert np.array_equal(made.inputs, wanted.inputs) and np.array_equal(made.commands, wanted.commands)
    assert made.late_steps == 0 and made.ended == "finished" and not any(body.wheels)
    turned = np.abs(made.counters[-1] - 10 * wanted.wheels[:-1].sum(axis=0))
    assert (turned <= 0.5).all()


def test_sensing_changes_nothing() -> None:
    """However often it is asked within a step; another stream reads otherwise."""
    body = SimulatedBody(_room(), stream=1)
    body.reset(Pose.from_degrees(6, 25, 180))
    first, again = body.sense().proximity, body.sense().proximity
    assert np.array_equal(first, again) and first.any() and len(body.sense().ambient) == 0
    body.stream = 2
    body.reset(Pose.from_degrees(6, 25, 180))
    assert not np.array_equal(body.sense().proximity, first)


def test_a_reset_begins_the_same_trial_again() -> None:
    """Same pose, same commands: same bits."""
    ends = []
    body = SimulatedBody(_room(), stream=7)
    for _ in range(2):
        body.reset(MIDDLE)
        body.act(Command(left=6, right=-2))
        body.clock.sleep_until(body.clock.now() + 2.0)
        ends.append((body.pose, body.sense().proximity.tolist(), body.odometry))
    assert ends[0] == ends[1] and ends[0][0] != MIDDLE


def test_a_copy_of_a_body_goes_on_as_the_body_does() -> None:
    """Through a pickle, too: what its steps are called by is found again."""
    body = SimulatedBody(_room(), stream=7)
    body.act(Command(left=4, right=5))
    body.clock.sleep_until(0.5)
    copy = pickle.loads(pickle.dumps(body))
    for one in (body, copy):
        one.clock.sleep_until(1.0)
    assert copy.pose == body.pose
    assert np.array_equal(copy.sense().proximity, body.sense().proximity)


@pytest.mark.parametrize(("profile", "command"), [("e-puck", 318), ("thymio", 120), ("paper", 4)])
def test_a_loop_written_for_a_robot_drives_the_simulated_one(profile: str, command: int) -> None:
    """Its commands are the robot's own units: what makes a real one drive so fast does here, and counts."""
    robot = load_profile(profile)
    task = replace(load_task("avoidance"), arena=EMPTY, start=Start(x_cm=25, y_cm=25))
    body = SimulatedBody(Simulation(task, robot, "zero"))
    body.reset(Pose.from_degrees(12, 25, 0))
    body.act(Command(left=command, right=command))
    body.clock.sleep_until(2.0)
    assert np.abs(np.array(body.wheels) - command).max() < 0.02 * command
    gone = body.pose.x - 12
    fast = command * np.mean(robot.wheels.speed_per_unit_cm_s)
    assert 1.5 * fast < gone < 2.05 * fast
    body.sense()
    if robot.provenance.pulses_per_mm:
        assert body.odometry.counters is not None
        assert body.odometry.counters[0] == pytest.approx(
            10 * gone * robot.provenance.pulses_per_mm[0], rel=0.05
        )
    most = int(12.7 * robot.wheels.top_command)
    with pytest.raises(UsageError, match=f"left: expected a whole number of ±{most}, for the top command"):
        body.act(Command(left=most + 1, right=0))


def test_a_body_is_refused_what_it_cannot_do() -> None:
    """A pose in a wall, sensors that there are not, readings of the wrong kind."""
    simulation = _room()
    body = SimulatedBody(simulation, kinds=("ambient",))
    with pytest.raises(UsageError, match="free place"):
        body.reset(Pose(x=1, y=25, heading=0))
    with pytest.raises(UsageError, match="kinds"):
        SimulatedBody(simulation, kinds=("sonar",))
    with pytest.raises(UsageError, match="proximity sensor"):
        network_inputs(simulation)(body.sense())
