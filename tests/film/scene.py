"""A small renderer of overhead films whose truth is known; it shares nothing with the tracker.

A pinhole camera with a bent lens looks at a floor with grain, cylinders with shadows and a robot
with its disk. Every pixel is the mean of 3 × 3 rays. Lengths in cm, angles in rad.
"""

import math
from dataclasses import dataclass, field, replace

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

    def rays(self, columns, rows):
        """Directions in the room of the rays through pixels, [..., 3]."""
        bent = np.stack([(columns - self.middle[0]) / self.focal, (rows - self.middle[1]) / self.focal], -1)
        straight = bent.copy()
        for _ in range(12):
            square = (straight**2).sum(-1, keepdims=True)
            a, b, c = self.bend
            straight = bent / (1 + a * square + b * square**2 + c * square**3)
        return np.concatenate([straight, np.ones_like(straight[..., :1])], -1) @ self.rotation()

    def on_plane(self, directions, height):
        """Where rays meet a plane above the floor, [..., 2]."""
        far = (height - self.place[2]) / directions[..., 2]
        return np.array(self.place[:2]) + directions[..., :2] * far[..., None]

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

    def _fine(self, left, top, right, bottom):
        """Directions of the rays of a part of the picture, RAYS × RAYS a pixel."""
        offsets = (np.arange(RAYS) + 0.5) / RAYS - 0.5
        columns = (np.arange(left, right)[:, None] + offsets).ravel()
        rows = (np.arange(top, bottom)[:, None] + offsets).ravel()
        return self.scene.lens.rays(*np.meshgrid(columns, rows))

    def _mean(self, fine):
        """The mean of each pixel's rays."""
        rows, columns = fine.shape
        return fine.reshape(rows // RAYS, RAYS, columns // RAYS, RAYS).mean((1, 3))

    def _still(self):
        """Floor, walls, cylinders and their shadows."""
        scene, (width, height) = self.scene, self.scene.lens.size
        image = np.empty((height, width))
        grain = cv2.GaussianBlur(self.random.normal(0, 1, (256, 256)), (0, 0), 1.5) * 30
        for top in range(0, height, 40):  # in strips: the rays of a whole picture are many
            bottom = min(top + 40, height)
            rays = self._fine(0, top, width, bottom)
            at = scene.lens.on_plane(rays, 0.0)
            cell = np.floor(at / 0.35).astype(int) % 256
            light = scene.floor * (1 - 0.004 * np.hypot(at[..., 0] - 20, at[..., 1] - 30))
            fine = light + grain[cell[..., 1], cell[..., 0]]
            for x, y, radius in scene.cylinders:
                far = np.hypot(at[..., 0] - x - 2.0, at[..., 1] - y + 1.2) - radius
                fine *= 1 - 0.45 / (1 + np.exp(far / 0.5))
            outside = (at < 0).any(-1) | (at > scene.room).any(-1)
            fine = np.where(outside, 70.0, fine)
            for step in np.linspace(0, 5, 9):
                top_of = scene.lens.on_plane(rays, step)
                for x, y, radius in scene.cylinders:
                    inside = (top_of[..., 0] - x) ** 2 + (top_of[..., 1] - y) ** 2 < radius**2
                    fine = np.where(inside, 205.0 if step == 5 else 120.0, fine)
            image[top:bottom] = self._mean(fine)
        return image

    def _draw_robot(self, image, pose):
        """The robot's shadow, body and disk, in place."""
        scene, (x, y, heading) = self.scene, pose
        column, row = scene.lens.pixel(x, y, scene.disk_height)
        reach = int(5.5 * scene.lens.focal / (scene.lens.place[2] - 3))
        left, right = max(int(column) - reach, 0), min(int(column) + reach, image.shape[1])
        top, bottom = max(int(row) - reach, 0), min(int(row) + reach, image.shape[0])
        if right <= left or bottom <= top:
            return
        rays = self._fine(left, top, right, bottom)
        fine = np.kron(image[top:bottom, left:right], np.ones((RAYS, RAYS)))
        at = scene.lens.on_plane(rays, 0.0)
        fine *= 1 - 0.4 / (1 + np.exp((np.hypot(at[..., 0] - x - 1.0, at[..., 1] - y + 0.6) - 2.8) / 0.3))
        for step in np.linspace(0.3, 0.95 * scene.disk_height, 6):
            at = scene.lens.on_plane(rays, step)
            fine = np.where(np.hypot(at[..., 0] - x, at[..., 1] - y) < 2.9, 85.0, fine)
        at = scene.lens.on_plane(rays, scene.disk_height) - (x, y)
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
