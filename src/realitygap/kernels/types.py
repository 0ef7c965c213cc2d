"""The kernels' arguments: robot, arena, task and networks as plain arrays.

Every value is a float64, an int64 or a C-contiguous array of the stated type, so that one compiled kernel
serves every robot, arena and task. Lengths cm, speeds cm/s, angles rad, readings counts. `world`, `tasks` and
`control` build these; nothing here checks them.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

F = NDArray[np.float64]
F32 = NDArray[np.float32]
I64 = NDArray[np.int64]

STEP_S = 0.1
"""One simulation step (§3.2): sensing, network and wheels are processed every 100 ms. A robot may have
another period; its wheels' model and its network's ten updates are per step all the same."""
UPDATES = 10
"""Network updates of 10 ms in one step (§5.3)."""
RAYS = 10
"""Rays of one sensor, in an arc of 180° (§3.2.3)."""
EYES = 8
"""Sensors that are looked through side by side."""
PAIRS = 32
"""The most pairs of a ray and its mirror image that one has."""
CONE = 0.15643446504023087
"""cos 81°: the outermost rays' angle off the sensor's direction."""
MAX_DELAY = 4
"""Longest delay of a link, in updates (§5.3)."""
LAMP_POINTS = 5
"""Point sources that model one lamp (§3.3)."""


class Contribution(NamedTuple):
    """Contribution of one kind of object to the readings of P proximity sensors."""

    at: F
    """[D] distances from the body's edge, rising, cm."""
    added: F
    """[D, B, P] counts, at bearings 0, 1/B, 2/B, … of a turn, counter-clockwise from the robot's front."""


class Table(NamedTuple):
    """A look-up table of proximity readings (infrared.py)."""

    nothing: F
    """[P] readings with nothing near."""
    wall: Contribution
    cylinder: Contribution


class Wheels(NamedTuple):
    """The wheels and what turns them (§3.2.2)."""

    track: float
    speed_per_unit: F
    """[2] cm/s of the left and the right wheel per Khepera unit."""
    kp: float
    ki: float
    kd: float
    divisor: float
    """Of the printed wheel equation (§3.2.2); the divisor is the "mass"."""
    lag: float
    """Share of a command that acts one step late: 0 in the paper."""
    rest_speed: float
    """A wheel rests below this, cm/s."""
    friction: float
    """The integral term that frees it, cm/s²."""
    half_play: float
    """Half the play, cm/s over a step: 0 in the paper."""
    top_command: float
    """Largest command of the network, Khepera units: 10."""


class Proximity(NamedTuple):
    """`P` proximity sensors (§3.2.3). Measured ones have curves; empty curves mean the paper's equation."""

    place: F
    """[P, 2] sensor places in the robot's frame (x forward, y left)."""
    facing: F
    """[P, 2] unit vector of each sensor's direction in the robot's frame."""
    fan: F32
    """[3, RAYS/2] of each pair of a ray and its mirror image, outermost first: cosine and sine of their angle
    off the sensor's direction, and cos^m β."""
    rows: F32
    """[blocks, 8, EYES] of each sensor, the last one repeated: place, direction, reach, a, b, offset."""
    span: float
    """Distance from the robot's middle beyond which no sensor notices anything, cm."""
    a: F
    b: F
    offset: F
    """[P] of each sensor: Σ cos^m β (a/(d + offset)² + b)."""
    reach: F
    """[P] distance beyond which every ray's term is ≤ 0, √(a/−b) − offset; inf where b ≥ 0."""
    top: float
    """The converter's highest count."""
    cone: float
    """The outermost rays' cosine."""
    lambertian: float
    """1: surfaces reflect by the cosine of incidence; 0 in the paper."""
    low: float
    high: float
    """Readings (counts) that become a network's inputs −10 and +10."""
    curve: F
    knee: float
    """[P, n] counts at equal steps of √x / (√x + knee), x = Σ weight a / ((d + offset)² + width²)."""
    width2: float
    least: float
    """width², cm²; and 1/d of a ray below which nothing returns."""
    overlap: float
    """Weight of the overlap of beams: light that a flat surface before the middle ray reflects into the
    outermost."""
    dead: float
    """Counts below which the sensors read 0."""
    noise: F
    rise: F
    """[P, n] deviation at equal steps of the reading, 0 … top; [P] its rise with the wheels' speed, s/cm."""
    between: F
    """[n] deviation, at equal steps of the reading, of what a trial draws once a sensor; empty: none."""
    table: Table | tuple[()]
    """Replaces equation and rays; (): none."""


class Ambient(NamedTuple):
    """`A` ambient light sensors (§3.3)."""

    place: F
    """[A, 2] as for proximity."""
    facing: F
    """[A, 2] unit vector of each sensor's direction in the robot's frame."""
    fan: F32
    """[3, r/2 rounded up] as for proximity; weights: reflectance · cos^m β · RAYS / r of r rays, 1.5 cos² β
    in the paper; an odd one in the middle counts as two halves."""
    rows: F32
    """[blocks, 5, EYES] place, direction, reach (inf)."""
    gain: F
    """[A] factor on the sensor's total illumination: 1 in the paper."""
    floor: F
    dark: F
    """[A] V = floor + 1/√A clipped at dark, of each sensor: all equal in the paper (55, 484)."""
    curve: F
    knee: float
    noise: F
    rise: F
    between: F
    """As for proximity, x the illumination times gain."""
    top: float
    """The converter's highest count."""
    low: float
    high: float
    """As for proximity: low is dark."""


class Light(NamedTuple):
    """Extensions of the paper's light model (§3.3), all 0 in it."""

    linear: float
    """1: V = dark − A, clipped at floor."""
    facing: float
    """The exponent of direct light's cosine of incidence."""
    height2: float
    """The lamp's height², cm²."""
    flat: float
    """1: reflected light falls off as 1/√(d² + near²)."""
    near: float
    """`near` above, cm."""
    lambertian: float
    """1: surfaces are lit by the cosine of incidence."""
    narrow: float
    """The share by which a lamp's points are moved to its centre."""
    wall_offset: float
    """Distance of a lamp from a wall, cm."""
    clear: float
    """The share of light's path from a lamp to a surface that is above the body's top."""


class Noise(NamedTuple):
    """Observed deviations (§6)."""

    proximity: float
    """Observed deviation (§6), counts, where the noise-free reading is above 0."""
    proximity_dark: float
    ambient: float
    wheel: float
    """Share of the speed."""
    friction: float
    """Share of the friction's threshold."""


class Robot(NamedTuple):
    """A robot's constants."""

    radius: float
    """Of the disc, or of the circle about the outline whose middle is the axle's."""
    outline: F
    """[V, 4] corners (x forward, y left), and the outward normal of the edge from each to the next,
    counter-clockwise; V = 0: a disc."""
    period: float
    """Length of a step, s: 0.1 in the paper."""
    wheels: Wheels
    proximity: Proximity
    ambient: Ambient
    light: Light
    noise: Noise


class Arena(NamedTuple):
    """A rectangular room from (0, 0) to `size`, and its contents."""

    size: F
    """[2] width (x) and depth (y), cm."""
    segments: F
    """[S, 4] inner walls, x0 y0 x1 y1."""
    segment_along: F
    """[S, 3] unit vector of each from its first end to its second, and its length."""
    cylinders: F
    """[C, 3] x, y, radius."""
    together: int
    """Cylinders that a ray may be held against at once: 4, or 1 where some overlap."""
    grid: I64
    """[2] cells along x and y: one, unless there are many obstacles."""
    cells_per_cm: F
    near_cylinders: NDArray[np.uint64]
    cylinder_gap: F
    """[cells, C] numbers of all cylinders, nearest first, and the least distance (cm) of each from any
    position in the cell; with one cell: in order, and 0."""
    near_segments: NDArray[np.uint64]
    segment_gap: F
    """[cells, S] the same for the inner walls."""
    lamp_points: F
    """[L, LAMP_POINTS, 2] places of each lamp's point sources."""
    lamp_weights: F
    """[L, LAMP_POINTS] k_i of §3.3, times the lamp's brightness."""
    lamp_offset: F
    """[L] the −4.15 of §3.3, times the lamp's brightness."""
    lamp_centre: F
    """[L, 2] the place that distance to the lamp is measured to."""
    sliding: float
    """Coulomb coefficient of a body sliding along a surface."""
    reflectance: F
    """[1 + C] of the walls and of each cylinder, relative to the surfaces that a robot's constants hold for;
    empty if all are 1."""


class Trial(NamedTuple):
    """One trial of a task, without its score."""

    steps: int
    feed: int
    """0: the network is fed proximity readings; 1: ambient readings; 2: both, proximity first."""
    channels: I64
    """[n_inputs] which of the fed readings each input is made of; −1 feeds a constant 0."""
    start: F
    """[5] centre x, centre y, radius of the disc of starts, lowest and highest heading."""


class World(NamedTuple):
    """Everything that a trial depends on."""

    robot: Robot
    arena: Arena
    task: Trial
    level: float
    """Noise level: 1 is observed."""


class Networks(NamedTuple):
    """N decoded networks. Neurons are numbered densely: outputs 0 (left) and 1 (right) first,
    then the hidden ones; links are grouped by their target and sorted by source kind."""

    inputs: I64
    """[N] inputs that each is made for."""
    neurons: I64
    """[N] neurons that compute: 2 outputs + hidden."""
    thresholds: NDArray[np.int16]
    """[N, M]."""
    sensor_links: NDArray[np.int16]
    """[N, K, 4] target neuron, source input, weight, delay; sorted by delay."""
    sensor_count: I64
    """[N]."""
    links: NDArray[np.int16]
    """[N, K, 4] target neuron, source neuron, weight, delay; sorted by target."""
    link_start: NDArray[np.int16]
    """[N, M + 1] links of neuron i are link_start[i] .. link_start[i + 1]."""


class Path(NamedTuple):
    """One trial as a task's score sees it: a row a step, after that step's movement. These are arrays for
    compiled code, which has no Track."""

    x: F
    """[steps] cm."""
    y: F
    heading: F
    """[steps] rad, unwrapped."""
    left: F
    """[steps] ground speed of the left wheel, cm/s: from the body's movement after contact."""
    right: F
    contact: F
    """[steps] 1 where the body touched something in that step, else 0."""


class Room(NamedTuple):
    """The world as a task's score sees it, besides the path."""

    lamps: F
    """[L, 2] lamp centres, cm."""
    size: F
    """[2] cm."""
    cylinders: F
    """[C, 3] x, y, radius, cm."""
    top_speed: float
    """Speed of a wheel at the network's largest command, cm/s."""
    radius: float
    """Body radius, cm."""
