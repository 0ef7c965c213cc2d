"""The twin's own cosine, logarithm and the like: the same bits on every processor.

Those of NumPy and of the C library take other ways on other processors (AVX-512, FMA) and differ in the last
bit. These are made of sums, products, quotients and square roots alone, which IEEE 754 rounds one way only,
in one order. Polynomials of fdlibm (Sun Microsystems 1993): errors of a few units in the last place.

It also says how the twin's inner loops are compiled: with no licence for the compiler to rewrite arithmetic.
"""

import math
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from realitygap.compiled import compiled
from realitygap.compiled import step as inlined

__all__ = [
    "arctan2", "cos_sin", "hypot", "jit", "normals", "one_arctan2", "one_cos_sin", "one_normal",
    "one_power", "power", "product", "routine", "step",
]  # fmt: skip

routine = partial(compiled, nogil=True)
jit = partial(compiled, nogil=True, allocates=False)
step = partial(inlined, fastmath=False)

Array = NDArray[np.float64]

LN2_HIGH, LN2_LOW = 6.93147180369123816490e-01, 1.90821492927058770002e-10
QUARTER = (1.57079632673412561417e00, 6.07710050630396597660e-11, 2.02226624879595063154e-21)
"""π/2 in three parts; whole multiples of the first two are exact."""


@step
def _log(x: float) -> float:
    m, e = math.frexp(x)
    if m < 0.7071067811865476:
        m, e = 2.0 * m, e - 1
    f = m - 1.0
    s = f / (2.0 + f)
    z, h = s * s, 0.5 * f * f
    r = 1.531383769920937332e-01 + z * 1.479819860511658591e-01
    r = 2.857142874366239149e-01 + z * (2.222219843214978396e-01 + z * (1.818357216161805012e-01 + z * r))
    r = z * (6.666666666666735130e-01 + z * (3.999999999940941908e-01 + z * r))
    return e * LN2_HIGH - ((h - (s * (h + r) + e * LN2_LOW)) - f)


@step
def _exp(x: float) -> float:
    k = math.floor(x / (LN2_HIGH + LN2_LOW) + 0.5)
    high, low = x - k * LN2_HIGH, k * LN2_LOW
    r = high - low
    t = r * r
    c = 6.61375632143793436117e-05 + t * (-1.65339022054652515390e-06 + t * 4.13813679705723846039e-08)
    c = r - t * (1.66666666666666019037e-01 + t * (-2.77777777770155933842e-03 + t * c))
    return math.ldexp(1.0 - ((low - (r * c) / (2.0 - c)) - high), int(k))


@jit
def one_cos_sin(x: float) -> tuple[float, float]:
    """Cosine and sine of one angle (rad), for compiled callers; so are the others of a single number."""
    k = math.floor(x / (QUARTER[0] + QUARTER[1]) + 0.5)
    r = ((x - k * QUARTER[0]) - k * QUARTER[1]) - k * QUARTER[2]
    z = r * r
    s = 2.75573137070700676789e-06 + z * (-2.50507602534068634195e-08 + z * 1.58969099521155010221e-10)
    s = 8.33333333332248946124e-03 + z * (-1.98412698298579493134e-04 + z * s)
    s = r + r * z * (-1.66666666666666324348e-01 + z * s)
    c = -2.75573143513906633035e-07 + z * (2.08757232129817482790e-09 + z * -1.13596475577881948265e-11)
    c = -1.38888888888741095749e-03 + z * (2.48015872894767294178e-05 + z * c)
    c = 1.0 - (0.5 * z - z * z * (4.16666666666666019037e-02 + z * c))
    quadrant = int(k) & 3
    if quadrant == 0:
        return c, s
    if quadrant == 1:
        return -s, c
    return (-c, -s) if quadrant == 2 else (s, -c)


@jit
def one_arctan2(y: float, x: float) -> float:
    """Angle of one point (rad, −π to π)."""
    wide, high = abs(x), abs(y)
    if wide == 0.0 and high == 0.0:
        return 0.0
    a = min(wide, high) / max(wide, high)
    base = 0.0
    if a > 0.4142135623730951:
        base, a = 0.7853981633974483, (a - 1.0) / (a + 1.0)
    z = a * a
    p = 4.97687799461593236017e-02 + z * (-3.65315727442169155270e-02 + z * 1.62858201153657823623e-02)
    p = 9.09088713343650656196e-02 + z * (-7.69187620504482999495e-02 + z * (6.66107313738753120669e-02
        + z * (-5.83357013379057348645e-02 + z * p)))  # fmt: skip
    p = 3.33333333333329318027e-01 + z * (-1.99999999998764832476e-01 + z * (1.42857142725034663711e-01
        + z * (-1.11111104054623557880e-01 + z * p)))  # fmt: skip
    angle = base + (a - a * z * p)
    if high > wide:
        angle = 1.5707963267948966 - angle
    if x < 0.0:
        angle = 3.141592653589793 - angle
    return -angle if y < 0.0 else angle


@jit
def one_power(base: float, exponent: float) -> float:
    """base to a power; 0 where the base is not above 0."""
    return _exp(exponent * _log(base)) if base > 0.0 else 0.0


@jit
def one_normal(bits: Any) -> Any:
    """A draw of deviation 1 from 64 random bits (Box and Muller 1958)."""
    first = (np.float64(bits >> np.uint64(32)) + 0.5) * 2.3283064365386963e-10
    second = np.float64(bits & np.uint64(0xFFFFFFFF)) * 2.3283064365386963e-10
    c, _ = one_cos_sin(6.283185307179586 * second)
    return math.sqrt(-2.0 * _log(first)) * c


@jit
def _all_normals(bits: Any, out: Any) -> None:
    for k in range(out.shape[0]):
        out[k] = one_normal(bits[k])


def cos_sin(angles: ArrayLike) -> tuple[Array, Array]:
    """Cosines and sines of angles (rad, below a million), shaped as these."""
    c, s = _each(one_cos_sin, angles).reshape(-1, 2).T.copy()
    return c.reshape(np.shape(angles)), s.reshape(np.shape(angles))


def arctan2(y: ArrayLike, x: ArrayLike) -> Array:
    """Angles (rad, −π to π) of the points x, y, shaped as these."""
    return _each(one_arctan2, y, x).reshape(np.shape(y))


def power(base: ArrayLike, exponent: float) -> Array:
    """base to a power; 0 where the base is not above 0."""
    return _each(partial(one_power, exponent=float(exponent)), base).reshape(np.shape(base))


def _each(law: Callable[..., Any], *values: ArrayLike) -> Array:
    """What a law makes of one number after another of arrays."""
    flat = (np.asarray(one, np.float64).ravel().tolist() for one in values)
    return np.array([law(*numbers) for numbers in zip(*flat, strict=True)], np.float64)


def normals(bits: NDArray[np.uint64]) -> Array:
    """A draw of deviation 1 from each word of 64 random bits, shaped as these."""
    flat = np.ascontiguousarray(bits, np.uint64).ravel()
    out = np.empty(flat.shape)
    _all_normals(flat, out)
    return out.reshape(np.shape(bits))


def hypot(x: Any, y: Any) -> Any:
    """Length of x, y."""
    return np.sqrt(x * x + y * y)


def product(a: Array, b: Array) -> Array:
    """a @ b for [..., n] and [n, m], summed in order: a BLAS library has an order for each processor."""
    total = a[..., 0, None] * b[0]
    for k in range(1, len(b)):
        total = total + a[..., k, None] * b[k]
    return np.asarray(total)
