"""Scratch arrays of one trial: allocated once a batch, so that no step allocates."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from realitygap.compiled import step
from realitygap.kernels.network import ROWS
from realitygap.kernels.params import F32, F, Networks, Path, Robot, Trial
from realitygap.kernels.rays import INVERSE, MIRROR

DRAWS = 8
"""Random draws of one block of noise, which give 16 normal numbers."""
MOTOR_NOISE = 4
"""Normal numbers of a step for the motors: friction left, right; speed left, right."""


class Work(NamedTuple):
    """Arrays of one trial; the letters are those of params.py."""

    eyes: F32
    """Rows of eight sensors, see rays.py."""
    noise: F
    """[16·m] normal numbers of this step."""
    readings: F
    """[P, A or P + A] readings of the fed sensors, counts."""
    unfed: F
    """[A, P or 0] readings of the other sensors; 0: they are not read."""
    unfed_noise: F
    """[16·m] their normal numbers."""
    pose: F
    """[5] x, y, heading and the heading's cosine and sine."""
    start: F
    """[3] the trial's start: x, y, heading."""
    wheel: F
    """[2, 9] see wheels.py."""
    ground: F
    """[3] speeds of the wheels over the ground (cm/s), contact (0 or 1)."""
    base: NDArray[np.int32]
    """[M] −threshold plus the inputs' contribution, of each computing neuron."""
    outputs: NDArray[np.int32]
    """[ROWS · M] see network.py."""
    link_end: NDArray[np.uint64]
    """[M] number of the first link that is not this neuron's."""
    link_back: NDArray[np.uint64]
    """[K] offset back in `outputs` to a link's source."""
    link_weight: NDArray[np.int32]
    """[K]."""
    sensor_link: NDArray[np.int64]
    """[4, K + 1] the network's links from sensors: target, source, weight, delay."""
    settled: NDArray[np.int64]
    """[1] 1 if the network repeats itself until an input changes."""
    inputs: NDArray[np.int32]
    """[I] the step's inputs."""
    change: NDArray[np.int32]
    """[I] their change since the previous step."""


class Record(NamedTuple):
    """A trial in full, a row a step: see realitygap.track.Trajectory. Without rows: none is kept."""

    pose: F
    """[steps, 3] x, y, heading at the step's beginning."""
    proximity: F
    ambient: F
    inputs: NDArray[np.int64]
    commands: NDArray[np.int64]
    wheels: F


class Robots(NamedTuple):
    """N robots between two steps, each at its own, to be advanced by one from Python."""

    pose: F
    """[N, 3] x, y (cm), heading (rad)."""
    wheel: F
    """[N, 2, 9] see wheels.py."""
    step: NDArray[np.int64]
    """[N] steps done."""
    stream: NDArray[np.uint64]
    """[N] of each robot's noise."""
    path: F
    """[N, 6, steps] the rows of params.Path; what lies beyond `steps` is not stored."""
    readings: F
    """[N, P, A or P + A] readings of the fed sensors, and [N, A, P or 0] of the others."""
    unfed: F


@step
def noise_blocks(sensors):
    """Blocks of 16 normal numbers that a step needs for `sensors` readings and the motors."""
    return (sensors + MOTOR_NOISE + 15) // 16


NO_NETWORK = Networks(
    inputs=np.zeros(0, np.int64), neurons=np.zeros(0, np.int64), thresholds=np.zeros((0, 2), np.int16),
    sensor_links=np.zeros((0, 1, 4), np.int16), sensor_count=np.zeros(0, np.int64),
    links=np.zeros((0, 1, 4), np.int16), link_start=np.zeros((0, 3), np.int16),
)  # fmt: skip
"""Where something else decides, or nothing."""
NO_RECORD = Record(
    pose=np.zeros((0, 3)), proximity=np.zeros((0, 0)), ambient=np.zeros((0, 0)),
    inputs=np.zeros((0, 0), np.int64), commands=np.zeros((0, 2), np.int64), wheels=np.zeros((0, 2)),
)  # fmt: skip


def unfed() -> Trial:
    """A trial without steps, whose network is fed nothing: for sensors and wheels alone."""
    return Trial(steps=0, feed=0, channels=np.zeros(0, np.int64), start=np.zeros(5))


def new_noise(sensors: int) -> F:
    """Room for a step's normal numbers."""
    return np.zeros(16 * noise_blocks(sensors))


def new_record(robot: Robot, inputs: int, steps: int) -> Record:
    """Room for a trial in full."""
    near, light = len(robot.proximity_place), len(robot.ambient_place)
    return Record(
        pose=np.zeros((steps, 3)), proximity=np.zeros((steps, near)), ambient=np.zeros((steps, light)),
        inputs=np.zeros((steps, inputs), np.int64), commands=np.zeros((steps, 2), np.int64),
        wheels=np.zeros((steps, 2)),
    )  # fmt: skip


def new_robots(count: int, steps: int, work: Work) -> Robots:
    """Robots that stand at (0, 0), with room for paths of so many steps."""
    return Robots(
        pose=np.zeros((count, 3)), wheel=np.zeros((count, *work.wheel.shape)),
        step=np.zeros(count, np.int64), stream=np.zeros(count, np.uint64),
        path=np.zeros((count, len(Path._fields), steps)),
        readings=np.zeros((count, len(work.readings))), unfed=np.zeros((count, len(work.unfed))),
    )  # fmt: skip


def new_work(robot: Robot, task: Trial, nets: Networks | None = None, *, whole: bool = False) -> Work:
    """Scratch arrays for trials of `task` by `robot`.

    Args:
        robot: whose sensors are read.
        task: what feeds the controllers.
        nets: networks of the most neurons and links that are to decide.
        whole: also for sensors that feed no controller.
    """
    nets = NO_NETWORK if nets is None else nets
    near, light = len(robot.proximity_place), len(robot.ambient_place)
    sensors, unfed = (near, light, near + light)[task.feed], (light, near, 0)[task.feed] if whole else 0
    inputs, neurons, links = len(task.channels), nets.thresholds.shape[1], nets.links.shape[1]
    return Work(
        eyes=np.zeros(int(INVERSE + MIRROR + MIRROR), np.float32),
        noise=new_noise(sensors), readings=np.zeros(sensors),
        unfed=np.zeros(unfed), unfed_noise=new_noise(unfed),
        pose=np.zeros(5), start=np.zeros(3), wheel=np.zeros((2, 9)), ground=np.zeros(3),
        base=np.zeros(neurons, np.int32), outputs=np.zeros(ROWS * neurons, np.int32),
        link_end=np.zeros(neurons, np.uint64), link_back=np.zeros(links, np.uint64),
        link_weight=np.zeros(links, np.int32),
        sensor_link=np.zeros((4, links + 1), np.int64), settled=np.zeros(1, np.int64),
        inputs=np.zeros(inputs, np.int32), change=np.zeros(inputs, np.int32),
    )  # fmt: skip
