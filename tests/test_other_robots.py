"""A robot of five sensors of 12 bits, without light sensors or counters: from its profile to a study."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from realitygap.calibration.calibrate import calibrate
from realitygap.calibration.judge import judge
from realitygap.calibration.load import load_recording
from realitygap.calibration.model import proximity, scene_of
from realitygap.calibration.recordings import SensorRecording, WheelRecording
from realitygap.control.controllers import as_controller
from realitygap.control.encoding import Variation
from realitygap.control.slots import decode
from realitygap.correspondence.trials import trial_of
from realitygap.errors import CalibrationError, ConfigError, RecordingError, TaskError
from realitygap.robots.address import Address
from realitygap.simulation.body import SimulatedBody
from realitygap.simulation.simulation import Simulation
from realitygap.study.config import StudyConfig
from realitygap.study.runner import run_study
from realitygap.tasks import load_task
from realitygap.transfer.drive import pairs
from realitygap.values import Command, Pose
from realitygap.world.robot import Profile, load_profile
from realitygap.world.sensors import UNLIT
from tests.calibration.conftest import places
from tests.calibration.written import save_recording
from tests.kernels.reference import trial as reference

FULL, LOOKS = 4095.0, (70.0, 30.0, 0.0, -30.0, -70.0)


@pytest.fixture(scope="module")
def five() -> Profile:
    """That robot."""
    paper = load_profile("paper")
    sensors = tuple(
        replace(
            paper.infrared.sensors[2], a=14000.0 + 500.0 * k, b=-366.0, direction_deg=look,
            x_cm=2.4 * np.cos(np.radians(look)), y_cm=2.4 * np.sin(np.radians(look)),
        )
        for k, look in enumerate(LOOKS)
    )  # fmt: skip
    return replace(
        paper, name="five", ambient=UNLIT,
        infrared=replace(paper.infrared, top=FULL, bands=(0.0, FULL), sensors=sensors, exponent=2.0),
        noise=replace(paper.noise, proximity=84.0, proximity_dark=13.0, ambient=0.0),
    )  # fmt: skip


@pytest.fixture
def file(five: Profile, tmp_path: Path) -> Path:
    """Its profile's file."""
    path = tmp_path / "five.toml"
    path.write_text(five.to_toml(), "utf-8")
    return path


def recorded(robot: Profile, object: str, seed: int) -> SensorRecording:
    """What it reads before a wall or a cylinder, with noise."""
    distance, bearing, repeat = places(3)
    blank = SensorRecording(
        kind="infrared", object=object, distance_cm=distance, bearing_deg=bearing, repeat=repeat,
        counts=np.zeros((len(distance), 5)), source=object, full_scale=FULL, facts={"full_scale": 4095},
        body_radius_cm=robot.body.radius_cm,
    )  # fmt: skip
    clean, random = proximity(robot, scene_of(blank)), np.random.default_rng(seed)
    noisy = clean + np.where(clean > 0, 84.0, 13.0) * random.normal(size=clean.shape)
    return replace(blank, counts=np.clip(np.rint(noisy), 0, FULL))


def test_its_profile_comes_back(five, file):
    """A profile without light sensors says nothing of light in its file, and reads back equal."""
    assert load_profile(file) == five
    assert "[ambient]" not in file.read_text("utf-8")
    assert load_profile(file).channel("ambient").sensors == ()


@pytest.mark.parametrize("level", [0.0, 1.0])
def test_its_trials_are_the_references(five, level):
    """Five inputs, counts up to 4095: readings, inputs and commands are those of the slow reference."""
    task = replace(load_task("obstacle-avoidance"), seconds=8.0)
    genes = Variation(inputs=5, start_neurons=0.3).random(np.uint64(7))
    expected = reference.run(task, five, genes, level=level, stream=3)
    got, _ = Simulation(task, five, level).trajectory(decode(genes, 5), stream=3)
    assert got.proximity.tolist() == expected.readings
    assert got.inputs.tolist() == expected.inputs and got.inputs.shape[1] == 5
    assert [tuple(row) for row in got.commands.tolist()] == expected.commands
    near = Simulation(task, five, level).probe(Pose(x=47.0, y=25.0, heading=0.0))[0]
    assert 1023 < near.max() <= FULL


def test_it_evolves(file, tmp_path):
    """A study of the paper's task feeds the five sensors that there are; one that needs light is refused."""
    config = StudyConfig.single("obstacle-avoidance", profile=str(file), evaluations=30).with_settings(
        ["task.seconds=1", "evolution.rows=3", "evolution.columns=3"]
    )
    study = run_study(tmp_path / "study", config, workers=1)
    assert study.task("obstacle-avoidance").sensors == (0, 1, 2, 3, 4)
    (run,) = study.runs
    assert run.finished
    with pytest.raises(TaskError, match="profile 'five' has no ambient sensors"):
        run_study(tmp_path / "dark", StudyConfig.single("light-seeking", profile=str(file)), workers=1)


def test_it_is_calibrated(five, tmp_path):
    """Its constants come back from a wall and a cylinder, at its own full scale; light is not asked for."""
    for k, name in enumerate(("wall", "cylinder:4")):
        save_recording(tmp_path / str(k), recorded(five, name, k))
    found = [load_recording(tmp_path / str(k)) for k in range(2)]
    rough = tuple(replace(s, a=10000.0, b=-300.0) for s in five.infrared.sensors)
    base = replace(five, infrared=replace(five.infrared, sensors=rough, exponent=1.0))
    made = calibrate(found, base, form="extended")
    assert made.infrared is not None and made.ambient is None and made.profile.ambient == UNLIT
    assert made.infrared.rmse < 84 and max(m.ratio for m in made.infrared.sensors) < 0.5
    for sensor, true in zip(made.profile.infrared.sensors, five.infrared.sensors, strict=True):
        assert sensor.a == pytest.approx(true.a, rel=0.15)
        assert sensor.direction_deg == pytest.approx(true.direction_deg, abs=1.5)
    assert made.profile.noise.proximity == pytest.approx(84.0, rel=0.1)
    assert made.profile.infrared.top == FULL
    assert not any(w.startswith("ambient") for w in made.warnings)  # it has no sensors for light
    assert judge(found[0], made.profile).rmse < 90


def test_counts_above_the_full_scale_are_refused(five, tmp_path):
    """At the line that has them, if the recording says its full scale; else by its robot's profile."""
    one = recorded(five, "wall", 1)
    save_recording(tmp_path / "said", replace(one, facts={"full_scale": 1023}))
    with pytest.raises(RecordingError, match=r"readings.csv, line \d+: s\d: expected counts from 0 to 1023"):
        load_recording(tmp_path / "said")
    ten_bits = replace(five, infrared=replace(five.infrared, top=1023.0, bands=(0.0, 1023.0)))
    with pytest.raises(
        RecordingError, match=r"expected counts from 0 to 1023, the full scale of profile 'five', got 4095"
    ):
        calibrate([one], ten_bits)
    save_recording(tmp_path / "unsaid", replace(one, facts={}))
    brighter = r"unsaid: expected counts from 0 to 1023, .* of profile 'five'"
    with pytest.raises(RecordingError, match=brighter):
        calibrate([load_recording(tmp_path / "unsaid")], ten_bits)
    with pytest.raises(RecordingError, match="expected 8 sensors, as profile 'paper' has, got 5"):
        calibrate([replace(one, counts=np.minimum(one.counts, 1023.0), full_scale=None)], "paper")


def test_wheels_without_counters_stay_as_they_were(five, tmp_path):
    """A drive without counters is read, keeps the profile's wheels, and says so; nothing is judged by it."""
    n, nothing = 40, np.full((40, 2), np.nan)
    made = WheelRecording(
        t_s=np.arange(n) / 10, commands=np.full((n, 2), 5.0), counters=nothing, speeds=nothing,
        trial=np.zeros(n, np.int64), kind=np.full(n, "step"),
    )  # fmt: skip
    save_recording(tmp_path / "w", made)
    assert "counter_left" not in (tmp_path / "w" / "steps.csv").read_text("utf-8")
    back = load_recording(tmp_path / "w")
    result = calibrate([recorded(five, "wall", 1), back], five, form="extended")
    assert result.wheels is None and result.profile.wheels == five.wheels
    assert any("no counters recorded, nor pictures of 300 successive steps" in w for w in result.warnings)
    with pytest.raises(CalibrationError, match="nor pictures of 300 successive steps: nothing tells how far"):
        judge(back, five)


@pytest.mark.parametrize("period_s", [0.02, 0.05, 0.2])
def test_any_period_of_control(five, tmp_path, period_s):
    """A trial has steps of the profile's period, as long in all, and its file keeps it; bodies go by it."""
    robot = replace(five, period_s=period_s)
    (tmp_path / "robot.toml").write_text(robot.to_toml(), "utf-8")
    assert load_profile(tmp_path / "robot.toml") == robot
    simulation = Simulation("obstacle-avoidance", robot, 0.0)
    genes = Variation(inputs=5, start_neurons=0.3).random(np.uint64(7))
    made, _ = simulation.trajectory(decode(genes, 5), stream=3, seconds=4.0)
    assert len(made.t) == round(4.0 / period_s) and made.track.t[-1] == pytest.approx(4.0)
    body = SimulatedBody(simulation)
    body.reset(Pose(x=20.0, y=25.0, heading=0.0))
    body.act(Command(left=5, right=5))
    body.clock.sleep_until(body.clock.now() + 1.0)
    assert body.period_s == period_s
    ran = body.pose.x - 20.0
    assert ran == pytest.approx(4.0, abs=5 * period_s * 4.0)  # but for some steps of starting
    assert len(trial_of(made)) == 41  # the names and scores of behaviour go by tenths of a second


def test_periods_that_do_not_fit_are_refused(five):
    """Milliseconds for seconds."""
    with pytest.raises(ConfigError, match=r"period_s: expected 0.02 to 0.2 \(s\) of one step, got 100.0"):
        replace(five, period_s=100)


@pytest.mark.parametrize("period_s", [0.064, 0.108])
@pytest.mark.parametrize("robot", ["twin:1", "enki:khepera:1"])
def test_a_trial_ends_at_the_nearest_step(period_s, robot):
    """4 s are 62 steps of 64 ms, 37 of 108: in simulation and on a robot that keeps to them."""
    if robot != "twin:1" and not Path("/usr/include/enki/PhysicalEngine.h").exists():
        pytest.skip("Enki is not installed here: apt install libenki-dev g++")
    profile = replace(load_profile("khepera"), period_s=period_s)
    simulation = Simulation("avoidance", profile, 0.0)
    driver = as_controller(lambda inputs: (6, 5))
    (pair,) = pairs(simulation, driver, Address.parse(robot), seconds=4)
    steps = round(4 / period_s)
    assert simulation.trial.steps == round(20 / period_s)
    assert len(pair.simulated) == len(pair.track) == steps + 1 and pair.track.lost == 0
    assert np.allclose(pair.track.t, pair.simulated.t) and np.isfinite(pair.score_situated)
