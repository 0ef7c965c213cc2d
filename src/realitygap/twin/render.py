"""MuJoCo's renderer, in a process of its own: a GL context must never be forked, and its library may fail.

`python -m realitygap.twin.render` reads one line of JSON (arena, unit), answers `ready`, then draws a
frame for each pose (7 numbers of 8 bytes) and writes it as bytes, until its input ends.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from realitygap.twin.drawing import (
    DISK_HEIGHT,
    DISK_RADIUS,
    FRONT_AHEAD,
    FRONT_RADIUS,
    MIDDLE_RADIUS,
)  # fmt: skip
from realitygap.twin.lens import HEIGHT, WIDTH, Lens, hang_camera
from realitygap.twin.process import end_process, launch

__all__ = ["Renderer", "open_renderer"]

Array = NDArray[np.float64]

PAD_WIDTH, PAD_HEIGHT = 704, 528
"""The renderer has no lens: it draws a little more, and the lens bends it afterwards."""
GL_LIBRARIES = ("egl", "osmesa")


def _scene(arena: Mapping[str, Any], lens: Lens) -> dict[str, Any]:
    """What the camera needs beyond the physics: itself, light, the disk."""
    right, up = lens.rotation[:, 0], lens.rotation[:, 1]
    axes = " ".join(f"{v:.9f}" for v in (*right, *up))
    place = " ".join(f"{v:.9f}" for v in lens.position)
    fovy = np.degrees(2.0 * np.arctan(PAD_HEIGHT / 2.0 / lens.focal))  # degrees, whatever the compiler says
    w, h = (v / 100.0 for v in arena["size_cm"])
    flat = 'type="cylinder" contype="0" conaffinity="0" mass="0" group="2"'
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


def _serve() -> None:
    """The other process."""
    import mujoco

    from realitygap.twin.model import build_xml
    from realitygap.twin.unit import draw_unit

    order = json.loads(sys.stdin.buffer.readline())
    unit = draw_unit(order["unit"])
    scene = _scene(order["arena"], hang_camera(order["arena"], unit))
    model = mujoco.MjModel.from_xml_string(build_xml(order["arena"], unit, **scene))
    data = mujoco.MjData(model)
    renderer = mujoco.Renderer(model, PAD_HEIGHT, PAD_WIDTH)
    sys.stdout.buffer.write(b"ready\n")
    sys.stdout.buffer.flush()
    while len(pose := sys.stdin.buffer.read(56)) == 56:
        data.qpos[:7] = np.frombuffer(pose)
        mujoco.mj_kinematics(model, data)
        mujoco.mj_camlight(model, data)
        renderer.update_scene(data, camera="overhead")
        sys.stdout.buffer.write(renderer.render().tobytes())
        sys.stdout.buffer.flush()
    renderer.close()


class Renderer:
    """Frames from the process that draws."""

    def __init__(self, process: subprocess.Popen[bytes], library: str, lens: Lens) -> None:
        self._process = process
        self.library = library
        columns, rows = np.meshgrid(np.arange(WIDTH, dtype=np.float64), np.arange(HEIGHT, dtype=np.float64))
        x, y = lens.straightened(columns, rows)
        self._u = (x * lens.focal + (PAD_WIDTH - 1) / 2).astype(np.float32)
        self._v = ((PAD_HEIGHT - 1) / 2 - y * lens.focal).astype(np.float32)

    def frame(self, pose: Array) -> NDArray[np.uint8]:
        """[480, 640, 3] grey levels, bent by the lens, without the camera's noise."""
        import cv2

        pipes = self._process
        assert pipes.stdin is not None and pipes.stdout is not None
        pipes.stdin.write(np.ascontiguousarray(pose, np.float64).tobytes())
        pipes.stdin.flush()
        size = PAD_WIDTH * PAD_HEIGHT * 3
        raw = pipes.stdout.read(size)
        if len(raw) != size:
            raise BrokenPipeError("the renderer's process ended")
        picture = np.frombuffer(raw, np.uint8).reshape(PAD_HEIGHT, PAD_WIDTH, 3)
        return np.asarray(cv2.remap(picture, self._u, self._v, cv2.INTER_LINEAR), np.uint8)

    def close(self) -> None:
        """End the other process."""
        end_process(self._process)


def open_renderer(arena: Mapping[str, Any], unit: int, lens: Lens) -> Renderer | None:
    """A renderer by the first GL library that works here, or None."""
    for library in GL_LIBRARIES:
        path = os.pathsep.join(filter(None, sys.path))
        environment = {**os.environ, "MUJOCO_GL": library, "PYTHONPATH": path}
        environment.pop("PYOPENGL_PLATFORM", None)
        order = {"arena": dict(arena), "unit": unit}
        process, said = launch("realitygap.twin.render", order, stderr=subprocess.DEVNULL, env=environment)
        if said == b"ready\n":
            return Renderer(process, library, lens)
        end_process(process)
    return None


if __name__ == "__main__":
    _serve()
