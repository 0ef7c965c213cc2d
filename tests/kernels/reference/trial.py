"""One whole trial, step by step: sense, think, act, move (§3.2)."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from realitygap.tasks.task import Task
from realitygap.world.robot import Profile
from realitygap.world.sensors import Ambient, Infrared
from tests.control.reference import ReferenceNetwork
from tests.kernels.reference.draws import normals, uniform
from tests.kernels.reference.motion import DT, Wheel, arc, settle
from tests.kernels.reference.sensors import ambient, proximity


def half_up(value: float) -> int:
    """Rounded to a whole number, halves upwards."""
    return math.floor(value + 0.5)


def counts(value: float, noise: float, top: float) -> float:
    """What the converter makes of a noise-free reading and its noise."""
    return float(min(max(half_up(value + noise), 0), top))


def scale(bands: tuple[float, float], reading: float) -> int:
    """A reading as a network input: bands[0] becomes −10, bands[1] +10."""
    low, high = bands
    return min(max(half_up(20 * (reading - low) / (high - low) - 10), -10), 10)


@dataclass
class Record:
    """What happened, a row a step."""

    readings: list[list[float]] = field(default_factory=list)
    inputs: list[list[int]] = field(default_factory=list)
    commands: list[tuple[int, int]] = field(default_factory=list)
    poses: list[tuple[float, float, float]] = field(default_factory=list)
    ground: list[tuple[float, float]] = field(default_factory=list)
    contact: list[bool] = field(default_factory=list)


def start(task: Task, stream: int) -> tuple[float, float, float]:
    """Uniform in the task's disc and range of headings: draws 0 to 2."""
    s = task.start
    radius = s.radius_cm * math.sqrt(uniform(stream, 0))
    angle = 2 * math.pi * uniform(stream, 1)
    low, high = (math.radians(degrees) for degrees in s.heading_deg)
    heading = low + (high - low) * uniform(stream, 2)
    return s.x_cm + radius * math.cos(angle), s.y_cm + radius * math.sin(angle), heading


def deviation(law: Infrared | Ambient, k: int, value: float, speed: float, plain: float) -> float:
    """Of sensor `k`'s noise at a noise-free reading while the wheels turn at `speed`: by its own table over
    the reading, if it has one; else the `plain` one."""
    sensor = law.sensors[k]
    if not sensor.noise:
        return plain
    steps = np.linspace(0.0, law.top, len(sensor.noise))
    return float(np.interp(value, steps, sensor.noise)) * (1.0 + sensor.noise_rise * speed)


def sense(task: Task, profile: Profile, pose, speed: float, level: float, z: list[float]) -> list[float]:
    """The fed sensors' readings: their noise is what is left of the step's after the motors' four."""
    noise, free, deviations, tops = profile.noise, [], [], []
    for feed in task.feeds.split("+"):
        law = profile.channel(feed)
        read = proximity if feed == "proximity" else ambient
        for k, value in enumerate(read(profile, task.arena, pose)):
            lit = noise.ambient if feed == "ambient" else noise.proximity
            plain = noise.proximity_dark if feed == "proximity" and value <= 0 else lit
            free.append(value)
            deviations.append(deviation(law, k, value, speed, plain))
            tops.append(law.top)
    return [
        counts(value, level * sd * draw, top)
        for value, sd, draw, top in zip(free, deviations, z[4 : 4 + len(free)], tops, strict=True)
    ]


def move(task: Task, profile: Profile, pose, left: float, right: float):
    """The pose after one step, the wheels' ground speeds and contact."""
    x, y, heading = pose
    track = profile.wheels.track_cm
    dx, dy, turn = arc(track, left, right, heading)
    to_x, to_y, touched = settle(task.arena, profile.body.radius_cm, x, y, dx, dy)
    if not touched:
        return (to_x, to_y, heading + turn), (left, right), False
    mean = heading + turn / 2
    chord = (to_x - x) * math.cos(mean) + (to_y - y) * math.sin(mean)
    along = chord * (turn / 2) / math.sin(turn / 2) if turn else chord
    ground = ((along - turn * track / 2) / DT, (along + turn * track / 2) / DT)
    return (to_x, to_y, heading + turn), ground, True


def run(task: Task, profile: Profile, genes, *, level: float, stream: int, pose=None) -> Record:
    """One trial of a genotype on a stream."""
    record, task = Record(), task.of(profile)
    pose = start(task, stream) if pose is None else pose
    network = ReferenceNetwork(genes, len(task.sensors))
    wheels = Wheel(profile), Wheel(profile)
    parts = {"proximity": profile.infrared, "ambient": profile.ambient}
    bands = [parts[kind].bands for kind in task.feeds.split("+") for _ in parts[kind].sensors]
    blocks = -(-(4 + len(bands)) // 16)
    units = profile.wheels.speed_per_unit_cm_s
    curves = [c for c in (profile.wheels.curve_left, profile.wheels.curve_right) if c]
    for k in range(task.steps):
        z = normals(stream, 8 * blocks * (k + 1), 16 * blocks)
        speed = sum(abs(wheel.speed) for wheel in wheels) / 2
        readings = sense(task, profile, pose, speed, level, z)
        inputs = [scale(bands[sensor], readings[sensor]) for sensor in task.sensors]
        command = network.decide(inputs)
        record.readings.append(readings)
        record.inputs.append(inputs)
        record.commands.append(command)
        speeds = []
        for w in range(2):
            asked = command[w] * profile.wheels.top_command / 10
            target = np.interp(asked, *np.array(curves[w]).T) if curves else asked * units[w]
            drag = 1 + level * profile.noise.friction * z[w]
            wheels[w].turn(target, drag, level * profile.noise.wheel * z[2 + w])
            speeds.append(wheels[w].bound(12.7 * profile.wheels.top_command * units[w]))
        pose, ground, touched = move(task, profile, pose, *speeds)
        record.poses.append(pose)
        record.ground.append(ground)
        record.contact.append(touched)
    return record
