"""Random robots, arenas and poses for the kernels to be judged on; the same for the same seed."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from realitygap.kernels import trial as loop
from realitygap.kernels.trial import MOTOR_NOISE, new_scratch, noise_blocks
from realitygap.kernels.types import Arena as KernelArena
from realitygap.kernels.types import Networks, Trial, World
from realitygap.world.arena import Arena, Cylinder, Lamp, load_arena
from realitygap.world.robot import Profile, load_profile
from realitygap.world.sensors import AmbientSensor, ProximitySensor
from tests.kernels.reference.rays import overlap

PAPER = load_profile("paper")
AVOIDANCE = load_arena("obstacle-avoidance")
SEEKING = load_arena("light-seeking")
EMPTY = Arena(name="empty", size_cm=(100, 100))
RADIUS = PAPER.body.radius_cm


def random_arena(random: np.random.Generator, *, lamps: int | None = None, sliding: float = 1.0) -> Arena:
    """A room with up to five cylinders, three inner walls and three lamps, which may overlap."""
    width, depth = random.uniform(25, 110, 2)
    radii = random.uniform(0.5, 6, random.integers(0, 6))
    cylinders = tuple(
        Cylinder(x_cm=random.uniform(r, width - r), y_cm=random.uniform(r, depth - r), radius_cm=r)
        for r in radii
    )
    walls = tuple(
        tuple(random.uniform(0, size) for size in (width, depth, width, depth))
        for _ in range(random.integers(0, 4))
    )
    count = random.integers(0, 4) if lamps is None else lamps
    drawn = (random_lamp(random, width, depth) for _ in range(count))
    placed = tuple(
        lamp for lamp in drawn if not any(c.covers(x, y) for x, y in lamp.points() for c in cylinders)
    )
    return Arena(
        name="random", size_cm=(width, depth), cylinders=cylinders, walls=walls, lamps=placed, sliding=sliding
    )


def full_room(random: np.random.Generator, *, things: int = 40) -> Arena:
    """A room with that many walls and poles, half of them poles; some reach into the robot's way."""
    side = random.uniform(8, 14) * math.sqrt(things)
    poles = tuple(
        Cylinder(x_cm=random.uniform(2, side - 2), y_cm=random.uniform(2, side - 2), radius_cm=radius)
        for radius in random.uniform(0.5, 2, things // 2)
    )
    walls = tuple(
        (x, y, *(float(v) for v in np.clip((x + dx, y + dy), 0, side)))
        for x, y in random.uniform(0, side, (things - things // 2, 2)).tolist()
        for dx, dy in random.uniform(-12, 12, (1, 2))
    )
    return Arena(name="full", size_cm=(side, side), cylinders=poles, walls=walls)


def random_lamp(random: np.random.Generator, width: float, depth: float) -> Lamp:
    """A lamp within a room at any angle; half of them stand across the end, as the paper's does."""
    weights = tuple(random.uniform(0, 9, 5))
    if random.random() < 0.5:
        return Lamp(x_cm=width, y_cm=random.uniform(5, depth - 5), weights=weights)
    return Lamp(
        x_cm=random.uniform(8, width - 8), y_cm=random.uniform(8, depth - 8),
        line_deg=random.uniform(-180, 180), spacing_cm=random.uniform(0, 4),
        brightness=random.uniform(0.2, 3), offset=-random.uniform(0, 10), weights=weights,
    )  # fmt: skip


def random_profile(random: np.random.Generator) -> Profile:
    """The paper's robot with other sensors: any number, anywhere, each with constants of its own."""

    def place() -> dict[str, float]:
        r, angle = RADIUS * random.uniform(0.2, 0.95), random.uniform(-math.pi, math.pi)
        degrees = random.uniform(-180, 180)
        return {"x_cm": r * math.cos(angle), "y_cm": r * math.sin(angle), "direction_deg": degrees}

    def law() -> dict[str, float]:
        b = random.choice([-150.0, -91.4, -40.0, 0.0, 3.0], p=[0.2, 0.5, 0.2, 0.05, 0.05])
        return {"a": random.uniform(500, 5000), "b": b, "offset_cm": random.choice([0.0, 0.36, 1.0, -0.05])}

    seen = tuple(ProximitySensor(**law(), **place()) for _ in range(random.integers(1, 17)))
    linear = random.random() < 0.5
    bright = 2e4 if linear else 1.0
    lit = tuple(
        AmbientSensor(
            gain=bright * random.uniform(0.2, 4),
            floor_shift=random.uniform(-9, 9),
            dark_shift=random.uniform(-9, 9),
            **place(),
        )
        for _ in range(random.integers(1, 17))
    )
    beyond = {
        "response": "linear" if linear else "paper",
        "facing": random.choice([0.0, 1.4]),
        "lamp_height_cm": random.choice([0.0, 4.0]),
        "falloff": random.choice([1.0, 2.0]),
        "near_cm": random.choice([0.0, 0.7]),
        "lamp_narrow": random.choice([0.0, 0.6]),
        "lamp_proud_cm": random.choice([0.0, 0.8]),
        "matt": random.choice([0.0, 1.0]),
        "rays": random.choice([10.0, 27.0, 32.0, 50.0]),
        "sensor_height_cm": 1.0,
    }
    body = replace(PAPER.body, height_cm=random.choice([0.0, 2.5, 4.5, 6.0]))
    infrared = replace(
        PAPER.infrared, sensors=seen, exponent=random.choice([0.0, 1.0, 2.6]), matt=random.choice([0.0, 1.0])
    )
    ambient = replace(
        PAPER.ambient, sensors=lit, exponent=random.uniform(0, 3), reflectance=random.uniform(0, 2), **beyond
    )
    return replace(PAPER, body=body, infrared=infrared, ambient=ambient)


def random_pose(random: np.random.Generator, arena: Arena, radius: float = RADIUS):
    """A free pose, one in three of them touching or nearly touching something; None where there is none."""
    width, depth = arena.size_cm
    for _ in range(200):
        x, y = random.uniform(radius, width - radius), random.uniform(radius, depth - radius)
        if random.random() < 0.33:
            x = random.choice([radius, width - radius, x])
        if overlap(arena, x, y, radius) <= 0:
            return x, y, random.uniform(-7, 7)
    return None


def random_scenes(seed: int, count: int, *, robots: bool = True):
    """`count` times (profile, arena, pose)."""
    random = np.random.default_rng(seed)
    made = 0
    while made < count:
        profile = random_profile(random) if robots and made % 4 else PAPER
        arena = random_arena(random)
        pose = random_pose(random, arena)
        if pose is not None:
            made += 1
            yield profile, arena, pose


COUNTS = 0.05
"""Counts by which single precision may differ from the reference, but where the law itself jumps."""
NUDGES = ((1e-4, 0, 0), (-1e-4, 0, 0), (0, 1e-4, 0), (0, -1e-4, 0), (0, 0, 2e-5), (0, 0, -2e-5))
"""Movements (cm, cm, rad) that show that a law jumps somewhere."""


def agree(got: np.ndarray, law, profile: Profile, arena: Arena, pose) -> int:
    """Assert that readings are those of a reference `law`, or between what it says a micron away, where it
    jumps; returns how many such there are."""
    expected = np.array(law(profile, arena, pose))
    off = np.abs(got - expected) > COUNTS
    if not off.any():
        return 0
    around = np.array([expected, *(law(profile, arena, np.add(pose, nudge)) for nudge in NUDGES)])
    low, high = around.min(axis=0) - COUNTS, around.max(axis=0) + COUNTS
    assert ((low <= got) & (got <= high)).all(), f"{got[off]} instead of {expected[off]} at {pose}"
    return int(off.sum())


def nobody() -> Networks:
    """One network that does nothing."""
    return Networks(
        inputs=np.full(1, 8), neurons=np.full(1, 2), thresholds=np.zeros((1, 2), np.int16),
        sensor_links=np.zeros((1, 1, 4), np.int16), sensor_count=np.zeros(1, np.int64),
        links=np.zeros((1, 1, 4), np.int16), link_start=np.zeros((1, 3), np.int16),
    )  # fmt: skip


def work_for(profile: Profile, *, feed: int = 0, inputs: int = 8, nets: Networks | None = None):
    """Scratch for a robot that stands somewhere."""
    trial = Trial(steps=1, feed=feed, channels=np.arange(inputs), start=np.zeros(5))
    return new_scratch(profile.to_kernel(), trial, nobody() if nets is None else nets)


def readings(profile: Profile, arena: Arena | KernelArena, pose) -> tuple[np.ndarray, np.ndarray]:
    """What the kernels say that all sensors read without noise: proximity [P], ambient [A]."""
    work = work_for(profile)
    work.start[:] = pose
    proximity = np.zeros((1, len(profile.infrared.sensors)))
    ambient = np.zeros((1, len(profile.ambient.sensors)))
    noise = np.zeros(16 * noise_blocks(max(proximity.size, ambient.size)))
    streams = np.zeros(1, np.uint64)
    nothing = Trial(steps=0, feed=0, channels=np.zeros(0, np.int64), start=np.zeros(5))
    room = arena.to_kernel() if isinstance(arena, Arena) else arena
    world = World(robot=profile.to_kernel(), arena=room, task=nothing, level=0.0)
    loop.probe(world, streams, work, noise, proximity, ambient)
    return proximity[0], ambient[0]


__all__ = [
    "AVOIDANCE", "COUNTS", "EMPTY", "MOTOR_NOISE", "PAPER", "RADIUS", "SEEKING", "agree",
    "full_room", "nobody", "random_arena", "random_pose", "random_profile", "random_scenes", "readings",
    "work_for",
]  # fmt: skip
