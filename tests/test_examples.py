"""The examples work as their page says: a task, an arena and a robot of one's own."""

import json
import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from realitygap import load_profile, load_study, load_transfers
from realitygap.calibration.load import STEP_COLUMNS, load_recording
from realitygap.cli import realitygap
from realitygap.control.encoding import Encoding, Variation, genotype_of, make_encoding
from realitygap.errors import StudyInterruptedError, UsageError
from realitygap.evolution import make_algorithm
from realitygap.plugins import named_object
from realitygap.study.config import StudyConfig
from realitygap.study.runner import run_study
from realitygap.testing import AlgorithmContract, BodyContract, EncodingContract, PoolContract
from realitygap.values import Command, Readings
from realitygap.work.cluster import named_pool
from realitygap.work.progress import Progress

EXAMPLES = Path(__file__).resolve().parents[1] / "examples"


def run(*words: str) -> str:
    """The output of a command that must succeed."""
    result = CliRunner().invoke(realitygap, [str(word) for word in words])
    assert result.exit_code == 0, result.output
    return result.stdout


def test_a_task_of_ones_own_evolves(tmp_path):
    """The third task, in one Python file with an arena of its own, evolves compiled."""
    words = ("--evaluations", "80", "--set", "task.seconds=4.0", "--workers", "1", "--out", tmp_path / "wall")
    run("evolve", EXAMPLES / "follow_the_wall.py", *words)
    study = load_study(tmp_path / "wall")
    assert study.runs[0].finished and study.runs[0].best_fitness > 0
    assert (tmp_path / "wall" / "report" / "index.html").is_file()


@pytest.mark.usefixtures("undrawn")
def test_a_task_that_infrared_and_light_feed_evolves(tmp_path):
    """Its networks have an input for each of the twelve sensors that it names, of both kinds."""
    words = ("--evaluations", "70", "--set", "task.seconds=2.0", "--workers", "1", "--out", tmp_path / "seek")
    run("evolve", EXAMPLES / "seek_in_two_rooms.py", *words)
    study = load_study(tmp_path / "seek")
    assert study.facts("seek-in-two-rooms")["feeds"] == "proximity+ambient"
    assert study.networks("seek-in-two-rooms", study.runs[0].champion).inputs[0] == 12


OWN = {
    "a (1+1)-ES on slots": ("evolution.algorithm=one_plus_one.py:OnePlusOne", "evolution.mutations=2"),
    "an ES on real weights": (
        "encoding.kind=real_weights.py:Weights",
        "encoding.hidden=1",
        "evolution.algorithm=real_weights.py:Strategy",
        "evolution.children=8",
    ),
}


@pytest.mark.parametrize("settings", OWN.values(), ids=OWN)
def test_an_algorithm_of_ones_own_evolves_and_resumes(tmp_path, monkeypatch, settings):
    """By --set alone; stopped and resumed, elsewhere and without its files, it ends in the same bits."""
    for file in ("one_plus_one.py", "real_weights.py"):
        shutil.copyfile(EXAMPLES / file, tmp_path / file)
    monkeypatch.chdir(tmp_path)
    few = ["task.seconds=2.0", "retest_trials=2", "fresh_trials=2", "checkpoint_every=10"]
    config = StudyConfig.single("avoidance", evaluations=37).with_settings([*few, *settings])
    whole = run_study(tmp_path / "whole", config.beside(tmp_path), workers=1)
    with pytest.raises(StudyInterruptedError):
        run_study(tmp_path / "half", config, workers=1, on_progress=stop_at(20))
    (tmp_path / "half").rename(tmp_path / "moved")
    for file in ("one_plus_one.py", "real_weights.py"):
        (tmp_path / file).unlink()
    half = run_study(tmp_path / "moved", resume=True, workers=1)
    assert (half.genotypes(1) == whole.genotypes(1)).all() and half.runs[0].evaluations == 37
    assert (half.runs[0].champion == whole.runs[0].champion).all()
    assert half.state(1).to_bytes() == whole.state(1).to_bytes()
    if "encoding" in settings[0]:
        assert half.genotypes(1).dtype == np.float64 and half.genotypes(1).shape == (37, 3, 12)
    shown = run("show", tmp_path / "moved", "1")
    assert "realitygap genotype 1" in shown
    lived = json.loads(run("replay", tmp_path / "moved", "1", "--json", "--pose", "25,25,90"))
    genotype = genotype_of(half.encoding("obstacle-avoidance"), half.runs[0].champion)
    again = genotype.controller()
    decided = [again.decide(fed) for fed in lived["inputs"]]
    assert [[one.left, one.right] for one in decided] == lived["commands"]


class TestOnePlusOne(AlgorithmContract):
    def made(self):
        return make_algorithm(f"{EXAMPLES / 'one_plus_one.py'}:OnePlusOne", Variation())


class TestStrategy(AlgorithmContract):
    def made(self):
        return make_algorithm(f"{EXAMPLES / 'real_weights.py'}:Strategy", weights(8))


class TestWeights(EncodingContract):
    def made(self, inputs):
        return weights(inputs)


def weights(inputs: int) -> Encoding:
    """The example's encoding."""
    return make_encoding(f"{EXAMPLES / 'real_weights.py'}:Weights", Variation(), {}, inputs=inputs)


def test_a_controller_is_written_for_a_chip_of_ones_own(tmp_path):
    """Evolved, written as C, compiled, and passed its test vectors."""
    if shutil.which("cc") is None:
        pytest.skip("no C compiler here")
    words = [sys.executable, EXAMPLES / "export_to_c.py", tmp_path]
    done = subprocess.run(words, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    assert done.stdout.endswith("avoider: 200 steps as in the simulation\n")


def test_a_learner_learns():
    """On the vector environment, in four iterations; typed as its page says, nothing else being imported."""
    pytest.importorskip("gymnasium", reason="no gymnasium here: pip install gymnasium")
    words = [sys.executable, EXAMPLES / "learn.py", "4"]
    done = subprocess.run(words, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    assert float(done.stdout.split()[-1]) > 0.3


def test_other_peoples_optimisers_find_something(monkeypatch):
    """CMA-ES and differential evolution do better than nothing within a few generations."""
    pytest.importorskip("cma", reason="no pycma here: pip install cma")
    monkeypatch.syspath_prepend(EXAMPLES)
    import optimise

    assert min(optimise.main(12).values()) > 0.1


def test_an_archive_of_behaviours_fills(monkeypatch, tmp_path):
    """And is drawn."""
    with monkeypatch.context() as patch:  # its own compiled functions are compiled longer than they run
        patch.setattr("numba.config.DISABLE_JIT", 1)
        for part in ("archives", "emitters", "schedulers"):
            pytest.importorskip(f"ribs.{part}", reason="no pyribs here: pip install ribs")
    monkeypatch.syspath_prepend(EXAMPLES)
    import illuminate

    assert illuminate.main(6, tmp_path / "map.png").stats.num_elites > 30
    assert (tmp_path / "map.png").stat().st_size > 5000


def test_a_study_becomes_tables(tmp_path, monkeypatch):
    """Three champions' tests at three levels of noise are counted in SQL; the tables are drawn."""
    pytest.importorskip("pyarrow", reason="no pyarrow here: pip install pyarrow")
    monkeypatch.syspath_prepend(EXAMPLES)
    import tables

    found = tables.main(tmp_path, runs=1)
    assert found["trials"].tolist() == [200] * 9 and found["mean"].min() > 0
    assert (tmp_path / "best.png").stat().st_size > 5000


def test_settings_of_a_calibration_are_tuned(monkeypatch, tmp_path):
    """Optuna finds a profile that errs by less than ten times the noise on an object that no fit saw."""
    pytest.importorskip("optuna", reason="no Optuna here: pip install optuna")
    monkeypatch.syspath_prepend(EXAMPLES)
    import tune

    best = tune.main(tmp_path, 3).best_trials
    assert min(readings for readings, _ in (one.values for one in best)) >= 40
    assert min(error for _, error in (one.values for one in best)) < 15


@pytest.fixture
def sb3(monkeypatch):
    """The example with Stable-Baselines3, whose packages warn of what is to come."""
    pytest.importorskip("stable_baselines3", reason="no Stable-Baselines3 here: pip install realitygap[sb3]")
    monkeypatch.syspath_prepend(EXAMPLES)
    import learn_sb3

    return learn_sb3


@pytest.mark.filterwarnings("ignore")
def test_stable_baselines_sees_what_its_own_vector_of_single_robots_shows(sb3):
    """Observations, rewards, ends and what was seen last: Stable-Baselines3's DummyVecEnv is the judge."""
    import gymnasium
    from stable_baselines3.common.vec_env import DummyVecEnv

    from realitygap.environment import RobotVectorEnv, stable_baselines

    with pytest.raises(UsageError, match=r"autoreset_mode: expected SameStep .* got NextStep"):
        stable_baselines(RobotVectorEnv("obstacle-avoidance", 2))
    single = [lambda: gymnasium.make("realitygap/ObstacleAvoidance-v0")] * 2
    random, ours, theirs = np.random.default_rng(2), sb3.make(2), DummyVecEnv(single)
    ours.seed(5), theirs.seed(5)
    assert (ours.reset() == theirs.reset()).all()
    for k in range(1, 402):
        actions = random.uniform(-1, 1, (2, 2)).astype(np.float32)
        (seen, rewards, dones, infos), expected = ours.step(actions), theirs.step(actions)
        assert (seen == expected[0]).all() and (rewards == expected[1]).all() and (dones == expected[2]).all()
        assert dones.all() == (k % 200 == 0)
        for one, other in zip(infos, expected[3], strict=True):
            assert one["TimeLimit.truncated"] is bool(other["TimeLimit.truncated"]) is (k % 200 == 0)
            assert ("terminal_observation" in one) is ("terminal_observation" in other)
            if "terminal_observation" in one:
                assert (one["terminal_observation"] == other["terminal_observation"]).all()
                assert one["score"] == other["score"]
    with pytest.raises(UsageError, match=r"set_attr\('noise'\): .* one compiled batch"):
        ours.set_attr("noise", 2, 0)
    with pytest.raises(UsageError, match=r"env_method\('render'\): .* Make another RobotVectorEnv"):
        ours.env_method("render")
    ours.set_options([{"noise": 0}, {}])
    with pytest.raises(UsageError, match="options: expected the same for all robots"):
        ours.reset()


@pytest.mark.filterwarnings("ignore")
def test_stable_baselines_learns(sb3):
    """Two updates of PPO on the example's robots."""
    assert -1 < sb3.main(12_800) < 1


def stop_at(done: int) -> Callable[[Progress], None]:
    """Ctrl-C once so many evaluations are done."""

    def told(progress: Progress) -> None:
        if progress.done >= done:
            raise KeyboardInterrupt

    return told


@pytest.mark.parametrize("file", sorted(EXAMPLES.glob("*.py")), ids=lambda path: path.name)
def test_examples_are_short(file):
    """An example is read at a glance, and its page says what it is."""
    assert len(file.read_text("utf-8").splitlines()) <= 80
    assert f"`{file.name}`" in (EXAMPLES / "README.md").read_text("utf-8")


def test_a_robot_and_an_arena_of_ones_own():
    """Another robot in another arena reads what is there, all of its sensors."""
    robot, arena = EXAMPLES / "hexagon.toml", EXAMPLES / "two_rooms.toml"
    pose = ("--pose", "20,20,-90", "--noise", "zero", "--json")
    read = json.loads(run("probe", "avoidance", "--profile", robot, "--arena", arena, *pose))
    assert len(read["proximity"][0]) == 6 and len(read["ambient"][0]) == 2


def test_the_how_tos_network_drives_any_robot(tmp_path, monkeypatch):
    """What the how-to shows runs as it stands, and is given speeds in cm/s."""
    config = StudyConfig.single("avoidance", runs=1, evaluations=64, fresh_trials=2, retest_trials=2)
    study = run_study(tmp_path / "out" / "reproduce", config.with_settings(["task.seconds=2"]), workers=1)
    text = (EXAMPLES.parent / "docs" / "how-to-own-parts.md").read_text("utf-8")
    shown = next(
        block for block in re.findall(r"```python\n(.*?)```", text, re.S) if "study.controller" in block
    )
    speeds = []
    yours = {
        "read_counts": lambda feeds: [900] * len(study.profile.infrared.sensors),
        "set_speeds": lambda left, right: speeds.append((left, right)),
    }
    monkeypatch.chdir(tmp_path)
    exec(compile(shown, "how-to-own-parts.md", "exec"), yours)
    assert len(speeds) == 20 + 1 and speeds[-1] == (0.0, 0.0)
    units = {speed / 0.8 for pair in speeds for speed in pair}
    assert len(units) > 1 and all(-10 <= unit <= 10 and unit == round(unit) for unit in units)


def test_a_recording_as_the_formats_say_can_be_calibrated(tmp_path):
    """A folder with the columns of the formats' table is a recording, of any number of sensors."""
    text = (EXAMPLES.parent / "docs" / "formats.md").read_text("utf-8")
    columns = re.search(r'`kind = "wheels"`[^|]*\| `steps.csv` \| (.*?);', text)
    assert columns and re.findall(r"`(\w+)`", columns[1]) == list(STEP_COLUMNS)
    facts = 'kind = "infrared"\nobject = "wall"\nsensors = 2\nbody_radius_cm = 3.5\n'
    (tmp_path / "recording.toml").write_text(facts)
    (tmp_path / "readings.csv").write_text(
        "distance_cm,bearing_deg,repeat,s0,s1\n1,0,0,500,40\n1,0,1,512,42\n"
    )
    recording = load_recording(tmp_path)
    assert recording.sensors == 2 and recording.body_radius_cm == 3.5 and recording.warnings == ()


class TestThreads(PoolContract):
    """The example's pool keeps the contract."""

    def opened(self):
        return named_pool(f"{EXAMPLES / 'own_pool.py'}:Threads")


@pytest.mark.usefixtures("undrawn")
def test_a_pool_of_ones_own_changes_no_bit(tmp_path):
    """Its two studies, by threads and by this process, have one digest; the command line takes it, too."""
    made = subprocess.run(
        [sys.executable, EXAMPLES / "own_pool.py", tmp_path], capture_output=True, text=True
    )
    first, second = made.stdout.split()
    assert first == second and len(first) == 64
    words = ("avoidance", "--evaluations", "66", "--set", "task.seconds=2", "--out", tmp_path / "cli")
    run("evolve", *words, "--workers", f"{EXAMPLES / 'own_pool.py'}:Threads")
    assert load_study(tmp_path / "cli").runs[0].finished


class TestFiveEyes(BodyContract):
    """The example's robot keeps the contract, and so does one whose readings are lists."""

    def opened(self):
        robot = named_object(f"{EXAMPLES / 'own_robot.py'}:FiveEyes", UsageError, "robot")()
        told = robot.sense
        robot.sense = lambda: Readings(proximity=[int(one) for one in told().proximity], ambient=[])
        return nullcontext((robot, robot.clock))

    def test_exchanged_wheels_are_found_out(self):
        """It has no counters that would tell."""
        with self.opened() as (body, clock):
            act = body.act
            body.act = lambda command: act(Command(left=command.right, right=command.left))
        wrong = BodyContract()
        wrong.opened = lambda: nullcontext((body, clock))
        with pytest.raises(AssertionError):
            wrong.test_it_goes_where_its_wheels_take_it()

    def test_a_wrong_place_and_a_body_that_rolls_on_are_found_out(self):
        """By its pose: it has no counters."""
        with self.opened() as (body, _):
            kind = type(body)
        wrong = BodyContract()
        far = {"reset": lambda self, pose=None: kind.reset(self, pose and replace(pose, x=30.0))}
        on = {"stop": lambda self: hasattr(self, "given") or kind.stop(self)}
        for change, test in (
            (far, wrong.test_it_goes_where_its_wheels_take_it),
            (on, wrong.test_a_stopped_body_stands),
        ):
            odd = type("Odd", (kind,), change)()
            wrong.opened = lambda odd=odd: nullcontext((odd, odd.clock))
            with pytest.raises(AssertionError):
                test()


def test_a_robot_of_ones_own_is_recorded_calibrated_evolved_for_and_driven(tmp_path):
    """Five sensors of 12 bits, no light, no counters: noise and wheels are found, a champion drives."""
    subprocess.run([sys.executable, EXAMPLES / "own_robot.py", tmp_path], check=True, capture_output=True)
    profile = load_profile(tmp_path / "robot.toml")
    assert len(profile.infrared.sensors) == 5 and profile.infrared.top == 4095
    assert abs(profile.noise.proximity - 60) < 6 and not profile.ambient.sensors
    assert abs(profile.wheels.track_cm - 5.6) < 0.1 and abs(profile.noise.wheel - 0.05) < 0.01
    assert all(abs(speed - 0.75) < 0.015 for speed in profile.wheels.speed_per_unit_cm_s)
    driven = load_transfers(tmp_path / "study")
    assert [one.start for one in driven] == [1, 2] and {one.situated_from for one in driven} == {"robot"}
    assert all(one.lost_steps == 0 and one.fitness_situated >= 0 for one in driven)
    assert len((EXAMPLES / "own_robot.py").read_text().splitlines()) <= 80
