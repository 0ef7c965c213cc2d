"""A trial, a step at a time (§3.2): its state and scratch, the step, and the kernels that Python calls.

All arrays are allocated once a batch, so that no step allocates.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from realitygap.compiled import kernel, step
from realitygap.kernels.infrared import infrared, receive, scale_noise, shift_readings
from realitygap.kernels.light import ambient, illuminate
from realitygap.kernels.motion import (
    FASTEST,
    Arc,
    body_clear,
    bound_wheel,
    drive_arc,
    ground_speeds,
    settle,
    settle_outline,
    turn_wheel,
)
from realitygap.kernels.network import LIMIT, ROWS, decide, load
from realitygap.kernels.rays import INVERSE, MIRROR
from realitygap.kernels.rng import normals, sin_cos, substream, uniform
from realitygap.kernels.types import F32, F, Networks, Path, Robot, Trial
from realitygap.streams import BETWEEN, UNFED

DRAWS = 8
"""Random draws of one block of noise, which give 16 normal numbers."""
MOTOR_NOISE = 4
"""Normal numbers of a step for the motors: friction left, right; speed left, right."""


class State(NamedTuple):
    """What a trial carries from one step to the next; the letters are those of types.py."""

    pose: F
    """[5] x, y, heading and the heading's cosine and sine."""
    wheel: F
    """[2, 9] see motion.py."""
    ground: F
    """[3] speeds of the wheels over the ground (cm/s), contact (0 or 1)."""
    inputs: NDArray[np.int32]
    """[I] the step's inputs."""
    change: NDArray[np.int32]
    """[I] their change since the previous step."""
    base: NDArray[np.int32]
    """[M] −threshold plus the inputs' contribution, of each computing neuron."""
    outputs: NDArray[np.int32]
    """[ROWS · M] see network.py."""
    settled: NDArray[np.int64]
    """[1] 1 if the network repeats itself until an input changes."""


class Scratch(NamedTuple):
    """Arrays that a step works in, and the state."""

    state: State
    start: F
    """[3] the trial's start: x, y, heading."""
    eyes: F32
    """Rows of eight sensors, see rays.py."""
    noise: F
    """[16·m] normal numbers of this step."""
    readings: F
    """[P, A or P + A] readings of the fed sensors, counts."""
    unfed: F
    """[A, P or 0] readings of the other sensors; 0: they are not read."""
    unfed_noise: F
    """[16·m] their normal numbers."""
    link_end: NDArray[np.uint64]
    """[M] number of the first link that is not this neuron's."""
    link_back: NDArray[np.uint64]
    """[K] offset back in `outputs` to a link's source."""
    link_weight: NDArray[np.int32]
    """[K]."""
    sensor_link: NDArray[np.int64]
    """[4, K + 1] the network's links from sensors: target, source, weight, delay."""


class Record(NamedTuple):
    """A trial in full, a row a step: see realitygap.track.Trajectory. Without rows: none is kept."""

    pose: F
    """[steps, 3] x, y, heading at the step's beginning."""
    proximity: F
    ambient: F
    inputs: NDArray[np.int64]
    commands: NDArray[np.int64]
    wheels: F


class Robots(NamedTuple):
    """N robots between two steps, each at its own, to be advanced by one from Python."""

    pose: F
    """[N, 3] x, y (cm), heading (rad)."""
    wheel: F
    """[N, 2, 9] see motion.py."""
    step: NDArray[np.int64]
    """[N] steps done."""
    stream: NDArray[np.uint64]
    """[N] of each robot's noise."""
    path: F
    """[N, 6, steps] the rows of types.Path; what lies beyond `steps` is not stored."""
    readings: F
    """[N, P, A or P + A] readings of the fed sensors, and [N, A, P or 0] of the others."""
    unfed: F


@step
def noise_blocks(sensors):
    """Blocks of 16 normal numbers that a step needs for `sensors` readings and the motors."""
    return (sensors + MOTOR_NOISE + 15) // 16


NO_NETWORK = Networks(
    inputs=np.zeros(0, np.int64), neurons=np.zeros(0, np.int64), thresholds=np.zeros((0, 2), np.int16),
    sensor_links=np.zeros((0, 1, 4), np.int16), sensor_count=np.zeros(0, np.int64),
    links=np.zeros((0, 1, 4), np.int16), link_start=np.zeros((0, 3), np.int16),
)  # fmt: skip
"""Where something else decides, or nothing."""
NO_RECORD = Record(
    pose=np.zeros((0, 3)), proximity=np.zeros((0, 0)), ambient=np.zeros((0, 0)),
    inputs=np.zeros((0, 0), np.int64), commands=np.zeros((0, 2), np.int64), wheels=np.zeros((0, 2)),
)  # fmt: skip


def unfed() -> Trial:
    """A trial without steps, whose network is fed nothing: for sensors and wheels alone."""
    return Trial(steps=0, feed=0, channels=np.zeros(0, np.int64), start=np.zeros(5))


def new_noise(sensors: int) -> F:
    """Room for a step's normal numbers."""
    return np.zeros(16 * noise_blocks(sensors))


def new_record(robot: Robot, inputs: int, steps: int) -> Record:
    """Room for a trial in full."""
    near, light = len(robot.proximity.place), len(robot.ambient.place)
    return Record(
        pose=np.zeros((steps, 3)), proximity=np.zeros((steps, near)), ambient=np.zeros((steps, light)),
        inputs=np.zeros((steps, inputs), np.int64), commands=np.zeros((steps, 2), np.int64),
        wheels=np.zeros((steps, 2)),
    )  # fmt: skip


def new_robots(count: int, steps: int, scratch: Scratch) -> Robots:
    """Robots that stand at (0, 0), with room for paths of so many steps."""
    return Robots(
        pose=np.zeros((count, 3)), wheel=np.zeros((count, *scratch.state.wheel.shape)),
        step=np.zeros(count, np.int64), stream=np.zeros(count, np.uint64),
        path=np.zeros((count, len(Path._fields), steps)),
        readings=np.zeros((count, len(scratch.readings))), unfed=np.zeros((count, len(scratch.unfed))),
    )  # fmt: skip


def new_scratch(robot: Robot, task: Trial, nets: Networks | None = None, *, whole: bool = False) -> Scratch:
    """Scratch arrays for trials of `task` by `robot`; `nets`: networks of the most neurons and links that are
    to decide; `whole`: also for sensors that feed no controller."""
    nets = NO_NETWORK if nets is None else nets
    near, light = len(robot.proximity.place), len(robot.ambient.place)
    sensors, unfed = (near, light, near + light)[task.feed], (light, near, 0)[task.feed] if whole else 0
    inputs, neurons, links = len(task.channels), nets.thresholds.shape[1], nets.links.shape[1]
    state = State(
        pose=np.zeros(5), wheel=np.zeros((2, 9)), ground=np.zeros(3), inputs=np.zeros(inputs, np.int32),
        change=np.zeros(inputs, np.int32), base=np.zeros(neurons, np.int32),
        outputs=np.zeros(ROWS * neurons, np.int32), settled=np.zeros(1, np.int64),
    )  # fmt: skip
    return Scratch(
        state=state, start=np.zeros(3), eyes=np.zeros(int(INVERSE + MIRROR + MIRROR), np.float32),
        noise=new_noise(sensors), readings=np.zeros(sensors),
        unfed=np.zeros(unfed), unfed_noise=new_noise(unfed),
        link_end=np.zeros(neurons, np.uint64), link_back=np.zeros(links, np.uint64),
        link_weight=np.zeros(links, np.int32), sensor_link=np.zeros((4, links + 1), np.int64),
    )  # fmt: skip


PROXIMITY, AMBIENT, BOTH = 0, 1, 2
APART = 1024
"""Draws of one kind of sensor before the next kind's."""


@step
def draw_start(task, stream, pose):
    """A start of the task: uniform in its disc and its range of headings (draws 0 to 2)."""
    radius = task.start[2] * math.sqrt(uniform(stream, 0))
    s, c = sin_cos(6.283185307179586 * uniform(stream, 1))
    pose[0] = task.start[0] + radius * c
    pose[1] = task.start[1] + radius * s
    pose[2] = task.start[3] + (task.start[4] - task.start[3]) * uniform(stream, 2)


@step
def update_heading(pose):
    """Update the cosine and sine of the heading."""
    s, c = sin_cos(pose[2])
    pose[3] = c
    pose[4] = s


@step
def set_pose(there, pose):
    """Put the robot's body `there` (x, y, heading)."""
    for i in range(3):
        pose[i] = there[i]
    update_heading(pose)


@step
def start(pose, state):
    """Robot at rest at `pose`, all inputs 0."""
    set_pose(pose, state.pose)
    for i in range(2):
        for j in range(state.wheel.shape[1]):
            state.wheel[i, j] = 0.0
    for i in range(state.inputs.shape[0]):
        state.inputs[i] = 0
        state.change[i] = 0


@step
def draw_noise(level, stream, k, scratch):
    """Draw the normal numbers of step `k`: a function of the trial's stream and the step alone."""
    if level > 0.0:
        normals(stream, DRAWS * noise_blocks(scratch.readings.shape[0]) * (k + 1), scratch.noise)


@step
def read(robot, feed, level, speed, noise, readings):
    """Apply the robot's converter to noise-free `readings`: noise, whole counts, clipping, dead zone.

    With a table of noise, `noise` is scaled in place.
    """
    lit, dark, top = robot.noise.proximity, robot.noise.proximity_dark, robot.proximity.top
    table, rise, dead = robot.proximity.noise, robot.proximity.rise, robot.proximity.dead
    if feed == AMBIENT:
        lit, dark, top = robot.noise.ambient, robot.noise.ambient, robot.ambient.top
        table, rise, dead = robot.ambient.noise, robot.ambient.rise, 0.0
    if table.shape[1] > 0 and level > 0.0:
        lit = dark = 1.0
        scale_noise(table, rise, readings, top, speed, noise[MOTOR_NOISE:])
    for i in range(readings.shape[0]):
        value = readings[i]
        if level > 0.0:
            size = lit if value > 0.0 else dark
            value += level * size * noise[MOTOR_NOISE + i]
        value = min(max(math.floor(value + 0.5), 0.0), top)
        readings[i] = value if value >= dead else 0.0


@step
def draw_between(robot, kind, stream, level, readings):
    """Move noise-free readings of a kind as they differ between recordings: the same throughout a trial."""
    between = robot.ambient.between if kind == AMBIENT else robot.proximity.between
    if between.shape[0] > 0 and level > 0.0:
        top = robot.ambient.top if kind == AMBIENT else robot.proximity.top
        shift_readings(between, substream(stream, BETWEEN), APART * kind, top, level, readings)


@step
def wheels_speed(state):
    """The wheels' mean absolute speed, cm/s, which the sensors' noise may rise with."""
    return 0.5 * (abs(state.wheel[0, 0]) + abs(state.wheel[1, 0]))


@step
def scale_input(low, high, reading):
    """A reading as an integer input −10 … 10, rounded half up ("bands" in a profile, §7.2)."""
    value = math.floor((reading - low) / (high - low) * (2.0 * LIMIT) - LIMIT + 0.5)
    return int(min(max(value, -float(LIMIT)), float(LIMIT)))


@step
def near_fed(robot, feed):
    """Number of fed readings that are proximity sensors'; they come first."""
    return 0 if feed == AMBIENT else robot.proximity.place.shape[0]


@step
def sense(world, stream, k, state, scratch):
    """Readings of the sensors that feed the controller, and of the others if there is room for them in
    scratch.unfed, with noise from a stream of their own.

    One kind of sensor after the other, so that each is compiled once, not once for each array that it may be
    read into.
    """
    robot, feed, level = world.robot, world.task.feed, world.level
    near = near_fed(robot, feed)
    for kind in range(BOTH):
        fed = feed == BOTH or feed == kind
        if not fed and scratch.unfed.shape[0] == 0:
            continue
        first = near if kind == AMBIENT else 0
        last = scratch.readings.shape[0] if kind == AMBIENT else near
        readings = scratch.readings[first:last] if fed else scratch.unfed[:]
        noise = scratch.noise[first:] if fed else scratch.unfed_noise[:]
        if kind == PROXIMITY:
            infrared(robot, world.arena, state.pose, scratch.eyes, readings)
        else:
            ambient(robot, world.arena, state.pose, scratch.eyes, readings)
        draw_between(robot, kind, stream, level, readings)
        if not fed and level > 0.0:
            normals(substream(stream, UNFED), DRAWS * noise_blocks(readings.shape[0]) * k, noise)
        read(robot, kind, level, wheels_speed(state), noise, readings)


@step
def feed_input(low, high, i, channel, readings, state):
    """Scale a reading to input `i`."""
    new = scale_input(low, high, readings[channel]) if channel >= 0 else 0
    state.change[i] = new - state.inputs[i]
    state.inputs[i] = new


@step
def to_inputs(robot, task, readings, state):
    """Scale readings to inputs; `change` keeps the difference to the previous step."""
    near = near_fed(robot, task.feed)
    low = robot.proximity.low if near > 0 else robot.ambient.low
    high = robot.proximity.high if near > 0 else robot.ambient.high
    if task.feed != BOTH:  # tested once: testing each input would take a sixth of a step
        for i in range(task.channels.shape[0]):
            feed_input(low, high, i, task.channels[i], readings, state)
        return
    for i in range(task.channels.shape[0]):
        channel = task.channels[i]
        if channel < near:
            feed_input(robot.proximity.low, robot.proximity.high, i, channel, readings, state)
        else:
            feed_input(robot.ambient.low, robot.ambient.high, i, channel, readings, state)


@step
def turn_wheels(robot, commands, level, noise, state):
    """Commands (left, right) set the wheels' targets; friction and speed are noisy."""
    for w in range(2):
        drag = 1.0
        slip = 0.0
        if level > 0.0:
            drag = 1.0 + level * robot.noise.friction * noise[w]
            slip = level * robot.noise.wheel * noise[2 + w]
        target = commands[w] * (robot.wheels.top_command / LIMIT) * robot.wheels.speed_per_unit[w]
        turn_wheel(robot, state.wheel[w], target, drag, slip)
        bound_wheel(state.wheel[w], FASTEST * robot.wheels.top_command * robot.wheels.speed_per_unit[w])


@step
def move(robot, arena, state):
    """The wheels' arcs carry the body, as far as walls and cylinders let it."""
    left = state.wheel[0, 0]
    right = state.wheel[1, 0]
    arc = drive_arc(robot.wheels.track, left, right, state.pose[3], state.pose[4], robot.period)
    if robot.outline.shape[0] == 0:
        x, y, touched = settle(arena, robot.radius, state.pose[0], state.pose[1], arc.dx, arc.dy)
    else:
        x, y, turn, touched = settle_outline(arena, robot, state.pose, arc.dx, arc.dy, arc.turn)
        arc = Arc(arc.dx, arc.dy, turn, arc.share, arc.cos_mean, arc.sin_mean)
    state.ground[2] = 1.0 if touched else 0.0
    if touched:
        left, right = ground_speeds(
            x - state.pose[0], y - state.pose[1], arc, robot.wheels.track, robot.period
        )
    state.ground[0] = left
    state.ground[1] = right
    state.pose[0] = x
    state.pose[1] = y
    state.pose[2] += arc.turn
    update_heading(state.pose)


@step
def store(path, k, state):
    """Store what the score will see of this step."""
    path.x[k] = state.pose[0]
    path.y[k] = state.pose[1]
    path.heading[k] = state.pose[2]
    path.left[k] = state.ground[0]
    path.right[k] = state.ground[1]
    path.contact[k] = state.ground[2]


@step
def keep(record, k, commands, robot, feed, state, scratch):
    """Keep all else of this step, before the body moves: where it is, readings, inputs, commands, wheels."""
    near = near_fed(robot, feed)
    for i in range(near):
        record.proximity[k, i] = scratch.readings[i]
    for i in range(near, scratch.readings.shape[0]):
        record.ambient[k, i - near] = scratch.readings[i]
    other = record.ambient if near > 0 else record.proximity
    for i in range(scratch.unfed.shape[0]):
        other[k, i] = scratch.unfed[i]
    for i in range(state.inputs.shape[0]):
        record.inputs[k, i] = state.inputs[i]
    for i in range(3):
        record.pose[k, i] = state.pose[i]
    for w in range(2):
        record.commands[k, w] = commands[w]
        record.wheels[k, w] = state.wheel[w, 0] / robot.wheels.speed_per_unit[w]


@step
def run_trial(world, brain, n, stream, path, record, scratch):
    """One trial of controller `n` from scratch.start, stored in `path`, and in `record` if that has rows."""
    state = scratch.state
    start(scratch.start, state)
    load(brain, n, state, scratch)  # §5.3: a network without a past
    for k in range(world.task.steps):  # §3.2: every 100 ms
        draw_noise(world.level, stream, k, scratch)  # §6
        sense(world, stream, k, state, scratch)  # §3.2.3 proximity, §3.3 ambient light
        to_inputs(world.robot, world.task, scratch.readings, state)  # §7.2
        commands = decide(brain, n, state, scratch)  # §5.3
        turn_wheels(world.robot, commands, world.level, scratch.noise, state)  # §3.2.2
        if record.pose.shape[0] > 0:
            keep(record, k, commands, world.robot, world.task.feed, state, scratch)
        move(world.robot, world.arena, state)  # §3.2.2
        store(path, k, state)  # for the score: §6.1, §6.2


@step
def run_each(world, brain, which, streams, paths, record, scratch):
    """Trial t runs controller which[t] on streams[t] from a start drawn there, and is stored in paths[t].

    Args:
        world: robot, arena, task and noise level.
        brain: N controllers, see network.py.
        which: [T] numbers of controllers.
        streams: [T].
        paths: [T, 6, steps], the rows of types.Path.
        record: of the one trial, or without rows.
        scratch: of the robot, for such controllers.
    """
    for t in range(which.shape[0]):
        draw_start(world.task, streams[t], scratch.start)
        p = paths[t]
        path = Path(p[0], p[1], p[2], p[3], p[4], p[5])
        run_trial(world, brain, which[t], streams[t], path, record, scratch)


@step
def take_up(robots, r, state):
    """Copy robot `r` into the state."""
    set_pose(robots.pose[r], state.pose)
    for i in range(2):
        for j in range(state.wheel.shape[1]):
            state.wheel[i, j] = robots.wheel[r, i, j]


@step
def put_back(robots, r, state, scratch):
    """Copy the state back into robot `r`, with its readings."""
    for i in range(scratch.readings.shape[0]):
        robots.readings[r, i] = scratch.readings[i]
    for i in range(scratch.unfed.shape[0]):
        robots.unfed[r, i] = scratch.unfed[i]
    for i in range(3):
        robots.pose[r, i] = state.pose[i]
    for i in range(2):
        for j in range(state.wheel.shape[1]):
            robots.wheel[r, i, j] = state.wheel[i, j]


@step
def step_robot(world, robots, r, commands, state, scratch):
    """Robot `r`'s step under commands (left, right; −10 … 10), stored in its path as far as that reaches."""
    k = robots.step[r]
    take_up(robots, r, state)
    draw_noise(world.level, robots.stream[r], k, scratch)
    turn_wheels(world.robot, commands, world.level, scratch.noise, state)
    move(world.robot, world.arena, state)
    if k < robots.path.shape[2]:
        p = robots.path[r]
        store(Path(p[0], p[1], p[2], p[3], p[4], p[5]), k, state)
    robots.step[r] += 1


@kernel
def run_trials(world, nets, which, streams, paths, record, scratch):
    """Trials of networks, as of `run_each`."""
    run_each(world, nets, which, streams, paths, record, scratch)


@kernel
def advance(world, robots, which, starts, commands, scratch):
    """Advance robots `which`: the first ones, as many as there are starts, begin a trial at rest at starts[i]
    (x, y, heading); the others do a step under commands[i] (left, right). All then read their sensors for the
    next step.

    One kernel for both, since reading the sensors is most of it. Under the commands of a network the bits are
    those of that network's trial.
    """
    state = scratch.state
    for i in range(which.shape[0]):
        r = which[i]
        if i < starts.shape[0]:
            start(starts[i], state)
            robots.step[r] = 0
        else:
            step_robot(world, robots, r, commands[i], state, scratch)
        draw_noise(world.level, robots.stream[r], robots.step[r], scratch)
        sense(world, robots.stream[r], robots.step[r], state, scratch)
        put_back(robots, r, state, scratch)


@kernel
def draw_starts(task, streams, starts):
    """Draw the starts (x, y, heading) of trials on `streams` into starts[t]."""
    for t in range(streams.shape[0]):
        draw_start(task, streams[t], starts[t])


@kernel
def probe(world, streams, scratch, noise, proximity, ambients):
    """Readings of all sensors at scratch.start, once for each stream, into proximity[t], ambients[t].

    Without noise the readings are the model's, unrounded.
    """
    robot, arena, level = world.robot, world.arena, world.level
    pose = scratch.state.pose
    set_pose(scratch.start, pose)
    for t in range(streams.shape[0]):
        infrared(robot, arena, pose, scratch.eyes, proximity[t])
        ambient(robot, arena, pose, scratch.eyes, ambients[t])
        draw_between(robot, PROXIMITY, streams[t], level, proximity[t])
        draw_between(robot, AMBIENT, streams[t], level, ambients[t])
        if level > 0.0:
            normals(streams[t], 0, noise)
            read(robot, PROXIMITY, level, 0.0, noise, proximity[t])
            normals(substream(streams[t], UNFED), 0, noise)
            read(robot, AMBIENT, level, 0.0, noise, ambients[t])
        else:
            for i in range(proximity.shape[1]):
                proximity[t, i] *= 1.0 if proximity[t, i] >= robot.proximity.dead else 0.0


@kernel
def is_clear(robot, arena, x, y, heading):
    """True if the robot's body at a pose overlaps nothing."""
    return body_clear(robot, arena, x, y, heading)


@kernel
def sweep_infrared(robot, arena, poses, scratch, out):
    """Proximity readings at poses [n, 3] into out [n, P], unrounded."""
    pose = scratch.state.pose
    for i in range(poses.shape[0]):
        set_pose(poses[i], pose)
        infrared(robot, arena, pose, scratch.eyes, out[i])


@kernel
def sweep_received(robot, arena, poses, scratch, out):
    """Light for measured sensors at poses [n, 3] into out [n, P], before their curves."""
    pose = scratch.state.pose
    for i in range(poses.shape[0]):
        set_pose(poses[i], pose)
        receive(robot, arena, pose, scratch.eyes, out[i])


@kernel
def sweep_light(robot, arena, poses, scratch, out):
    """Illumination of the ambient sensors at poses [n, 3] into out [n, A], before their gains."""
    pose = scratch.state.pose
    for i in range(poses.shape[0]):
        set_pose(poses[i], pose)
        illuminate(robot, arena, True, pose, scratch.eyes, out[i])


@kernel
def sweep_direct(robot, arena, poses, scratch, out):
    """As sweep_light, direct light only: where nothing near could reflect any."""
    pose = scratch.state.pose
    for i in range(poses.shape[0]):
        set_pose(poses[i], pose)
        illuminate(robot, arena, False, pose, scratch.eyes, out[i])


@kernel
def sweep_wheels(robot, commands, first, scratch, speeds):
    """Speeds [n, 2] (cm/s) of both wheels after each step of commands [n, 2] (Khepera units).

    Wheels stand still before each row that `first` marks with 1.
    """
    wheel = scratch.state.wheel
    for i in range(commands.shape[0]):
        for w in range(2):
            if first[i] != 0:
                for j in range(wheel.shape[1]):
                    wheel[w, j] = 0.0
            target = commands[i, w] * robot.wheels.speed_per_unit[w]
            speeds[i, w] = turn_wheel(robot, wheel[w], target, 1.0, 0.0)
