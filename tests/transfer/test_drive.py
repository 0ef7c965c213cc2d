"""Any controller on any body: the track is the body's, the score the task's."""

from __future__ import annotations

import json
import math
from itertools import cycle
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from realitygap import Pose, SimulatedBody, Simulation, drive, drive_simulated
from realitygap.cli import realitygap
from realitygap.control.genotype import Genotype
from realitygap.errors import UsageError
from realitygap.robots.body import Body, Channel, Odometry
from realitygap.values import Command, Readings

AVOIDER = Path(__file__).resolve().parents[2] / "examples" / "avoider.toml"
NETWORK = Genotype.braitenberg("proximity").controller()


class Passing:
    """A network that nobody takes for one."""

    def reset(self):
        NETWORK.reset()

    def decide(self, inputs):
        return NETWORK.decide(inputs)


@pytest.fixture(scope="module")
def simulation() -> Simulation:
    return Simulation("avoidance", "paper")


def test_any_controller_lives_the_kernels_trial(simulation):
    """Step by step from Python or whole in the kernels: every array and the score have the same bits."""
    pose = Pose.from_degrees(8, 40, 100)
    for at in (None, pose):
        kernel, score = drive_simulated(simulation, NETWORK, stream=4, pose=at)
        steps, again = drive_simulated(simulation, Passing(), stream=4, pose=at)
        assert score == again and kernel.end == steps.end
        for name in (
            "t",
            "x",
            "y",
            "heading",
            "proximity",
            "ambient",
            "inputs",
            "commands",
            "wheels",
            "contact",
        ):
            assert (getattr(kernel, name) == getattr(steps, name)).all(), name


def test_a_drive_gives_track_and_score(simulation):
    """On the simulated body the track is the simulation's, to its end; the score is taken from it."""
    lived, score = drive_simulated(simulation, NETWORK, stream=4)
    made = drive(SimulatedBody(simulation, stream=4), NETWORK, task="avoidance")
    assert (made.track.x[:-1] == lived.x).all() and made.track.x[-1] == lived.end.x
    assert len(made.recording.commands) == 200
    assert made.score == pytest.approx(score, abs=0.02)  # a film's score: ground speeds from poses
    still = drive(
        SimulatedBody(simulation), lambda inputs: Command(left=0, right=0), task="avoidance", seconds=1
    )
    assert still.score == 0 and np.ptp(still.track.x) == 0


class Bends:
    """Bends away from what its first sensor sees, however many it has."""

    def reset(self):
        """It keeps nothing."""

    def decide(self, inputs):
        return Command(left=7, right=2 - inputs[0] // 2)


@pytest.mark.parametrize("name", ["e-puck", "thymio"])
def test_a_simulated_robot_of_any_kind_is_driven_as_in_its_simulation(name):
    """By its own profile, in whole commands of its own unit as a robot takes them (a tenth of an e-puck's top
    command is 62.5); another kind's is refused."""
    simulation = Simulation("avoidance", name, noise=0, arena="obstacle-avoidance-large")
    pose = Pose.from_degrees(20, 50, 180)
    lived, _ = drive_simulated(simulation, Bends(), stream=4, pose=pose, seconds=4)
    body = SimulatedBody(simulation, stream=4)
    made = drive(body, Bends(), task=simulation.task, start=pose, seconds=4)
    assert np.abs(made.track.x[1:-1] - lived.x[1:]).max() <= (0.0 if name == "thymio" else 0.05)
    assert np.abs(made.recording.inputs - lived.inputs).max() <= (0 if name == "thymio" else 1)
    told = [[simulation.profile.wheels.command(one) for one in pair] for pair in lived.commands.tolist()]
    assert np.abs(made.recording.commands - told).max() <= (0 if name == "thymio" else 63)
    assert np.ptp(lived.inputs) > 5
    with pytest.raises(UsageError, match=r"got one of .*: (calibrate it, and )?use its own profile"):
        drive(body, Bends(), task=simulation.task, profile="paper")


def test_a_word_drives_as_the_commands_does(simulation):
    """`drive` takes what `--controller` takes: a network's file, a vehicle, two speeds."""

    def commands(given):
        made = drive(SimulatedBody(simulation, stream=4), given, task="avoidance", seconds=2)
        return made.recording.commands.tolist()

    assert commands(str(AVOIDER)) == commands(Genotype.load(AVOIDER, 8).controller())
    assert commands("braitenberg") == commands(Genotype.braitenberg("proximity").controller())
    assert commands("constant:5,-3") == [[5, -3]] * 20
    with pytest.raises(UsageError, match="expected constant:L,R, braitenberg, "):
        commands("nowhere.toml")


@pytest.mark.parametrize(
    ("counts", "says"),
    [
        (np.full(8, 5000.0), "expected proximity counts from 0 to 1023"),
        (np.full(7, 1.0), r"expected 8 proximity readings, as its channels say, got \(7,\)"),
    ],
)
def test_a_body_of_ones_own_is_held_to_its_word(counts, says):
    """Nothing of another range or number is driven by."""

    class Odd(Knowing):
        def sense(self):
            return Readings(proximity=counts, ambient=np.empty(0))

    with pytest.raises(UsageError, match=f"Odd.sense: {says}"):
        drive(Odd([0.0]), NETWORK, task="avoidance", seconds=0.5)


@pytest.mark.parametrize(
    ("scale", "jump", "says"),
    [
        (10, 0, "a place in the task's arena of 50 by 50 cm, got x = 250, y = 10"),
        (1, 10, r"at most 3\.4 cm of a wheel from one step to the next, got 10"),
    ],
)
def test_a_pose_that_cannot_be_is_refused(scale, jump, says):
    """Before its track is scored."""

    class Odd(Knowing):
        @property
        def pose(self):
            at = super().pose
            return Pose(x=scale * at.x + jump * (self.passed > 1), y=scale * at.y, heading=at.heading)

    with pytest.raises(UsageError, match=f"^robot: pose: expected {says}"):
        drive(Odd([0.0]), NETWORK, task="avoidance", start=Pose(x=25, y=1, heading=0), seconds=2)


def test_a_hand_made_network_drives_the_twin(tmp_path):
    """`drive` keeps both tracks of each start, `score` compares them; no other drive is mixed in."""
    words = ["drive", "avoidance", "--controller", str(AVOIDER), "--starts", "2", "--seconds", "4", "--json"]
    result = CliRunner().invoke(realitygap, [*words, "--out", str(tmp_path / "mine")])
    assert result.exit_code == 0, result.output
    told = json.loads(result.stdout)["trials"]
    assert [one["start"] for one in told] == [1, 2] and all(one["fitness"]["situated"] > 0 for one in told)
    scored = CliRunner().invoke(realitygap, ["score", str(tmp_path / "mine"), "--task", "avoidance"])
    assert scored.exit_code == 0 and "2 and 2 trials" in scored.stdout, scored.output
    again = CliRunner().invoke(realitygap, [*words[:3], "constant:5,5", "--out", str(tmp_path / "mine")])
    assert again.exit_code == 2 and "already holds trials" in again.stderr


class Busy:
    """A clock of which steps come late by so many seconds, over and over."""

    waits = False

    def __init__(self, late):
        self._now, self._late = 5.0, cycle(late)

    def now(self):
        return self._now

    def sleep_until(self, time_s):
        self._now = max(self._now, time_s) + next(self._late)


class Arc(Body):
    """A robot on an arc at 8 and 10 cm/s from (25, 1), whatever it is told; it counts 120 pulses a cm."""

    channels, period_s, pulses_per_mm = (Channel(name="proximity", sensors=8, high=1023),), 0.1, 12.0
    counts_turns = True

    def __init__(self, late):
        self.clock, self._begun = Busy(late), 0.0

    @property
    def passed(self):
        return self.clock.now() - self._begun

    @property
    def odometry(self):
        return Odometry((round(960 * self.passed), round(1200 * self.passed)), (100, 125))

    def reset(self, pose=None):
        self._begun = self.clock.now()

    def sense(self):
        return Readings(proximity=np.zeros(8, np.int64), ambient=np.zeros(0, np.int64))

    def act(self, command):
        """It does as it likes."""

    def stop(self):
        """Nor does it stand."""

    close = stop


class Knowing(Arc):
    """One that knows its place, and counts nothing."""

    counts_turns = False

    @property
    def pose(self):
        turned = self.passed * TURN
        x, y = 25 + RADIUS * math.sin(turned), 1 + RADIUS * (1 - math.cos(turned))
        return Pose(x=x, y=y, heading=math.remainder(turned, math.tau))


TURN, RADIUS = 2 / 5.3, 9 * 5.3 / 2


@pytest.mark.parametrize("late", [(0.0, 0.01, 0.06, 0.13, 0.0, 0.03), (0.0, 0.01, 0.06, 0.03)])
@pytest.mark.parametrize(("robot", "seen_by"), [(Arc, "counters"), (Knowing, "robot")])
def test_late_steps_do_not_make_a_robot_faster(robot, seen_by, late):
    """The track is where it was when each step was due, not when the computer came to look."""
    made = drive(robot(late), NETWORK, task="avoidance", start=Pose(x=25, y=1, heading=0), seconds=10)
    assert made.recording.late_steps > 40 and made.track.seen_by == seen_by
    turned = made.track.t * TURN
    x, y = 25 + RADIUS * np.sin(turned), 1 + RADIUS * (1 - np.cos(turned))
    assert np.hypot(made.track.x - x, made.track.y - y).max() < 0.05


def test_counters_that_jump_are_refused():
    """As those that wrap at 16 bits; a path from them would be nonsense."""

    class Jumping(Arc):
        @property
        def odometry(self):
            left, right = super().odometry.counters
            return Odometry(counters=(left + 65536 * (self.passed > 1), right))

    with pytest.raises(UsageError, match=r"robot: odometry: expected at most .* Do counters jump or wrap"):
        drive(Jumping([0.0]), NETWORK, task="avoidance", start=Pose(x=25, y=1, heading=0), seconds=2)
