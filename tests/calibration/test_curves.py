"""Curves, the ends of sensors and places that were recorded twice: what the form "measured" rests on."""

from dataclasses import replace

import numpy as np
import pytest

from realitygap.calibration.channels import contradicted
from realitygap.calibration.curves import Curves, Seen, on_curves, smoothness
from realitygap.calibration.misfit import contradiction
from realitygap.calibration.rows import Rows, saturation
from realitygap.world.profile import load_profile

PAPER = load_profile("paper")


@pytest.mark.parametrize("linear", [False, True])
def test_bends_are_penalised_over_what_errs_least(linear):
    """Readings that rise evenly with the light are fitted with bends over the light, those that rise evenly
    with the share over the share; held to hardly any bend, either is then right where nothing was read."""
    random = np.random.default_rng(7)
    u = random.uniform(0.02, 0.75, (120, 2))
    true = 100.0 * (u / (1 - u)) ** 2 if linear else 1000.0 * u
    counts = true + 20 * random.normal(size=u.shape)
    use = ~((u > 0.3) & (u < 0.55))
    seen = Seen(counts=counts, use=use, top=1023.0, most=1023.0, noise=20.0)
    _, chosen = smoothness(seen, u, np.arange(len(u)) % 4)
    assert chosen.linear == linear and chosen.smooth > Seen.smooth

    def off(way: bool) -> float:
        curves = Curves(replace(seen, smooth=1e-1, linear=way), u).fitted()
        return float(np.abs(on_curves(curves, u) - true)[~use].max())

    assert off(linear) < 25 and off(not linear) > 2 * off(linear)


def piled(recorded, *, end: float):
    """Rows of a wall whose sensor 0 reads at most `end`."""
    table = recorded("wall")
    counts = table.counts.copy()
    counts[:, 0] = np.minimum(counts[:, 0], end)
    return Rows([replace(table, counts=counts)], PAPER)


def test_a_sensor_ends_where_its_readings_pile_up(recorded):
    """Below the full scale; a sensor whose highest reading is one of few ends at the full scale."""
    most = saturation(piled(recorded, end=700.0))
    assert most[0] == 700.0
    free = piled(recorded, end=1e9)
    free.counts[:, 0] = np.minimum(0.9 * free.counts[:, 0], 900.0 + np.arange(len(free.counts)) / 100)
    assert saturation(free)[0] == free.top and free.counts[:, 0].max() < free.top


def test_places_recorded_twice_contradict_each_other(recorded):
    """By half of what lies between the two, where that is lit; not where one of them is another object's."""
    first = recorded("wall", noise=0.0)
    lower = replace(first, counts=np.maximum(first.counts - 80.0, 0.0), hash="again")
    lit = first.counts > 200
    counts = np.where(lit, first.counts, 0.0), np.where(lit, lower.counts, 0.0)
    twice = [replace(one, counts=c) for one, c in zip((first, lower), counts, strict=True)]
    assert contradiction(Rows(twice, PAPER), 21.0) == pytest.approx(40.0, abs=3.0)
    assert contradiction(Rows([twice[0], twice[0]], PAPER), 21.0) == 0.0
    (said,) = contradicted(Rows(twice, PAPER), 21.0)
    assert "recordings of the same places lie 4" in said and "no form can follow both" in said
    noisy = [replace(recorded("wall", seed=seed), hash=str(seed)) for seed in (1, 2)]
    assert contradicted(Rows(noisy, PAPER), 21.0) == []
    other = replace(twice[1], object="cylinder:4")
    assert np.isnan(contradiction(Rows([twice[0], other], PAPER), 21.0))
