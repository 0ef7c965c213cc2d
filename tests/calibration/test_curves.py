"""Curves, the ends of sensors and places that were recorded twice: what the form "measured" rests on."""

from dataclasses import replace

import numpy as np
import pytest

from realitygap.calibration.channels import contradicted
from realitygap.calibration.curves import Curves, Seen, on_curves, smoothness
from realitygap.calibration.misfit import contradiction
from realitygap.calibration.rows import Rows, saturation
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


def test_straight_curves_do_not_hang_on_rounding():
    """A share that differs in its tenth digit moves a curve that is straight over the light hardly."""
    random = np.random.default_rng(3)
    u = random.uniform(0.02, 0.6, (400, 2))
    counts = np.minimum(2000.0 * (u / (1 - u)) ** 2 + 10 * random.normal(size=u.shape), 4095.0)
    seen = Seen(
        counts=counts,
        use=np.ones(u.shape, bool),
        top=4095.0,
        most=4095.0,
        noise=18.0,
        smooth=0.1,
        linear=True,
    )
    here, there = (on_curves(Curves(seen, share).fitted(beyond=True), u) for share in (u, u * (1 + 1e-10)))
    assert np.abs(here - there).max() < 0.02  # with the light without end 1.7


def test_curves_go_on_beyond_their_end_where_asked():
    """So that a reading just below it lies on a straight line, not on one towards the end's own step."""
    u = np.random.default_rng(5).uniform(0.1, 0.6, (2000, 1))
    true = 2500.0 * (u / (1 - u)) ** 2
    seen = Seen(
        counts=np.minimum(true, 4095.0), use=np.ones(u.shape, bool), top=4095.0, most=4095.0, noise=18.0,
        smooth=0.1, linear=True,
    )  # fmt: skip
    fit, near = Curves(seen, u), (true > 3600) & (true < 4090)
    off = [
        np.abs(np.minimum(on_curves(fit.fitted(beyond=far), u), 4095.0) - true)[near].max()
        for far in (True, False)
    ]
    assert off[0] < 10 < 25 < off[1] and fit.fitted().max() <= 4095.0


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
        rows = Rows.__new__(Rows)
        rows.recordings, rows.edges, rows.distance = [few], (None,), few.distance_cm
        rows.bearing, rows.place, rows.use = (
            bearing,
            np.arange(len(bearing)),
            np.ones((len(bearing), 8), bool),
        )
        rows.block = rows._blocks()
        out = np.abs(np.abs(bearing) - 180.0) < 1
        kept[step] = bearing[rows.without(out).use.all(axis=1)]
    assert np.abs(kept[2.0]).max() == 170.0 and len(kept[2.0]) == 171 and len(kept[15.0]) == 23
