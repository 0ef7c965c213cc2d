"""The delay network's kernel, judged by the slow obvious network: exactly, for all is integers (§5.3)."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from realitygap.control.encoding import Variation
from realitygap.control.slots import decode
from realitygap.kernels.types import Networks
from tests.control.reference import ReferenceNetwork
from tests.control.strategies import SMALL, drives, genotypes
from tests.kernels import calls
from tests.kernels.scenes import PAPER, work_for

WHOLE = Variation()


def driven(nets: Networks, inputs, n: int = 0) -> list[tuple[int, int]]:
    """What the kernel commands on a sequence of inputs."""
    inputs = np.asarray(inputs, np.int64)
    commands = np.full((inputs.shape[0], 2), -99)
    calls.drive(nets, n, inputs, work_for(PAPER, inputs=inputs.shape[1], nets=nets), commands)
    return [tuple(row) for row in commands.tolist()]


def agree(genes, layout: Variation, inputs) -> None:
    expected = ReferenceNetwork(genes, layout.inputs).drive(inputs)
    for prune in (True, False):
        assert driven(decode(genes, layout.inputs, prune=prune), inputs) == expected


@settings(max_examples=200)
@given(genotypes(), drives(steps=12))
def test_small_networks(genes, inputs):
    """Any network of a small layout commands what the reference commands, step by step."""
    agree(genes, SMALL, inputs)


@settings(max_examples=60)
@given(genotypes(WHOLE), st.integers(0, 2**32 - 1), st.sampled_from(["new", "rare", "blips", "one"]))
def test_networks_of_the_paper(genes, seed, kind):
    """Networks of up to twenty hidden neurons, on inputs that hold for long, change rarely, or blip."""
    agree(genes, WHOLE, sequence(np.random.default_rng(seed), kind, 25, 8))


def sequence(random: np.random.Generator, kind: str, steps: int, inputs: int) -> list[list[int]]:
    """Inputs that let a network settle, and then disturb it a little."""
    rows = random.integers(-10, 11, (steps, inputs))
    for k in range(1, steps):
        if kind == "rare" and random.random() < 0.85:
            rows[k] = rows[k - 1]
        elif kind == "one" and random.random() < 0.9:
            kept = random.integers(inputs)
            rows[k, np.arange(inputs) != kept] = rows[k - 1, np.arange(inputs) != kept]
        elif kind == "blips":
            rows[k] = rows[0] if k % 6 else rows[k]
    return rows.tolist()


def chain(delays, layout: Variation = WHOLE, threshold: int = 0) -> np.ndarray:
    """Sensor 0 → hidden → hidden → … → left motor, each link of weight 1 with its own delay."""
    genes = np.zeros(layout.shape, np.int8)
    genes[: layout.inputs + 2, 0] = 1
    slots = list(range(layout.inputs + 2, layout.inputs + 2 + len(delays) - 1))
    genes[slots, 0] = 1
    genes[slots, 1] = threshold
    for source, target, delay in zip([0, *slots], [*slots, layout.inputs], delays, strict=True):
        genes[target, 2:6] = 1, source, 1, delay
    return genes


@pytest.mark.parametrize("first", range(5))
@pytest.mark.parametrize("rest", range(5))
def test_a_signal_in_a_long_chain_is_never_lost(first, rest):
    """A signal on its way through many delays keeps the network awake until it has arrived."""
    for length in (1, 2, 3, 10, 20):
        genes = chain([first] + [rest] * length)
        inputs = [[0] * 8] * 3 + [[7] + [0] * 7] * 30 + [[0] * 8] + [[7] + [0] * 7] * 29
        agree(genes, WHOLE, inputs)
        commands = [left for left, _ in driven(decode(genes, 8), inputs)]
        # Each link takes its delay and one update; the first change is at update 30.
        arrived = 30 + (first + 1) + length * (rest + 1)
        expected = [7 if 10 * (k + 1) >= arrived else 0 for k in range(33)]
        assert commands[:33] == expected


def test_slow_oscillators():
    """Loops with long delays that change seldom are not taken for settled."""
    random = np.random.default_rng(15)
    moved = 0
    for _ in range(150):
        genes = np.zeros(WHOLE.shape, np.int8)
        genes[:10, 0] = 1
        ring = 10 + np.arange(random.integers(1, 20))
        genes[ring, 0] = 1
        for slot, before in zip(ring, np.roll(ring, 1), strict=True):
            genes[slot, 1] = random.integers(-1, 2)
            genes[slot, 2:6] = 1, before, random.choice([-1, 1, 2, -2]), random.integers(2, 5)
        genes[8, 2:6] = 1, ring[-1], 1, 4
        genes[9, 2:6] = 1, ring[0], 1, 0
        inputs = [[0] * 8] * 40
        agree(genes, WHOLE, inputs)
        commands = driven(decode(genes, 8), inputs)
        moved += len(set(commands[20:])) > 1
    assert moved > 30, "hardly a network oscillated"


def test_networks_of_one_population_do_not_meet():
    """Network n of a batch does what it does alone, whatever ran in the same scratch before."""
    random = np.random.default_rng(16)
    genes = random.integers(-4, 5, (12, *WHOLE.shape)).astype(np.int8)
    genes[:, :, 0] = random.random((12, 30)) < 0.6
    genes[:, :10, 0] = 1
    links = genes[:, :, 2:].reshape(12, 30, 8, 4)
    links[..., 0] = random.random(links.shape[:3]) < 0.6
    links[..., 1] = random.integers(0, 30, links.shape[:3])
    links[..., 3] = random.integers(0, 5, links.shape[:3])
    nets = decode(genes, 8)
    inputs = np.array(sequence(random, "rare", 15, 8))
    work, commands = work_for(PAPER, nets=nets), np.zeros((15, 2), np.int64)
    for n in [*range(12), *range(11, -1, -1)]:
        calls.drive(nets, n, inputs, work, commands)
        assert [tuple(row) for row in commands.tolist()] == ReferenceNetwork(genes[n]).drive(inputs.tolist())
