"""Frames as a decoder gives them: which of them to trust, their brightness, and which way is up."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import av
import numpy as np
from numpy.typing import NDArray

__all__ = ["Image", "grey", "sound_or_hurt", "turned"]

Image = NDArray[np.uint8]

_LUMA_FIRST = ("yuv420p", "yuvj420p", "yuv422p", "yuvj422p", "yuv444p", "yuvj444p", "nv12", "gray")
"""Pixel formats of 8 bits whose first plane is the brightness."""

_BETWEEN = int(av.video.frame.PictureType.B)
"""Frames that build on earlier and on later ones (type B)."""


def sound_or_hurt(sources: Iterator[Any]) -> Iterator[tuple[Any, bool]]:
    """Frames, and whether each is damaged: most frames of a film only say what changed since others.

    So damage lasts until the next key frame, and it also reaches the frames just before, which build
    on what comes after them (type B): these wait until that is known.
    """
    waiting: list[Any] = []
    hurt = False
    for source in sources:
        if source is None:
            hurt = True
            continue
        if source.pict_type == _BETWEEN:
            waiting.append(source)
            hurt = hurt or bool(source.is_corrupt)
            continue
        anew = bool(source.is_corrupt) or (hurt and not source.key_frame)
        yield from ((one, hurt or anew) for one in waiting)
        yield source, anew
        waiting.clear()
        hurt = anew
    yield from ((one, hurt) for one in waiting)


def grey(source: Any) -> Image:
    """A decoded frame's brightness; the decoder's own memory where it is one plane of 8 bits."""
    if source.format.name in _LUMA_FIRST:
        plane = source.planes[0]
        rows = np.frombuffer(plane, np.uint8).reshape(-1, plane.line_size)
        return rows[: source.height, : source.width]
    return np.asarray(source.to_ndarray(format="gray"))


def turned(picture: Image, source: Any) -> Image:
    """The picture upright: telephones note how they were held instead of turning it."""
    quarters = round(getattr(source, "rotation", 0) / 90) % 4
    return np.ascontiguousarray(np.rot90(picture, quarters)) if quarters else picture
