"""Randomness as an argument: SplitMix64 read as a counter-based generator.

A stream is a 64-bit number; draw `i` of a stream is `mix(stream + (i + 1)·γ)`. A stream is made
from its names (seed, purpose, evaluation, trial) by `substream`, so that any draw can be made
anywhere, in any order, with the same bits. Source: Steele, Lea and Flood, "Fast splittable
pseudorandom number generators" (OOPSLA 2014).

Logarithm, sine and cosine are polynomials: C libraries differ in their last bits.
"""

import math

import numpy as np

from realitygap.kernels.jit import step

_GAMMA = np.uint64(0x9E3779B97F4A7C15)
_M1 = np.uint64(0xBF58476D1CE4E5B9)
_M2 = np.uint64(0x94D049BB133111EB)
_S30, _S27, _S31 = np.uint64(30), np.uint64(27), np.uint64(31)
_S11, _S32 = np.uint64(11), np.uint64(32)
_LOW = np.uint64(0xFFFFFFFF)
_ONE = np.uint64(1)


@step
def mix(x):
    """SplitMix64's finaliser: a bijection of 64 bits that scatters neighbours."""
    x = (x ^ (x >> _S30)) * _M1
    x = (x ^ (x >> _S27)) * _M2
    return x ^ (x >> _S31)


@step
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
    """Natural logarithm of a positive normal float64, within 2 units in the last place or so."""
    b = np.float64(x).view(np.int64)
    # x = 2^e · m with m in [√½, √2): shift the bits so that the exponent rounds at √2.
    e = (b - np.int64(0x3FE6A09E667F3BCD)) >> np.int64(52)
    m = np.int64(b - (e << np.int64(52))).view(np.float64)
    s = (m - 1.0) / (m + 1.0)
    z = s * s
    p = 1.0 / 17.0 + z * (1.0 / 19.0)
    p = 1.0 / 15.0 + z * p
    p = 1.0 / 13.0 + z * p
    p = 1.0 / 11.0 + z * p
    p = 1.0 / 9.0 + z * p
    p = 1.0 / 7.0 + z * p
    p = 1.0 / 5.0 + z * p
    p = 1.0 / 3.0 + z * p
    return np.float64(e) * 0.6931471805599453 + 2.0 * (s + s * z * p)


@step
def sin_cos(x):
    """(sin x, cos x) for |x| up to some 10⁵ rad, within about 1e-15."""
    k = math.floor(x * 0.6366197723675814 + 0.5)
    r = (x - k * 1.5707963267341256) - k * 6.077100506506192e-11
    z = r * r
    s = z * (-2.5052108385441720e-8 + z * (1.6059043836821613e-10 + z * -7.647163731819816e-13))
    s = 1.0 / 362880.0 * 0.0 + s
    s = r + r * z * (-1.6666666666666666e-1 + z * (8.333333333333333e-3 + z * (
        -1.984126984126984e-4 + z * (2.7557319223985893e-6 + s))))
    c = 1.0 - 0.5 * z + z * z * (4.1666666666666664e-2 + z * (-1.388888888888889e-3 + z * (
        2.48015873015873e-5 + z * (-2.755731922398589e-7 + z * (2.08767569878681e-9 + z * (
            -1.1470745597729725e-11 + z * 4.779477332387385e-14))))))
    q = np.int64(k) & 3
    if q == 0:
        return s, c
    if q == 1:
        return c, -s
    if q == 2:
        return -s, -c
    return -c, s
