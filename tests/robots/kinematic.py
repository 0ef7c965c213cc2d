"""A robot without physics, of the twin body's interface: wheels do at once what they are told."""

from __future__ import annotations

import math
import random
from typing import Any

from realitygap.robots.khepera import PULSES_PER_MM

PULSES_PER_CM = 10 * PULSES_PER_MM
TRACK_CM = 5.3


class KinematicBody:
    """Stands in for the twin's body in tests of line, firmware and loop."""

    def __init__(self, arena: dict[str, Any], *, unit: int, noise: float, seed: int) -> None:
        self.size = arena["size_cm"]
        self.time_ms = 0
        self.leds = [0, 0]
        self.settings: dict[str, tuple[int, ...]] = {}
        self._random = random.Random(1000 * unit + seed)
        self._noise = noise
        self._speed = (0.0, 0.0)
        self._pulses = [0.0, 0.0]
        self._target: tuple[int, int] | None = None
        self._pose = (self.size[0] / 2, self.size[1] / 2, 0.0)

    def advance(self, milliseconds: int) -> None:
        """Move, a millisecond at a time in position control, else at once."""
        assert milliseconds > 0
        self.time_ms += milliseconds
        if self._target is None:
            self._move(milliseconds)
            return
        for _ in range(milliseconds):
            errors = [goal - now for goal, now in zip(self._target, self._pulses, strict=True)]
            self._speed = tuple(max(-20.0, min(20.0, 10 * e)) for e in errors)
            self._move(1)
        self._speed = (0.0, 0.0) if all(self.on_target()) else self._speed

    def _move(self, milliseconds: int) -> None:
        moved = [v * milliseconds / 10 for v in self._speed]
        self._pulses = [p + m for p, m in zip(self._pulses, moved, strict=True)]
        left, right = (m / PULSES_PER_CM for m in moved)
        x, y, heading = self._pose
        middle = heading + (right - left) / TRACK_CM / 2
        x += (left + right) / 2 * math.cos(middle)
        y += (left + right) / 2 * math.sin(middle)
        x = min(max(x, 3.0), self.size[0] - 3.0)
        y = min(max(y, 3.0), self.size[1] - 3.0)
        self._pose = (x, y, heading + (right - left) / TRACK_CM)

    def set_speed(self, left: int, right: int) -> None:
        self._target, self._speed = None, (float(left), float(right))

    def set_position(self, left: int, right: int) -> None:
        self._target = (left, right)

    def set_pwm(self, left: int, right: int) -> None:
        self._target, self._speed = None, (left / 10, right / 10)

    def set_speed_gains(self, kp: int, ki: int, kd: int) -> None:
        self.settings["speed gains"] = (kp, ki, kd)

    def set_position_gains(self, kp: int, ki: int, kd: int) -> None:
        self.settings["position gains"] = (kp, ki, kd)

    def set_profile(self, vl: int, al: int, vr: int, ar: int) -> None:
        self.settings["profile"] = (vl, al, vr, ar)

    def pulses(self) -> tuple[int, int]:
        return round(self._pulses[0]), round(self._pulses[1])

    def set_pulses(self, left: int, right: int) -> None:
        self._pulses = [float(left), float(right)]

    def speeds(self) -> tuple[int, int]:
        return round(self._speed[0]), round(self._speed[1])

    def on_target(self) -> tuple[bool, bool]:
        if self._target is None:
            return True, True
        near = [abs(goal - now) < 1 for goal, now in zip(self._target, self._pulses, strict=True)]
        return near[0], near[1]

    def proximity(self) -> list[int]:
        """Higher near a wall, with noise."""
        x, y, heading = self._pose
        gap = min(x, y, self.size[0] - x, self.size[1] - y)
        return [self._noisy(1000 * math.exp(-gap / 5) * (1 + math.cos(heading + k)) / 2) for k in range(8)]

    def ambient(self) -> list[int]:
        x, _, heading = self._pose
        return [self._noisy(450 - x + 20 * math.cos(heading + k)) for k in range(8)]

    def _noisy(self, value: float) -> int:
        return max(0, min(1023, round(value + self._noise * self._random.gauss(0, 20))))

    def analog(self, n: int) -> int:
        return 100 * n

    def place(self, x_cm: float, y_cm: float, heading: float) -> None:
        self._pose = (x_cm, y_cm, heading)

    def truth(self) -> tuple[float, float, float]:
        return self._pose
