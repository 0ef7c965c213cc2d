"""Curves, and the ends of sensors: what the form "measured" rests on."""

from dataclasses import replace

import numpy as np
import pytest

from realitygap.calibration.curves import Curves, Seen, on_curves, smoothness
from realitygap.calibration.readings import Readings, saturation
from realitygap.world.robot import load_profile

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
    """Readings of a wall whose sensor 0 reads at most `end`."""
    table = recorded("wall")
    counts = table.counts.copy()
    counts[:, 0] = np.minimum(counts[:, 0], end)
    return Readings([replace(table, counts=counts)], PAPER)


def test_a_sensor_ends_where_its_readings_pile_up(recorded):
    """Below the full scale; a sensor whose highest reading is one of few ends at the full scale."""
    most = saturation(piled(recorded, end=700.0))
    assert most[0] == 700.0
    free = piled(recorded, end=1e9)
    free.counts[:, 0] = np.minimum(0.9 * free.counts[:, 0], 900.0 + np.arange(len(free.counts)) / 100)
    assert saturation(free)[0] == free.top and free.counts[:, 0].max() < free.top


def test_what_stands_beside_a_place_held_out_is_not_fitted(recorded):
    """At its distance, within 10 degrees, round the back too; places at 15 degrees are all kept."""
    table = recorded("wall", repeats=1)
    kept = {}
    for step in (2.0, 15.0):
        bearing = np.arange(-180.0, 180.0, step)
        row = np.resize(np.arange(len(table.counts)), len(bearing))
        few = replace(
            table, bearing_deg=bearing, distance_cm=np.full(len(bearing), 2.0),
            repeat=np.zeros(len(bearing), np.int64), counts=table.counts[row],
        )  # fmt: skip
        rows = Readings.__new__(Readings)
        rows.recordings, rows.distance = [few], few.distance_cm
        rows.bearing, rows.place, rows.use = (
            bearing,
            np.arange(len(bearing)),
            np.ones((len(bearing), 8), bool),
        )
        rows.block = rows._blocks()
        out = np.abs(np.abs(bearing) - 180.0) < 1
        kept[step] = bearing[rows.without(out).use.all(axis=1)]
    assert np.abs(kept[2.0]).max() == 170.0 and len(kept[2.0]) == 171 and len(kept[15.0]) == 23
