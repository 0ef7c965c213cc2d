"""The simulation and other realities as Gymnasium's environments."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

gymnasium = pytest.importorskip("gymnasium", reason="no gymnasium here: pip install 'realitygap[gymnasium]'")

from gymnasium.utils.env_checker import check_env  # noqa: E402
from gymnasium.vector import AutoresetMode  # noqa: E402

from realitygap.control.genotype import Genotype  # noqa: E402
from realitygap.environment import RobotEnv, RobotVectorEnv  # noqa: E402
from realitygap.errors import RealityGapError, TaskError, UsageError  # noqa: E402
from realitygap.kernels.rng import substream  # noqa: E402
from realitygap.problem import Problem  # noqa: E402
from realitygap.simulation.simulation import Simulation  # noqa: E402
from realitygap.tasks.load import load_task  # noqa: E402

AVOID, SEEK = "realitygap/ObstacleAvoidance-v0", "realitygap/LightSeeking-v0"
STEPS = 200
HEADER = Path("/usr/include/enki/PhysicalEngine.h")


OWN = """
from realitygap import Start, Task


def score(path, room):
    return path.x[150]


start = Start(x_cm=25, y_cm=25)
task = Task(name="own", arena="obstacle-avoidance", feeds="proximity", score=score, start=start)
"""
"""A task whose score cannot take the beginning of a path."""


def vector(count: int = 3, task: str = "obstacle-avoidance", **settings) -> RobotVectorEnv:
    return RobotVectorEnv(task, count, **settings)


@pytest.mark.parametrize("name", [AVOID, SEEK])
def test_gymnasium_makes_them_and_finds_nothing_wrong(name):
    """Both names, single; Gymnasium's own checker, warnings as errors."""
    check_env(gymnasium.make(name).unwrapped, skip_render_check=True)


@pytest.mark.parametrize("name", [AVOID, SEEK])
def test_robot_i_lives_the_trials_of_a_single_one(name):
    """With seed s, robot i has the bits of a single environment with seed s + i, over two trials."""
    many = gymnasium.make_vec(name, num_envs=2, vectorization_mode="vector_entry_point")
    singles = [gymnasium.make(name) for _ in range(2)]
    seen, _ = many.reset(seed=40)
    for i, one in enumerate(singles):
        assert (one.reset(seed=40 + i)[0] == seen[i]).all()
    random = np.random.default_rng(3)
    for k in range(2 * STEPS + 1):
        actions = random.uniform(-1, 1, (2, 2)).astype(np.float32)
        seen, rewards, _, truncated, _ = many.step(actions)
        for i, one in enumerate(singles):
            if k == STEPS:  # its next trial begins
                alone, reward, over = one.reset()[0], 0.0, False
            else:
                alone, reward, _, over, _ = one.step(actions[i])
            assert (alone == seen[i]).all() and (reward, over) == (rewards[i], truncated[i])


@pytest.mark.parametrize(
    ("task", "feeds", "spread"),
    [
        ("obstacle-avoidance", "proximity", 0.0),
        ("light-seeking", "ambient", 0.0),
        ("obstacle-avoidance", "proximity", 0.3),
    ],
)
def test_a_networks_trial_is_the_simulations(task, feeds, spread):
    """Driven as a network drives, its path is the simulation's, bit for bit, and rewards make its score: with
    constants drawn anew for the trial, too."""
    genotype = Genotype.braitenberg(feeds)
    one, network = RobotEnv(task, spread=spread), genotype.controller()
    simulation = Simulation(load_task(task).under(spread), "paper")
    stream = int(substream(np.uint64(9), np.uint64(0)))
    expected, score = simulation.trajectory(genotype.networks(), stream=stream)
    one.reset(seed=9)
    total, inner = 0.0, one._inner
    network.reset()
    for _ in range(STEPS):
        readings = inner._robots.readings[0]
        fed = simulation.profile.inputs(readings.tolist(), feeds, simulation.task.sensors)
        command = network.decide(fed)
        _, reward, terminated, truncated, info = one.step(np.array([command.left, command.right]) / 10)
        total += reward
    assert truncated and not terminated
    assert (inner._robots.path[0, 0, :-1] == expected.x[1:]).all()
    assert (inner._robots.path[0, 2, -1]) == expected.end.heading
    assert info["score"] == pytest.approx(score, rel=1e-12) and total == pytest.approx(score, rel=1e-9)


def test_within_a_spread_each_robot_has_constants_of_its_own():
    """Under one command from one pose three robots go three ways, in each trial others, as alone."""
    many, pose = vector(spread=0.2, noise="zero", autoreset_mode="Disabled"), {"pose": (25, 25, 0)}
    alone = RobotEnv("obstacle-avoidance", spread=0.2, noise="zero")
    ends, robots = [], np.arange(3)
    for trial in range(2):
        many.reset(seed=None if trial else 7, options={**pose, "reset_mask": robots > -1})
        alone.reset(seed=None if trial else 8, options=pose)
        for _ in range(20):
            many.step(np.full((3, 2), 0.5, np.float32)), alone.step(np.full(2, 0.5, np.float32))
        assert (alone._inner._robots.pose[0] == many._robots.pose[1]).all()
        ends += many._robots.pose[:, 0].tolist()
    assert len(set(ends)) == 6


def run(env: RobotVectorEnv, steps: int, seed: int = 5):
    """Two of three robots end: all of them, in these tasks. What each step gave."""
    random, env_seen = np.random.default_rng(seed), []
    for _ in range(steps):
        env_seen.append(env.step(random.uniform(-1, 1, (env.num_envs, 2))))
    return env_seen


def test_next_step_begins_anew_with_the_step_after():
    """Gymnasium's default: at the end the last observation; then a step of no reward, whatever the action."""
    env = vector(autoreset_mode="NextStep")
    assert env.metadata["autoreset_mode"] is env.autoreset_mode is AutoresetMode.NEXT_STEP
    first, _ = env.reset(seed=1)
    made = run(env, STEPS + 2)
    assert made[STEPS - 1][3].all() and not made[STEPS - 2][3].any()
    seen, rewards, _, truncated, _ = made[STEPS]
    assert (rewards == 0).all() and not truncated.any() and not (seen == first).all()
    assert (made[STEPS + 1][1] != 0).any()


def test_same_step_tells_the_end_and_shows_the_beginning():
    """`final_obs` is what NEXT_STEP shows at the end, and the observation what it shows a step later."""
    other, env = vector(), vector(autoreset_mode=AutoresetMode.SAME_STEP)
    other.reset(seed=1), env.reset(seed=1)
    there, here = run(other, STEPS + 1), run(env, STEPS)
    seen, rewards, _, truncated, info = here[-1]
    assert truncated.all() and info["_final_obs"].all() and info["_final_info"].all()
    assert (np.stack(info["final_obs"]) == there[-2][0]).all() and (seen == there[-1][0]).all()
    assert (info["final_info"]["score"] == there[-2][4]["score"]).all() and (rewards == there[-2][1]).all()


def test_disabled_waits_for_a_mask():
    """Nothing begins by itself; a mask begins some, and leaves the others where they are."""
    env = vector(autoreset_mode=AutoresetMode.DISABLED)
    env.reset(seed=1)
    run(env, 50)
    before = env._robots.pose.copy()
    seen, _ = env.reset(options={"reset_mask": np.array([False, True, False])})
    assert (env._robots.pose[[0, 2]] == before[[0, 2]]).all() and (env._robots.step == [50, 0, 50]).all()
    assert seen.shape == (3, 8)
    last = run(env, STEPS - 50)[-1]
    assert last[3].tolist() == [True, False, True]
    with pytest.raises(UsageError, match=r"trials \[0, 2\] are over"):
        run(env, 1)


def test_what_is_returned_is_nobody_elses():
    """No array that a step returned changes with the next one."""
    env = vector()
    seen, _ = env.reset(seed=0)
    made = [seen, *run(env, 1)[0][:4]]
    kept = [one.copy() for one in made]
    run(env, 3)
    assert all((one == two).all() for one, two in zip(made, kept, strict=True))


def test_a_pose_and_noise_are_options():
    """At zero noise, from one pose, all robots see the same."""
    env = vector(noise="zero")
    seen, _ = env.reset(seed=3, options={"pose": (20, 20, 45)})
    assert (seen == seen[0]).all()
    assert len({row.tobytes() for row in vector(noise=2).reset(seed=3)[0]}) == 3
    with pytest.raises(UsageError, match="pose: expected a free place"):
        env.reset(options={"pose": (0, 0, 0)})


def test_noise_profile_and_reality_are_options_of_a_reset(tmp_path):
    """From then on, as if it had been made with them; the trial is the one that it would have been."""
    env, changes = vector(noise="zero"), {"noise": 2, "profile": "khepera"}
    env.reset(seed=3)
    other = vector(**changes)
    for options in (changes, None):
        seed = None if options is None else 3
        assert (env.reset(seed=seed, options=options)[0] == other.reset(seed=seed)[0]).all()
    for options, said in (
        ({"noise": 1, "reset_mask": np.array([True, False, True])}, "noise: expected a reset of all robots"),
        ({"noise": "loud"}, "noise: expected zero"), ({"reality": "twin:1"}, "options: expected noise, pose"),
        ({"profile": "enki-thymio2"}, "profile: expected one with 8 sensors that the task feeds, got 7"),
    ):  # fmt: skip
        with pytest.raises(RealityGapError, match=said):
            env.reset(options=options)
    one, alone = gymnasium.make(AVOID, noise="double", spread=0.1), vector(1, noise="zero", spread=0.1)
    first = one.reset(seed=3)[0]
    (tmp_path / "own.py").write_text(BODY.format(speeds="speeds"))
    reality, pose = f"{tmp_path / 'own.py'}:Speedy", {"pose": (25, 25, 0)}
    assert (one.reset(seed=3, options={"reality": reality, **pose})[0] == one.reset(options=pose)[0]).all()
    assert one.step(np.full(2, 0.5, np.float32))[1] > 0
    with pytest.raises(UsageError, match="noise: expected none with reality"):
        one.reset(options={"noise": "zero"})
    assert (one.reset(seed=3, options={"reality": "simulation"})[0] == first).all()
    alone.reset(seed=3)
    assert (one.reset(options={"noise": "zero"})[0] == alone.reset()[0][0]).all()


@pytest.mark.parametrize("make", [Problem, RobotEnv, RobotVectorEnv])
@pytest.mark.parametrize(
    ("given", "made"), [({}, (0.2, 0.0)), ({"spread": 0.1}, (0.1, 0.0)), ({"spread": 0.0}, (0.0, None))]
)
def test_a_tasks_own_spread_counts_unless_another_is_given(make, given, made):
    """None leaves it, 0 switches it off, another keeps that of the wheels."""
    task = make(load_task("avoidance").under(0.2, 0.0), **given).simulation.task
    assert (task.spread, task.spread_wheels) == made


def test_a_score_that_fails_on_a_part_of_a_path_is_named(tmp_path):
    """A user's score meets every beginning of a path; one that cannot take it says so, with its line."""
    file = tmp_path / "own.py"
    file.write_text(OWN)
    env = gymnasium.make("realitygap/Task-v0", task=str(file)).unwrapped
    env.reset(seed=0)
    with pytest.raises(TaskError, match=r"own.py, line 6: the score fails with IndexError"):
        env.step(np.zeros(2))


@pytest.mark.parametrize("reality", ["twin:1", "enki:khepera:1"])
def test_other_realities(reality):
    """The same name steps the twin and Enki: the same bits twice, and rewards that add up."""
    if reality.startswith("enki") and not (shutil.which("g++") and HEADER.is_file()):
        pytest.skip("Enki is not installed here: apt install libenki-dev g++")
    ends = []
    for _ in range(2):
        one = gymnasium.make(AVOID, reality=reality).unwrapped
        seen, _ = one.reset(seed=11)
        total = 0.0
        for _ in range(STEPS):
            left = 0.6 if seen.max() < -0.5 else -0.4
            seen, reward, _, truncated, info = one.step(np.array([left, 0.6], np.float32))
            total += reward
        assert truncated and total == pytest.approx(info["score"]) and 0 < info["score"] < 1
        with pytest.raises(UsageError, match="after a trial's end"):
            one.step(np.zeros(2))
        one.close()
        ends.append((total, seen.tobytes()))
    assert ends[0] == ends[1]


BODY = """
import numpy as np
from realitygap.robots import Body, Channel, SteppedClock
from realitygap.values import Readings

class Speedy(Body):
    channels = (Channel(name="proximity", sensors=8, high=1023),)
    period_s, counts_turns, {speeds} = 0.1, False, (0, 0)
    def __init__(self): self.clock = SteppedClock(lambda: None, 0.1)
    def reset(self, pose=None): self.stop()
    def sense(self): return Readings(proximity=np.zeros(8), ambient=np.empty(0))
    def act(self, command): self.{speeds} = (command.left, command.right)
    def stop(self): self.{speeds} = (0, 0)
"""


def own(folder: Path, speeds: str = "speeds", pose: tuple[float, ...] = (25, 25, 0)) -> RobotEnv:
    (folder / "own.py").write_text(BODY.format(speeds=speeds))
    env = RobotEnv("obstacle-avoidance", reality=f"{folder / 'own.py'}:Speedy")
    env.reset(seed=0, options={"pose": pose})
    return env


def test_measured_speeds_are_a_path(tmp_path):
    """A robot that counts nothing is where its wheels' measured speeds say: five units a second, say."""
    env = own(tmp_path)
    rewards = [env.step(np.full(2, 0.5))[1] for _ in range(10)]
    track, speed = env._inner._track(), env.simulation.profile.wheels.speed_per_unit_cm_s[0]
    assert track.x[-1] - track.x[0] == pytest.approx(5 * speed * 0.95) and min(rewards) > 0
    env.close()


def test_robots_that_cannot_be_scored_are_refused(tmp_path):
    """Of nobody's knowing where it is, or of another kind than the profile's: before it drives."""
    with pytest.raises(UsageError, match="expected one that reports its pose or its wheels' speeds"):
        own(tmp_path, speeds="secret")
    other = RobotEnv("obstacle-avoidance", profile="e-puck", reality="twin:1")
    with pytest.raises(
        UsageError, match=r"counts up to \d+ \(profile 'e-puck'\); this robot's go up to 1023"
    ):
        other.reset(seed=0)
