"""A card of black and white cells on the robot's back, in the disk's place: a printed marker."""

from typing import Any

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from realitygap.twin.arithmetic import hypot

__all__ = ["Plate"]

Array = NDArray[np.float32]

TEXELS = 24
"""Parts along a cell's side in which the card is kept."""


class Plate:
    """A square of n × n cells on a card that shows a white rim, a cell wide, about them.

    Args:
        cells: [n, n] from the upper left one on, 1 where one is white.
        corners: [4, 2] of the cells' square, clockwise from its upper left one: ahead and to the left of the
            robot's centre (m).
        height: above the floor (m).
    """

    def __init__(self, cells: NDArray[np.uint8], corners: NDArray[np.float64], height: float) -> None:
        self.height, self.reach = height, 1.5 * float(hypot(*corners.T).max())
        self._first, self._across, self._down = corners[0], corners[1] - corners[0], corners[3] - corners[0]
        self._count = len(cells)
        card = np.pad(cells, 1, constant_values=1)
        parts = np.pad(np.stack([np.ones_like(card), card]), ((0, 0), (1, 1), (1, 1)))
        self._fine = parts.repeat(TEXELS, axis=1).repeat(TEXELS, axis=2).astype(np.float64)

    def softened(self, sample: float) -> Array:
        """[2, side, side] how much the card covers, and how white it is there, under samples so wide (m)."""
        cell = float(hypot(*self._across)) / self._count
        half = max(1, round(TEXELS * sample / cell / 2))
        wide = np.pad(self._fine, ((0, 0), (half, half), (half, half)))
        windows = sliding_window_view(wide, (2 * half + 1, 2 * half + 1), axis=(1, 2))
        return np.asarray(windows.mean(axis=(3, 4)), np.float32)

    def shown(self, soft: Array, off: NDArray[Any], turn: tuple[float, float]) -> Array:
        """[2, ...] cover and whiteness of a `softened` card at places `off` [2, ...] the robot's centre (m);
        `turn` has cosine and sine of its heading."""
        (x, y), (c, s) = off, turn
        ahead, left = c * x + s * y - self._first[0], c * y - s * x - self._first[1]
        parts = self._count * TEXELS / float(self._across[0] ** 2 + self._across[1] ** 2)
        column, row = (
            np.floor((ahead * to[0] + left * to[1]) * parts).astype(int) + 2 * TEXELS
            for to in (self._across, self._down)
        )
        last = soft.shape[1] - 1
        return soft[:, row.clip(0, last), column.clip(0, last)]
