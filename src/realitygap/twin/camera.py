"""The overhead camera: true poses in, frames out, afterwards and at any pace.

Its lens, what it draws and its pixels. Frames are drawn or, if asked for, made by MuJoCo's renderer, through
the same camera and lens; `metadata` says which made them. The lens is the twin's own; the tracker's camera
model has to find it out from frames (film/camera.py).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from realitygap.errors import ConfigError
from realitygap.track import Track
from realitygap.twin.compiled import jit, part
from realitygap.twin.noise import check_scale, draws
from realitygap.twin.unit import (
    BODY_RADIUS,
    BODY_TOP,
    WALL_HALF,
    WALL_HEIGHT,
    Unit,
    draw_unit,
    plain_arena,
)
from realitygap.values import Closing, Pose

__all__ = [
    "DISK_HEIGHT", "DISK_RADIUS", "FRONT_AHEAD", "FRONT_RADIUS", "HEIGHT", "MIDDLE_RADIUS", "WIDTH",
    "Lens", "OverheadCamera", "Plate", "hang_camera",
]  # fmt: skip

Array = NDArray[np.float64]
Pixels = NDArray[np.float32]
Frame = NDArray[np.uint8]
Part = tuple[slice, slice]
"""Rows and columns of a picture."""

DISK_RADIUS, MIDDLE_RADIUS, FRONT_RADIUS, FRONT_AHEAD = 0.0275, 0.007, 0.0045, 0.0195
"""The disk on the robot's back: black, with a white patch in the middle and another ahead."""
DISK_HEIGHT = 0.0305
"""On top of the robot: half a millimetre of card above its body (m)."""
WIDTH, HEIGHT = 640, 480
_WHOLE = slice(0, HEIGHT), slice(0, WIDTH)
MARGIN = 1.085
"""The picture shows 8.5 % more than the floor."""
ABOVE = 1.9
"""The camera hangs 1.9 times the floor's longer side above it, at least `LOWEST` (m)."""
LOWEST = 1.2


@dataclass(frozen=True, kw_only=True)
class Lens:
    """A pinhole with two radial terms. World in metres; pixel centres are whole numbers.

    Attributes:
        position: [3] of the pinhole (m).
        rotation: [3, 3] camera to world; the camera looks along its −z, y is up in the picture.
        focal: pixels.
        k1, k2: radial terms on coordinates divided by the focal length.
    """

    position: Array
    rotation: Array
    focal: float
    k1: float
    k2: float

    def pixels(self, points: Array) -> Array:
        """[..., 2] column and row of world points [..., 3] (m)."""
        q = (points - self.position) @ self.rotation
        x, y = q[..., 0] / -q[..., 2], q[..., 1] / -q[..., 2]
        r2 = x * x + y * y
        bend = self.focal * (1.0 + self.k1 * r2 + self.k2 * r2 * r2)
        return np.stack([(WIDTH - 1) / 2 + x * bend, (HEIGHT - 1) / 2 - y * bend], axis=-1)

    def straightened(self, columns: Array, rows: Array) -> tuple[Array, Array]:
        """x right and y up of pixels as a pinhole of focal length 1 would see them."""
        bent_x = (columns - (WIDTH - 1) / 2) / self.focal
        bent_y = ((HEIGHT - 1) / 2 - rows) / self.focal
        x, y = bent_x, bent_y
        for _ in range(12):  # a contraction: the terms are small
            r2 = x * x + y * y
            bend = 1.0 + self.k1 * r2 + self.k2 * r2 * r2
            x, y = bent_x / bend, bent_y / bend
        return x, y

    def floor(self, columns: Array, rows: Array) -> tuple[Array, Array]:
        """Where the pixels' rays meet the floor, and how far they move a metre above it.

        Returns:
            [..., 2] x, y on the floor (m) and [..., 2] their change for each metre of height.
        """
        x, y = self.straightened(columns, rows)
        ray = np.stack([x, y, -np.ones_like(x)], axis=-1) @ self.rotation.T
        slope = ray[..., :2] / ray[..., 2:]
        return self.position[:2] - self.position[2] * slope, slope


def _turn(axis: int, angle: float) -> Array:
    c, s = math.cos(angle), math.sin(angle)
    out = np.eye(3)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    out[i, i], out[i, j], out[j, i], out[j, j] = c, -s, s, c
    return out


def hang_camera(arena: Mapping[str, Any], unit: Unit) -> Lens:
    """The camera of this unit's room above this arena."""
    w, h = (v / 100.0 for v in arena["size_cm"])
    hung = unit.camera
    nominal = max(LOWEST, ABOVE * max(w, h))
    height = nominal * hung.height_share
    focal = min(WIDTH / (w * MARGIN), HEIGHT / (h * MARGIN)) * nominal
    rotation = _turn(0, hung.tilt[0]) @ _turn(1, hung.tilt[1]) @ _turn(2, hung.roll)
    # somebody looked at the picture and pushed the camera until the floor was about in its middle
    straight_down = height * rotation[:2, 2] / rotation[2, 2]
    off = min(w, h) * np.array(hung.offset_share)
    position = np.array([w / 2 + off[0], h / 2 + off[1], height])
    position[:2] += straight_down
    return Lens(position=position, rotation=rotation, focal=focal, k1=hung.k1, k2=hung.k2)


TEXELS = 24
"""Parts along a cell's side in which the card is kept."""


class Plate:
    """A card of black and white cells on the robot's back, in the disk's place: a printed marker.

    A square of n × n cells on a card that shows a white rim, a cell wide, about them.

    Args:
        cells: [n, n] from the upper left one on, 1 where one is white.
        corners: [4, 2] of the cells' square, clockwise from its upper left one: ahead and to the left of the
            robot's centre (m).
        height: above the floor (m).
    """

    def __init__(self, cells: NDArray[np.uint8], corners: NDArray[np.float64], height: float) -> None:
        self.height, self.reach = height, 1.5 * float(np.hypot(*corners.T).max())
        self._first, self._across, self._down = corners[0], corners[1] - corners[0], corners[3] - corners[0]
        self._count = len(cells)
        card = np.pad(cells, 1, constant_values=1)
        parts = np.pad(np.stack([np.ones_like(card), card]), ((0, 0), (1, 1), (1, 1)))
        self._fine = parts.repeat(TEXELS, axis=1).repeat(TEXELS, axis=2).astype(np.float64)

    def softened(self, sample: float) -> Pixels:
        """[2, side, side] how much the card covers, and how white it is there, under samples so wide (m)."""
        cell = float(np.hypot(*self._across)) / self._count
        half = max(1, round(TEXELS * sample / cell / 2))
        wide = np.pad(self._fine, ((0, 0), (half, half), (half, half)))
        windows = sliding_window_view(wide, (2 * half + 1, 2 * half + 1), axis=(1, 2))
        return np.asarray(windows.mean(axis=(3, 4)), np.float32)

    @property
    def axes(self) -> Array:
        """[3, 2] ahead and to the left of the robot's centre: the cells' upper left corner (m), and how many
        parts to the right and down a metre is."""
        parts = self._count * TEXELS / float(self._across[0] ** 2 + self._across[1] ** 2)
        return np.stack([self._first, self._across * parts, self._down * parts])


COLOURS = {
    "floor": (199, 196, 189), "wall": (237, 235, 230), "outside": (120, 118, 115), "lamp": (255, 255, 205),
    "body": (52, 56, 52), "black": (14, 14, 15), "white": (243, 243, 241),
}  # fmt: skip
LUMINANCE = np.array([0.299, 0.587, 0.114])
"""Shares of red, green and blue in a grey level (ITU-R BT.601)."""
SUB = 2
"""Samples along a pixel's side."""
LAYERS = 5
"""Heights at which walls and cylinders are drawn, beside their tops."""
SIDE = 0.003
"""The lowest of the body's side that the camera sees (m)."""
EDGE = 2
"""Pixels round the robot's box."""
SURROUNDINGS = 0.035
"""About it all that a tracker looks at while it sees the robot (m)."""


class _Drawing:
    """Draws frames [480, 640, 3], or grey ones [480, 640, 1], of one arena through one lens.

    The robot may wear a plate, not the disk. Each pixel's ray is followed down: walls and cylinders once for
    all frames, the robot in each, in its box.
    """

    def __init__(self, arena: Mapping[str, Any], lens: Lens, plate: Plate | None, *, grey: bool) -> None:
        weights = LUMINANCE[:, None] if grey else np.eye(3)
        self._colours = {name: (colour @ weights).astype(np.float32) for name, colour in COLOURS.items()}
        self._paints = np.stack([self._colours[name] for name in ("body", "black", "white")])
        step = (np.arange(SUB) + 0.5) / SUB - 0.5
        columns = (np.arange(WIDTH)[:, None] + step).ravel()
        rows = (np.arange(HEIGHT)[:, None] + step).ravel()
        # [..., 4] x and y where a sample's ray meets the floor, and their change with height
        self._rays = np.concatenate(lens.floor(*np.meshgrid(columns, rows)), axis=-1, dtype=np.float32)
        self._lens = lens
        self._samples = np.float32(SUB * lens.focal / lens.position[2])  # a metre
        self._reach, self._top, self._axes = BODY_RADIUS, DISK_HEIGHT, np.empty((3, 2))
        self._soft, self._worn = np.empty((2, 0, 0), np.float32), DISK_HEIGHT
        self._disk = np.array([DISK_RADIUS, MIDDLE_RADIUS, FRONT_RADIUS, FRONT_AHEAD], np.float32)
        if plate is not None:
            self._soft, self._axes = plate.softened(1 / float(self._samples)), plate.axes
            self._reach, self._top = max(BODY_RADIUS, plate.reach), max(DISK_HEIGHT, plate.height)
            self._worn = plate.height
        self._fine, self._over = self._still(arena)
        total = sum(self._fine[k // SUB :: SUB, k % SUB :: SUB] for k in range(SUB * SUB))
        self.background: Pixels = np.asarray(total * np.float32(1.0 / SUB**2))

    def _at(self, z: float) -> Pixels:
        """[2, ...] x and y of the samples' rays at a height (m)."""
        return np.moveaxis(self._rays[..., 2:] * np.float32(z) + self._rays[..., :2], -1, 0)

    def _still(self, arena: Mapping[str, Any]) -> tuple[Pixels, NDArray[np.bool_]]:
        """[..., colours] what does not move, from the floor up; [...] whether it is higher than the robot."""
        colours = self._colours
        w, h = (v / 100.0 for v in arena["size_cm"])
        picture = np.tile(colours["floor"], (*self._rays.shape[:2], 1))
        off_x, off_y = self._rays[..., 0] - np.float64(w / 2), self._rays[..., 1] - np.float64(h / 2)
        light = 1.0 - 0.10 * (off_x**2 + off_y**2) / (w * w + h * h) * 4
        picture *= light[..., None].astype(np.float32)
        over = np.zeros(picture.shape[:2], np.bool_)
        for layer in range(LAYERS + 1):
            z = WALL_HEIGHT * layer / LAYERS
            x, y = self._at(z)
            shade = np.float32(0.72 if layer < LAYERS else 1.0)
            stands = np.zeros(x.shape, np.bool_)
            for cx, cy, r in np.array(arena["cylinders"]).reshape(-1, 3) / 100.0:
                stands |= np.hypot(x - cx, y - cy) < r
            for x0, y0, x1, y1 in np.array(arena["walls"]).reshape(-1, 4) / 100.0:
                length = math.hypot(x1 - x0, y1 - y0)
                along = ((x - x0) * (x1 - x0) + (y - y0) * (y1 - y0)) / length
                off = ((y - y0) * (x1 - x0) - (x - x0) * (y1 - y0)) / length
                stands |= (along > -WALL_HALF) & (along < length + WALL_HALF) & (np.abs(off) < WALL_HALF)
            picture[stands] = colours["wall"] * shade
            if z > DISK_HEIGHT:
                over |= stands
            out = np.maximum(np.abs(x - w / 2) - w / 2, np.abs(y - h / 2) - h / 2)
            picture[(out > 0) & (out < 0.01)] = colours["wall"] * shade
        picture[out >= 0.01] = colours["outside"]
        for cx, cy in np.array(arena["lamps"]).reshape(-1, 2) / 100.0:
            x, y = self._at(0.05)
            picture[np.hypot(x - cx, y - cy) < 0.008] = colours["lamp"]
        return picture, over

    def boxes(self, x: Array, y: Array) -> list[Part]:
        """Of robots at x, y [n] (m) each the rows and columns of the picture in which it may be seen."""
        reach, places = self._reach, np.stack([x, y, np.zeros_like(x)], axis=-1)
        near = [(a, b, z) for a in (-reach, reach) for b in (-reach, reach) for z in (0.0, self._top)]
        ends = self._lens.pixels(places[:, None] + near)
        low, high = np.floor(ends.min(axis=1)) - EDGE, np.ceil(ends.max(axis=1)) + EDGE
        corners = (end.clip(0, (WIDTH, HEIGHT)).astype(int).tolist() for end in (low, high))
        return [
            (slice(top, bottom), slice(left, right))
            for (left, top), (right, bottom) in zip(*corners, strict=True)
        ]

    def robot(self, x: float, y: float, heading: float, box: Part) -> Pixels:
        """[rows, columns, colours] grey levels in a box of the picture, with the robot at x, y (m)."""
        rows, columns = (slice(SUB * side.start, SUB * side.stop) for side in box)
        still = self._fine[rows, columns]
        out = np.empty((len(still) // SUB, still.shape[1] // SUB, still.shape[2]), np.float32)
        place = np.array(
            [x, y, math.cos(heading), math.sin(heading), self._worn, self._reach + 2 / self._samples],
            np.float32,
        )
        rays = self._over[rows, columns], self._rays[rows, columns]
        for n, paints in enumerate(self._paints.T):
            shapes = self._samples, paints, self._disk, self._soft, self._axes
            _draw_robot(still[..., n], *rays, place, *shapes, out[..., n])
        return out


@part
def _share(off_x: Any, off_y: Any, radius: Any, samples: Any) -> Any:
    """How much of a sample, so far off the middle of a circle of that radius (m), the circle covers."""
    square = off_x * off_x + off_y * off_y
    if square > (radius + np.float32(1.0) / samples) ** 2:
        return np.float32(0.0)
    if square < (radius - np.float32(1.0) / samples) ** 2:
        return np.float32(1.0)
    share = (radius - math.sqrt(square)) * samples + np.float32(0.5)
    return min(max(share, np.float32(0.0)), np.float32(1.0))


@jit
def _draw_robot(
    still: Any, over: Any, rays: Any, place: Any, samples: Any, paints: Any, disk: Any, soft: Any,
    axes: Any, out: Any,
) -> None:  # fmt: skip
    """A box of the picture with the robot in it, one colour of it, into [rows, columns].

    `still`, `over` and `rays` are the drawing's, of the box's samples; `place` is x, y (m), cosine
    and sine of the heading, the height of what the robot wears and how far both reach (m); `paints` its
    body's, black and white; `disk` the radii of the disk and its patches and how far ahead the front one is;
    `soft` and `axes` a plate's, `soft` without parts if it has none.
    """
    x, y, c, s, height, reach = place[0], place[1], place[2], place[3], place[4], place[5]
    body, black, white, last = paints[0], paints[1], paints[2], soft.shape[1] - 1
    for row in range(out.shape[0]):
        for column in range(out.shape[1]):
            total = np.float32(0.0)
            for k in range(SUB * SUB):
                i, j = SUB * row + k // SUB, SUB * column + k % SUB
                level, slope_x, slope_y = still[i, j], rays[i, j, 2], rays[i, j, 3]
                off_x, off_y = rays[i, j, 0] - x, rays[i, j, 1] - y
                farthest = reach + height * (abs(slope_x) + abs(slope_y))  # of a ray that meets the robot
                if over[i, j] or off_x * off_x + off_y * off_y > farthest * farthest:
                    total += level
                    continue
                # where the ray comes nearest to the body's axis, on the height of its side
                z = -(off_x * slope_x + off_y * slope_y)
                z /= slope_x * slope_x + slope_y * slope_y + np.float32(1e-12)
                z = min(max(z, np.float32(SIDE)), np.float32(BODY_TOP))
                side_x, side_y = off_x + z * slope_x, off_y + z * slope_y
                if side_x * side_x + side_y * side_y < np.float32(BODY_RADIUS**2):
                    level = body
                off_x, off_y = off_x + slope_x * height, off_y + slope_y * height
                if last < 0:
                    level += _share(off_x, off_y, disk[0], samples) * (black - level)
                    level += _share(off_x, off_y, disk[1], samples) * (white - level)
                    off_x, off_y = off_x - disk[3] * c, off_y - disk[3] * s
                    level += _share(off_x, off_y, disk[2], samples) * (white - level)
                else:
                    ahead, left = c * off_x + s * off_y - axes[0, 0], c * off_y - s * off_x - axes[0, 1]
                    across = math.floor(ahead * axes[1, 0] + left * axes[1, 1]) + 2 * TEXELS
                    down = math.floor(ahead * axes[2, 0] + left * axes[2, 1]) + 2 * TEXELS
                    across, down = min(max(across, 0), last), min(max(down, 0), last)
                    level += soft[0, down, across] * (black - level) + soft[1, down, across] * (white - black)
                total += level
            out[row, column] = total * np.float32(1.0 / SUB**2)


PIXEL_NOISE = 2.5
"""Grey levels, deviation: a plain video camera indoors."""
FALL_OFF = 0.16
"""A lens darkens its corners: by this share at the picture's corner."""
VIEWS = ("drawn", "mujoco")


class OverheadCamera(Closing):
    """The camera above one unit's arena. Use it in a `with`, or `close` it.

    Args:
        arena: size_cm, cylinders, walls, lamps (cm).
        unit: the robot, and with it the room and the camera.
        noise: the twin's noise scale.
        view: `drawn`, or `mujoco`, by MuJoCo's renderer, without shadows, at several times the cost a frame.
        seed: names the noise of the pixels.
        plate: what the robot wears in the disk's place; it is drawn.
        grey: whether frames have no colours, which a tracker does not look at; drawn at a third of the cost.

    Raises:
        ConfigError: `mujoco` is asked for with a plate, or where its GL library does not work.
    """

    def __init__(
        self,
        arena: Mapping[str, Any],
        *,
        unit: int,
        noise: float = 1.0,
        view: str = VIEWS[0],
        seed: int = 0,
        plate: Plate | None = None,
        grey: bool = False,
    ) -> None:
        if view not in VIEWS:
            raise ConfigError(f"the camera's view is one of {', '.join(VIEWS)}, got {view!r}")
        if view == "mujoco" and (plate is not None or grey):
            raise ConfigError("MuJoCo's renderer shows no robot with a plate: ask for the drawn view")
        arena, who = plain_arena(arena), draw_unit(unit)
        self.lens = hang_camera(arena, who)
        self._unit, self._noise, self._seed = unit, check_scale(noise), seed
        columns, rows = np.meshgrid(np.arange(WIDTH) - WIDTH / 2, np.arange(HEIGHT) - HEIGHT / 2)
        corner = (WIDTH**2 + HEIGHT**2) / 4
        light = who.camera.gain * (1 - FALL_OFF * (columns**2 + rows**2) / corner)
        self._light: Pixels = np.repeat(light.astype(np.float32)[..., None], 1 if grey else 3, axis=2)
        self._renderer: Any = None
        if view == "mujoco":
            from realitygap.twin.render import Renderer  # it needs MuJoCo and a GL library

            self._renderer = Renderer(arena, who, self.lens)
        else:
            self._drawing = _Drawing(arena, self.lens, plate, grey=grey)
            self._still = self._drawing.background * self._light
        bank = draws(unit, seed, 53).standard_normal(2 * self._light.size, np.float32)
        share = math.sqrt((LUMINANCE**2).sum()) if grey else 1.0
        self._bank = bank * np.float32(PIXEL_NOISE * self._noise * share)

    def close(self) -> None:
        """Release the renderer, if there is one."""
        if self._renderer is not None:
            self._renderer.close()

    @property
    def metadata(self) -> dict[str, Any]:
        """Who made the frames, for the film's metadata. Nothing that a tracker has to find out."""
        view = f"MuJoCo ({self._renderer.library})" if self._renderer else "drawn"
        return {"view": view, "width": WIDTH, "height": HEIGHT, "noise": self._noise,
                "unit": self._unit, "body": "twin (pseudo-reality)"}  # fmt: skip

    def frame(self, pose: Pose, number: int = 0) -> Frame:
        """[480, 640, 3], or of a grey camera [480, 640], what it shows of a robot at `pose`.

        The frame's `number` names its noise.
        """
        if self._renderer is not None:
            return _exposed(self._renderer.frame(pose) * self._light, self._noise_of(number))
        frame, (box,) = np.empty(self._light.shape, np.uint8), self._boxes([pose])
        self._paint(frame, _WHOLE, box, pose, number)
        return frame.squeeze()

    def frames(self, truth: Track, *, fps: float, first: int = 0) -> Iterator[tuple[float, Frame]]:
        """Frames of where the robot was, at an even pace: (time in s from the first row, picture).

        Between two rows the later one that is not after the frame's time is shown. `first` is the first
        frame's number, which names its noise.
        """
        for number, (t, pose) in enumerate(_shown(truth, fps), first):
            yield t, self.frame(pose, number)

    def watched(self, truth: Track, *, fps: float, first: int = 0) -> Iterator[tuple[float, Frame]]:
        """The same for a tracker, which keeps none: each frame is painted onto the one before it, whose noise
        stays where the robot is far away."""
        frame, before, shown = np.empty(self._light.shape, np.uint8), _WHOLE, _shown(truth, fps)
        more = math.ceil(SURROUNDINGS * self.lens.focal / self.lens.position[2])
        for number, ((t, pose), here) in enumerate(
            zip(shown, self._boxes([pose for _, pose in shown]), strict=True), first
        ):
            rows, columns = (
                slice(max(min(a.start, b.start) - more, 0), max(a.stop, b.stop) + more)
                for a, b in zip(here, before, strict=True)
            )
            self._paint(frame, (rows, columns), here, pose, number)
            before = here
            yield t, frame.squeeze()

    def _boxes(self, poses: list[Pose]) -> list[Part]:
        x, y = np.array([(pose.x, pose.y) for pose in poses]).T / 100.0
        return self._drawing.boxes(x, y)

    def _paint(self, frame: Frame, part: Part, box: Part, pose: Pose, number: int) -> None:
        """Paint a part of a frame, and the robot in its box."""
        noise = self._noise_of(number)
        frame[part] = _exposed(self._still[part], noise[part])
        if box[0].start < box[0].stop and box[1].start < box[1].stop:
            robot = self._drawing.robot(pose.x / 100.0, pose.y / 100.0, pose.heading, box) * self._light[box]
            frame[box] = _exposed(robot, noise[box])

    def _noise_of(self, number: int) -> Pixels:
        """Of a frame's pixels."""
        size = self._light.size
        start = int(draws(self._seed, 59, number).integers(size))
        return self._bank[start : start + size].reshape(self._light.shape)


def _shown(truth: Track, fps: float) -> list[tuple[float, Pose]]:
    """The frames' times (s from the first row) and poses."""
    start, end = float(truth.t[0]), float(truth.t[-1])
    times = np.arange(int((end - start) * fps + 1e-6) + 1) / fps
    rows = np.searchsorted(truth.t, start + times + 1e-9, side="right") - 1
    columns = (column.tolist() for column in (times, truth.x[rows], truth.y[rows], truth.heading[rows]))
    return [(t, Pose.reached(x, y, heading)) for t, x, y, heading in zip(*columns, strict=True)]


def _exposed(picture: Pixels, noise: Pixels) -> Frame:
    """Grey levels as bytes, the pixels' noise on them."""
    levels = cv2.add(picture, np.ascontiguousarray(noise), dtype=cv2.CV_8U)
    return np.asarray(levels, np.uint8).reshape(picture.shape)
