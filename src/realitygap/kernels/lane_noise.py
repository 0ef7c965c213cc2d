"""Normal numbers for trials in lockstep: to the bit for motors, in single precision for sensors, whose margin
allows for it."""

import math

import numpy as np

from realitygap.kernels.jit import step
from realitygap.kernels.lanes import NOISE, WIDE
from realitygap.kernels.rng import bits, normal_pair
from realitygap.kernels.work import DRAWS, MOTOR_NOISE

U, f32, i32, u32 = np.uint64, np.float32, np.int32, np.uint32
ROW, HALF_WORD = U(WIDE), U(32)
SINGLE = f32(2e-6)
"""The most by which a sensor's normal number errs."""
ONE, TWO, HALF = f32(1.0), f32(2.0), f32(0.5)
ROOT_HALF, MANTISSA, WORD = i32(0x3F3504F3), i32(23), i32(32)
"""√½ as bits; widths of a mantissa and of a half word."""
ALL, LOW30, BIT30, BIT31 = u32(0xFFFFFFFF), u32(0x3FFFFFFF), u32(1 << 30), u32(1 << 31)
PER_WORD, PER_LOW, QUARTER_TURN, LOG_TWO = f32(2.0**-32), f32(2.0**-30), f32(math.pi / 2), f32(math.log(2.0))
THIRD, FIFTH, SEVENTH, NINTH = f32(1 / 3), f32(1 / 5), f32(1 / 7), f32(1 / 9)
SINE, COSINE = (
    (f32(-1 / 6), f32(1 / 120), f32(-1 / 5040)),
    (f32(-1 / 2), f32(1 / 24), f32(-1 / 720), f32(1 / 40320)),
)


@step
def log_share(high):
    """Natural logarithm of u = (high + ½)/2³² to about 2e-7 relative, also near u = 1, by 1 − u."""
    b = f32(f32(high) + HALF).view(i32)
    e = i32(i32(b - ROOT_HALF) >> MANTISSA)
    m = i32(b - i32(e << MANTISSA)).view(f32)
    short = (f32(u32(high ^ ALL)) + HALF) * PER_WORD
    s = (-short if e == WORD else m - ONE) / (m + ONE)
    z = s * s
    series = ONE + z * (THIRD + z * (FIFTH + z * (SEVENTH + z * NINTH)))
    return f32(i32(e - WORD)) * LOG_TWO + TWO * s * series


@step
def normal_single(high, low):
    """The first of rng.normal_pair, from both halves of its draw."""
    radius = f32(math.sqrt(-TWO * log_share(high)))
    angle = (f32(u32(low & LOW30)) * PER_LOW - HALF) * QUARTER_TURN
    z = angle * angle
    s = radius * (angle + angle * z * (SINE[0] + z * (SINE[1] + z * SINE[2])))
    c = radius * (ONE + z * (COSINE[0] + z * (COSINE[1] + z * (COSINE[2] + z * COSINE[3]))))
    c = -c if u32(low & BIT30) != 0 else c
    return s if u32(low & BIT31) != 0 else c


@step
def draw_normals(n, first, lanes):
    """As rng.normals, for all lanes; sensors' in Lanes.single."""
    s = lanes.single
    for i in range(MOTOR_NOISE):
        at, other = U(i) * ROW, NOISE + U(DRAWS - MOTOR_NOISE + i) * ROW
        for t in range(n):
            lanes.noise[at + t], z = normal_pair(lanes.stream[t], first + i)
            s[other + t] = f32(z)
    for i in range(DRAWS - MOTOR_NOISE):
        at = NOISE + U(i) * ROW
        for t in range(n):
            b = bits(lanes.stream[t], first + MOTOR_NOISE + i)
            lanes.high[t], lanes.low[t] = u32(b >> HALF_WORD), u32(b)
        for t in range(n):
            s[at + t] = normal_single(lanes.high[t], lanes.low[t])
