"""The simulated robot at a task: scores, trajectories, readings, refusals."""

from __future__ import annotations

import gc
import math
import weakref
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

from realitygap.control.encoding import Variation
from realitygap.control.genotype import Genotype
from realitygap.control.origin import Origin, remember
from realitygap.errors import TaskError, UsageError
from realitygap.kernels.rng import substream
from realitygap.simulation.body import SimulatedBody
from realitygap.simulation.simulation import Simulation
from realitygap.tasks import load_task
from realitygap.values import Pose
from realitygap.world.robot import load_profile

PAPER = load_profile("paper")
AVOIDANCE, SEEKING = load_task("avoidance"), load_task("light")
TASKS = pytest.mark.parametrize("task", [AVOIDANCE, SEEKING], ids=["avoidance", "light"])


RANDOM = Variation(start_neurons=0.2)


def networks(count: int, variation: Variation = RANDOM):
    genes = np.stack([variation.random(substream(np.uint64(29), i)) for i in range(count)])
    return genes, variation.decode(genes)


@TASKS
@pytest.mark.parametrize("noise", ["zero", "observed", "double", 0.37])
def test_trajectory_has_the_bits_of_scores(task, noise):
    """A trajectory's score is that of `scores` for the same network and stream, bit for bit."""
    simulation = Simulation(task, PAPER, noise)
    genes, nets = networks(20)
    streams = np.random.default_rng(30).integers(0, 2**64, (20, 2), np.uint64)
    scores = simulation.scores(nets, streams)
    assert scores.shape == (20, 2) and np.unique(scores).size > 8
    for i in range(20):
        for t in range(2):
            _, score = simulation.trajectory(Genotype.decode(genes[i], 8), stream=int(streams[i, t]))
            assert score == scores[i, t]


@TASKS
def test_trajectory_rows(task):
    """A row a step: what the robot read at t, decided there, where it stood; and its end."""
    genotype = Genotype.braitenberg(task.feeds)
    simulation = Simulation(task, PAPER, "observed")
    trajectory, _ = simulation.trajectory(genotype.networks(), stream=3)
    n = 200
    assert trajectory.t.tolist() == pytest.approx([0.1 * k for k in range(n)])
    for name, shape in {
        "x": (n,), "heading": (n,), "proximity": (n, 8), "ambient": (n, 8), "inputs": (n, 8),
        "commands": (n, 2), "wheels": (n, 2), "contact": (n,),
    }.items():  # fmt: skip
        assert getattr(trajectory, name).shape == shape
    start = simulation.start(3)
    assert (trajectory.x[0], trajectory.y[0], trajectory.heading[0]) == (start.x, start.y, start.heading)
    controller = genotype.controller()
    for k in range(n):
        command = controller.decide(trajectory.inputs[k])
        assert (command.left, command.right) == tuple(trajectory.commands[k])
    assert np.hypot(np.diff(trajectory.x), np.diff(trajectory.y)).max() < 1.2
    assert (trajectory.proximity == np.round(trajectory.proximity)).all()
    assert (trajectory.ambient == np.round(trajectory.ambient)).all()


def test_unfed_sensors_read_too():
    """Sensors that feed nobody are in the trajectory as well: proximity beside ambient."""
    pose = Pose(x=105, y=35, heading=0.0)
    trajectory, _ = Simulation(SEEKING, PAPER, 0).trajectory(networks(1)[1], stream=0, pose=pose, seconds=0.1)
    proximity, ambient = Simulation(SEEKING, PAPER, 0).probe(pose)
    assert trajectory.proximity[0].tolist() == np.floor(proximity[0] + 0.5).tolist()
    assert trajectory.ambient[0].tolist() == np.floor(ambient[0] + 0.5).tolist()
    assert trajectory.proximity[0].max() > 100 and trajectory.ambient[0].min() < 60


@pytest.mark.parametrize(
    ("pose", "words"),
    [
        ((15, 15, 0), "cylinder at (15, 15)"), ((15, 21.8, 0), "cylinder at (15, 35)|cylinder at (15, 15)"),
        ((2.8, 25, 0), "wall at x = 0"), ((25, 47.2, 0), "wall at y = 50"),
        ((-5, 25, 0), "outside of the room"),
        ((1000, 25, 0), "outside of the room"), ((math.nan, 25, 0), "finite"), ((25, 25, math.inf), "finite"),
        ((25, 25, 90), "radians, got 90"), ((25, 25, 1e7 + 0.5), "radians"),
    ],
)  # fmt: skip
def test_poses_in_obstacles_are_refused(pose, words):
    """A robot cannot be set down where something stands, nor anywhere that is no place."""
    import re

    simulation = Simulation(AVOIDANCE, PAPER, 0)
    words = "|".join(re.escape(word) for word in words.split("|"))
    with pytest.raises(UsageError, match=words):
        simulation.trajectory(networks(1)[1], stream=0, pose=Pose(*pose))
    with pytest.raises(UsageError, match=words):
        simulation.probe(Pose(*pose))


def test_a_heading_in_degrees_is_refused_at_once_but_a_robot_may_turn_on_and_on():
    """Whole and half numbers beyond a turn; a robot that came to such a heading is set down there again."""
    for heading in (90, -45.0, 22.5, np.float64(180)):
        with pytest.raises(UsageError, match=r"Pose.from_degrees\(25, 30, -?[0-9.]+\) takes degrees"):
            Pose(25, 30, heading)
    assert Pose(25, 25, 6.28).heading_deg == pytest.approx(-0.18, abs=0.01)
    body = SimulatedBody(Simulation(AVOIDANCE))
    body.reset(Pose.reached(25.0, 25.0, 9.0))
    assert body.pose.heading == 9.0 and body.pose == Pose.reached(25.0, 25.0, 9.0)


def one_over_contact(path, room):
    return 1.0 / path.contact.sum()


def root_of_negative(path, room):
    return math.sqrt(-1.0 - path.x[0])


@pytest.mark.parametrize("score", [one_over_contact, root_of_negative])
def test_scores_that_are_no_numbers_are_refused(score):
    """A division by zero in a user's score is one clear message, in scores and in trajectory."""
    simulation = Simulation(replace(AVOIDANCE, name="mine", score=score, seconds=0.5), PAPER, 0)
    nets = networks(1)[1]
    with pytest.raises(TaskError, match=r"'mine'.*finite"):
        simulation.scores(nets, np.zeros((1, 2), np.uint64))
    with pytest.raises(TaskError, match=r"'mine'.*finite"):
        simulation.trajectory(nets, stream=0)


def test_seconds():
    """A trajectory may be shorter or longer than the task: its beginning is the same."""
    simulation = Simulation(AVOIDANCE, PAPER, "observed")
    nets = networks(1)[1]
    short, usual, long = (simulation.trajectory(nets, stream=9, seconds=s)[0] for s in (3.7, None, 41))
    assert (short.x.size, usual.x.size, long.x.size) == (37, 200, 410)
    assert (short.x == long.x[:37]).all() and (usual.heading == long.heading[:200]).all()
    assert simulation.trajectory(nets, stream=9, seconds=1.234)[0].x.size == 12  # the nearest step
    for wrong in (0, -1, 0.04, math.inf, math.nan):
        with pytest.raises(UsageError, match="seconds"):
            simulation.trajectory(nets, stream=9, seconds=wrong)


def test_nothing_of_it_can_change():
    """Trials go on with what was compiled, so an assignment would be ignored."""
    simulation = Simulation(AVOIDANCE, PAPER, 0)
    for name in ("noise", "profile", "task", "engine"):
        with pytest.raises(UsageError, match=rf"simulation\.{name}: it cannot change"):
            setattr(simulation, name, getattr(simulation, name))


def test_threads_leave_no_scratch_behind():
    """What a thread wrote into goes with it; each has its own, and the scores of one."""
    simulation, (_, nets), left = Simulation(AVOIDANCE, PAPER), networks(2), []
    streams = np.arange(4, dtype=np.uint64).reshape(2, 2)

    def score() -> np.ndarray:
        left.append(weakref.ref(simulation.scratch(nets).start))
        return simulation.scores(nets, streams)

    with ThreadPoolExecutor(3) as pool:
        found = [one.result() for one in [pool.submit(score) for _ in range(6)]]
    assert all(np.array_equal(one, simulation.scores(nets, streams)) for one in found)
    gc.collect()
    assert not any(one() is not None for one in left)


def test_a_simulation_takes_what_the_command_line_would():
    """The printed robot and stream 0; streams as any whole numbers, one row for every network."""
    simulation, pair = Simulation(AVOIDANCE), Genotype.braitenberg("proximity").networks()
    assert simulation.profile == PAPER
    assert simulation.trajectory(pair)[1] == simulation.trajectory(pair, stream=0)[1]
    rows = np.arange(3, dtype=np.uint64).reshape(1, 3)
    assert (simulation.scores(pair, np.arange(3)) == simulation.scores(pair, rows)).all()
    assert simulation.tracks(pair, np.arange(3)).x.shape == (1, 3, 200)
    for wrong in (np.array([-1]), np.arange(3.0), [1, 2]):
        with pytest.raises(UsageError, match="streams: expected an array uint64"):
            simulation.scores(pair, wrong)


def test_networks_of_another_task_are_warned_about():
    """Of which it is remembered where they evolved, as of a study's."""
    made = remember(Genotype.braitenberg("ambient").networks(), Origin("light-seeking", "ambient"))
    with pytest.warns(UserWarning, match="evolved at light-seeking with ambient sensors; .* fed proximity"):
        Simulation(AVOIDANCE).trajectory(made)
    Simulation("light").trajectory(made)
    assert Origin.told("# run 3, corner/zero/2, seed 7\nrealitygap genotype 1") == ("corner", "")
    with pytest.warns(UserWarning, match="evolved at corner; here it drives at light-seeking"):
        Origin("corner", "").warn("light-seeking", "ambient")
    Origin("light-seeking", "ambient").warn("light-seeking-spread-10", "ambient")
