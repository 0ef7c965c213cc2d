"""Networks judged by the slow obvious one."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings

from realitygap.control.genotype import Genotype, NetworkController
from realitygap.control.slots import decode
from realitygap.kernels.types import Networks
from tests.control.reference import ReferenceNetwork
from tests.control.strategies import SMALL, drives, genotypes


def commands(controller: NetworkController, steps) -> list[tuple[int, int]]:
    controller.reset()
    return [(c.left, c.right) for c in (controller.decide(inputs) for inputs in steps)]


def drive_dense(net: Networks, steps, i: int = 0) -> list[tuple[int, int]]:
    """What the dense arrays mean, spelled out: network `i` on a sequence of inputs."""
    m = int(net.neurons[i])
    outputs, held = [[0] * m], []
    made = []
    for inputs in steps:
        held.append(inputs)
        for _ in range(10):
            t = len(outputs) - 1
            total = [-int(threshold) for threshold in net.thresholds[i, :m]]
            for target, source, weight, delay in net.sensor_links[i, : net.sensor_count[i]].tolist():
                total[target] += weight * held[(t - delay) // 10][source] if t >= delay else 0
            for neuron in range(m):
                for e in range(net.link_start[i, neuron], net.link_start[i, neuron + 1]):
                    target, source, weight, delay = net.links[i, e].tolist()
                    assert target == neuron
                    total[neuron] += weight * outputs[t - delay][source] if t >= delay else 0
            outputs.append([min(10, max(-10, value)) for value in total])
        made.append((outputs[-1][0], outputs[-1][1]))
    return made


@given(genotypes(), drives())
def test_controller_is_the_reference(genes, steps):
    """A controller commands what the slow obvious network commands."""
    assert commands(Genotype(genes, 3).controller(), steps) == ReferenceNetwork(genes, 3).drive(steps)


@given(genotypes(), drives())
def test_decoded_arrays_are_the_reference(genes, steps):
    """Dense arrays, pruned or not, hold the same network as the genotype."""
    expected = ReferenceNetwork(genes, 3).drive(steps)
    assert drive_dense(decode(genes, 3), steps) == expected
    assert drive_dense(decode(genes, 3, prune=False), steps) == expected


@given(genotypes(), drives())
def test_reset_forgets_everything(genes, steps):
    """A controller that was reset drives as a new one."""
    controller = Genotype(genes, 3).controller()
    first = commands(controller, steps)
    assert commands(controller, steps) == first


@settings(max_examples=50)
@given(genotypes())
def test_dense_arrays_are_sorted(genes):
    """Outputs come first, sensor links by delay, other links by target, the rest is blank."""
    net = decode(genes, 3, prune=False)
    used, last = int(net.sensor_count[0]), int(net.link_start[0, net.neurons[0]])
    assert (net.thresholds[0, :2] == genes[3:5, 1]).all()
    assert (np.diff(net.sensor_links[0, :used, 3]) >= 0).all()
    assert (np.diff(net.links[0, :last, 0]) >= 0).all()
    assert not net.sensor_links[0, used:].any() and not net.links[0, last:].any()
    assert net.neurons[0] == genes[3:, 0].sum()
    assert used + last == sum(len(neuron.links) for neuron in Genotype(genes, 3).neurons)


def test_pruning_leaves_out_what_no_motor_hears():
    """A hidden neuron that reaches no motor, or only by weight 0, is left out; others stay."""
    genes = np.zeros(SMALL.shape, np.int8)
    genes[:9, 0] = 1
    genes[3, 2:6] = 1, 5, 2, 0  # the left motor hears slot 5,
    genes[5, 2:6] = 1, 6, 2, 0  # which hears slot 6;
    genes[4, 2:6] = 1, 7, 0, 0  # the right motor hears slot 7 with weight 0,
    genes[8, 2:6] = 1, 8, 4, 0  # and slot 8 hears itself alone.
    assert decode(genes, 3).neurons[0] == 4
    assert decode(genes, 3, prune=False).neurons[0] == 6
