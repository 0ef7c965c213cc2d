"""Small compiled loops over the kernels' own steps, one for each kernel that is judged over many calls."""

import numpy as np

from realitygap.compiled import kernel
from realitygap.kernels.contact import settle
from realitygap.kernels.network import load_network, output, update_network
from realitygap.kernels.outline import settle_outline
from realitygap.kernels.rng import below, bits, log, normals, sin_cos, substream, uniform
from realitygap.kernels.trial import PROXIMITY, read, scale_input
from realitygap.kernels.wheels import turn_wheel
from tests.kernels.scenes import MOTOR_NOISE


@kernel
def drive(nets, n, inputs, work, commands):
    """Network `n` from silence through a sequence of inputs [steps, I] into commands [steps, 2]."""
    load_network(nets, n, work)
    for i in range(inputs.shape[1]):
        work.inputs[i] = 0
    for k in range(inputs.shape[0]):
        for i in range(inputs.shape[1]):
            work.change[i] = inputs[k, i] - work.inputs[i]
            work.inputs[i] = inputs[k, i]
        update_network(nets, n, work)
        for w in range(2):
            commands[k, w] = output(nets, n, work, w)


@kernel
def draw(stream, n, raw, uniforms, whole):
    """Draws 0, 1, … of a stream as bits, in [0, 1), and below n."""
    for i in range(raw.shape[0]):
        raw[i] = bits(stream, i)
        uniforms[i] = uniform(stream, i)
        whole[i] = below(stream, i, n)


@kernel
def draw_normals(stream, z):
    """Normal numbers of one stream, 16 at a time into the rows of z."""
    for i in range(z.shape[0]):
        normals(stream, 8 * i, z[i])


@kernel
def name_streams(stream, streams):
    """The substreams 0, 1, … of a stream."""
    for i in range(streams.shape[0]):
        streams[i] = substream(stream, np.uint64(i))


@kernel
def evaluate(x, logs, sines, cosines):
    """log |x|, sin x and cos x."""
    for i in range(x.shape[0]):
        logs[i] = log(abs(x[i]))
        sines[i], cosines[i] = sin_cos(x[i])


@kernel
def scale_inputs(low, high, readings, inputs):
    """Readings [steps, I] as inputs."""
    for k in range(readings.shape[0]):
        for i in range(readings.shape[1]):
            inputs[k, i] = scale_input(low, high, readings[k, i])


@kernel
def turn(robot, wheel, targets, drags, slips, speeds):
    """Speeds of a wheel through a sequence of targets."""
    for k in range(speeds.shape[0]):
        speeds[k] = turn_wheel(robot, wheel, targets[k], drags[k], slips[k])


@kernel
def read_often(robot, level, speed, motors, noise, readings):
    """Readings of one proximity sensor, each as it would be without noise, under these motors' noise."""
    for i in range(readings.shape[0]):
        noise[MOTOR_NOISE] = motors[i]
        read(robot, PROXIMITY, level, speed, noise, readings[i : i + 1])


@kernel
def slide(arena, radius, x, y, steps, ends):
    """Where a disc is after each of some steps [n, 2], and whether it touched anything [n, 3]."""
    for k in range(steps.shape[0]):
        x, y, touched = settle(arena, radius, x, y, steps[k, 0], steps[k, 1])
        ends[k, 0], ends[k, 1], ends[k, 2] = x, y, touched


@kernel
def slide_outline(arena, robot, pose, dx, dy, turn):
    """Where a body of an outline is after a step, how far it turned, whether it touched anything."""
    return settle_outline(arena, robot, pose, dx, dy, turn)
