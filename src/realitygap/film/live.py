"""A live camera over the arena: a camera's number, a stream or a video file, read while a robot drives.

A process of its own opens it, keeps the frames flowing and writes the film, so that a control loop
beside it is never made late. Every frame carries the time at which it arrived.
"""

from __future__ import annotations

import multiprocessing
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from realitygap.errors import FilmError
from realitygap.film.live_process import OPEN_S, serve
from realitygap.values import Closing

__all__ = ["Filmed", "LiveCamera"]

ANSWER_S = 10.0
"""How long a live camera may take to give a picture."""


class Filmed(NamedTuple):
    """A film from a live camera: when its first frame came (`time.monotonic`), how many frames there are,
    and what went wrong meanwhile, in words (None: nothing)."""

    first_at: float
    frames: int
    trouble: str | None


class LiveCamera(Closing):
    """An open camera, stream or video file. Use it in a `with`, or `close` it.

    A video file moves on only with each picture that is looked at; while it is filmed it plays at its
    own rate.

    Args:
        source: a camera's number, or what OpenCV opens: a file, an address.
        size: width and height that a camera is asked for, px.

    Raises:
        FilmError: nothing opens there, or no picture comes.
    """

    def __init__(self, source: str | int, *, size: tuple[int, int] | None = None) -> None:
        self.source = str(source)
        context = multiprocessing.get_context("spawn")
        self._pipe, there = context.Pipe()
        arguments = (there, self.source, size)
        self._process: Any = context.Process(target=serve, args=arguments, daemon=True)
        self._process.start()
        there.close()
        try:
            self._answer(OPEN_S + ANSWER_S)
        except BaseException:
            self.close()
            raise

    def look(self) -> NDArray[np.uint8]:
        """What the camera sees now, grey [height, width]."""
        return np.asarray(self._ask("look"), np.uint8)

    def film(self, file: str | Path) -> None:
        """Begin a film (.mp4); returns when its first frame is there."""
        self._ask("film", str(file))

    def finish(self, until: float) -> Filmed:
        """End the film with the first frame that came at or after `until` (`time.monotonic`).

        Raises:
            FilmError: the film could not be written.
        """
        return Filmed(*self._ask("finish", until))

    def close(self) -> None:
        """Release the camera."""
        if self._process is None:
            return
        self._pipe.close()  # it ends when nobody listens
        self._process.join(ANSWER_S)
        if self._process.is_alive():
            self._process.kill()
            self._process.join()
        self._process.close()
        self._process = None

    def _ask(self, *order: Any) -> Any:
        try:
            self._pipe.send(order)
        except OSError:
            raise self._gone() from None
        return self._answer(ANSWER_S)

    def _answer(self, patience_s: float) -> Any:
        try:
            if not self._pipe.poll(patience_s):
                raise FilmError(
                    f"live camera {self.source!r}: no answer in {patience_s:g} s. Check the camera."
                )
            answer = self._pipe.recv()
        except (EOFError, OSError):
            raise self._gone() from None
        if isinstance(answer, FilmError):
            raise answer
        return answer

    def _gone(self) -> FilmError:
        return FilmError(f"live camera {self.source!r}: its process ended. Check the camera and try again.")
