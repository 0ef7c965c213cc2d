"""A task of your own: follow the walls of two rooms, near but never touching.

    realitygap evolve examples/follow_the_wall.py

`score` is plain Python over arrays (a row for each step of 0.1 s) and runs compiled. It may use
numbers, math and NumPy. `path` has x, y (cm), heading (rad), left, right (ground speed of each
wheel, cm/s) and contact (1 while touching); `room` has size, cylinders, lamps (cm), top_speed
(cm/s) and radius (of the robot, cm).
"""

from realitygap import Start, Task

LANE_CM = 5.0


def score(path, room):
    """Speed as a share of the top speed, counted only within 5 cm of an outer wall and without contact."""
    total = 0.0
    for i in range(path.x.size):
        beside = min(path.x[i], room.size[0] - path.x[i])
        below = min(path.y[i], room.size[1] - path.y[i])
        gap = min(beside, below) - room.radius
        if gap < LANE_CM and path.contact[i] == 0:
            total += (path.left[i] + path.right[i]) / 2.0
    return max(0.0, total / (path.x.size * room.top_speed))


task = Task(
    name="follow-the-wall",
    arena="two_rooms.toml",  # beside this file; the name of a shipped arena works too
    feeds="proximity",
    sensors=(0, 1, 2, 3, 4, 5, 6, 7),
    start=Start(x_cm=20, y_cm=30, radius_cm=5),
    seconds=20,
    trials=2,
    score=score,
)
