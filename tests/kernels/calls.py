"""Small compiled loops over the kernels' own steps, one for each kernel that is judged over many calls."""

import numpy as np

from realitygap.kernels.jit import kernel
from realitygap.kernels.network import output, think, wake
from realitygap.kernels.rng import below, bits, log, normals, sin_cos, substream, uniform
from realitygap.kernels.trial import scale_input


@kernel
def drive(nets, n, inputs, work, commands):
    """Network `n` from silence through a sequence of inputs [steps, I] into commands [steps, 2]."""
    wake(nets, n, work)
    for k in range(inputs.shape[0]):
        for i in range(inputs.shape[1]):
            work.change[i] = inputs[k, i] - work.inputs[i]
            work.inputs[i] = inputs[k, i]
        think(nets, n, work)
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
