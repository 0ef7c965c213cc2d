"""MuJoCo's renderer, in a process of its own: a GL context must never be forked, and its library may fail.

`python -m realitygap.twin.render` reads one line of JSON (arena, unit), answers `ready`, then draws what it
is asked for (`QUESTION`: a pose and a window of the picture) and writes it as bytes, until its input ends.
Only the robot moves and nothing casts a shadow: so the whole is drawn once, then a window round the robot.
"""

import json
import os
import select
import struct
import subprocess
import sys
import time
from collections.abc import Mapping
from contextlib import ExitStack, suppress
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from realitygap.errors import FilmError, RobotError
from realitygap.twin.drawing import (
    DISK_HEIGHT,
    DISK_RADIUS,
    FRONT_AHEAD,
    FRONT_RADIUS,
    MIDDLE_RADIUS,
    WHOLE,
    Window,
)  # fmt: skip
from realitygap.twin.lens import HEIGHT, WIDTH, Lens, hang_camera
from realitygap.twin.model import BODY_RADIUS
from realitygap.twin.process import LEAVE_S, launch
from realitygap.work import child

__all__ = ["Renderer", "open_renderer"]

Array = NDArray[np.float64]

PAD_WIDTH, PAD_HEIGHT = 704, 528
"""The renderer has no lens: it draws a little more, and the lens bends it afterwards."""
GL_LIBRARIES = ("egl", "osmesa")

QUESTION = struct.Struct("=7d4i")
"""A row of `States.pose`; left, top, width and height of a window of the padded picture."""
ANSWER_S = 60.0
"""Longer than any frame takes, on a busy machine too."""
CHUNK = 1 << 20
AWAY = (0.0, 0.0, 100.0, 1.0, 0.0, 0.0, 0.0)
"""Behind the camera."""
REACH, EDGE = float(np.hypot(BODY_RADIUS, DISK_HEIGHT)), 3
"""Round the robot's place, however it leans (m); and pixels more."""
SHOWN, HIDDEN = 2, 5
"""Groups of geoms."""
GRAIN = 32
"""Windows are so many pixels wide and high, or a multiple: their buffer is seldom made anew."""


def _scene(arena: Mapping[str, Any], lens: Lens) -> dict[str, Any]:
    """What the camera needs beyond the physics: itself, light, the disk."""
    right, up = lens.rotation[:, 0], lens.rotation[:, 1]
    axes = " ".join(f"{v:.9f}" for v in (*right, *up))
    place = " ".join(f"{v:.9f}" for v in lens.position)
    fovy = np.degrees(2.0 * np.arctan(PAD_HEIGHT / 2.0 / lens.focal))  # degrees, whatever the compiler says
    w, h = (v / 100.0 for v in arena["size_cm"])
    flat = 'type="cylinder" mass="0" group="2"'
    return {
        "visual": f'<global offwidth="{PAD_WIDTH}" offheight="{PAD_HEIGHT}"/>'
        '<quality offsamples="4" shadowsize="0"/><map znear="0.05"/>'
        '<headlight ambient="0.35 0.35 0.35" diffuse="0.25 0.25 0.25" specular="0 0 0"/>',
        "extra": f'<camera name="overhead" pos="{place}" xyaxes="{axes}" fovy="{fovy:.9f}"/>\n    '
        f'<light pos="{w * 0.3} {h * 0.7} 2.2" dir="{w * 0.1} {-h * 0.1} -1" diffuse="0.45 0.45 0.44" '
        'specular="0 0 0" castshadow="false"/>\n    ',
        "disk": f'<geom {flat} pos="0 0 {DISK_HEIGHT - 0.0005}" size="{DISK_RADIUS} 0.0005" '
        'rgba="0.05 0.05 0.055 1"/>'
        f'<geom {flat} pos="0 0 {DISK_HEIGHT}" size="{MIDDLE_RADIUS} 0.0001" rgba="1 1 1 1"/>'
        f'<geom {flat} pos="{FRONT_AHEAD} 0 {DISK_HEIGHT}" size="{FRONT_RADIUS} 0.0001" rgba="1 1 1 1"/>',
    }


class _Painter:
    """In the other process: MuJoCo's renderer of any window of the picture.

    The view is always the whole picture's, so that every pixel has the same bits in each window; its buffer
    ends where the window does, and what stands elsewhere is left out.
    """

    def __init__(self, order: Mapping[str, Any]) -> None:
        import mujoco

        from realitygap.twin.model import build_xml
        from realitygap.twin.unit import draw_unit

        unit = draw_unit(order["unit"])
        lens = hang_camera(order["arena"], unit)
        scene = _scene(order["arena"], lens)
        self._gl = mujoco
        self._model = mujoco.MjModel.from_xml_string(build_xml(order["arena"], unit, **scene))
        self._data = mujoco.MjData(self._model)
        self._library = mujoco.GLContext(PAD_WIDTH, PAD_HEIGHT)
        self._library.make_current()
        self._context = mujoco.MjrContext(self._model, mujoco.mjtFontScale.mjFONTSCALE_150)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, self._context)
        self._scene, self._shown = mujoco.MjvScene(self._model, maxgeom=10_000), mujoco.MjvOption()
        self._shown.geomgroup[HIDDEN] = 0
        self._camera = mujoco.MjvCamera()
        self._camera.type, self._camera.fixedcamid = mujoco.mjtCamera.mjCAMERA_FIXED, 0
        self._size = PAD_WIDTH, PAD_HEIGHT
        mujoco.mj_kinematics(self._model, self._data)
        self._things = np.flatnonzero(self._model.geom_bodyid == 0)[1:]  # the first is the floor
        self._ends = self._outlines(lens)

    def _outlines(self, lens: Lens) -> Array:
        """[4, n] least column and row, last column and row at which each thing that stands may be seen."""
        signs = np.array(list(product((-1.0, 1.0), repeat=3)))
        box = self._model.geom_aabb[self._things]
        local = box[:, None, :3] + signs * box[:, None, 3:]
        turn = self._data.geom_xmat[self._things].reshape(-1, 3, 3)
        corners = local @ turn.transpose(0, 2, 1) + self._data.geom_xpos[self._things, None]
        x, y, z = np.moveaxis((corners - lens.position) @ lens.rotation, -1, 0)
        columns = (PAD_WIDTH - 1) / 2 - x / z * lens.focal
        rows = (PAD_HEIGHT - 1) / 2 + y / z * lens.focal
        least, most = (np.stack([end(columns, axis=1), end(rows, axis=1)]) for end in (np.min, np.max))
        return np.concatenate([least - EDGE, most + EDGE])

    def window(self, pose: Any, left: int, top: int, width: int, height: int) -> NDArray[np.uint8]:
        """[height, width, 3] of the padded picture."""
        gl, model, data = self._gl, self._model, self._data
        bottom = PAD_HEIGHT - top - height  # GL counts rows upwards
        size = left + width, bottom + height
        if self._size != size:
            self._size = size
            gl.mjr_resizeOffscreen(*size, self._context)
        data.qpos[:7] = pose
        gl.mj_kinematics(model, data)
        gl.mj_camlight(model, data)
        first = self._ends[0] > left + width, self._ends[1] > top + height
        last = self._ends[2] < left, self._ends[3] < top
        model.geom_group[self._things] = np.where(np.any([*first, *last], axis=0), HIDDEN, SHOWN)
        everything = gl.mjtCatBit.mjCAT_ALL
        gl.mjv_updateScene(model, data, self._shown, None, self._camera, everything, self._scene)
        gl.mjr_render(gl.MjrRect(0, 0, PAD_WIDTH, PAD_HEIGHT), self._scene, self._context)
        pixels = np.empty((height, width, 3), np.uint8)
        gl.mjr_readPixels(pixels, None, gl.MjrRect(left, bottom, width, height), self._context)
        return pixels[::-1]

    def close(self) -> None:
        """Let go of the library."""
        self._context.free()
        self._library.free()


def _serve() -> None:
    """The other process."""
    painter = _Painter(json.loads(sys.stdin.buffer.readline()))
    # unbuffered, as sys.stdout may be, an interrupted call writes a part
    with open(sys.stdout.fileno(), "wb", closefd=False) as out:
        out.write(b"ready\n")
        out.flush()
        while len(question := sys.stdin.buffer.read(QUESTION.size)) == QUESTION.size:
            *pose, left, top, width, height = QUESTION.unpack(question)
            out.write(painter.window(pose, left, top, width, height).tobytes())
            out.flush()
    painter.close()


class Renderer:
    """Frames from the process that draws."""

    def __init__(self, process: subprocess.Popen[bytes], library: str, lens: Lens) -> None:
        self._process, self._lens = process, lens
        self.library = library
        columns, rows = np.meshgrid(np.arange(WIDTH, dtype=np.float64), np.arange(HEIGHT, dtype=np.float64))
        x, y = lens.straightened(columns, rows)
        self._u = (x * lens.focal + (PAD_WIDTH - 1) / 2).astype(np.float32)
        self._v = ((PAD_HEIGHT - 1) / 2 - y * lens.focal).astype(np.float32)
        self._padded = self._seen(AWAY, 0, 0, PAD_WIDTH, PAD_HEIGHT).copy()
        self._still = self._bent(WHOLE)

    def frame(self, pose: Array) -> NDArray[np.uint8]:
        """[480, 640, 3] grey levels, bent by the lens, without the camera's noise."""
        picture = self._still.copy()
        about = self._about(pose[:3])
        if about[0].start < about[0].stop and about[1].start < about[1].stop:
            (left, width), (top, height) = (
                _needed(bent[about], most) for bent, most in ((self._u, PAD_WIDTH), (self._v, PAD_HEIGHT))
            )
            part = self._seen(pose, left, top, width, height)
            self._padded[top : top + height, left : left + width] = part
            picture[about] = self._bent(about)
        return picture

    def _about(self, place: Array) -> Window:
        """Where in the picture the robot may be seen."""
        corners = np.array(list(product((-REACH, REACH), repeat=3))) + place
        ends = self._lens.pixels(corners)
        (left, top), (right, bottom) = ends.min(axis=0).round() - EDGE, ends.max(axis=0).round() + EDGE
        rows, columns = np.clip((top, bottom), 0, HEIGHT), np.clip((left, right), 0, WIDTH)
        return slice(*rows.astype(int).tolist()), slice(*columns.astype(int).tolist())

    def _bent(self, window: Window) -> NDArray[np.uint8]:
        """A window of the picture, of the padded one."""
        import cv2

        u, v = (np.ascontiguousarray(bent[window]) for bent in (self._u, self._v))
        return np.asarray(cv2.remap(self._padded, u, v, cv2.INTER_LINEAR), np.uint8)

    def _seen(self, pose: Any, left: int, top: int, width: int, height: int) -> NDArray[np.uint8]:
        """[height, width, 3] of the padded picture with the robot at a pose, from the other process.

        Raises:
            FilmError: it ended, or does not answer.
        """
        pipes = self._process
        assert pipes.stdin is not None and pipes.stdout is not None
        try:
            pipes.stdin.write(QUESTION.pack(*map(float, pose), left, top, width, height))
            pipes.stdin.flush()
        except OSError:
            raise FilmError("MuJoCo's renderer ended. Start again.") from None
        raw = _read(pipes.stdout.fileno(), width * height * 3, ANSWER_S)
        return np.frombuffer(raw, np.uint8).reshape(height, width, 3)

    def close(self) -> None:
        """End the other process."""
        child.end(self._process, LEAVE_S)


def _needed(at: NDArray[np.float32], most: int) -> tuple[int, int]:
    """First and number of the padded columns, or rows, that pixels at those places are made of."""
    first, last = int(np.floor(at.min())), int(np.floor(at.max())) + 2
    first, last = min(max(first, 0), most - 1), min(max(last, 1), most)
    size = min(-(-(last - first) // GRAIN) * GRAIN, most)
    return min(first, most - size), size


def _read(source: int, size: int, patience_s: float) -> bytes:
    """So many bytes.

    Raises:
        FilmError: there are no more, or no more come.
    """
    data, give_up = bytearray(), time.monotonic() + patience_s
    while len(data) < size:
        if not select.select([source], [], [], max(0.0, give_up - time.monotonic()))[0]:
            raise FilmError(f"MuJoCo's renderer has not answered for {patience_s:g} s. Start again.")
        more = os.read(source, min(size - len(data), CHUNK))
        if not more:
            raise FilmError("MuJoCo's renderer ended. Start again.")
        data += more
    return bytes(data)


def open_renderer(arena: Mapping[str, Any], unit: int, lens: Lens) -> Renderer | None:
    """A renderer by the first GL library that works here, or None."""
    for library in GL_LIBRARIES:
        path = os.pathsep.join(filter(None, sys.path))
        environment = {**os.environ, "MUJOCO_GL": library, "PYTHONPATH": path}
        environment.pop("PYOPENGL_PLATFORM", None)
        order, quiet = {"arena": dict(arena), "unit": unit}, subprocess.DEVNULL
        # a library that hangs, or fails with the first frame, is none
        with suppress(RobotError, FilmError), ExitStack() as otherwise:
            process, said = launch("realitygap.twin.render", order, stderr=quiet, env=environment)
            otherwise.callback(child.end, process, LEAVE_S)
            if said == b"ready\n":
                renderer = Renderer(process, library, lens)
                otherwise.pop_all()
                return renderer
    return None


if __name__ == "__main__":
    _serve()
