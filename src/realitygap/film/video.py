"""Films read and written through PyAV: no other program is needed."""

import json
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any, Self

import av
import numpy as np
from av.error import EOFError as EndOfFilm
from av.error import FFmpegError
from numpy.typing import NDArray

from realitygap.errors import FilmError
from realitygap.files import move_whole
from realitygap.values import Closing

__all__ = ["FilmReader", "FilmWriter", "Frame", "Image"]

Image = NDArray[np.uint8]

_LUMA_FIRST = ("yuv420p", "yuvj420p", "yuv422p", "yuvj422p", "yuv444p", "yuvj444p", "nv12", "gray")
"""Pixel formats of 8 bits whose first plane is the brightness."""

_TYPE_B = int(av.video.frame.PictureType.B)

_ANY_NOTES = {} if int(av.__version__.split(".")[0]) >= 19 else {"metadata_errors": "replace"}
"""Opens a film even if its notes are not UTF-8, as PyAV 19 and later do by default."""

_BROKEN_IN_A_ROW = 50
"""This many packets in a row that cannot be decoded end a film."""

_NO_TIMES = 0x80
"""FFmpeg's mark (AVFMT_NOTIMESTAMPS) of formats without times, such as a bare stream of H.264."""

_TICK = Fraction(1, 90_000)
"""Unit of the times that pictures of an uneven film bear, s."""
_THREADS = 1
"""x264's pictures depend on their number, and with two they differ now and then between equal films."""


@dataclass(frozen=True)
class Frame:
    """One picture of a film: when it was taken after the first (s), and its brightness [height, width]."""

    t_s: float
    grey: Image
    damaged: bool
    source: Any

    def colour(self) -> Image:
        """The picture in red, green and blue, [height, width, 3]."""
        return _turned(self.source.to_ndarray(format="rgb24"), self.source)


class FilmReader(Closing):
    """A film being read, a context manager and an iterator of its frames; one pass.

    What is wrong with the film is known when the pass is over: `trouble` then says in words where
    it was cut off or damaged, or that it has no times; or is None.

    Raises:
        FilmError: no such file, not a film, or one that no frame can be read from.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        self.trouble: str | None = None
        self._container: Any = self._open()
        self._stream: Any = self._container.streams.video[0]
        self._stream.thread_type = "AUTO"
        self.frames_expected = self._expected()

    @property
    def notes(self) -> dict[str, Any]:
        """What `FilmWriter` noted about the film; empty for others' films."""
        with suppress(ValueError):
            notes = json.loads(self._container.metadata.get("comment", ""))
            if isinstance(notes, dict):
                return notes
        return {}

    def close(self) -> None:
        self._container.close()

    def __iter__(self) -> Iterator[Frame]:
        begin, last, count, n_damaged = None, 0.0, 0, 0
        for source, damaged in _marked(self._decoded()):
            t = count / self._rate() if source.pts is None else float(source.pts * source.time_base)
            begin = t if begin is None else begin
            if t - begin < last and not damaged:
                raise FilmError(f"{self.path}: its times fall back at {last:.2f} s. Cut the film there.")
            last, count, n_damaged = t - begin, count + 1, n_damaged + damaged
            yield Frame(round(last, 9), _turned(_grey(source), source), damaged, source)
        if not count:
            raise FilmError(f"{self.path}: no frame can be read from this film. Give another file.")
        self._judge(count, n_damaged, last)

    def _open(self) -> Any:
        if not self.path.exists():
            raise FilmError(f"{self.path}: no such film. Check the path.")
        try:
            container: Any = av.open(str(self.path), **_ANY_NOTES)
        except (FFmpegError, ValueError, OSError) as error:
            why = getattr(error, "strerror", None) or error
            raise FilmError(
                f"{self.path}: not a film, or cut off so early that its table of contents is missing: {why}. "
                "Give a film as a camera writes it (MP4, MOV, MKV, AVI …)."
            ) from None
        if not container.streams.video or container.streams.video[0].codec_context is None:
            container.close()
            raise FilmError(f"{self.path}: there is no picture in this file that can be read. Give a film.")
        return container

    def _expected(self) -> int | None:
        """How many frames the film says it has, if it says so."""
        if self._stream.frames:
            return int(self._stream.frames)
        if self._stream.duration and self._stream.time_base:
            return round(float(self._stream.duration * self._stream.time_base) * self._rate())
        named = self._container.format.name
        begin = (self._container.start_time or 0) * ("matroska" in named)  # tells its end
        return round(((self._container.duration or 0) - begin) / av.time_base * self._rate()) or None

    def _rate(self) -> float:
        return float(self._stream.average_rate or self._stream.guessed_rate or 25)

    def _decoded(self) -> Iterator[Any]:
        """Frames as the decoder gives them; None where there was something that it cannot decode."""
        packets, broken = self._container.demux(self._stream), 0
        while broken <= _BROKEN_IN_A_ROW:
            try:
                packet = next(packets)
            except (StopIteration, FFmpegError, OSError):
                break
            try:
                yield from packet.decode()
                broken = 0
            except EndOfFilm:
                return
            except FFmpegError:
                broken += 1
                yield None
        with suppress(FFmpegError):  # what the decoder still holds of a film that was cut off
            yield from self._stream.codec_context.decode(None)

    def _judge(self, count: int, n_damaged: int, last: float) -> None:
        """Say what the pass found."""
        expected, reached = self.frames_expected, count
        if not self._stream.frames:  # it tells its length alone: pictures may come at any rate
            reached = max(count, round(last * self._rate()) + 1)
        if expected is not None and reached < expected - max(2, round(0.02 * expected)):
            self.trouble = (
                f"the film is cut off or damaged: {count} of about {expected} frames could be read, "
                f"the last at {last:.2f} s"
            )
        elif n_damaged:
            self.trouble = f"{n_damaged} of the film's {count} frames are damaged or depend on damaged ones"
        if count > 1 and int(self._container.format.flags) & _NO_TIMES:
            assumed = (
                f"the file holds no times, so {self._rate():g} frames a second are assumed: put the film "
                "into an MP4 or MKV at the rate of its camera"
            )
            self.trouble = "; ".join(filter(None, (assumed, self.trouble)))


class FilmWriter:
    """A film being written as MP4 with H.264, a context manager; it appears when it is complete.

    Args:
        path: the file, ending in .mp4.
        rate: frames a second.
        made_by: which camera made it, such as "MuJoCo's renderer": kept in the film.
        notes: what else to keep in it, ready for JSON.
        quality: H.264's constant rate factor: 0 lossless, 20 looks good, 51 worst.

    Raises:
        FilmError: a path or a rate that cannot be used, frames of different sizes.
    """

    def __init__(
        self,
        path: str | Path,
        *,
        rate: float,
        made_by: str,
        notes: Mapping[str, Any] | None = None,
        quality: float = 20,
    ) -> None:
        self.path = Path(path)
        if self.path.suffix.lower() != ".mp4":
            raise FilmError(f"{path}: expected a film's name ending in .mp4.")
        if not 0 < rate <= 1000:
            raise FilmError(f"rate: expected 0 to 1000 frames a second, got {rate!r}.")
        self._rate = Fraction(rate).limit_denominator(1000)
        self._notes = json.dumps({"made_by": made_by, **(notes or {})}, ensure_ascii=False)
        self._quality = quality
        self._part = self.path.with_name(f".{self.path.stem}.part.mp4")
        self._container: Any = None
        self._stream: Any = None
        self._shape: tuple[int, ...] = ()
        self._last = -1

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if self._container is None:
            return
        try:
            if kind is None:
                self._container.mux(self._stream.encode())
        finally:
            self._container.close()
            if kind is not None:
                self._part.unlink(missing_ok=True)
        if kind is None:
            move_whole(self._part, self.path)

    def add(self, picture: Image, t_s: float | None = None) -> None:
        """Append a picture, [height, width] grey or [height, width, 3] red, green and blue, 8 bits.

        `t_s` is when it was taken after the first one; without it pictures follow at the film's rate.
        """
        if self._container is None:
            self._begin(picture.shape, uneven=t_s is not None)
        if picture.shape != self._shape:
            raise FilmError(f"{self.path}: expected pictures of shape {self._shape}, got {picture.shape}.")
        form = "gray" if picture.ndim == 2 else "rgb24"
        even = np.ascontiguousarray(picture[: self._stream.height, : self._stream.width])
        frame = av.VideoFrame.from_ndarray(even, format=form)
        if t_s is not None:
            self._last = max(round(t_s / _TICK), self._last + 1)
            frame.pts, frame.time_base = self._last, _TICK
        self._container.mux(self._stream.encode(frame))

    def _begin(self, shape: tuple[int, ...], *, uneven: bool) -> None:
        self._shape = shape
        codec = "libx264" if "libx264" in av.codecs_available else "mpeg4"
        try:
            self._container = av.open(str(self._part), "w", options={"movflags": "+faststart"})
        except (FFmpegError, OSError) as error:
            why = error.strerror
            raise FilmError(f"{self.path}: cannot be written ({why}). Choose another place.") from None
        self._container.metadata["comment"] = self._notes
        self._stream = self._container.add_stream(codec, rate=self._rate)
        self._stream.height, self._stream.width = (n - n % 2 for n in shape[:2])
        self._stream.pix_fmt = "yuv420p"
        if uneven:
            self._stream.codec_context.time_base = _TICK
        if codec == "libx264":
            self._stream.options = {"crf": f"{self._quality:g}", "preset": "ultrafast"}
            self._stream.codec_context.thread_count = _THREADS


def _marked(sources: Iterator[Any]) -> Iterator[tuple[Any, bool]]:
    """Frames, and whether each is damaged. Most only say what changed since others, so damage lasts until the
    next key frame; frames of type B build on the next one too, and wait until that is known."""
    waiting, damaged = list[Any](), False
    for source in sources:
        if source is None or source.pict_type == _TYPE_B:
            damaged = damaged or source is None or bool(source.is_corrupt)
            waiting += [source] * (source is not None)
            continue
        before, damaged = damaged, bool(source.is_corrupt) or (damaged and not source.key_frame)
        yield from ((one, before or damaged) for one in waiting)
        yield source, damaged
        waiting.clear()
    yield from ((one, damaged) for one in waiting)


def _grey(source: Any) -> Image:
    """A decoded frame's brightness; the decoder's own memory where it is one plane of 8 bits."""
    if source.format.name in _LUMA_FIRST:
        plane = source.planes[0]
        rows = np.frombuffer(plane, np.uint8).reshape(-1, plane.line_size)
        return rows[: source.height, : source.width]
    return np.asarray(source.to_ndarray(format="gray"))


def _turned(picture: Image, source: Any) -> Image:
    """The picture upright: telephones note how they were held instead of turning it."""
    quarters = round(getattr(source, "rotation", 0) / 90) % 4
    return np.ascontiguousarray(np.rot90(picture, quarters)) if quarters else picture
