"""Random draws: the recipe's bits, the stated laws, and wrong laws that are found out."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import stats

from tests.kernels import calls
from tests.kernels.reference import draws as reference

SEED = np.uint64(1995)
DRAWS = 200_000
ALARM = 1e-4
"""A law is doubted below this p-value; seeds are fixed, so a test that passes always passes."""


def drawn(stream, n: int = 7, count: int = DRAWS):
    raw, uniforms, whole = np.zeros(count, np.uint64), np.zeros(count), np.zeros(count, np.int64)
    calls.draw(np.uint64(stream), n, raw, uniforms, whole)
    return raw, uniforms, whole


def drawn_normals(stream, count: int = DRAWS) -> np.ndarray:
    z = np.zeros((count // 16, 16))
    calls.draw_normals(np.uint64(stream), z)
    return z


def test_known_bits():
    """SplitMix64 seeded with 1234567 begins with the numbers that its authors' code gives."""
    raw, _, _ = drawn(1234567, count=5)
    assert raw.tolist() == [
        6457827717110365317, 3203168211198807973, 9817491932198370423, 4593380528125082431,
        16408922859458223821,
    ]  # fmt: skip


def test_bits_are_the_reference():
    """Every draw, name and normal number is what the recipe in whole numbers gives."""
    random = np.random.default_rng(10)
    names = np.zeros(20, np.uint64)
    for stream in random.integers(0, 2**64, 20, np.uint64):
        raw, uniforms, _ = drawn(stream, count=32)
        assert raw.tolist() == [reference.bits(int(stream), i) for i in range(32)]
        assert uniforms.tolist() == [reference.uniform(int(stream), i) for i in range(32)]
        calls.name_streams(stream, names)
        assert names.tolist() == [reference.substream(int(stream), i) for i in range(20)]
        z = drawn_normals(stream, 64)
        expected = [reference.normals(int(stream), 8 * i, 16) for i in range(4)]
        np.testing.assert_allclose(z, expected, rtol=1e-13, atol=1e-15)


def test_uniform_law():
    """Draws are uniform in [0, 1), and each is independent of the one before."""
    _, u, _ = drawn(SEED)
    assert u.min() >= 0 and u.max() < 1
    assert stats.kstest(u, "uniform").pvalue > ALARM
    assert stats.kstest(np.mod(u[1:] - u[:-1], 1), "uniform").pvalue > ALARM
    assert abs(np.corrcoef(u[1:], u[:-1])[0, 1]) < 4 / math.sqrt(DRAWS)


@pytest.mark.parametrize("n", [1, 2, 3, 7, 64, 1000])
def test_below_law(n):
    """`below` takes each of 0 … n − 1 equally often."""
    _, _, whole = drawn(SEED, n)
    counts = np.bincount(whole, minlength=n)
    assert counts.shape == (n,)
    assert n == 1 or stats.chisquare(counts).pvalue > ALARM


def test_normal_law():
    """Normal numbers are normal in every place of the block, far out too, and independent."""
    z = drawn_normals(SEED, 16 * 50_000)
    for lane in range(16):
        assert stats.kstest(z[:, lane], "norm").pvalue > ALARM
    flat = z.ravel()
    for bound in (2.0, 3.0, 4.0):
        expected = flat.size * 2 * stats.norm.sf(bound)
        assert stats.poisson.sf(np.sum(np.abs(flat) > bound), expected) > ALARM
        assert stats.poisson.cdf(np.sum(np.abs(flat) > bound), expected) > ALARM
    assert flat.std() == pytest.approx(1, abs=4 / math.sqrt(2 * flat.size))
    correlations = np.corrcoef(z.T) - np.eye(16)
    assert np.abs(correlations).max() < 5 / math.sqrt(z.shape[0])
    squares = np.corrcoef((z**2).T) - np.eye(16)
    assert np.abs(squares).max() < 5 / math.sqrt(z.shape[0])


def test_wrong_laws_are_found_out():
    """The tests above would notice a deviation of 1.01, a shift of 0.01 and a bias of one in fifty."""
    z = drawn_normals(SEED, 16 * 50_000).ravel()
    assert stats.kstest(z * 1.01, "norm").pvalue < ALARM
    assert stats.kstest(z + 0.01, "norm").pvalue < ALARM
    _, u, whole = drawn(SEED, 7)
    assert stats.kstest(u**1.02, "uniform").pvalue < ALARM
    assert stats.chisquare(np.bincount(np.where(u[::-1] < 0.02, 0, whole))).pvalue < ALARM


def test_streams_differ():
    """No two names make the same stream, and streams of neighbouring names are independent."""
    names = np.zeros(50_000, np.uint64)
    calls.name_streams(SEED, names)
    assert np.unique(names).size == names.size
    under = np.zeros(50_000, np.uint64)
    calls.name_streams(names[0], under)
    assert np.intersect1d(names, under).size == 0
    first = np.array([drawn(stream, count=1)[1][0] for stream in names[:2000]])
    assert stats.kstest(first, "uniform").pvalue > ALARM
    a, b = (drawn(stream)[1] for stream in names[:2])
    assert abs(np.corrcoef(a, b)[0, 1]) < 4 / math.sqrt(DRAWS)
    # A bit of a stream's number changes half the bits of its draws.
    flipped = drawn(SEED ^ np.uint64(1))[0] ^ drawn(SEED)[0]
    assert np.unpackbits(flipped.view(np.uint8)).mean() == pytest.approx(0.5, abs=0.001)


def evaluated(x: np.ndarray):
    logs, sines, cosines = np.zeros_like(x), np.zeros_like(x), np.zeros_like(x)
    calls.evaluate(x, logs, sines, cosines)
    return logs, sines, cosines


def test_logarithm():
    """The polynomial logarithm is the C library's to two units in the last place."""
    random = np.random.default_rng(11)
    x = np.concatenate([
        np.exp(random.uniform(-700, 700, 50_000)), random.uniform(0, 2, 50_000),
        1 + random.uniform(-1e-6, 1e-6, 10_000), [1.0, 2.0, 0.5, math.sqrt(2), math.sqrt(0.5)],
    ])  # fmt: skip
    logs, _, _ = evaluated(x)
    np.testing.assert_allclose(logs, np.log(x), rtol=5e-16, atol=0)


def test_sine_and_cosine():
    """The polynomial sine and cosine are exact to 1e-15 for headings of a long trial."""
    random = np.random.default_rng(12)
    x = np.concatenate([
        random.uniform(-10, 10, 100_000), random.uniform(-1e4, 1e4, 50_000),
        random.uniform(-1e-6, 1e-6, 1000),
        np.arange(-40, 41) * (math.pi / 4), [0.0],
    ])  # fmt: skip
    _, sines, cosines = evaluated(x)
    np.testing.assert_allclose(sines, np.sin(x), rtol=0, atol=1e-15)
    np.testing.assert_allclose(cosines, np.cos(x), rtol=0, atol=1e-15)
    np.testing.assert_allclose(sines**2 + cosines**2, 1, rtol=0, atol=5e-16)
    _, far_sines, far_cosines = evaluated(random.uniform(-1e5, 1e5, 10_000))
    np.testing.assert_allclose(far_sines**2 + far_cosines**2, 1, rtol=0, atol=5e-16)


def test_a_heading_and_its_mirror_are_exact():
    """sin(−x) = −sin x and cos(−x) = cos x to the last bit: mirrored trials rest on it."""
    x = np.random.default_rng(13).uniform(-20, 20, 10_000)
    _, sines, cosines = evaluated(x)
    _, mirrored_sines, mirrored_cosines = evaluated(-x)
    assert (sines == -mirrored_sines).all() and (cosines == mirrored_cosines).all()
