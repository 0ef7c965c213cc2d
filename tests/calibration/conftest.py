"""Where the real tables stand, and recordings made by the project's own model."""

from __future__ import annotations

import math
import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from realitygap.calibration.model import (
    illumination,
    light_readings,
    proximity,
    scene_of,
    wheel_speeds,
)
from realitygap.calibration.recordings import SensorRecording, WheelRecording
from realitygap.world.robot import Profile, load_profile
from tests.calibration.tables import write_tables

DISTANCES = np.array([0.5, 1.0, 1.5, 2.0, 3.0, 4.0, 6.0])
BEARINGS = np.arange(-180.0, 180.0, 10.0) + 10.0


@pytest.fixture(scope="session")
def tables() -> Path:
    """The folder of the real tables."""
    beside = Path(__file__).parents[3] / "shared" / "data" / "khepera"
    folder = Path(os.environ.get("REALITYGAP_DATA", beside))
    if not (folder / "wall.sam").is_file():
        pytest.skip(f"no real tables in {folder}; set REALITYGAP_DATA to the folder of wall.sam")
    return folder


@pytest.fixture(scope="session")
def made_tables(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of tables of our own making, with the faults of the real ones."""
    return write_tables(tmp_path_factory.mktemp("tables"))


@pytest.fixture(scope="session")
def robot() -> Profile:
    """A robot unlike the paper's, as a calibration should find it."""
    base, random = load_profile("paper"), np.random.default_rng(3)
    near = tuple(
        replace(
            s,
            a=1800.0 * random.uniform(0.7, 1.3),
            b=-90.0,
            direction_deg=s.direction_deg + float(d),
            offset_cm=0.35,
        )
        for s, d in zip(base.infrared.sensors, [4, -3, 2, -1, 1, -2, 3, -4], strict=True)
    )
    lit = tuple(replace(s, gain=2000.0 * random.uniform(0.7, 1.3)) for s in base.ambient.sensors)
    return replace(
        base,
        infrared=replace(base.infrared, sensors=near, exponent=2.0),
        ambient=replace(base.ambient, sensors=lit, response="linear", facing=1.4, floor=60.0, dark=480.0),
    )


def places(repeats: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Distance, bearing and number of each reading."""
    d, b, r = np.meshgrid(DISTANCES, BEARINGS, np.arange(repeats), indexing="ij")
    return d.ravel(), b.ravel(), r.ravel()


@pytest.fixture(scope="session")
def recorded(robot: Profile) -> Callable[..., SensorRecording]:
    """Record that robot before a wall, a cylinder or a lamp, with noise."""

    def make(
        object: str = "wall",
        *,
        noise: float = 21.0,
        turn: float = 0.0,
        repeats: int = 4,
        seed: int = 1,
        matt: float = 0.0,
        reflectance: float = 1.0,
    ) -> SensorRecording:
        made = replace(robot, infrared=replace(robot.infrared, matt=matt))
        distance, bearing, repeat = places(repeats)
        kind = "ambient" if object == "lamp" else "infrared"
        blank = SensorRecording(
            kind=kind, object=object, distance_cm=distance, bearing_deg=bearing, repeat=repeat,
            counts=np.zeros((len(distance), 8)), source="made", reflectance=reflectance,
        )  # fmt: skip
        scene = scene_of(blank)
        if kind == "ambient":
            clean = light_readings(robot, illumination(robot, scene, turn))
        else:
            clean = proximity(made, scene, turn)
        deviation = noise if kind == "ambient" else np.where(clean > 0, noise, 0.0)
        random = np.random.default_rng(seed)
        drawn = clean + deviation * random.normal(size=clean.shape)
        idle = 4.0 * np.abs(random.normal(size=clean.shape))
        drawn = np.where((clean > 0) | (kind == "ambient"), drawn, idle)
        return replace(blank, counts=np.clip(np.rint(drawn), 0, 1023))

    return make


@pytest.fixture(scope="session")
def driven(robot: Profile) -> Callable[..., WheelRecording]:
    """Record a robot's wheels: constants as given, counters, and a camera that sees them slip."""

    def make(
        *,
        slip: float = 0.06,
        camera: bool = True,
        seed: int = 2,
        each: bool = False,
        keep: float = 0.0,
        **wheels: object,
    ) -> WheelRecording:
        """`each`: a camera sees every step; `keep`: how much of a step's slip the next one has."""
        made = replace(robot, wheels=replace(robot.wheels, **wheels))  # type: ignore[arg-type]
        random = np.random.default_rng(seed)
        commands, trial = [], []
        for k in range(40):
            pair = (k % 10 + 1, k % 10 + 1) if k % 2 else tuple(random.integers(-10, 11, 2))
            back = (-pair[0], -pair[1]) if k % 3 == 2 else pair
            commands += [pair] * 20 + [back] * 10 + [(0, 0)] * 6
            trial += [k] * 36
        n = len(commands)
        blank = WheelRecording(
            t_s=np.tile(np.arange(36) * 0.1, 40), commands=np.array(commands, float),
            counters=np.zeros((n, 2)), speeds=np.zeros((n, 2)), trial=np.array(trial),
            kind=np.array(["step"] * n), source="made",
        )  # fmt: skip
        speeds = wheel_speeds(made, blank)
        counters, pose = np.zeros((n, 2)), np.full((n, 3), np.nan)
        x, lost = np.zeros(3), np.zeros(2)
        way = np.zeros(2)
        for i in range(n):
            if i % 36 == 0:
                x, way = np.zeros(3), np.zeros(2)
            counters[i] = np.rint(way * 120.0)
            if each or i % 5 == 0:
                pose[i] = x + random.normal(size=3) * [0.01, 0.01, 0.003]
            step = speeds[i] * 0.1
            lost = keep * lost + math.sqrt(1 - keep**2) * random.normal(size=2)
            ground = step * (1 + slip * lost)
            way = way + step
            turn = (ground[1] - ground[0]) / made.wheels.track_cm
            mean = x[2] + turn / 2
            chord = ground.mean() * np.sinc(turn / 2 / np.pi)
            x = x + np.array([chord * np.cos(mean), chord * np.sin(mean), turn])
        return replace(blank, counters=counters, pose=pose if camera else None)

    return make
