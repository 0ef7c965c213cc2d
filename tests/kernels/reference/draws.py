"""Random numbers by their published recipe, in Python's whole numbers (SplitMix64; Box and Muller)."""

from __future__ import annotations

import math

MASK = (1 << 64) - 1
GAMMA = 0x9E3779B97F4A7C15


def mix(x: int) -> int:
    """SplitMix64's finaliser (Steele, Lea and Flood 2014)."""
    x = (x ^ (x >> 30)) * 0xBF58476D1CE4E5B9 & MASK
    x = (x ^ (x >> 27)) * 0x94D049BB133111EB & MASK
    return x ^ (x >> 31)


def bits(stream: int, i: int) -> int:
    """Draw `i` of SplitMix64 seeded with `stream`."""
    return mix((stream + (i + 1) * GAMMA) & MASK)


def substream(stream: int, name: int) -> int:
    """The stream called `name` under `stream`."""
    return mix(mix((stream + GAMMA) & MASK) ^ ((name * 0x94D049BB133111EB + GAMMA) & MASK))


def uniform(stream: int, i: int) -> float:
    """Draw `i` in [0, 1): its 53 highest bits."""
    return (bits(stream, i) >> 11) / 2**53


def normals(stream: int, first: int, count: int) -> list[float]:
    """`count` standard normal numbers from count/2 draws: cosines and sines of Box and Muller."""
    front, back = [], []
    for i in range(count // 2):
        b = bits(stream, first + i)
        radius = math.sqrt(-2 * math.log(((b >> 32) + 0.5) / 2**32))
        angle = ((b & 0x3FFFFFFF) / 2**30 - 0.5) * math.pi / 2
        s, c = radius * math.sin(angle), radius * math.cos(angle)
        c = -c if b >> 30 & 1 else c
        s, c = (c, s) if b >> 31 & 1 else (s, c)
        front.append(c)
        back.append(s)
    return front + back
