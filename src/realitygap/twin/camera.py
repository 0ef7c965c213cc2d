"""The overhead camera: recorded states in, frames out, afterwards and at any pace.

Frames are drawn or, if asked for, made by MuJoCo's renderer, through the same camera and lens; `metadata`
says which made them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from copy import copy
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from realitygap.errors import ConfigError
from realitygap.twin.arena import check_arena
from realitygap.twin.drawing import WHOLE, Drawing, Window
from realitygap.twin.lens import HEIGHT, WIDTH, hang_camera
from realitygap.twin.noise import check_scale, draws, normal_draws
from realitygap.twin.painting import expose
from realitygap.twin.plate import Plate
from realitygap.twin.states import States, heading_of
from realitygap.twin.unit import draw_unit
from realitygap.values import Closing

__all__ = ["OverheadCamera"]

Frame = NDArray[np.uint8]

PIXEL_NOISE = 2.5
"""Grey levels, deviation: a plain video camera indoors."""
FALL_OFF = 0.16
"""A lens darkens its corners: by this share at the picture's corner."""
FPS = 25.0
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

    Raises:
        ConfigError: `mujoco` is asked for with a plate, or where neither EGL nor OSMesa works.
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
    ) -> None:
        if view not in VIEWS:
            raise ConfigError(f"the camera's view is one of {', '.join(VIEWS)}, got {view!r}")
        arena = check_arena(arena)
        who = draw_unit(unit)
        self.lens = hang_camera(arena, who)
        self._unit, self._noise = unit, check_scale(noise)
        if view == "mujoco" and plate is not None:
            raise ConfigError("MuJoCo's renderer shows no robot with a plate: ask for the drawn view")
        self._renderer = _renderer(arena, who, self.lens) if view == "mujoco" else None
        self._drawing = Drawing(arena, self.lens, plate) if self._renderer is None else None
        columns, rows = np.meshgrid(np.arange(WIDTH) - WIDTH / 2, np.arange(HEIGHT) - HEIGHT / 2)
        corner = (WIDTH**2 + HEIGHT**2) / 4
        light = who.camera.gain * (1 - FALL_OFF * (columns**2 + rows**2) / corner)
        self._light = np.repeat(light.astype(np.float32), 3, axis=1)
        self.begin(seed)

    def begin(self, seed: int) -> None:
        """Another film: its seed names the noise of its pixels, as if the camera were new."""
        self._seed = seed
        self._bank = normal_draws(draws(self._unit, seed, 53), 2 * WIDTH * HEIGHT * 3).astype(np.float32)
        self._bank *= np.float32(PIXEL_NOISE * self._noise)

    def again(self, seed: int) -> OverheadCamera:
        """This camera for another film, as if it were new: both share what they draw with."""
        other = copy(self)
        other.begin(seed)
        return other

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

    def frame(self, pose: NDArray[np.float64], number: int = 0, window: Window = WHOLE) -> Frame:
        """[480, 640, 3] what the camera shows of a robot at `pose` [7], a row of `States.pose`; the frame's
        `number` names its noise. Of a `window` (rows and columns) it is the whole frame's, to the last bit.
        """
        picture: NDArray[Any]
        if self._renderer is not None:
            picture = self._renderer.frame(pose)[window]
        else:
            assert self._drawing is not None
            where = float(pose[0]), float(pose[1]), heading_of(pose)
            picture = self._drawing.frame(*where, window)
        size = self._light.size
        start = int(draws(self._seed, 59, number).integers(size))
        noise = self._bank[start : start + size].reshape(self._light.shape)
        frame = np.empty(picture.shape, np.uint8)
        lines = (np.ascontiguousarray(picture).reshape(len(frame), -1), self._light, noise)
        expose(*lines, (window[0].start, 3 * window[1].start), frame.reshape(len(frame), -1))
        return frame

    def looks(
        self, states: States, *, fps: float = FPS, first: int = 0
    ) -> Iterator[tuple[float, Callable[[Window], Frame]]]:
        """Frames of the recorded states at an even pace: (time in s from the first state, what shows it).

        It shows any window of it, and only that much is made. Between two states the later one that is not
        after the frame's time is shown (10 ms at most). `first` is the first frame's number, which names
        its noise.
        """
        start, end = int(states.time_ms[0]), int(states.time_ms[-1])
        for number in range(int((end - start) * fps / 1000.0) + 1):
            t = number / fps
            row = int(np.searchsorted(states.time_ms, start + t * 1000.0 + 1e-6, side="right")) - 1
            yield t, partial(self.frame, states.pose[row], first + number)


def _renderer(*words: Any) -> Any:
    from realitygap.twin.render import Renderer  # it needs MuJoCo, OpenCV and a GL library

    return Renderer(*words)
