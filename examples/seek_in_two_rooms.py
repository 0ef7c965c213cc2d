"""A task that feeds infrared and light to one network: find a lamp and touch nothing on the way.

    realitygap evolve examples/seek_in_two_rooms.py --set encoding.slots=36

The proximity sensors are numbered first: 0 to 7 are a Khepera's infrared sensors, 8 to 15 its light
sensors. `sensors` chooses those that become inputs, of either kind and in any order; 16 at most.
"""

import math

from realitygap import Start, Task


def score(path, room):
    """Nearness to the nearest lamp, 0 … 1, counted only in steps without contact."""
    total = 0.0
    for i in range(path.x.size):
        nearest = 1e12
        for lamp in range(room.lamps.shape[0]):
            dx = path.x[i] - room.lamps[lamp, 0]
            dy = path.y[i] - room.lamps[lamp, 1]
            nearest = min(nearest, math.sqrt(dx * dx + dy * dy))
        total += (1.0 - path.contact[i]) / (1.0 + nearest / 10.0)
    return total / path.x.size


task = Task(
    name="seek-in-two-rooms",
    arena="two_rooms.toml",
    feeds=("proximity", "ambient"),
    sensors=(0, 1, 2, 3, 4, 5, 8, 9, 10, 11, 12, 13),  # those in front and at the sides, of both kinds
    start=Start(x_cm=20, y_cm=20, radius_cm=2),
    seconds=20,
    trials=2,
    score=score,
)
