"""The engine of all fits: least squares with honest intervals, and a random search where readings jump."""

from __future__ import annotations

import numpy as np
import pytest

from realitygap.calibration.fit import Observed, Parameter, fit, search

SENSORS, TRUE = 8, np.linspace(-0.1, 0.1, 8)
X = np.linspace(-0.5, 0.5, 400)
FREES = [
    Parameter(key="log_gain", start=np.zeros(SENSORS), low=-5, high=5, step=1e-3),
    Parameter(key="edge", start=np.zeros(SENSORS), low=-0.15, high=0.15, prior=0.5, step=4e-3, jump=0.04),
    Parameter(key="wide", start=np.ones(1), low=0.5, high=2, step=1e-3, jump=0.05),
]


def model(values):
    """Rays that a shadow puts out one by one: readings fall in steps of 20 as X passes an edge."""
    lit = np.floor((X[:, None] * values["wide"] - values["edge"]) * 20)
    return np.exp(values["log_gain"]) * 20.0 * lit


@pytest.fixture(scope="module")
def counts():
    truth = {"log_gain": np.log(np.linspace(2, 3, SENSORS)), "edge": TRUE, "wide": np.array([1.1])}
    return model(truth) + np.random.default_rng(1).normal(0, 4.5, (len(X), SENSORS))


def found(counts, start, use=None):
    everything = np.ones(counts.shape, bool) if use is None else use
    return search(FREES, model, measured(counts, everything), start, draws=2000)


def measured(counts, use):
    return Observed(counts=counts, noise=4.5, use=use, clusters=np.arange(len(X)))


def test_it_finds_edges_that_least_squares_do_not_see(counts):
    """Least squares stay beside the truth; the search comes within a place's distance of it."""
    use = np.ones(counts.shape, bool)
    start = {p.key: p.start for p in FREES}
    stuck = fit(FREES, model, measured(counts, use), intervals=False).values
    best = found(counts, start)

    def misfit(values):
        return float(np.sqrt(((model(values) - counts) ** 2).mean()))

    assert misfit(stuck) > 3 * misfit(best)
    assert misfit(best) < 5.0
    np.testing.assert_allclose(best["edge"], TRUE, atol=2 * (X[1] - X[0]))
    np.testing.assert_allclose(np.exp(best["log_gain"]), np.linspace(2, 3, SENSORS), rtol=0.01)


def test_it_gives_the_same_bits_and_stays_within_bounds(counts):
    """Twice the same; no constant leaves its bounds; what has no jump stays, the gains aside."""
    start = {f.key: f.start for f in FREES} | {"dark": np.array([3.0])}
    one, two = found(counts, start), found(counts, start)
    assert all(np.array_equal(one[key], two[key]) for key in one)
    assert one["dark"] == 3.0
    assert (np.abs(one["edge"]) <= 0.15).all()


def test_constants_that_do_the_same_are_named():
    """Two that move the readings alike are a pair; one that moves nothing gets all of its bounds."""
    random = np.random.default_rng(0)
    x, noise = random.normal(size=600), 0.01 * random.normal(size=600)
    frees = [
        Parameter(key=key, start=np.full(1, 4.0 if key == "r" else 1.0), low=0, high=10) for key in "pqrs"
    ]
    data = Observed(
        counts=noise[:, None], noise=0.01, use=np.ones((600, 1), bool), clusters=np.arange(600) // 30
    )
    made = fit(frees, lambda v: 0.01 * ((v["p"] + 2 * v["q"] - 3) * x + (v["s"] - 1))[:, None], data)
    assert [{a, b} for a, b, _ in made.alike] == [{"p", "q"}]
    assert (made.constants[2].low, made.constants[2].high, made.constants[2].told) == (0.0, 10.0, False)
    assert made.constants[3].told
    assert made.constants[3].high - made.constants[3].low == pytest.approx(4 / 600**0.5, rel=0.5)


def test_readings_of_a_cluster_err_together():
    """An error that a whole cluster shares widens the interval as a mean of clusters has it."""
    random, clusters = np.random.default_rng(0), np.arange(1200) // 30
    off = 0.01 * random.normal(size=40)[clusters] + 0.001 * random.normal(size=1200)
    data = Observed(counts=5 - off[:, None], noise=0.01, use=np.ones((1200, 1), bool), clusters=clusters)
    one = Parameter(key="p", start=np.full(1, 5.0), low=0, high=10)
    (found,) = fit([one], lambda v: np.repeat(v["p"][None], 1200, axis=0), data).constants
    assert (found.high - found.low) / 2 == pytest.approx(1.96 * off.std() / 40**0.5, rel=0.1)


def test_values_that_no_robot_can_have_are_not_asked_for_a_slope():
    """Beside such values the derivative is taken on the other side: the interval is as without them."""
    x = np.linspace(1, 2, 200)[:, None]
    counts = x * [1.0, 2.0] + 0.01 * np.random.default_rng(0).normal(size=(200, 2))
    data = Observed(counts=counts, noise=0.01, use=np.ones((200, 2), bool), clusters=np.arange(200))
    frees = [
        Parameter(key=k, start=np.full(1, s), low=0, high=9) for k, s in zip("abc", (0.9, 1, 1), strict=True)
    ]

    def free(v):
        return x * [1.0, 2.0] * v["a"] + np.hstack([v["b"] - 1 + 0 * x, v["c"] - 1 + 0 * x])

    wide = fit(frees, free, data)
    edge = wide.constants[0].value + 9e-4

    def bounded(v):
        return free(v) if v["a"][0] < edge else np.full_like(counts, np.inf)

    near = fit(frees, bounded, data)
    assert near.constants[0].high == pytest.approx(wide.constants[0].high, abs=1e-4)
    assert near.constants[0].low == pytest.approx(wide.constants[0].low, abs=1e-4)
