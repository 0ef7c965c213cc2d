"""One trial, and one step of it as a recipe: sense, think, act, move, note (§3.2).

A task's score is computed from the notes when the trial is over.
"""

import math

from realitygap.kernels.contact import ground_speeds, settle
from realitygap.kernels.infrared import infrared, scale_noise
from realitygap.kernels.jit import step
from realitygap.kernels.light import ambient
from realitygap.kernels.network import LIMIT, output, think, wake
from realitygap.kernels.outline import settle_outline
from realitygap.kernels.rng import normals, sin_cos, uniform
from realitygap.kernels.wheels import FASTEST, Arc, bound_wheel, drive_arc, turn_wheel
from realitygap.kernels.work import DRAWS, MOTOR_NOISE, noise_blocks

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
def face(work):
    """Update the cosine and sine of the heading."""
    s, c = sin_cos(work.pose[2])
    work.pose[3] = c
    work.pose[4] = s


@step
def stand(pose, work):
    """Put the robot's body at `pose`."""
    for i in range(3):
        work.pose[i] = pose[i]
    face(work)


@step
def begin(nets, n, pose, work):
    """Robot at rest at `pose`, network silent."""
    stand(pose, work)
    for i in range(2):
        for j in range(work.wheel.shape[1]):
            work.wheel[i, j] = 0.0
    wake(nets, n, work)


@step
def draw_noise(level, stream, k, sensors, work):
    """Draw the normal numbers of step `k`: a function of the trial's stream and the step alone."""
    if level > 0.0:
        normals(stream, DRAWS * noise_blocks(sensors) * (k + 1), work.noise)


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
def sense(robot, arena, feed, level, work):
    """Readings of the sensors that the task feeds to the network."""
    near = near_fed(robot, feed)
    if feed != AMBIENT:
        infrared(robot, arena, work, work.readings[:near])
        read(robot, PROXIMITY, level, wheels_speed(work), work.noise, work.readings[:near])
    if feed != PROXIMITY:
        ambient(robot, arena, work, work.readings[near:])
        read(robot, AMBIENT, level, wheels_speed(work), work.noise[near:], work.readings[near:])


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
def feed_network(robot, task, work):
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
def act_on(robot, nets, n, level, w, work):
    """Motor neuron `w`'s output sets its wheel's target; friction and speed are noisy."""
    drag = 1.0
    slip = 0.0
    if level > 0.0:
        drag = 1.0 + level * robot.noise_friction * work.noise[w]
        slip = level * robot.noise_wheel * work.noise[2 + w]
    target = output(nets, n, work, w) * (robot.top_command / LIMIT) * robot.speed_per_unit[w]
    turn_wheel(robot, work.wheel[w], target, drag, slip)
    bound_wheel(work.wheel[w], FASTEST * robot.top_command * robot.speed_per_unit[w])


@step
def act(robot, nets, n, level, work):
    """The motor neurons' outputs drive both wheels."""
    for w in range(2):
        act_on(robot, nets, n, level, w, work)


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
    face(work)


@step
def note(path, k, work):
    """Note what the score will see of this step."""
    path.x[k] = work.pose[0]
    path.y[k] = work.pose[1]
    path.heading[k] = work.pose[2]
    path.left[k] = work.ground[0]
    path.right[k] = work.ground[1]
    path.contact[k] = work.ground[2]


@step
def run_trial(world, nets, n, stream, work, path):
    """One trial of network `n` from work.start, noted in `path`."""
    begin(nets, n, work.start, work)
    for k in range(world.task.steps):
        draw_noise(world.level, stream, k, work.readings.shape[0], work)
        sense(world.robot, world.arena, world.task.feed, world.level, work)
        feed_network(world.robot, world.task, work)
        think(nets, n, work)
        act(world.robot, nets, n, world.level, work)
        move(world.robot, world.arena, work)
        note(path, k, work)
