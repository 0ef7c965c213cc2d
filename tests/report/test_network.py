"""A network's picture shows what the genotype expresses, each part in its place."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from realitygap.control.genotype import Genotype
from realitygap.report.network import network_figure, place_neurons, read_wiring
from realitygap.report.style import styled
from realitygap.world.robot import load_profile
from tests.report.scenes import random_genotype

PROFILE = load_profile("paper")
ROBOT = PROFILE.to_kernel()


@settings(max_examples=20)
@given(seed=st.integers(0, 10**6), hidden=st.sampled_from([0.05, 0.3, 1.0]))
def test_neurons_do_not_overlap_and_stay_on_the_robot(seed: int, hidden: float) -> None:
    """Whatever the genotype, with a picture large enough for it."""
    wiring = read_wiring(random_genotype(seed, hidden=hidden))
    unit = 0.92 if len(wiring.hidden) <= 3 else 0.73 if len(wiring.hidden) <= 7 else 0.5
    places = place_neurons(wiring, ROBOT, ROBOT.proximity.place, range(8), unit)
    spots = np.array(list(places.values()))
    gaps = np.hypot(*(spots[:, None] - spots[None]).transpose(2, 0, 1)) + 9 * np.eye(len(spots))
    assert gaps.min() > 0.6 * unit
    assert np.hypot(*spots.T).max() < ROBOT.radius


def test_sensors_stand_at_their_places_and_motors_at_their_wheels() -> None:
    """The robot looks up: what is ahead is drawn above, what is left is drawn left."""
    wiring = read_wiring(random_genotype(1, hidden=0))
    places = place_neurons(wiring, ROBOT, ROBOT.proximity.place, range(8), 0.92)
    for sensor, (forward, left) in enumerate(ROBOT.proximity.place):
        assert places[sensor] == pytest.approx([-left, forward])
    assert places[8][0] < -1 < 1 < places[9][0]


def test_only_what_can_move_a_wheel_counts_as_working() -> None:
    """A neuron without a way to a motor, and a link of weight 0, have no effect."""
    genes = np.zeros((12, 2 + 4 * 2), np.int8)
    genes[:, 0] = 1
    genes[8, 2:6] = (1, 10, 3, 2)  # hidden 10 drives the left motor
    genes[9, 2:6] = (1, 11, 0, 0)  # a link that weighs nothing from hidden 11
    genes[10, 2:6] = (1, 0, -2, 4)
    wiring = read_wiring(Genotype(genes, 8))
    assert [(k.source, k.target, k.weight, k.delay) for k in wiring.links if wiring.works(k)] == [
        (10, 8, 3, 2),
        (0, 10, -2, 4),
    ]
    assert wiring.useful == {0, 8, 9, 10}


@pytest.mark.parametrize(("hidden", "feeds"), [(0.0, "proximity"), (0.1, "ambient"), (1.0, "proximity")])
def test_a_picture_names_weights_delays_and_thresholds(hidden: float, feeds: str) -> None:
    """Each working link's number and each computing neuron's threshold stand in it."""
    genotype = random_genotype(5, hidden=hidden)
    with styled():
        figure = network_figure(genotype, PROFILE, title="a run", feeds=feeds, sensors=range(8))
    texts = [text.get_text() for text in figure.axes[0].texts]
    wiring = read_wiring(genotype)
    assert sum(t.startswith("θ") for t in texts) == len(wiring.thresholds)
    assert sum(t[0] in "+−" for t in texts) == sum(wiring.works(k) for k in wiring.links)
