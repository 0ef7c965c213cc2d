"""Scratch arrays of trials in lockstep (lockstep.py), one lane per trial.

Rows of WIDE lanes lie in one flat array at constant unsigned offsets, so that LLVM knows their distance,
checks neither for overlap nor for negative indices, and vectorises each loop.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from realitygap.kernels.network import ROWS
from realitygap.kernels.params import RAYS, F, Networks, Path, World
from realitygap.kernels.trial import PROXIMITY
from realitygap.kernels.work import MOTOR_NOISE, Work, new_work, spread_fan

WIDE = 64
"""Trials at once."""
SOME = 128
"""Pairs of a trial and a sensor whose rays are followed at once, so that their rows stay in the nearest
cache."""
NOTED = 8
"""Steps that are noted before they are copied to the paths."""
SENSORS, CYLINDERS = 8, 4
"""Largest numbers of them."""
LARGEST, GAP = 120.0, 0.01
"""The largest room, and the smallest gap between cylinders, cm, for which lockstep.py's margins hold."""
G = NDArray[np.float32]


def _rows(first: int, count: int, wide: int = WIDE) -> tuple[np.uint64, ...]:
    """Offsets of rows."""
    return tuple(np.uint64(wide * i) for i in range(first, first + count))


# Of Lanes.double: pose, arc, the body's end without contact, ground speeds, contact, and nine of each wheel.
X, Y, HEADING, COS, SIN, DX, DY, TURN, SHARE, COS_MEAN, SIN_MEAN = _rows(0, 11)
TO_X, TO_Y, LEFT, RIGHT, TOUCHED = _rows(11, 5)
WHEELS = _rows(16, 18)[::9]
SPEED, CHANGE, P0, P1, P2, P3, P4, TARGET, PLAY = _rows(0, 9)
# Of Lanes.single: pose; the cylinders as the robot sees them, forward and leftward; how uncertain the inputs
# are; and of each sensor place, direction, light, cylinders in its fan (their numbers from 1, octal), noise.
X1, Y1, COS1, SIN1 = _rows(0, 4)
FORWARD, UNSURE = _rows(4, 9)[::8]
PLACE_X, PLACE_Y, FACING_X, FACING_Y, LIGHT, CROWD, NOISE = _rows(13, 7 * SENSORS)[::SENSORS]
# Of Lanes.pair: place and direction, reciprocals of the walls' distances, the sum, what is least certain, the
# offset; and of each cylinder how far ahead and aside it is, 1/(square of its distance − of its radius), its
# radius squared and 1/radius.
PX, PY, FX, FY, WEST, EAST, SOUTH, NORTH, SUM, LEAST, OFFSET, WHICH = _rows(0, 12, SOME)
DISCS = _rows(12, 5 * CYLINDERS, SOME)[::5]
ASIDE, INVERSE, SQUARE, BEND = _rows(1, 4, SOME)
MANY = np.uint64(SENSORS * WIDE + 1)
"""Where in Lanes.listed the pairs with more than two cylinders in their fans begin."""


class Lanes(NamedTuple):
    """State of trials in lockstep."""

    double: F
    single: G
    pair: G
    noise: F
    """[4, WIDE] normal numbers of a step, of the motors."""
    stream: NDArray[np.uint64]
    high: NDArray[np.uint32]
    low: NDArray[np.uint32]
    """[WIDE] a draw of each."""
    inputs: NDArray[np.int32]
    change: NDArray[np.int32]
    base: NDArray[np.int32]
    outputs: NDArray[np.int32]
    """[.., WIDE] as of Work."""
    noticed: NDArray[np.uint32]
    listed: NDArray[np.uint64]
    """[SENSORS · WIDE] 1 unless that sensor certainly reads 0; the numbers of those pairs, or of lanes."""
    apart: NDArray[np.uint64]
    """[WIDE] 1 where a lane has to do a part of its step separately."""
    fan: G
    """[3, RAYS] cosine and sine of each ray off its sensor's direction, and its weight."""
    edges: G
    """[8, P] as Work.fan."""
    discs: G
    """[1 + CYLINDERS, 3] x, y, radius; those that are not there, and the first, lie far off."""
    notes: F
    """[NOTED, 6, WIDE] rows of paths."""
    loud: G
    """[2] deviation of the noise of readings, and of dark ones, counts."""
    work: Work
    """Of what goes one by one."""


def new_lanes(world: World, nets: Networks) -> Lanes:
    """Scratch arrays for trials of any of `nets`, side by side."""
    robot, neurons = world.robot, nets.thresholds.shape[1]
    rays, facing = robot.proximity_ray[0, :, :RAYS], robot.proximity_ray[0, :, RAYS]
    cosines, sines = facing @ rays, facing[0] * rays[1] - facing[1] * rays[0]
    discs = np.tile(np.array((1e4, 1e4, 1.0), np.float32), (1 + CYLINDERS, 1))
    discs[1 : 1 + len(world.arena.cylinders)] = world.arena.cylinders
    fed, loud = len(world.task.channels), np.array([robot.noise_proximity, robot.noise_proximity_dark])
    return Lanes(
        double=np.zeros(34 * WIDE), single=np.zeros((13 + 7 * SENSORS) * WIDE, np.float32),
        pair=np.zeros((12 + 5 * CYLINDERS) * SOME, np.float32), noise=np.zeros(MOTOR_NOISE * WIDE),
        stream=np.zeros(WIDE, np.uint64), high=np.zeros(WIDE, np.uint32), low=np.zeros(WIDE, np.uint32),
        inputs=np.zeros(fed * WIDE, np.int32), change=np.zeros(fed * WIDE, np.int32),
        base=np.zeros(neurons * WIDE, np.int32), outputs=np.zeros(ROWS * neurons * WIDE, np.int32),
        noticed=np.zeros(SENSORS * WIDE, np.uint32), listed=np.zeros(2 * (SENSORS * WIDE + 1), np.uint64),
        apart=np.zeros(WIDE, np.uint64),
        fan=np.array([cosines, sines, robot.proximity_weight[0, :RAYS]], np.float32),
        notes=np.zeros(NOTED * len(Path._fields) * WIDE), loud=(world.level * loud).astype(np.float32),
        edges=spread_fan(robot).astype(np.float32), discs=discs,
        work=new_work(robot, world.task, nets),
    )  # fmt: skip


def fit_lanes(world: World) -> bool:
    """Whether trials of this world can run in lockstep.

    That is: a disc with the paper's infrared equation, or its extended form, in a room with nothing but a few
        cylinders, and constants for which single precision's margins hold.
    """
    robot, arena, task = world.robot, world.arena, world.task
    plain = task.feed == PROXIMITY and not len(robot.outline) and not robot.proximity_table
    if not plain or not 0 < len(robot.proximity_a) <= SENSORS or min(task.channels, default=0) < 0:
        return False
    measured = robot.proximity_curve.shape[1] + robot.proximity_noise.shape[1] or robot.proximity_dead
    furnished = len(arena.segments) + len(arena.reflectance) or len(arena.cylinders) > CYLINDERS
    if measured or furnished or arena.size.max() > LARGEST or not np.isfinite(robot.proximity_reach).all():
        return False
    place, radius = arena.cylinders[:, :2], arena.cylinders[:, 2]
    gaps = np.hypot(*(place[:, None] - place).T) - radius - radius[:, None]
    spaced = (gaps[~np.eye(len(radius), dtype=bool)] > GAP).all() and ((radius > 0.5) & (radius < 10)).all()
    loud = world.level * max(robot.noise_proximity, robot.noise_proximity_dark) > 1000
    bands = robot.proximity_high - robot.proximity_low >= 1 and robot.proximity_top <= 4096
    bounded = (np.abs(robot.proximity_b) < 1000).all() and (robot.proximity_offset >= 0).all()
    return bool(spaced and not loud and bands and bounded)
