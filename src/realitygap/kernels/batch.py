"""Entry points for Python: many trials, one recorded trial, a step in two halves, readings at a pose."""

from realitygap.kernels.infrared import infrared
from realitygap.kernels.jit import kernel, step
from realitygap.kernels.light import ambient
from realitygap.kernels.network import output, think
from realitygap.kernels.outline import body_clear
from realitygap.kernels.params import Path
from realitygap.kernels.rng import normals, substream
from realitygap.kernels.trial import (
    AMBIENT,
    BOTH,
    PROXIMITY,
    act,
    begin,
    draw_noise,
    draw_start,
    feed_network,
    move,
    near_fed,
    note,
    read,
    run_trial,
    stand,
    wheels_speed,
)
from realitygap.kernels.work import DRAWS, noise_blocks
from realitygap.streams import ASIDE


@kernel
def run_trials(world, nets, which, streams, paths, work):
    """Trial t runs network which[t] on streams[t] from a start drawn there, and is noted in paths[t].

    `paths` is [trials, 6, steps]: the rows of params.Path.
    """
    for t in range(which.shape[0]):
        draw_start(world.task, streams[t], work.start)
        p = paths[t]
        path = Path(p[0], p[1], p[2], p[3], p[4], p[5])
        run_trial(world, nets, which[t], streams[t], work, path)


@step
def sense_both(world, stream, k, whole, work, aside):
    """As `sense`, and if `whole` also the sensors that feed no input in this trial, with noise from a stream
    of their own.

    One kind of sensor after the other, so that each is compiled once, not once for each array that it may be
    read into.
    """
    robot, feed, level = world.robot, world.task.feed, world.level
    near = near_fed(robot, feed)
    for kind in range(BOTH):
        fed = feed == BOTH or feed == kind
        first = near if kind == AMBIENT else 0
        last = work.readings.shape[0] if kind == AMBIENT else near
        readings = work.readings[first:last] if fed else aside.readings[:]
        noise = work.noise[first:] if fed else aside.noise[:]
        if not fed and not whole:
            continue
        if kind == PROXIMITY:
            infrared(robot, world.arena, work, readings)
        else:
            ambient(robot, world.arena, work, readings)
        if not fed and level > 0.0:
            blocks = noise_blocks(readings.shape[0])
            normals(substream(stream, ASIDE), DRAWS * blocks * k, noise)
        read(robot, kind, level, wheels_speed(work), noise, readings)


@step
def keep_readings(near, aside, work, record, k):
    """Write both kinds of readings, and the inputs made from them, into row `k` of the record.

    The first `near` fed readings are the proximity sensors'.
    """
    for i in range(near):
        record.proximity[k, i] = work.readings[i]
    for i in range(near, work.readings.shape[0]):
        record.ambient[k, i - near] = work.readings[i]
    other = record.ambient if near > 0 else record.proximity
    for i in range(aside.shape[0]):
        other[k, i] = aside[i]
    for i in range(work.inputs.shape[0]):
        record.inputs[k, i] = work.inputs[i]
    for i in range(3):
        record.pose[k, i] = work.pose[i]


@kernel
def record_trial(world, nets, stream, work, aside, record):
    """One trial of network 0 from work.start, recorded in full in `record`: the same bits as run_trials."""
    robot, task, level = world.robot, world.task, world.level
    begin(nets, 0, work.start, work)
    for k in range(task.steps):
        draw_noise(level, stream, k, work.readings.shape[0], work)
        sense_both(world, stream, k, True, work, aside)
        feed_network(robot, task, work)
        keep_readings(near_fed(robot, task.feed), aside.readings, work, record, k)
        think(nets, 0, work)
        act(robot, nets, 0, level, work)
        move(robot, world.arena, work)
        note(record.path, k, work)
        for w in range(2):
            record.commands[k, w] = output(nets, 0, work, w)
            record.wheels[k, w] = work.wheel[w, 0] / robot.speed_per_unit[w]


@kernel
def set_down(nets, work):
    """Put the robot at rest at work.start, wheels without commands."""
    begin(nets, 0, work.start, work)
    work.outputs[0] = 0
    work.outputs[1] = 0


@kernel
def sense_now(world, stream, k, both, work, aside):
    """The first half of step `k`, for controllers that are not kernels: readings of the fed sensors into
    work.readings, of the others into `aside`.

    A function of the trial's stream, the step and the pose: the same bits as record_trial.
    """
    draw_noise(world.level, stream, k, work.readings.shape[0], work)
    sense_both(world, stream, k, both, work, aside)


@kernel
def move_on(world, nets, stream, k, work):
    """The second half of step `k`: wheels and movement, under the commands in work.outputs."""
    draw_noise(world.level, stream, k, work.readings.shape[0], work)
    act(world.robot, nets, 0, world.level, work)
    move(world.robot, world.arena, work)


@kernel
def draw_starts(task, streams, starts):
    """Draw the starts (x, y, heading) of trials on `streams` into starts[t]."""
    for t in range(streams.shape[0]):
        draw_start(task, streams[t], starts[t])


@kernel
def probe(world, streams, work, noise, proximity, ambients):
    """Readings of all sensors at work.start, once for each stream, into proximity[t], ambients[t].

    Without noise the readings are the model's, unrounded.
    """
    robot, arena, level = world.robot, world.arena, world.level
    stand(work.start, work)
    for t in range(streams.shape[0]):
        infrared(robot, arena, work, proximity[t])
        ambient(robot, arena, work, ambients[t])
        if level > 0.0:
            normals(streams[t], 0, noise)
            read(robot, PROXIMITY, level, 0.0, noise, proximity[t])
            normals(substream(streams[t], ASIDE), 0, noise)
            read(robot, AMBIENT, level, 0.0, noise, ambients[t])
        else:
            for i in range(proximity.shape[1]):
                proximity[t, i] *= 1.0 if proximity[t, i] >= robot.proximity_dead else 0.0


@kernel
def is_clear(robot, arena, x, y, heading):
    """True if the robot's body at a pose overlaps nothing."""
    return body_clear(robot, arena, x, y, heading)
