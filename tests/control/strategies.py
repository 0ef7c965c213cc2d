"""Genotypes as hypothesis makes them: everything that the encoding can hold, blank or not."""

from __future__ import annotations

import numpy as np
from hypothesis import strategies as st

from realitygap.control.encoding import Variation

SMALL = Variation(inputs=3, slots=9, links=4)
"""A size small enough for links to meet, and not the default one."""


@st.composite
def genotypes(draw, size: Variation = SMALL):
    """Any genotype of a size: unexpressed and dormant content included."""
    seed = draw(st.integers(0, 2**32 - 1))
    neurons = draw(st.sampled_from([0.0, 0.2, 0.5, 1.0]))
    links = draw(st.sampled_from([0.0, 0.3, 0.7, 1.0]))
    blank = draw(st.booleans())
    random = np.random.default_rng(seed)
    genes = np.zeros(size.shape, np.int8)
    genes[:, 0] = random.random(size.slots) < neurons
    genes[: size.inputs + 2, 0] = 1
    genes[:, 1] = random.integers(-10, 11, size.slots)
    field = genes[:, 2:].reshape(size.slots, size.links, 4)
    fields = field.shape[:2]
    field[:, :, 0] = random.random(fields) < links
    field[:, :, 1] = random.integers(0, size.slots, fields)
    field[:, :, 2] = random.integers(-4, 5, fields)
    field[:, :, 3] = random.integers(0, 5, fields)
    if blank:
        field[field[:, :, 0] == 0] = 0
        genes[genes[:, 0] == 0] = 0
    return genes


def drives(size: Variation = SMALL, steps: int = 6):
    """Sequences of inputs."""
    step = st.lists(st.integers(-10, 10), min_size=size.inputs, max_size=size.inputs)
    return st.lists(step, min_size=1, max_size=steps)
