"""One trial, and one step of it as a recipe: draw noise, sense, to inputs, decide, move, store (§3.2).

A task's score is computed from what was stored when the trial is over.
"""

import math

from realitygap.compiled import step
from realitygap.kernels.brain import decide, load
from realitygap.kernels.contact import ground_speeds, settle
from realitygap.kernels.infrared import infrared, scale_noise
from realitygap.kernels.light import ambient
from realitygap.kernels.network import LIMIT
from realitygap.kernels.outline import settle_outline
from realitygap.kernels.params import Path
from realitygap.kernels.rng import normals, sin_cos, substream, uniform
from realitygap.kernels.wheels import FASTEST, Arc, bound_wheel, drive_arc, turn_wheel
from realitygap.kernels.work import DRAWS, MOTOR_NOISE, noise_blocks
from realitygap.streams import UNFED

PROXIMITY, AMBIENT, BOTH = 0, 1, 2


@step
def draw_start(task, stream, pose):
    """A start of the task: uniform in its disc and its range of headings (draws 0 to 2)."""
    radius = task.start[2] * math.sqrt(uniform(stream, 0))
    s, c = sin_cos(6.283185307179586 * uniform(stream, 1))
    pose[0] = task.start[0] + radius * c
    pose[1] = task.start[1] + radius * s
    pose[2] = task.start[3] + (task.start[4] - task.start[3]) * uniform(stream, 2)


@step
def update_heading(work):
    """Update the cosine and sine of the heading."""
    s, c = sin_cos(work.pose[2])
    work.pose[3] = c
    work.pose[4] = s


@step
def set_pose(pose, work):
    """Put the robot's body at `pose`."""
    for i in range(3):
        work.pose[i] = pose[i]
    update_heading(work)


@step
def start(pose, work):
    """Robot at rest at `pose`, all inputs 0."""
    set_pose(pose, work)
    for i in range(2):
        for j in range(work.wheel.shape[1]):
            work.wheel[i, j] = 0.0
    for i in range(work.inputs.shape[0]):
        work.inputs[i] = 0
        work.change[i] = 0


@step
def draw_noise(level, stream, k, work):
    """Draw the normal numbers of step `k`: a function of the trial's stream and the step alone."""
    if level > 0.0:
        normals(stream, DRAWS * noise_blocks(work.readings.shape[0]) * (k + 1), work.noise)


@step
def read(robot, feed, level, speed, noise, readings):
    """Apply the robot's converter to noise-free `readings`: noise, whole counts, clipping, dead zone.

    With a table of noise, `noise` is scaled in place.
    """
    lit, dark, top = robot.noise_proximity, robot.noise_proximity_dark, robot.proximity_top
    table, rise, dead = robot.proximity_noise, robot.proximity_rise, robot.proximity_dead
    if feed == AMBIENT:
        lit, dark, top = robot.noise_ambient, robot.noise_ambient, robot.ambient_top
        table, rise, dead = robot.ambient_noise, robot.ambient_rise, 0.0
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
def wheels_speed(work):
    """The wheels' mean absolute speed, cm/s, which the sensors' noise may rise with."""
    return 0.5 * (abs(work.wheel[0, 0]) + abs(work.wheel[1, 0]))


@step
def scale_input(low, high, reading):
    """A reading as an integer input −10 … 10, rounded half up ("bands" in a profile, §7.2)."""
    value = math.floor((reading - low) / (high - low) * (2.0 * LIMIT) - LIMIT + 0.5)
    return int(min(max(value, -float(LIMIT)), float(LIMIT)))


@step
def near_fed(robot, feed):
    """Number of fed readings that are proximity sensors'; they come first."""
    return 0 if feed == AMBIENT else robot.proximity_place.shape[0]


@step
def sense(world, stream, k, work):
    """Readings of the sensors that feed the controller, and of the others if there is room for them in
    work.unfed, with noise from a stream of their own.

    One kind of sensor after the other, so that each is compiled once, not once for each array that it may be
    read into.
    """
    robot, feed, level = world.robot, world.task.feed, world.level
    near = near_fed(robot, feed)
    for kind in range(BOTH):
        fed = feed == BOTH or feed == kind
        if not fed and work.unfed.shape[0] == 0:
            continue
        first = near if kind == AMBIENT else 0
        last = work.readings.shape[0] if kind == AMBIENT else near
        readings = work.readings[first:last] if fed else work.unfed[:]
        noise = work.noise[first:] if fed else work.unfed_noise[:]
        if kind == PROXIMITY:
            infrared(robot, world.arena, work, readings)
        else:
            ambient(robot, world.arena, work, readings)
        if not fed and level > 0.0:
            normals(substream(stream, UNFED), DRAWS * noise_blocks(readings.shape[0]) * k, noise)
        read(robot, kind, level, wheels_speed(work), noise, readings)


@step
def feed_input(low, high, i, channel, work):
    """Scale a reading to input `i`."""
    new = scale_input(low, high, work.readings[channel]) if channel >= 0 else 0
    work.change[i] = new - work.inputs[i]
    work.inputs[i] = new


@step
def feed_one(robot, task, near, i, work):
    """Scale a reading, the first `near` of which are proximity sensors', to input `i`."""
    channel = task.channels[i]
    if channel < near:
        feed_input(robot.proximity_low, robot.proximity_high, i, channel, work)
    else:
        feed_input(robot.ambient_low, robot.ambient_high, i, channel, work)


@step
def to_inputs(robot, task, work):
    """Scale readings to inputs; `change` keeps the difference to the previous step."""
    near = near_fed(robot, task.feed)
    low = robot.proximity_low if near > 0 else robot.ambient_low
    high = robot.proximity_high if near > 0 else robot.ambient_high
    if task.feed != BOTH:  # tested once: testing each input would take a sixth of a step
        for i in range(task.channels.shape[0]):
            feed_input(low, high, i, task.channels[i], work)
        return
    for i in range(task.channels.shape[0]):
        feed_one(robot, task, near, i, work)


@step
def turn_wheels(robot, commands, level, work):
    """Commands (left, right) set the wheels' targets; friction and speed are noisy."""
    for w in range(2):
        drag = 1.0
        slip = 0.0
        if level > 0.0:
            drag = 1.0 + level * robot.noise_friction * work.noise[w]
            slip = level * robot.noise_wheel * work.noise[2 + w]
        target = commands[w] * (robot.top_command / LIMIT) * robot.speed_per_unit[w]
        turn_wheel(robot, work.wheel[w], target, drag, slip)
        bound_wheel(work.wheel[w], FASTEST * robot.top_command * robot.speed_per_unit[w])


@step
def move(robot, arena, work):
    """The wheels' arcs carry the body, as far as walls and cylinders let it."""
    left = work.wheel[0, 0]
    right = work.wheel[1, 0]
    arc = drive_arc(robot.track, left, right, work.pose[3], work.pose[4], robot.period)
    if robot.outline.shape[0] == 0:
        x, y, touched = settle(arena, robot.radius, work.pose[0], work.pose[1], arc.dx, arc.dy)
    else:
        x, y, turn, touched = settle_outline(arena, robot, work.pose, arc.dx, arc.dy, arc.turn)
        arc = Arc(arc.dx, arc.dy, turn, arc.share, arc.cos_mean, arc.sin_mean)
    work.ground[2] = 1.0 if touched else 0.0
    if touched:
        left, right = ground_speeds(x - work.pose[0], y - work.pose[1], arc, robot.track, robot.period)
    work.ground[0] = left
    work.ground[1] = right
    work.pose[0] = x
    work.pose[1] = y
    work.pose[2] += arc.turn
    update_heading(work)


@step
def store(path, k, work):
    """Store what the score will see of this step."""
    path.x[k] = work.pose[0]
    path.y[k] = work.pose[1]
    path.heading[k] = work.pose[2]
    path.left[k] = work.ground[0]
    path.right[k] = work.ground[1]
    path.contact[k] = work.ground[2]


@step
def keep(record, k, commands, robot, feed, work):
    """Keep all else of this step, before the body moves: where it is, readings, inputs, commands, wheels."""
    near = near_fed(robot, feed)
    for i in range(near):
        record.proximity[k, i] = work.readings[i]
    for i in range(near, work.readings.shape[0]):
        record.ambient[k, i - near] = work.readings[i]
    other = record.ambient if near > 0 else record.proximity
    for i in range(work.unfed.shape[0]):
        other[k, i] = work.unfed[i]
    for i in range(work.inputs.shape[0]):
        record.inputs[k, i] = work.inputs[i]
    for i in range(3):
        record.pose[k, i] = work.pose[i]
    for w in range(2):
        record.commands[k, w] = commands[w]
        record.wheels[k, w] = work.wheel[w, 0] / robot.speed_per_unit[w]


@step
def run_trial(world, brain, n, stream, path, record, work):
    """One trial of controller `n` from work.start, stored in `path`, and in `record` if that has rows."""
    start(work.start, work)
    load(brain, n, work)  # §5.3: a network without a past
    for k in range(world.task.steps):  # §3.2: every 100 ms
        draw_noise(world.level, stream, k, work)  # §6
        sense(world, stream, k, work)  # §3.2.3 proximity, §3.3 ambient light
        to_inputs(world.robot, world.task, work)  # §7.2
        commands = decide(brain, n, work)  # §5.3
        turn_wheels(world.robot, commands, world.level, work)  # §3.2.2
        if record.pose.shape[0] > 0:
            keep(record, k, commands, world.robot, world.task.feed, work)
        move(world.robot, world.arena, work)  # §3.2.2
        store(path, k, work)  # for the score: §6.1, §6.2


@step
def run_each(world, brain, which, streams, paths, record, work):
    """Trial t runs controller which[t] on streams[t] from a start drawn there, and is stored in paths[t].

    Args:
        world: robot, arena, task and noise level.
        brain: N controllers, see brain.py.
        which: [T] numbers of controllers.
        streams: [T].
        paths: [T, 6, steps], the rows of params.Path.
        record: of the one trial, or without rows.
        work: scratch.
    """
    for t in range(which.shape[0]):
        draw_start(world.task, streams[t], work.start)
        p = paths[t]
        path = Path(p[0], p[1], p[2], p[3], p[4], p[5])
        run_trial(world, brain, which[t], streams[t], path, record, work)


@step
def take_up(robots, r, work):
    """Copy robot `r` into the scratch arrays."""
    set_pose(robots.pose[r], work)
    for i in range(2):
        for j in range(work.wheel.shape[1]):
            work.wheel[i, j] = robots.wheel[r, i, j]


@step
def put_back(robots, r, work):
    """Copy the scratch arrays back into robot `r`, with its readings."""
    for i in range(work.readings.shape[0]):
        robots.readings[r, i] = work.readings[i]
    for i in range(work.unfed.shape[0]):
        robots.unfed[r, i] = work.unfed[i]
    for i in range(3):
        robots.pose[r, i] = work.pose[i]
    for i in range(2):
        for j in range(work.wheel.shape[1]):
            robots.wheel[r, i, j] = work.wheel[i, j]


@step
def step_robot(world, robots, r, commands, work):
    """Robot `r`'s step under commands (left, right; −10 … 10), stored in its path as far as that reaches."""
    k = robots.step[r]
    take_up(robots, r, work)
    draw_noise(world.level, robots.stream[r], k, work)
    turn_wheels(world.robot, commands, world.level, work)
    move(world.robot, world.arena, work)
    if k < robots.path.shape[2]:
        p = robots.path[r]
        store(Path(p[0], p[1], p[2], p[3], p[4], p[5]), k, work)
    robots.step[r] += 1
