"""A live camera over the arena: a camera's number, a stream or a video file, read while a robot drives.

A process of its own opens it, keeps the frames flowing and writes the film, so that it never delays
a control loop. Every frame carries the time at which it arrived.
"""

from __future__ import annotations

import multiprocessing
import signal
import time
from contextlib import closing, suppress
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from realitygap.errors import FilmError
from realitygap.film.video import FilmWriter, Image
from realitygap.values import Closing

__all__ = ["Filmed", "LiveCamera"]

OPEN_S, ANSWER_S, MISSED_S = 40.0, 10.0, 1.0
"""How long a camera may take to open, to give a picture, and may go without one."""

FALLBACK_FPS = 25.0
"""The rate of a source that does not state its own."""


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
        size: width and height requested of a camera, px.

    Raises:
        FilmError: it cannot be opened, or gives no picture.
    """

    def __init__(self, source: str | int, *, size: tuple[int, int] | None = None) -> None:
        self.source = str(source)
        context = multiprocessing.get_context("spawn")
        self._pipe, there = context.Pipe()
        self._process: Any = context.Process(target=_serve, args=(there, self.source, size), daemon=True)
        self._process.start()
        there.close()
        try:
            self._ask(patience_s=OPEN_S)
        except BaseException:
            self.close()
            raise

    def look(self) -> NDArray[np.uint8]:
        """What the camera sees now, grey [height, width]."""
        return np.asarray(self._ask("look"), np.uint8)

    def film(self, file: str | Path) -> None:
        """Start a film (.mp4); returns when its first frame is there."""
        self._ask("film", str(file))

    def finish(self, until: float) -> Filmed:
        """End the film with the first frame that came at or after `until` (`time.monotonic`).

        Raises:
            FilmError: the film could not be written.
        """
        filmed: Filmed = self._ask("finish", until)
        return filmed

    def close(self) -> None:
        if self._process is None:
            return
        self._pipe.close()  # it ends when nobody listens
        self._process.join(ANSWER_S)
        if self._process.is_alive():
            self._process.kill()
            self._process.join()
        self._process.close()
        self._process = None

    def _ask(self, *order: Any, patience_s: float = ANSWER_S) -> Any:
        """What comes of an order; of none, what comes by itself."""
        try:
            if order:
                self._pipe.send(order)
            if not self._pipe.poll(patience_s):
                raise FilmError(
                    f"live camera {self.source!r}: no answer in {patience_s:g} s. Check the camera."
                )
            answer = self._pipe.recv()
        except (EOFError, OSError):
            ended = "its process ended. Check the camera and try again."
            raise FilmError(f"live camera {self.source!r}: {ended}") from None
        if isinstance(answer, FilmError):
            raise answer
        return answer


def _serve(pipe: Connection, source: str, size: tuple[int, int] | None) -> None:
    """In the process of its own: take frames and carry out orders until nobody listens."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the driver's: it must stop the robot first
    with suppress(EOFError, OSError):
        try:
            camera = _Opened(source, size)
        except FilmError as error:
            pipe.send(error)
            return
        with closing(camera):
            pipe.send("open")
            while True:
                if not pipe.poll(None if camera.still else 0):
                    camera.take()
                    continue
                order, *rest = pipe.recv()
                try:
                    pipe.send(getattr(camera, order)(*rest))
                except FilmError as error:
                    pipe.send(error)


class _Opened:
    """A source that OpenCV opened."""

    def __init__(self, source: str, size: tuple[int, int] | None) -> None:
        cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
        self._source = source
        number = source.isascii() and source.isdecimal()
        self._video = cv2.VideoCapture(int(source)) if number else cv2.VideoCapture(source)
        if not self._video.isOpened():
            raise FilmError(
                f"live camera {source!r}: it cannot be opened. "
                "Give a camera's number (0, 1 …), a video file or a stream's address."
            )
        if number and size is not None:
            self._video.set(cv2.CAP_PROP_FRAME_WIDTH, size[0])
            self._video.set(cv2.CAP_PROP_FRAME_HEIGHT, size[1])
        rate = self._video.get(cv2.CAP_PROP_FPS)
        self._rate = rate if 0 < rate <= 1000 else FALLBACK_FPS
        self._live = number or self._video.get(cv2.CAP_PROP_FRAME_COUNT) <= 0
        self._writer: FilmWriter | None = None
        self._trouble: str | None = None
        self._times: list[float] = []

    @property
    def still(self) -> bool:
        """Whether nothing happens without a command."""
        return self._trouble is not None or (self._writer is None and not self._live)

    def close(self) -> None:
        """Release the source; an unfinished film is kept as far as it got."""
        if self._writer is not None:
            self._writer.__exit__(None)
        self._video.release()

    def look(self) -> Image:
        """The next frame, grey."""
        return np.asarray(cv2.cvtColor(self._next()[1], cv2.COLOR_BGR2GRAY), np.uint8)

    def film(self, file: str) -> None:
        notes = {"view": f"camera {self._source}"}
        self._writer, self._times = FilmWriter(file, rate=self._rate, made_by="a camera", notes=notes), []
        self._add(*self._next())

    def take(self) -> None:
        """Wait for a frame, and add it to the film if one is being made."""
        try:
            at, picture = self._next()
            if self._writer is not None:
                self._add(at, picture)
        except FilmError as error:
            self._trouble = str(error)

    def finish(self, until: float) -> Filmed:
        if self._writer is None:
            raise FilmError(f"live camera {self._source!r}: there is no film to finish.")
        while self._times[-1] < until and self._trouble is None:
            self.take()
        writer, self._writer = self._writer, None
        writer.__exit__(None)
        return Filmed(self._times[0], len(self._times), self._trouble)

    def _add(self, at: float, picture: Image) -> None:
        assert self._writer is not None
        self._times.append(at)
        colour = np.asarray(cv2.cvtColor(picture, cv2.COLOR_BGR2RGB), np.uint8)
        self._writer.add(colour, at - self._times[0])

    def _next(self) -> tuple[float, Any]:
        """The next frame and when it came."""
        if self._trouble is not None:
            raise FilmError(self._trouble)
        at = time.monotonic()
        if self._writer is not None and self._times and not self._live:
            at = self._times[0] + len(self._times) / self._rate  # a file plays at its own rate
            time.sleep(max(0.0, at - time.monotonic()))
        give_up = at + (MISSED_S if self._live else 0.0)
        while True:
            got = self._video.grab()
            at = time.monotonic() if self._live else at
            got, picture = self._video.retrieve() if got else (False, None)
            if got:
                return at, picture
            if time.monotonic() >= give_up:
                raise FilmError(
                    f"live camera {self._source!r}: no more pictures arrive. Check the camera or the file."
                )
            time.sleep(0.02)
