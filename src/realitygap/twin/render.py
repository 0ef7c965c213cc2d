"""MuJoCo's renderer behind the twin's lens, for films whose lighting is not ours (`--view mujoco`)."""

import importlib
import os
import sys
from collections.abc import Mapping
from ctypes.util import find_library
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from realitygap.errors import ConfigError
from realitygap.twin.body import build_xml, mujoco
from realitygap.twin.camera import (
    DISK_HEIGHT,
    DISK_RADIUS,
    FRONT_AHEAD,
    FRONT_RADIUS,
    HEIGHT,
    MIDDLE_RADIUS,
    WIDTH,
    Lens,
)
from realitygap.twin.unit import Unit
from realitygap.values import Pose

__all__ = ["Renderer"]

PAD_WIDTH, PAD_HEIGHT = 704, 528
"""The renderer has no lens: it draws a little more, and the lens bends it afterwards."""
LIBRARIES = ("egl", "osmesa", "cgl", "glfw")


def _scene(arena: Mapping[str, Any], lens: Lens) -> dict[str, Any]:
    """What the camera needs beyond the physics: itself, light, the disk."""
    axes = " ".join(f"{v:.9f}" for v in lens.rotation[:, :2].T.ravel())
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


class Renderer:
    """Frames of one arena through one lens, by the GL library that MUJOCO_GL names or the first there is.

    Raises:
        ConfigError: none works here.
    """

    def __init__(self, arena: Mapping[str, Any], unit: Unit, lens: Lens) -> None:
        named = os.environ.get("MUJOCO_GL", "").strip().lower()
        first = "cgl" if sys.platform == "darwin" else "egl" if find_library("EGL") else "osmesa"
        self.library = named if named in LIBRARIES else first
        self._model = mujoco.MjModel.from_xml_string(build_xml(arena, unit, **_scene(arena, lens)))
        self._data = mujoco.MjData(self._model)
        try:
            self._gl = importlib.import_module(f"mujoco.{self.library}").GLContext(PAD_WIDTH, PAD_HEIGHT)
            self._gl.make_current()
            self._context = mujoco.MjrContext(self._model, mujoco.mjtFontScale.mjFONTSCALE_150)
        except Exception as error:  # whatever a GL library that is missing, or half there, raises
            raise ConfigError(
                f"MuJoCo's renderer needs an EGL or OSMesa library, and {self.library} does not work here "
                f"({error}): install one, name another by MUJOCO_GL, or ask for the drawn view"
            ) from None
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, self._context)
        self._scene, self._option = mujoco.MjvScene(self._model, maxgeom=1000), mujoco.MjvOption()
        self._camera = mujoco.MjvCamera()
        self._camera.type, self._camera.fixedcamid = mujoco.mjtCamera.mjCAMERA_FIXED, 0
        x, y = lens.straightened(*np.meshgrid(np.arange(WIDTH) * 1.0, np.arange(HEIGHT) * 1.0))
        self._u = (x * lens.focal + (PAD_WIDTH - 1) / 2).astype(np.float32)
        self._v = ((PAD_HEIGHT - 1) / 2 - y * lens.focal).astype(np.float32)

    def frame(self, pose: Pose) -> NDArray[np.uint8]:
        """[480, 640, 3] grey levels, bent by the lens, without the camera's noise."""
        c, s = np.cos(pose.heading / 2), np.sin(pose.heading / 2)
        self._data.qpos[:7] = pose.x / 100.0, pose.y / 100.0, 0.0, c, 0.0, 0.0, s
        mujoco.mj_kinematics(self._model, self._data)
        mujoco.mj_camlight(self._model, self._data)
        everything = mujoco.mjtCatBit.mjCAT_ALL
        mujoco.mjv_updateScene(
            self._model, self._data, self._option, None, self._camera, everything, self._scene
        )
        whole = mujoco.MjrRect(0, 0, PAD_WIDTH, PAD_HEIGHT)
        picture = np.empty((PAD_HEIGHT, PAD_WIDTH, 3), np.uint8)
        self._gl.make_current()
        mujoco.mjr_render(whole, self._scene, self._context)
        mujoco.mjr_readPixels(picture, None, whole, self._context)
        return np.asarray(cv2.remap(picture[::-1], self._u, self._v, cv2.INTER_LINEAR), np.uint8)

    def close(self) -> None:
        """Release the GL library."""
        self._context.free()
        self._gl.free()
