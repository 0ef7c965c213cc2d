"""Tasks as problems for anybody's optimiser."""

from __future__ import annotations

import numpy as np
import pytest
from numba import njit

from realitygap.control.slots import decode
from realitygap.errors import UsageError
from realitygap.plugins import run_file
from realitygap.problem import Problem, form_of
from realitygap.robots.drive import drive
from realitygap.simulation.body import SimulatedBody, drive_simulated, network_inputs
from realitygap.simulation.simulation import Simulation, batch_streams
from realitygap.tasks.load import load_task
from realitygap.transfer.paths import of_poses
from realitygap.transfer.paths import score as of_track

RANDOM = np.random.default_rng(5)
FEED, ELMAN = "feed-forward:3", "recurrent:2"


@pytest.fixture(scope="module", params=[FEED, ELMAN])
def problem(request) -> Problem:
    return Problem("obstacle-avoidance", request.param, workers=1)


def feed_forward(weights, inputs, hidden):
    """The slow, obvious one."""
    into, out = np.split(weights, [hidden * (len(inputs) + 1)])
    into, out = into.reshape(hidden, -1), out.reshape(2, -1)
    values = np.tanh(into[:, :-1] @ inputs + into[:, -1])
    return np.tanh(out[:, :-1] @ values + out[:, -1])


def test_feed_forward_is_the_obvious_one():
    """Random weights, random inputs: the same outputs, hence the same commands."""
    one = Problem("obstacle-avoidance", FEED)
    for _ in range(200):
        weights, inputs = RANDOM.normal(size=one.dim), RANDOM.integers(-10, 11, 8)
        got = one.controller(weights).decide(inputs)
        outputs = feed_forward(np.clip(weights, -4, 4), inputs / 10, 3)
        assert [got.left, got.right] == np.floor(outputs * 10 + 0.5).tolist()


def test_recurrent_is_the_obvious_one():
    """It remembers its hidden layer from step to step, and nothing from trial to trial."""
    one = Problem("obstacle-avoidance", ELMAN)
    weights = RANDOM.normal(size=one.dim)
    into, out = weights[: 2 * 11].reshape(2, 11), weights[2 * 11 :].reshape(2, 3)
    driver = one.controller(weights)
    for _ in range(2):
        driver.reset()
        memory = np.zeros(2)
        for _ in range(50):
            inputs = RANDOM.integers(-10, 11, 8)
            memory = np.tanh(into[:, :8] @ (inputs / 10) + into[:, 8:10] @ memory + into[:, 10])
            outputs = np.tanh(out[:, :2] @ memory + out[:, 2])
            got = driver.decide(inputs)
            assert [got.left, got.right] == np.floor(outputs * 10 + 0.5).tolist()


class Watched:
    """Drives as a solution does, and keeps where the robot was."""

    def __init__(self, inner, body):
        self.inner, self.body = inner, body

    def reset(self):
        self.inner.reset()
        self.poses = []

    def decide(self, inputs):
        self.poses.append(self.body.pose)
        return self.inner.decide(inputs)


def test_a_controller_drives_a_body_as_it_was_evaluated(problem):
    """A trial of the compiled loop is that of the simulated body, driven step by step."""
    weights, simulation = RANDOM.normal(size=problem.dim), problem.simulation
    batch = problem.evaluate(weights, seed=3, trials=2)
    for stream, score in zip(batch_streams(3, 2), batch.info["scores"][0], strict=True):
        body = SimulatedBody(simulation, stream=int(stream))
        watched = Watched(problem.controller(weights), body)
        drive(body, watched, seconds=20.0, inputs=network_inputs(simulation))
        track = of_poses([*watched.poses, body.pose])
        assert of_track(track, simulation.task, simulation.profile) == pytest.approx(score, abs=0.005)


def test_fitness_depends_on_nothing_else(problem):
    """Not on the others of its batch, their order, or the number of threads; but on the seed."""
    solutions = RANDOM.normal(size=(7, problem.dim))
    whole = problem.evaluate(solutions, seed=1)
    assert (problem.evaluate(solutions[3], seed=1).fitness == whole.fitness[3]).all()
    assert (problem.evaluate(solutions[::-1], seed=1).fitness == whole.fitness[::-1]).all()
    problem.workers = 3
    more = problem.evaluate(solutions, seed=1)
    problem.workers = 1
    assert (more.fitness == whole.fitness).all() and (more.measures == whole.measures).all()
    assert (problem.evaluate(solutions, seed=2).fitness != whole.fitness).any()


def test_within_a_spread_each_trial_is_of_another_robot():
    """Of weights as of networks: by the trial's stream alone, whatever else is in the batch."""
    plain, wide = (Problem("obstacle-avoidance", FEED, noise=0, spread=share) for share in (0.0, 0.3))
    solutions = np.random.default_rng(6).normal(size=(6, wide.dim))  # its own: some networks stand still
    scores = wide.evaluate(solutions, seed=1).info["scores"]
    assert (wide.evaluate(solutions[4], seed=1).info["scores"] == scores[4]).all()
    assert (plain.evaluate(solutions, seed=1).info["scores"] != scores).mean() > 0.5
    stream = int(batch_streams(1, 2)[0])
    _, score = drive_simulated(wide.simulation, wide.controller(solutions[4]), stream=stream)
    assert score == pytest.approx(scores[4, 0], rel=1e-12)


def test_driving_straight_and_turning_are_told_by_the_measures(problem):
    """A controller of biases alone: both wheels forward; one back. The former is champion, by other trials
    than those that measure it."""
    weights, hidden = np.zeros((2, problem.dim)), 3 if problem.form.memory == 3 else 2
    weights[:, -1] = 4.0  # the right wheel's bias
    weights[:, -2 - hidden] = 4.0, -4.0
    speed, turning = problem.evaluate(weights, seed=1).measures.T
    assert speed[0] > 0.05 and abs(speed[1]) < 0.05 and turning[1] > 0.8 and abs(turning[0]) < 0.2
    best, measured = problem.champion(weights[::-1])
    chosen_by = problem.retest(weights[0], trials=20, seed=1).info["scores"]
    assert best == 1 and measured.fitness[0] > 0.05 and measured.info["scores"].shape == (1, 100)
    assert not np.isin(measured.info["scores"], chosen_by).any(), "what chose it measures it"


def test_the_papers_network_is_the_simulations():
    """Genotypes as vectors have the fitness of `Simulation.scores`, within a spread too; every vector is
    clipped into one."""
    one = Problem("light-seeking", "delay-network")
    wide = Problem("light-seeking", "delay-network", spread=0.2)
    solutions = np.stack([one.x0(seed) for seed in range(3)])
    nets = decode(one.decode(solutions), 8)
    streams = np.tile(batch_streams(4, 2), (3, 1))
    expected = Simulation("light-seeking", "paper").scores(nets, streams)
    assert (one.evaluate(solutions, seed=4, trials=2).info["scores"] == expected).all()
    drawn = Simulation(load_task("light-seeking").under(0.2), "paper").scores(nets, streams)
    assert (wide.evaluate(solutions, seed=4, trials=2).info["scores"] == drawn).all() and (
        drawn != expected
    ).any()
    wild = RANDOM.uniform(-300, 300, (20, one.dim))
    assert one.integer.all() and np.isfinite(one.evaluate(wild, trials=1).fitness).all()
    assert one.evaluate(solutions[0]).fitness.shape == (1,)


OWN = """
WEIGHTS = 4
MEMORY = 1


def decide(weights, memory, inputs, outputs):
    memory[0] += 0.1
    outputs[0] = weights[0] + 0.0 * memory[{place}] * inputs[int(100 * weights[2])] / weights[3]
    outputs[1] = weights[1]


class Own:
    WEIGHTS, MEMORY = 4, 1
    decide = staticmethod(decide)
"""


def test_a_controller_of_ones_own(tmp_path):
    """A function or a class in a short file is enough, or itself; what it may not do is said by name, before
    a trial or in one."""
    file = tmp_path / "own.py"
    for place, said in (("7", "index|bounds"), ("unknown", "unknown")):
        file.write_text(OWN.format(place=place))
        with pytest.raises(UsageError, match=said):
            Problem("obstacle-avoidance", f"{file}:decide")
    file.write_text(OWN.format(place="0"))
    one = Problem("obstacle-avoidance", f"{file}:Own")
    ahead, round = one.evaluate([[0.5, 0.5, 0.0, 1.0], [0.5, -0.5, 0.0, 1.0]]).fitness
    assert one.dim == 4 and ahead > round
    with pytest.raises(UsageError, match=r"own\.py, line 8: the controller fails with IndexError"):
        one.evaluate([[0.5, 0.5, 0.5, 1.0]])
    with pytest.raises(UsageError, match="finite"):
        one.evaluate([[0.5, 0.5, 0.0, 0.0]])
    module = run_file(file, UsageError)
    for same in (module.Own, module.decide, njit(module.decide)):
        form = form_of(same, 8)
        assert (form.inputs, form.weights, form.memory) == (8, 4, 1)


class Learns:
    """Changes its weights in a trial, and leaves its outputs alone where nothing is near."""

    WEIGHTS, MEMORY = 2, 1

    def decide(weights, memory, inputs, outputs):
        memory[0] += 1.0
        if memory[0] > 5.0 and inputs.max() <= 0.0:
            outputs[:] = weights
            weights[0] += 0.003
            weights[1] -= 0.002


def test_what_a_controller_learns_ends_with_its_trial():
    """A trial follows from solution and stream alone, even of a function that writes into its weights."""
    problem = Problem("obstacle-avoidance", Learns, noise=0, workers=1)
    solutions = np.array([[0.9, 0.8], [-0.2, 0.4], [0.3, 0.3]])
    scores = problem.evaluate(solutions, seed=3, trials=4).info["scores"]
    assert (problem.evaluate(solutions[2], seed=3, trials=4).info["scores"] == scores[2]).all()
    again, streams = problem.controller(solutions[2]), batch_streams(3, 4).tolist()
    for stream, score in zip(streams, scores[2], strict=True):
        for one in (problem.controller(solutions[2]), again):
            assert drive_simulated(problem.simulation, one, stream=stream)[1] == score
