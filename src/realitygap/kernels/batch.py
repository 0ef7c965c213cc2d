"""Entry points for Python: many trials, a step of many robots, readings at a pose."""

from realitygap.compiled import kernel
from realitygap.kernels.infrared import infrared
from realitygap.kernels.light import ambient
from realitygap.kernels.outline import body_clear
from realitygap.kernels.rng import normals, substream
from realitygap.kernels.trial import (
    AMBIENT,
    PROXIMITY,
    draw_noise,
    draw_start,
    put_back,
    read,
    run_each,
    sense,
    set_pose,
    start,
    step_robot,
)
from realitygap.streams import UNFED


@kernel
def run_trials(world, nets, which, streams, paths, record, work):
    """Trials of networks, as of `run_each`."""
    run_each(world, nets, which, streams, paths, record, work)


@kernel
def advance(world, robots, which, starts, commands, work):
    """Advance robots `which`: the first ones, as many as there are starts, begin a trial at rest at starts[i]
    (x, y, heading); the others do a step under commands[i] (left, right). All then read their sensors for the
    next step.

    One kernel for both, since reading the sensors is most of it. Under the commands of a network the bits are
    those of that network's trial.
    """
    for i in range(which.shape[0]):
        r = which[i]
        if i < starts.shape[0]:
            start(starts[i], work)
            robots.step[r] = 0
        else:
            step_robot(world, robots, r, commands[i], work)
        draw_noise(world.level, robots.stream[r], robots.step[r], work)
        sense(world, robots.stream[r], robots.step[r], work)
        put_back(robots, r, work)


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
    set_pose(work.start, work)
    for t in range(streams.shape[0]):
        infrared(robot, arena, work, proximity[t])
        ambient(robot, arena, work, ambients[t])
        if level > 0.0:
            normals(streams[t], 0, noise)
            read(robot, PROXIMITY, level, 0.0, noise, proximity[t])
            normals(substream(streams[t], UNFED), 0, noise)
            read(robot, AMBIENT, level, 0.0, noise, ambients[t])
        else:
            for i in range(proximity.shape[1]):
                proximity[t, i] *= 1.0 if proximity[t, i] >= robot.proximity_dead else 0.0


@kernel
def is_clear(robot, arena, x, y, heading):
    """True if the robot's body at a pose overlaps nothing."""
    return body_clear(robot, arena, x, y, heading)
