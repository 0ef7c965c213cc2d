"""Tables in the community's format, made by a slow law of their own, with the faults that real ones have.

One reading at each pose, a rig that was turned by a degree or two, a row of distances a millimetre off, one
sensor with dirt before it, noise with heavy tails; light is inverted and goes in steps of 10.24.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

__all__ = ["DIRTY", "TURN_DEG", "write_tables"]

LOOKS = (90, 45, 3, -4, -45, -90, 180, 178)
LEFT = (0.9, 2.2), (1.8, 1.7), (2.4, 0.6)
PLACES = (*LEFT, *((x, -y) for x, y in reversed(LEFT)), (-2.3, -0.9), (-2.3, 0.9))
RADIUS_CM, TURN_DEG, DIRTY, NOISE = 2.75, 1.7, 4, 21.0
BEARINGS = 60
RAYS_DEG = np.linspace(-75.0, 75.0, 31)


def write_tables(folder: Path) -> Path:
    """`wall.sam` and `light.sam` in a folder."""
    draw = np.random.default_rng(1995)
    gains = 1300.0 * draw.uniform(0.8, 1.2, 8)
    gains[DIRTY] *= 0.5
    lamp = 60.0 * draw.uniform(0.8, 1.2, 8)

    def wall(distance: float, bearing: float) -> list[int]:
        clean = np.array([gains[k] * _thrown_back(k, distance, bearing) - 45.0 for k in range(8)])
        clean[DIRTY] += 20.0
        noisy = clean + (clean > 30) * NOISE * draw.standard_t(8, 8) * math.sqrt(6 / 8)
        return [round(v) for v in np.clip(noisy, 0, 1023)]

    def light(distance: float, bearing: float) -> list[int]:
        read = np.array([max(60.0, 485.0 - lamp[k] * _lit(k, distance, bearing)) for k in range(8)])
        steps = np.rint((1.0 - (read + 4.5 * draw.standard_normal(8)) / 500.0) * 100.0)
        return [int(step * 10.24) for step in np.clip(steps, 0, 99)]

    for name, read, first, step, many in (("wall", wall, 2, 3, 15), ("light", light, 13, 30, 10)):
        rows = [f"8 {BEARINGS} {many} {first} {step}"]
        for d in range(many):
            rows.append(f"TURN {d}")
            off = 0.1 if name == "wall" and d >= 8 else 0.0
            for b in range(BEARINGS):
                place = (first + step * d) / 10 - off, -360.0 / BEARINGS * b + TURN_DEG
                rows.append(" ".join(map(str, read(*place))))
        (folder / f"{name}.sam").write_text("\n".join([*rows, "END"]) + "\n", "utf-8")
    return folder


def _thrown_back(k: int, distance_cm: float, bearing_deg: float) -> float:
    """Light that a matt wall throws back: a sum over rays, each by both cosines and the square of its way."""
    x, y = PLACES[k]
    towards = math.radians(bearing_deg)
    gap = distance_cm + RADIUS_CM - (x * math.cos(towards) + y * math.sin(towards))
    total = 0.0
    for ray in RAYS_DEG:
        meets = math.cos(math.radians(LOOKS[k] + ray - bearing_deg))
        if meets > 0.05:
            total += math.cos(math.radians(ray)) ** 2 * meets / (gap / meets + 0.35) ** 2
    return total / 8.0


def _lit(k: int, distance_cm: float, bearing_deg: float) -> float:
    """Direct light of a lamp, by the cosine of its angle; none from behind the body."""
    x, y = PLACES[k]
    far = distance_cm + RADIUS_CM
    dx, dy = far * math.cos(math.radians(bearing_deg)) - x, far * math.sin(math.radians(bearing_deg)) - y
    cosine = math.cos(math.atan2(dy, dx) - math.radians(LOOKS[k]))
    return 500.0 * max(0.0, cosine) ** 1.3 / (dx * dx + dy * dy)
