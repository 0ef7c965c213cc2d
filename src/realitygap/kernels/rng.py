"""Randomness as an argument: SplitMix64 read as a counter-based generator.

A stream is a 64-bit number; draw `i` of a stream is `mix(stream + (i + 1)·γ)`. A stream is derived from its
names (seed, purpose, evaluation, trial) by `substream`, so that any draw can be made anywhere, in any order,
with the same bits. Source: Steele, Lea and Flood, "Fast splittable pseudorandom number generators" (OOPSLA
2014).

Logarithm, sine and cosine are polynomials: C libraries differ in their last bits.
"""

import math

import numpy as np

from realitygap.compiled import helper, step

_GAMMA = np.uint64(0x9E3779B97F4A7C15)
_M1 = np.uint64(0xBF58476D1CE4E5B9)
_M2 = np.uint64(0x94D049BB133111EB)
_S30, _S27, _S31 = np.uint64(30), np.uint64(27), np.uint64(31)
_S11, _S32 = np.uint64(11), np.uint64(32)
_LOW30, _BIT30, _BIT31 = np.uint64(0x3FFFFFFF), np.uint64(1 << 30), np.uint64(1 << 31)
_ZERO, _ONE = np.uint64(0), np.uint64(1)
_ROOT_HALF, _FIFTY_TWO = np.int64(0x3FE6A09E667F3BCD), np.int64(52)


@step
def mix(x):
    """SplitMix64's finaliser: a bijection of 64 bits that decorrelates neighbours."""
    x = (x ^ (x >> _S30)) * _M1
    x = (x ^ (x >> _S27)) * _M2
    return x ^ (x >> _S31)


@helper
def substream(stream, name):
    """The stream called `name` (an integer) under `stream`."""
    return mix(mix(np.uint64(stream) + _GAMMA) ^ (np.uint64(name) * _M2 + _GAMMA))


@step
def bits(stream, i):
    """Draw `i` of a stream: 64 random bits."""
    return mix(np.uint64(stream) + (np.uint64(i) + _ONE) * _GAMMA)


@step
def uniform(stream, i):
    """Draw `i` as a float64 in [0, 1)."""
    return np.float64(np.int64(bits(stream, i) >> _S11)) * 1.1102230246251565e-16


@step
def below(stream, i, n):
    """Draw `i` as an integer in 0 .. n − 1 (n up to 2³²; bias below n/2³²)."""
    return np.int64(((bits(stream, i) >> _S32) * np.uint64(n)) >> _S32)


@step
def log(x):
    """Natural logarithm of a positive normal float64, to about 1e-16 relative (fdlibm's series)."""
    b = np.float64(x).view(np.int64)
    # x = 2^e · m with m in [√½, √2): the offset makes the exponent round at √2.
    e = (b - _ROOT_HALF) >> _FIFTY_TWO
    m = np.int64(b - (e << _FIFTY_TWO)).view(np.float64)
    s = (m - 1.0) / (m + 1.0)
    z = s * s
    r = 1.818357216161805012e-01 + z * (1.531383769920937332e-01 + z * 1.479819860511658591e-01)
    r = 3.999999999940941908e-01 + z * (2.857142874366239149e-01 + z * (2.222219843214978396e-01 + z * r))
    r = z * (6.666666666666735130e-01 + z * r)
    return np.float64(e) * 0.6931471805599453 + (2.0 * s + s * r)


@step
def _sin_core(r, z):
    """sin r for |r| ≤ π/4, z = r² (fdlibm's series)."""
    t = 2.75573137070700676789e-06 + z * (-2.50507602534068634195e-08 + z * 1.58969099521155010221e-10)
    t = 8.33333333332248946124e-03 + z * (-1.98412698298579493134e-04 + z * t)
    return r + r * z * (-1.66666666666666324348e-01 + z * t)


@step
def _cos_core(z):
    """cos r for |r| ≤ π/4, z = r²."""
    t = -2.75573143513906633035e-07 + z * (2.08757232129817482790e-09 + z * -1.13596475577881948265e-11)
    t = -1.38888888888741095749e-03 + z * (2.48015872894767294178e-05 + z * t)
    return 1.0 - 0.5 * z + z * z * (4.16666666666666019037e-02 + z * t)


@step
def sin_cos(x):
    """(sin x, cos x) for |x| up to some 10⁵ rad, to about 1e-15."""
    k = math.floor(x * 0.6366197723675814 + 0.5)
    r = (x - k * 1.5707963267341256) - k * 6.077100506506192e-11
    z = r * r
    s = _sin_core(r, z)
    c = _cos_core(z)
    # Which quarter turn: odd ones swap sine and cosine; selects, since a branch would be unpredictable.
    quarter = np.int64(k)
    odd = (quarter & 1) != 0
    sine = c if odd else s
    cosine = s if odd else c
    sine = -sine if (quarter & 2) != 0 else sine
    cosine = -cosine if ((quarter + 1) & 2) != 0 else cosine
    return sine, cosine


@step
def normal_pair(stream, i):
    """Two standard normal numbers from draw `i`.

    Box and Muller: 32 bits make the radius, 30 an angle within ±45°, 2 its quarter.
    """
    b = bits(stream, i)
    radius = math.sqrt(-2.0 * log((np.float64(np.int64(b >> _S32)) + 0.5) * 2.3283064365386963e-10))
    angle = (np.float64(np.int64(b & _LOW30)) * 9.313225746154785e-10 - 0.5) * 1.5707963267948966
    square = angle * angle
    s = radius * _sin_core(angle, square)
    c = radius * _cos_core(square)
    c = -c if (b & _BIT30) != _ZERO else c
    swap = (b & _BIT31) != _ZERO
    return s if swap else c, c if swap else s


@step
def normals(stream, first, z):
    """Fill `z` ([16·m]) with standard normal numbers from draws `first` … `first + 8·m − 1`."""
    half = z.shape[0] // 2
    for i in range(half):
        z[i], z[half + i] = normal_pair(stream, first + i)
