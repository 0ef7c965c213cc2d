"""Curves, and the ends of sensors: what the form "measured" rests on."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from realitygap.calibration import curves as own
from realitygap.calibration.curves import Curves, Seen, on_curves, smoothness
from realitygap.calibration.readings import Readings, saturation
from realitygap.kernels.curves import ROUNDS, SETTLED, STEEP, STEPS
from realitygap.world.robot import load_profile

PAPER = load_profile("paper")


def slowly(seen: Seen, u: np.ndarray) -> np.ndarray:
    """The curves by whole matrices: all sensors' common one first, then each sensor's."""
    sensors = u.shape[1]
    at = own._light() if seen.linear else np.arange(STEPS + 1.0)
    bend = np.zeros((STEPS - 1, STEPS + 1))
    for j in range(STEPS - 1):
        left, right = at[j + 1] - at[j], at[j + 2] - at[j + 1]
        bend[j, j : j + 3] = np.array([1 / left, -1 / left - 1 / right, 1 / right]) * (left + right) / 2
    step = np.arange(STEPS + 1.0)
    hats = np.maximum(0, 1 - np.abs(np.clip(u, 0, 1)[..., None] * STEPS - step)) * seen.use[..., None]
    normal = np.einsum("nsi,nsj->sij", hats, hats) / seen.noise**2

    def expected(curves):
        model, dark = np.einsum("nsi,si->ns", hats, curves), 0.0 if seen.dead else seen.dark()
        below = model
        if dark:
            z = np.clip(-model / dark, -6, 6)
            below = model - dark * stats.norm.pdf(z) / stats.norm.cdf(z)
        read = np.where(seen.counts <= 0, np.minimum(below, seen.dead), seen.counts)
        return np.where(seen.counts >= seen.most, np.maximum(model, seen.counts), read)

    def solve(normal, towards, pooled):
        each = np.einsum("sii->si", normal).mean()
        near = np.full(towards.shape, 1e-12) if pooled else (seen.alike * np.maximum(towards, 1023)) ** -2.0
        held = seen.smooth * STEPS**3 * each * (bend.T @ bend) + np.stack([np.diag(one) for one in near])
        falls, curves = np.zeros((len(towards), STEPS), bool), towards
        for _ in range(ROUNDS):
            drops = [np.diff(np.eye(STEPS + 1), axis=0)[one] for one in falls]
            steep = [STEEP * each * (drop.T @ drop) for drop in drops]
            read = np.einsum("nsi,ns->si", hats, expected(np.resize(curves, (sensors, STEPS + 1))))
            right = (read.sum(axis=0, keepdims=True) if pooled else read) / seen.noise**2
            right = right + np.einsum("sij,sj->si", held, towards)
            before, curves = (
                curves,
                np.linalg.solve(normal + held + np.stack(steep), right[..., None])[..., 0],
            )
            new = (np.diff(curves) < 0) & ~falls
            falls |= new
            if not new.any() and np.abs(curves - before).max() < SETTLED * seen.top:
                break
        return curves

    common = solve(normal.sum(axis=0, keepdims=True), np.zeros((1, STEPS + 1)), True)
    return np.maximum.accumulate(solve(normal, np.repeat(common, sensors, 0), False), axis=1)


@pytest.mark.parametrize("linear", [False, True])
@pytest.mark.parametrize("dead", [0.0, 60.0])
def test_curves_are_those_of_the_slow_solution(linear, dead):
    """With readings at both ends, some of them where no ray arrives, and a dead zone or none."""
    random = np.random.default_rng(3)
    u = np.where(random.random((250, 3)) < 0.2, 0.0, random.uniform(-0.1, 1.05, (250, 3)))
    counts = np.clip(
        np.rint(1300 * np.clip(u, 0, 1) ** 1.5 - 100 + 15 * random.normal(size=u.shape)), 0, 1023
    )
    seen = Seen(
        counts=np.where(counts < dead, 0, counts), use=random.random(u.shape) < 0.9, top=1023.0, most=1023.0,
        noise=20.0, dead=dead, linear=linear,
    )  # fmt: skip
    right, made = slowly(seen, u), Curves(seen, u).fitted(beyond=True)
    shown = np.clip(right, 0, None)
    lit = made > made[:, :1] + 0.5
    assert lit.mean() > 0.5 and made[lit] == pytest.approx(shown[lit], abs=1e-3)


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
