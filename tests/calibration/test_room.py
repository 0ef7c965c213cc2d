"""The default path in small: light in an arena of known walls, wheels judged, a unit recorded and fitted."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from realitygap.calibration import calibrate as fits
from realitygap.calibration import forms as light
from realitygap.calibration.calibrate import calibrate
from realitygap.calibration.judge import judge
from realitygap.calibration.model import illumination, light_readings, scene_of
from realitygap.calibration.plan import ambient_task
from realitygap.calibration.recordings import SensorRecording
from realitygap.calibration.unit import PARTS, Unit
from realitygap.files import to_toml
from realitygap.world.robot import load_profile
from tests.calibration.written import save_recording

PAPER = load_profile("paper")
REPEATS = 3


@pytest.fixture(scope="module")
def lit():
    """Record light all over the arena of light seeking, with this law in the place of the paper's."""

    def make(apart: int, **law: object) -> SensorRecording:
        plan = ambient_task()
        poses = [place.pose for place in plan.stops[::apart]]
        pose = np.repeat([[p.x, p.y, p.heading] for p in poses], REPEATS, 0)
        n = len(pose)
        blank = SensorRecording(
            kind="ambient", object="lamp", distance_cm=np.zeros(n), bearing_deg=np.zeros(n),
            repeat=np.tile(np.arange(REPEATS), len(poses)), counts=np.zeros((n, 8)), pose=pose,
            arena=plan.arena, source="room",
        )  # fmt: skip
        robot = replace(PAPER, ambient=replace(PAPER.ambient, **law))  # type: ignore[arg-type]
        clean = light_readings(robot, illumination(robot, scene_of(blank)))
        noisy = clean + 4.5 * np.random.default_rng(1).normal(size=clean.shape)
        return replace(blank, counts=np.clip(np.rint(noisy), 0, 1023))

    return make


def test_gains_come_back_in_an_arena(lit):
    """The lamp's brightness is known there: gains are found themselves, and a judge at known poses agrees."""
    gains = np.random.default_rng(3).uniform(0.7, 1.3, 8)
    sensors = tuple(replace(s, gain=float(g)) for s, g in zip(PAPER.ambient.sensors, gains, strict=True))
    table = lit(2, floor=60.0, dark=480.0, sensors=sensors)
    made = calibrate([table], PAPER, light="individual", beside=False)
    found = [s.gain for s in made.profile.ambient.sensors]
    np.testing.assert_allclose(found, gains, rtol=0.1)
    assert made.ambient.rmse < 5.5 and made.profile.provenance.notes == ()
    judged = judge(table, made.profile)
    assert (judged.turn_deg, judged.brightness) == (0.0, 1.0) and judged.noise_fits
    assert judged.rmse == pytest.approx(made.ambient.rmse, rel=0.01)


def test_several_recordings_are_modelled_as_each_alone(lit):
    """Each row reads what the profile of the values reads at its place, whatever changed since the last try:
    nothing, gains, the lamp, directions, the rigs, or how many rays have a weight."""
    tables = [lit(9), lit(20)]
    names = ["turn_0_deg", "turn_1_deg"]
    scenes = [(name, replace(scene_of(one), turn=name)) for name, one in zip(names, tables, strict=True)]
    lit_model, draw = light.LightModel(PAPER, scenes, "linear"), np.random.default_rng(4)
    values = {"log_gain": np.zeros(8), "lamp_height_cm": np.array([3.0]), "exponent": np.array([1.0])}
    values |= {"direction_deg": np.array([s.direction_deg for s in PAPER.ambient.sensors])}
    values |= {name: np.zeros(1) for name in names}
    for key, size in [("", 0), ("log_gain", 0.3), ("lamp_height_cm", 1.0), ("direction_deg", 5.0),
                      ("turn_1_deg", 3.0), ("exponent", 60.0)]:  # fmt: skip
        if key:
            values[key] = values[key] + size * draw.uniform(0.5, 1.0, values[key].shape)
        made = light.with_light(PAPER, values, "linear")
        alone = [
            light_readings(made, illumination(made, scene, float(values[name][0]))) for name, scene in scenes
        ]
        both = lit_model(values)
        assert both.tobytes() == np.concatenate(alone).tobytes(), key


def test_an_arenas_walls_are_found(lit, monkeypatch):
    """Of light off walls as the paper has it and off walls of some height the right one is kept."""
    sensors = tuple(replace(s, gain=2000.0) for s in PAPER.ambient.sensors)
    law = {
        "response": "linear", "facing": 1.4, "exponent": 1.4, "falloff": 1.0, "near_cm": 1.0,
        "reflectance": 0.05, "matt": 1.0, "lamp_height_cm": 3.0, "lamp_narrow": 1.0, "rays": 30.0,
    }  # fmt: skip
    monkeypatch.setattr(light, "RAY_NUMBERS", (10, 20, 30))  # the quicker
    monkeypatch.setattr(light, "DRAWS", 200)
    monkeypatch.setattr(light, "DRAWS_HELD_OUT", 50)
    made = calibrate([lit(7, sensors=sensors, **law)], PAPER, light="extended", beside=False)
    ambient = made.profile.ambient
    assert (ambient.falloff, ambient.matt, ambient.lamp_narrow) == (1.0, 1.0, 1.0)
    assert ambient.facing == pytest.approx(1.4, abs=0.15) and ambient.exponent == ambient.facing
    assert made.ambient.rmse < 8


def test_wheels_are_judged(driven, robot):
    """The profile that drove is right about its drive, another speed is not; slip is held against its own."""
    drive = driven(slip=0.06, each=True, friction_cm_s2=0.0)
    good = replace(robot, wheels=replace(robot.wheels, friction_cm_s2=0.0))
    fast = replace(good, wheels=replace(good.wheels, speed_per_unit_cm_s=(0.9, 0.9)))
    judged = judge(drive, good)
    assert judged.kind == "wheels" and judged.rmse < 0.1 < 0.3 < judge(drive, fast).rmse
    assert judged.noise["wheel"] == (pytest.approx(0.06, rel=0.1), good.noise.wheel) and judged.warnings == ()


def test_a_unit_is_fitted(tmp_path, monkeypatch, recorded, driven, lit):
    """All its recordings make its profile, without a day in it: the same bits on any day."""
    made = {
        "ambient": lit(7), "wheels": driven(friction_cm_s2=0.0),
        "infrared-wall": recorded("wall", repeats=1),
        "infrared-cylinder": recorded("cylinder:4", repeats=1, seed=5),
    }  # fmt: skip
    assert set(made) == set(PARTS)
    for name, recording in made.items():
        save_recording(tmp_path / "recordings" / name, recording)
    (tmp_path / "unit.toml").write_text(to_toml({"unit": 11, "twin_noise": 1.0, "seed": 3}), "utf-8")
    monkeypatch.setattr(
        fits, "calibrate", lambda *args, **facts: calibrate(*args, **{**facts, "form": "paper"})
    )  # the quickest
    made_unit = Unit(tmp_path)
    text = made_unit.profile([made_unit.fitted(list(made))])
    (tmp_path / "robot.toml").write_text(text, "utf-8")
    profile = load_profile(tmp_path / "robot.toml")
    assert profile.name == "twin-11" and profile.provenance.date == "" and len(profile.provenance.files) == 4
    assert {fit.channel for fit in profile.provenance.fits} == {"infrared", "ambient", "wheels"}
