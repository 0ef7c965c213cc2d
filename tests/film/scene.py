"""A small renderer of overhead films whose truth is known; it shares nothing with the tracker.

A pinhole camera with a bent lens looks at a floor with grain, cylinders with shadows and a robot
with its disk. Every pixel is the mean of 3 × 3 rays. Lengths in cm, angles in rad.
"""

import math
from dataclasses import dataclass, field, replace
from functools import lru_cache

import cv2
import numpy as np

RAYS = 3

_STILLS = {}
"""Still parts that were drawn before: they take longest."""


@dataclass(frozen=True, kw_only=True)
class Lens:
    """A camera's construction: where it is, how it leans, how its lens bends straight lines."""

    size: tuple[int, int] = (640, 480)
    focal: float = 720.0
    middle: tuple[float, float] = (322.3, 237.1)
    place: tuple[float, float, float] = (26.0, 23.5, 78.0)
    lean: tuple[float, float, float] = (0.05, -0.04, 0.03)
    bend: tuple[float, float, float] = (-0.12, 0.06, -0.01)

    def rotation(self):
        """From the room's axes to the camera's."""
        turn, _ = cv2.Rodrigues(np.array(self.lean))
        return turn @ np.diag([1.0, -1.0, -1.0])

    @lru_cache(maxsize=2)  # noqa: B019
    def rays(self):
        """How far along x and along y each ray of the picture goes for a cm up, RAYS × RAYS a pixel,
        [2, rows, columns]."""
        width, height = self.size
        made, turn, (a, b, c) = np.empty((2, height * RAYS, width * RAYS)), self.rotation(), self.bend
        bent_x = (np.arange(width * RAYS) / RAYS + (0.5 / RAYS - 0.5) - self.middle[0]) / self.focal
        for row in range(height * RAYS):
            bent_y = (row / RAYS + (0.5 / RAYS - 0.5) - self.middle[1]) / self.focal
            squares, square = bent_x**2 + bent_y**2, 0.0
            for _ in range(12):
                straightened = 1 / (1 + square * (a + square * (b + square * c)))
                square = squares * straightened**2
            x, y = bent_x * straightened, bent_y * straightened
            up = x * turn[0, 2] + y * turn[1, 2] + turn[2, 2]
            made[0, row] = (x * turn[0, 0] + y * turn[1, 0] + turn[2, 0]) / up
            made[1, row] = (x * turn[0, 1] + y * turn[1, 1] + turn[2, 1]) / up
        return made

    def on_plane(self, part, height):
        """Where the rays of a part of the picture meet a plane above the floor: x and y."""
        x, y = self.rays()[:, *part]
        up = height - self.place[2]
        return self.place[0] + x * up, self.place[1] + y * up

    def about(self, x, y, radius, height):
        """The part of the picture's rays that has all that is so near to a place, and some more."""
        corners = [self.pixel(x + i * radius, y + j * radius, height) for i in (-1, 1) for j in (-1, 1)]
        (left, top), (right, bottom) = np.floor(np.min(corners, 0)) - 3, np.ceil(np.max(corners, 0)) + 4
        width, rows = self.size
        return part_of(*np.clip([left, top, right, bottom], 0, [width, rows, width, rows]).astype(int))

    def pixel(self, x, y, height):
        """Where a place is in the picture, px."""
        v = self.rotation() @ (np.array([x, y, height]) - self.place)
        u = v[:2] / v[2]
        square = float(u @ u)
        a, b, c = self.bend
        return self.focal * u * (1 + a * square + b * square**2 + c * square**3) + self.middle


@dataclass(frozen=True, kw_only=True)
class Scene:
    """What is filmed, and how well; brightness 0 to 255.

    A tag takes the disk's place: OpenCV's dictionary, number, side (cm), and its middle ahead and to the left
    of the robot's centre (cm) and turn against it (rad).
    """

    lens: Lens = field(default_factory=Lens)
    room: tuple[float, float] = (50.0, 50.0)
    cylinders: tuple[tuple[float, float, float], ...] = ((15, 15, 4), (35, 15, 4), (15, 35, 4), (35, 35, 4))
    floor: float = 165.0
    black: float = 28.0
    white: float = 225.0
    disk_height: float = 3.0
    disk: tuple[float, float, float, float] = (2.75, 0.7, 0.45, 1.95)
    noise: float = 1.5
    blur: float = 0.6
    contrast: float = 1.0
    glare: float = 0.0
    hidden: float = 0.0
    tag: tuple[int, int, float, tuple[float, float, float]] | None = None
    robot: bool = True
    seed: int = 1

    def but(self, **changes):
        """This scene with changes."""
        return replace(self, **changes)


def part_of(left, top, right, bottom):
    """Rows and columns of the rays of these pixels."""
    return slice(top * RAYS, bottom * RAYS), slice(left * RAYS, right * RAYS)


class Renderer:
    """Draws a scene's pictures; the still part once."""

    def __init__(self, scene):
        self.scene = scene
        self.random = np.random.default_rng(scene.seed)
        key = (scene.lens, scene.room, scene.cylinders, scene.floor, scene.seed)
        if key not in _STILLS:
            _STILLS[key] = self._still()
        self.still = _STILLS[key]

    def picture(self, pose):
        """The picture [height, width] of 8 bits with the robot's centre and heading at `pose`."""
        scene, image = self.scene, self.still.copy()
        if scene.robot:
            self._draw_robot(image, pose)
        if scene.glare:
            self._draw_glare(image)
        if scene.blur:
            image = cv2.GaussianBlur(image, (0, 0), scene.blur)
        image = 110 + scene.contrast * (image - 110)
        image += self.random.normal(0, scene.noise, image.shape) if scene.noise else 0
        return np.clip(np.rint(image), 0, 255).astype(np.uint8)

    def _mean(self, fine):
        """The mean of each pixel's rays."""
        rows, columns = fine.shape
        return fine.reshape(rows // RAYS, RAYS, columns // RAYS, RAYS).mean((1, 3))

    def _still(self):
        """Floor, walls, cylinders and their shadows."""
        scene, lens = self.scene, self.scene.lens
        grain = cv2.GaussianBlur(self.random.normal(0, 1, (256, 256)), (0, 0), 1.5) * 30
        x, y = lens.on_plane(part_of(0, 0, *lens.size), 0.0)
        fine = scene.floor * (1 - 0.004 * np.sqrt((x - 20) ** 2 + (y - 30) ** 2))
        fine += grain[np.floor(y / 0.35).astype(int) % 256, np.floor(x / 0.35).astype(int) % 256]
        for cylinder_x, cylinder_y, radius in scene.cylinders:
            middle = cylinder_x + 2.0, cylinder_y - 1.2
            part = lens.about(*middle, radius + 10, 0.0)  # farther off is no shadow
            far = np.hypot(x[part] - middle[0], y[part] - middle[1]) - radius
            fine[part] *= 1 - 0.45 / (1 + np.exp(far / 0.5))
        fine[(x < 0) | (y < 0) | (x > scene.room[0]) | (y > scene.room[1])] = 70.0
        for step in np.linspace(0, 5, 9):
            for cylinder_x, cylinder_y, radius in scene.cylinders:
                part = lens.about(cylinder_x, cylinder_y, radius, step)
                x, y = lens.on_plane(part, step)
                inside = (x - cylinder_x) ** 2 + (y - cylinder_y) ** 2 < radius**2
                fine[part][inside] = 205.0 if step == 5 else 120.0
        return self._mean(fine)

    def _draw_robot(self, image, pose):
        """The robot's shadow, body and disk, in place."""
        scene, (x, y, heading) = self.scene, pose
        column, row = scene.lens.pixel(x, y, scene.disk_height)
        reach = int(5.5 * scene.lens.focal / (scene.lens.place[2] - 3))
        left, right = max(int(column) - reach, 0), min(int(column) + reach, image.shape[1])
        top, bottom = max(int(row) - reach, 0), min(int(row) + reach, image.shape[0])
        if right <= left or bottom <= top:
            return
        part = part_of(left, top, right, bottom)
        fine = image[top:bottom, left:right].repeat(RAYS, 0).repeat(RAYS, 1)
        floor_x, floor_y = scene.lens.on_plane(part, 0.0)
        fine *= 1 - 0.4 / (1 + np.exp((np.hypot(floor_x - x - 1.0, floor_y - y + 0.6) - 2.8) / 0.3))
        for step in np.linspace(0.3, 0.95 * scene.disk_height, 6):
            body_x, body_y = scene.lens.on_plane(part, step)
            fine[(body_x - x) ** 2 + (body_y - y) ** 2 < 2.9**2] = 85.0
        at = np.stack(scene.lens.on_plane(part, scene.disk_height), -1) - (x, y)
        fine = self._tag(fine, at, heading) if scene.tag else self._disk(fine, at, heading)
        if scene.hidden:  # a cable's end: a strip over the disk's rear, so wide
            across = at[..., 0] * math.cos(heading) + at[..., 1] * math.sin(heading) + 1.1 + scene.hidden / 2
            fine = np.where((np.abs(across) < scene.hidden / 2) & (np.abs(at[..., 1]) < 6), 140.0, fine)
        image[top:bottom, left:right] = self._mean(fine)

    def _disk(self, fine, at, heading):
        """The disk over what is beneath it."""
        scene = self.scene
        radius, centre, front, ahead = scene.disk
        spot = np.array([math.cos(heading), math.sin(heading)]) * ahead
        away = np.hypot(at[..., 0], at[..., 1])
        white = (away < centre) | (np.hypot(at[..., 0] - spot[0], at[..., 1] - spot[1]) < front)
        return np.where(away < radius, np.where(white, scene.white, scene.black), fine)

    def _tag(self, fine, at, heading):
        """A tag on its white card over what is beneath it."""
        scene = self.scene
        dictionary, number, side, (x, y, turn) = scene.tag
        known = cv2.aruco.getPredefinedDictionary(dictionary)
        n = known.markerSize + 2
        cells = cv2.aruco.generateImageMarker(known, number, n) > 0
        c, s = math.cos(heading), math.sin(heading)
        ahead, left = c * at[..., 0] + s * at[..., 1] - x, c * at[..., 1] - s * at[..., 0] - y
        c, s = math.cos(turn), math.sin(turn)
        row = np.floor((0.5 - (c * ahead + s * left) / side) * n).astype(int)
        column = np.floor((0.5 - (c * left - s * ahead) / side) * n).astype(int)
        inside = (row >= 0) & (row < n) & (column >= 0) & (column < n)
        white = ~inside | cells[row.clip(0, n - 1), column.clip(0, n - 1)]
        card = (row >= -1) & (row <= n) & (column >= -1) & (column <= n)
        return np.where(card, np.where(white, scene.white, scene.black), fine)

    def _draw_glare(self, image):
        """A lamp's reflection on everything that is glossy, off the middle."""
        rows, columns = np.mgrid[: image.shape[0], : image.shape[1]]
        away = np.hypot(columns - 0.55 * image.shape[1], rows - 0.45 * image.shape[0])
        image += self.scene.glare * np.exp(-((away / (0.16 * image.shape[1])) ** 2))


def wander(count, rate=25.0, speed=6.0, start=(25.0, 25.0, 0.4), room=(50.0, 50.0), about=7.0):
    """Poses [count, 3] of a robot that turns this way and that and keeps to the middle of the room."""
    x, y, heading = start
    poses = np.empty((count, 3))
    for i in range(count):
        poses[i] = x, y, heading
        home = math.atan2(room[1] / 2 - y, room[0] / 2 - x)
        off = math.hypot(room[0] / 2 - x, room[1] / 2 - y)
        pull = math.sin(home - heading) * max(off - about, 0) * 1.2
        heading += (1.3 * math.sin(i / 17) + 0.9 * math.sin(i / 7.3) + pull) / rate
        x += speed / rate * math.cos(heading)
        y += speed / rate * math.sin(heading)
    return poses
