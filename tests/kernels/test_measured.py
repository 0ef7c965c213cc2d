"""Sensors as measured: optics by rays, electronics by tables, judged by the slow reference and by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from realitygap.world.arena import Arena, Cylinder
from realitygap.world.robot import Profile
from tests.kernels.calls import read_often
from tests.kernels.reference import sensors as reference
from tests.kernels.scenes import PAPER, SEEKING, agree, random_scenes, readings


def measured(profile: Profile, random: np.random.Generator) -> Profile:
    """A robot with the same sensors, which read by curves of their own."""
    law, light = profile.infrared, profile.ambient

    def curve(top: float) -> np.ndarray:
        steps = random.uniform(0, 1, 24) * (random.uniform(0, 1, 24) < 0.7)
        steps[: random.integers(1, 8)] = 0.0
        return 0.999 * top * np.cumsum(steps) / max(steps.sum(), 1e-9)

    lobe = random.uniform(0, 1, 5) - (random.random() < 0.3) * np.array([0.5, 0, 0, 0, 0])
    sensors = tuple(
        replace(s, a=float(random.uniform(0.5, 2)), b=0.0, curve=tuple(curve(law.top))) for s in law.sensors
    )
    eyes = tuple(replace(s, curve=tuple(light.top - curve(light.top))) for s in light.sensors)
    return replace(
        profile,
        infrared=replace(
            law, sensors=sensors, matt=float(random.integers(2)), lobe=tuple(lobe / lobe.sum()),
            overlap=float(random.choice([0.0, 0.3])), aperture_deg=float(random.uniform(10, 85)),
            width_cm=float(random.choice([0.0, 3.0])),
            range_cm=float(random.choice([0.0, 9.0])), curve_cm=float(random.uniform(1, 6)),
        ),
        ambient=replace(light, sensors=eyes, response="measured", curve_light=float(random.uniform(1e-3, 1))),
    )  # fmt: skip


def test_agrees_with_the_reference():
    """Every measured sensor reads what the slow reference reads: short cuts change nothing."""
    random, lit = np.random.default_rng(3), 0
    for profile, arena, pose in random_scenes(seed=4, count=60):
        robot = measured(profile, random)
        got, light = readings(robot, arena, pose)
        agree(got, reference.proximity, robot, arena, pose)
        agree(light, reference.ambient, robot, arena, pose)
        lit += int(((got > 0) & (got < robot.infrared.top)).sum())
    assert lit > 60, "the scenes are too empty to judge anything"


def test_nothing_reads_above_the_full_scale_and_nearer_never_less():
    """Towards a wall a measured sensor's reading only rises, and never above the full scale."""
    random, arena = np.random.default_rng(5), Arena(name="hall", size_cm=(400, 400))
    for _ in range(10):
        robot = measured(PAPER, random)
        robot = replace(robot, infrared=replace(robot.infrared, lobe=(0.2,) * 5))
        ahead = np.array([readings(robot, arena, (x, 200.0, 0.0))[0][2:4] for x in np.linspace(380, 396, 40)])
        assert ahead.max() <= robot.infrared.top and np.diff(ahead, axis=0).min() >= -1e-3


def test_mirror_images_read_mirror_images():
    """In a mirrored room a mirrored robot reads the mirrored numbers, to the last bit."""
    random = np.random.default_rng(6)
    robot = measured(PAPER, random)
    tables = [s.curve for s in robot.infrared.sensors]
    alike = tuple(replace(s, a=1.0, curve=tables[0]) for s in robot.infrared.sensors)
    robot = replace(robot, infrared=replace(robot.infrared, sensors=alike))
    width, depth = SEEKING.size_cm
    for _ in range(40):
        pole = Cylinder(x_cm=random.uniform(3, width - 3), y_cm=random.uniform(3, depth - 3), radius_cm=2)
        x, y = pole.x_cm - np.sign(pole.x_cm - width / 2) * 6.0, pole.y_cm
        heading = random.uniform(-7, 7)
        room = replace(SEEKING, cylinders=(pole,))
        mirrored = replace(SEEKING, cylinders=(replace(pole, y_cm=depth - pole.y_cm),))
        here, _ = readings(robot, room, (x, y, heading))
        there, _ = readings(robot, mirrored, (x, depth - y, -heading))
        np.testing.assert_allclose(here[:6], there[:6][::-1], rtol=1e-6, atol=1e-3)


def noisy(rise: float = 0.0, dead: float = 0.0) -> Profile:
    """The paper's robot with noise of 2 counts in the dark, 10 at half scale, 6 at full scale."""
    sensors = tuple(replace(s, noise=(2.0, 10.0, 6.0), noise_rise=rise) for s in PAPER.infrared.sensors)
    return replace(PAPER, infrared=replace(PAPER.infrared, sensors=sensors, dead=dead))


def drawn(robot: Profile, value: float, *, level: float = 1.0, speed: float = 0.0) -> np.ndarray:
    """Four thousand readings of one sensor."""
    out = np.full(4000, value)
    motors = np.random.default_rng(7).standard_normal(len(out))
    read_often(robot.to_kernel(), float(level), float(speed), motors, np.zeros(16), out)
    return out


@pytest.mark.parametrize(
    ("value", "level", "speed", "size"),
    [(511.5, 1, 0, 10), (255.75, 1, 0, 6), (511.5, 2, 0, 20), (511.5, 1, 4, 30)],
)
def test_noise_is_that_of_the_table(value, level, speed, size):
    """Noise has the table's deviation at its reading, times the level, and rises with the wheels' speed."""
    found = drawn(noisy(rise=0.5), value, level=level, speed=speed).std()
    assert found == pytest.approx(size, rel=0.05)
    assert found != pytest.approx(size * 1.2, rel=0.05), "a wrong law would pass"


def test_readings_below_the_dead_zone_are_zero():
    """Just above the dead zone readings flicker between 0 and its edge; well above it they do not."""
    robot = noisy(dead=200.0)
    edge, above = drawn(robot, 201.0), drawn(robot, 300.0)
    assert 0.3 < (edge == 0).mean() < 0.5 and edge[edge > 0].min() == 200.0
    assert above.min() > 200.0
