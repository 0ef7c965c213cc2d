"""What the twin's sensors see: laws of physics, and the shape of the real robot's tables."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from realitygap.twin.sensors import (
    HISTORY_MS,
    IR_OFFSET,
    LAMP_COUNTS,
    SENSORS,
    Sensors,
    on_wall,
    refreshed_at,
)
from realitygap.twin.unit import draw_unit, faces_of, plain_arena
from tests.twin.rooms import CROWDED, OPEN, table
from tests.twin.slow_sensors import SlowScene, SlowSensors, illumination, reflected

FRONT = (2, 3)


def eyes(arena: dict[str, Any], unit: int = 0) -> Sensors:
    """Sensors without noise."""
    return Sensors(plain_arena(arena), draw_unit(unit), noise=0.0, seed=0)


def at(x_cm: float, y_cm: float, heading: float) -> NDArray[np.float64]:
    """The pose of a robot at rest, for all eight sensors (m)."""
    return np.tile([x_cm / 100, y_cm / 100, heading], (8, 1))


def lived(x_cm: float, y_cm: float, heading: float) -> NDArray[np.float64]:
    """The same as the robot's last milliseconds."""
    pose = [x_cm / 100, y_cm / 100, 0.0, math.cos(heading / 2), 0.0, 0.0, math.sin(heading / 2)]
    return np.tile(pose, (HISTORY_MS, 1))


def slow_ray(scene: dict[str, Any], x: float, y: float, angle: float) -> float:
    """The obvious way: walk along the ray, a tenth of a millimetre at a time (cm)."""
    w, h = scene["size_cm"]
    for step in range(1, 20_000):
        px, py = x + step * 0.01 * math.cos(angle), y + step * 0.01 * math.sin(angle)
        if not (0 < px < w and 0 < py < h):
            return step * 0.01
        if any(math.hypot(px - cx, py - cy) < r for cx, cy, r in scene["cylinders"]):
            return step * 0.01
        for x0, y0, x1, y1 in scene["walls"]:
            length = math.hypot(x1 - x0, y1 - y0)
            along = ((px - x0) * (x1 - x0) + (py - y0) * (y1 - y0)) / length
            off = ((py - y0) * (x1 - x0) - (px - x0) * (y1 - y0)) / length
            if -0.3 < along < length + 0.3 and abs(off) < 0.3:
                return step * 0.01
    return math.inf


def test_rays_meet_what_the_obvious_way_meets() -> None:
    """Rays in NumPy, the compiled ones' judges, end where slow ones do, with normals that look back."""
    arena = plain_arena(CROWDED)
    scene = SlowScene(faces_of(arena), np.array(arena["cylinders"]) / 100)
    generator = np.random.default_rng(5)
    for x, y in [(10, 10), (30, 45), (70, 20), (47, 30)]:
        angles = generator.uniform(-math.pi, math.pi, 12)
        start = np.array([x / 100]), np.array([y / 100])
        distance, incidence, *_ = scene.meet(*start, np.cos(angles)[None], np.sin(angles)[None])
        slow = [slow_ray(arena, x, y, a) for a in angles]
        assert distance[0] * 100 == pytest.approx(slow, abs=0.03)
        assert (incidence > 0).all() and (incidence <= 1 + 1e-12).all()


def some_room(random: np.random.Generator) -> dict[str, Any]:
    """A room with a few of everything, walls through each other too."""
    size = random.uniform(20, 90, 2)
    count = random.integers(0, 5, 3)
    return {
        "size_cm": size.tolist(),
        "cylinders": [[*random.uniform(0, size), random.uniform(0.5, 5)] for _ in range(count[0])],
        "walls": [[*random.uniform(0, size), *random.uniform(0, size)] for _ in range(count[1])],
        "lamps": [random.uniform(0, size).tolist() for _ in range(count[2])],
    }


def test_compiled_sensors_read_as_plain_ones() -> None:
    """In any room, at any place and time, the compiled sensors read what the plain ones do."""
    random, tints = np.random.default_rng(7), np.random.default_rng(8)
    for unit in range(40):
        room, noise = plain_arena(some_room(random)), (0.0, 1.0, 2.0)[unit % 3]
        if unit % 2:
            room["reflectance"] = tints.uniform(0, 4, 1 + len(room["cylinders"])).tolist()
        fast = Sensors(room, draw_unit(unit), noise=noise, seed=unit)
        slow = SlowSensors(room, draw_unit(unit), noise=noise, seed=unit)
        for _ in range(8):
            where = [*random.uniform(0, room["size_cm"]), random.uniform(-math.pi, math.pi)]
            history, time_ms = lived(*where), int(random.integers(0, 50_000))
            poses = np.array([[*history[0, :2], where[2]]] * SENSORS)
            when = slow.refreshed(time_ms)
            assert when.tolist() == [refreshed_at(k, time_ms) for k in range(SENSORS)]
            assert reflected(fast, poses) == pytest.approx(slow.reflected(poses), rel=1e-9, abs=1e-7)
            assert illumination(fast, poses) == pytest.approx(slow.illumination(poses), rel=1e-9, abs=1e-12)
            assert fast.proximity(time_ms, history) == slow.proximity(time_ms, when, poses)
            assert fast.ambient(time_ms, history) == slow.ambient(time_ms, when, poses)
            x, y = history[0, :2]
            assert fast.clearance(x, y) == pytest.approx(slow.clearance(x, y), rel=1e-9)


def test_surfaces_throw_back_by_their_reflectance() -> None:
    """Infrared and reflected light are those of the surface that is met; where it is 1 nothing changes."""
    room = {"size_cm": [100, 100], "cylinders": [[50, 50, 4], [20, 70, 3]], "lamps": [[100, 20]]}
    plain, same = eyes(room), eyes({**room, "reflectance": [1, 1, 1]})
    tinted = eyes({**room, "reflectance": [2.0, 0.25, 1.0]})
    for pose, white in ((at(100 - 4.75, 50, 0.0), 2.0), (at(50 - 4 - 4.75, 50, 0.0), 0.25)):
        usual = reflected(plain, pose)
        assert reflected(same, pose).tolist() == usual.tolist()
        assert reflected(tinted, pose)[2] + IR_OFFSET == pytest.approx(white * (usual[2] + IR_OFFSET))
    far = at(100 - 2.75 - 14.0, 50, 0.0)
    assert reflected(plain, far)[2] == -IR_OFFSET < reflected(tinted, far)[2]
    corner = at(30, 92, 2.0)
    off = [illumination(one, corner) for one in (plain, same, tinted)]
    assert off[0].tolist() == off[1].tolist() and (off[2] > 1.5 * off[0])[off[0] > 0].any()


def test_direct_light_weakens_with_the_square_and_adds_up() -> None:
    """Without walls near, half the distance is four times the light; two lamps give twice as much."""
    one = {"size_cm": [900, 900], "lamps": [[450, 450]]}
    sensors = eyes(one)
    sensors.eyes.direction[:] = 0.0
    near, far = (illumination(sensors, at(450 - d - 2.5, 450, 0.0))[2] for d in (50.0, 100.0))
    assert near / far == pytest.approx(4.0, rel=0.05)
    two = eyes({**one, "lamps": one["lamps"] * 2})
    two.eyes.direction[:] = 0.0
    assert illumination(two, at(350, 450, 0.0)) == pytest.approx(2 * illumination(sensors, at(350, 450, 0.0)))


def test_ambient_is_linear_between_dark_and_floor() -> None:
    """Readings fall in proportion to the light, from about 480 down to about 60 and no further."""
    room = {"size_cm": [110, 70], "lamps": [[110, 35]]}
    sensors, unit = eyes(room), draw_unit(0)
    for x, y, heading in [(15, 35, 0.0), (15, 35, 2.0), (60, 20, -2.5), (90, 50, 1.0)]:
        light = illumination(sensors, at(x, y, heading))
        readings = np.array(sensors.ambient(0, lived(x, y, heading)))
        expected = np.array(unit.dark) - LAMP_COUNTS * np.array(unit.ambient_gain) * light
        assert readings == pytest.approx(np.maximum(expected, unit.floor), abs=0.51)
    dark = eyes({"size_cm": [110, 70]}).ambient(0, lived(50, 30, 0.0))
    assert dark == [round(v) for v in unit.dark]


def test_sensors_are_refreshed_one_after_another() -> None:
    """A reading is 0 to 19 ms old, and the eight have different ages."""
    ages = np.array([[t - refreshed_at(k, t) for k in range(SENSORS)] for t in range(100, 200)])
    assert ages.min() == 0 and ages.max() == 19
    assert len(set(ages[0])) == 8


def test_proximity_looks_like_the_real_table() -> None:
    """In front of a wall, twin units and the real robot agree about where a sensor saturates, where it
    loses the wall, and how wide it looks; they differ no more than units do."""
    real, distances = table("wall.sam")
    saturated, lost, width, twin = [], [], [], []
    for unit in range(6):
        sensors = eyes(OPEN, unit)
        rows = np.array([
            [reflected(sensors, at(200 - 2.75 - d / 10, 100, math.radians(b))) for b in range(0, 360, 8)]
            for d in distances
        ])  # fmt: skip
        rows = np.clip(rows, 0, 1023)
        twin.append(rows)
        saturated += list((rows.max(axis=1) >= 1023).sum(axis=0))
        lost += list((rows.max(axis=1) >= 50).sum(axis=0))
        width += list((rows[10] > 100).sum(axis=0) * 8)
    assert np.mean(saturated) == pytest.approx((real.max(axis=1) >= 1023).sum(axis=0).mean(), abs=1.5)
    assert np.mean(lost) == pytest.approx((real.max(axis=1) >= 50).sum(axis=0).mean(), abs=2.0)
    assert np.mean(width) == pytest.approx((real[10] > 100).sum(axis=0).mean() * 2, abs=14)
    for sensor in range(8):
        mean = np.mean(twin, axis=0)[:, :, sensor].ravel()
        assert np.corrcoef(mean, real[:, ::4, sensor].ravel())[0, 1] > 0.93


def test_ambient_looks_like_the_real_table() -> None:
    """Dark and saturated readings, and how much light a sensor keeps at an angle, are the real robot's."""
    real, distances = table("light.sam")
    volts = 500 * (1 - real / 1024)
    units = [draw_unit(k) for k in range(20)]
    assert np.mean([u.dark for u in units]) == pytest.approx(np.median(volts[-1].max(axis=0)), abs=15)
    assert np.mean([u.floor for u in units]) == pytest.approx(np.median(volts[1].min(axis=0)), abs=8)
    row = int(np.argmin(abs(distances - 253)))
    drop = (volts[row].max() - volts[row][:, FRONT]).mean(axis=1)
    sensors = eyes({"size_cm": [900, 900], "lamps": [[450, 450]]})
    sensors.eyes.direction[:] = [math.radians(v) for v in (90, 45, 0, 0, -45, -90, 180, 180)]
    reach = (27.5 + distances[row]) / 10
    seen = np.array(
        [illumination(sensors, at(450 - reach, 450, math.radians(a)))[[2, 3]].mean() for a in (0, 30, 60)]
    )
    for k, share in zip((15, 30), seen[1:] / seen[0], strict=True):
        both = (drop[k] + drop[180 - k]) / 2 / drop[[0, 1, 2, 178, 179]].mean()
        assert share == pytest.approx(both, abs=0.12)


def test_light_passes_over_the_body() -> None:
    """Of a wall behind the robot the body shades what light would reach below its top, and no more."""
    eight = eyes({"size_cm": [200, 200], "lamps": [[150, 100]]}).eyes
    lamp, wall, normal = (1.5, 1.0), (0.0, 1.0), (1.0, 0.0)
    over = (
        (0.030 - 0.012) / (draw_unit(0).lamp_height - 0.012) * 1.5
    )  # m from the wall: light at the body's top
    shaded, lit = (on_wall(eight, lamp, wall, normal, (over + off, 1.0)) for off in (0.027, 0.028))
    assert shaded == 0 and lit > 0
