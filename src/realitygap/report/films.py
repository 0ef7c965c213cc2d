"""The films of a report: the simulation beside the film from above, each with the tail of its robot.

The left half is drawn through the film's own camera, so that both robots are seen alike.
"""

import base64
import hashlib
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from realitygap.errors import UsageError
from realitygap.files import atomic_write
from realitygap.film.camera import load_camera
from realitygap.film.video import FilmReader, FilmWriter
from realitygap.report.drawing import front
from realitygap.report.style import noise_styles
from realitygap.report.transfers import Pair
from realitygap.track import Track, read_track
from realitygap.transfer.record import read_trial
from realitygap.values import Floats
from realitygap.world.arena import Arena
from realitygap.world.robot import Profile

__all__ = ["film_of"]

FORM = 1
"""Changes with the look of the films: those of the same sources and look are kept."""
HALF_PX = 480
"""Width of a half."""
MARGIN_CM = 3.0
"""Around the arena."""
RATE, QUALITY = 25, 27
"""Frames a second, unless the film says otherwise; H.264's rate factor."""
BRIGHTEST = 140.0
"""A floor brighter than this is darkened, so that white tails show."""
FLOOR, GROUND, POST, EDGE, LAMP = (86, 84, 80), (52, 51, 49), (118, 113, 106), (178, 170, 158), (230, 159, 0)
SHIFT = 4
"""Bits after the point of OpenCV's coordinates."""

Pixels = NDArray[np.uint8]
"""[height, width, 3] in red, green and blue, or [height, width]."""


def film_of(pair: Pair, arena: Arena, profile: Profile, report: Path) -> dict[str, object] | None:
    """A transfer's film in the report's folder, with its last frame (a data URI, its size in px); None where
    the trial was not filmed, and the last frame alone where the film cannot be read."""
    tails, film = pair.folder / "tails.png", pair.folder / "film.mp4"
    if not (pair.filmed and tails.is_file()):
        return None
    link = f"films/{pair.folder.parent.name}-{pair.robot}-{pair.folder.name}.mp4"
    target = report / link
    try:
        sources = ("film.mp4", "track.csv", "simulated.csv", "camera.json")
        data = b"".join((pair.folder / name).read_bytes() for name in sources) + f"{FORM} {profile}".encode()
        poster = target.with_suffix(f".{hashlib.blake2b(data, digest_size=12).hexdigest()}.jpg")
        if not (target.is_file() and poster.is_file()):
            target.parent.mkdir(parents=True, exist_ok=True)
            for old in target.parent.glob(f"{target.stem}.*.jpg"):
                old.unlink()
            atomic_write(poster, _jpeg(_Beside(pair, arena, profile).write(film, target)))
        data = poster.read_bytes()
    except (UsageError, OSError):
        last, link = np.asarray(cv2.imread(str(tails)), np.uint8)[..., ::-1], ""
        deep = max(1, round(2 * HALF_PX * last.shape[0] / last.shape[1]))
        data = _jpeg(
            np.asarray(cv2.resize(last, (2 * HALF_PX, deep), interpolation=cv2.INTER_AREA), np.uint8)
        )
    deep, wide = np.asarray(cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)).shape[:2]
    picture = f"data:image/jpeg;base64,{base64.b64encode(data).decode('ascii')}"
    return {"pair": pair, "picture": picture, "size": (wide, deep), "link": link}


def _jpeg(picture: Pixels) -> bytes:
    _, data = cv2.imencode(".jpg", np.ascontiguousarray(picture[..., ::-1]), [cv2.IMWRITE_JPEG_QUALITY, 82])
    return bytes(data)


class _Beside:
    """What a film's frames are made of: the simulated path and the film's own track, seen by its camera."""

    def __init__(self, pair: Pair, arena: Arena, profile: Profile) -> None:
        self.camera, self.arena, self.profile = load_camera(pair.folder / "camera.json"), arena, profile
        self.tracks = (pair.simulated, read_track(pair.folder / "track.csv"))
        self.lead_s = float(read_trial(pair.folder).get("film_lead_s", 0.0))
        self.colour = tuple(bytes.fromhex(noise_styles([pair.level])[pair.level].colour[1:]))
        # The part of the film that shows the arena, and what makes it a half.
        low, (wide, deep) = -MARGIN_CM, (side + MARGIN_CM for side in arena.size_cm)
        seen = self.camera.to_pixels([(low, low), (low, deep), (wide, low), (wide, deep)])
        seen = np.clip(seen, 0, (self.camera.width_px, self.camera.height_px))
        self.corner, (right, bottom) = np.floor(seen.min(0)).astype(int), np.ceil(seen.max(0)).astype(int)
        self.scale = HALF_PX / max(1, right - self.corner[0])
        self.size = (HALF_PX, 2 * max(1, round((bottom - self.corner[1]) * self.scale / 2)))

    def write(self, film: Path, target: Path) -> Pixels:
        """Write it frame by frame; returns the last."""
        empty, veils = self._empty(), [np.zeros(self.size[::-1], np.uint8) for _ in range(2)]
        tails, done = [self._strokes(track) for track in self.tracks], [0, 0]
        times = [self.tracks[0].t + self.lead_s, self.tracks[1].t]
        (x, y), cut, dim = self.corner, np.ceil(np.array(self.size) / self.scale).astype(int), 0.0
        both, writer = empty, FilmWriter(target, rate=RATE, made_by="realitygap's report", quality=QUALITY)
        with FilmReader(film) as frames, writer as made:
            for frame in frames:
                seen = cv2.resize(frame.colour()[y : y + cut[1], x : x + cut[0]], self.size)
                dim = dim or min(1.0, BRIGHTEST / max(float(np.median(seen)), 1.0))
                for side in range(2):
                    until = int(np.searchsorted(times[side], frame.t_s + 1e-6, side="right"))
                    for stroke in tails[side][done[side] : until]:
                        if np.isfinite(stroke).all():
                            _line(veils[side], stroke, 255)
                    done[side] = max(done[side], until)
                drawn, track, k = empty.copy(), self.tracks[0], max(0, done[0] - 1)
                rim = self._disc(track.x[k], track.y[k], self.profile.body.radius_cm)
                _filled(drawn, rim, GROUND)
                _line(drawn, rim, self.colour, 3)
                both = np.hstack([_veiled(drawn, veils[0]), _veiled(seen * dim, veils[1])])
                made.add(both, frame.t_s)
        return both

    def _strokes(self, track: Track) -> Floats:
        """Lines [n, 2, 2] of a tail, px, from centre to leading edge; NaN where the robot is lost."""
        centre, reach = track.x + 1j * track.y, front(self.profile.to_kernel()) * np.exp(1j * track.heading)
        ends = np.stack([centre, centre + reach], 1)
        lines = self._px(np.nan_to_num(np.stack([ends.real, ends.imag], 2)))
        lines[~track.found] = np.nan
        return lines

    def _px(self, places: object) -> Floats:
        """Places (cm) as pixels of a half."""
        return np.asarray((self.camera.to_pixels(places) - self.corner) * self.scale)  # type: ignore[arg-type]

    def _disc(self, x: float, y: float, radius: float) -> Floats:
        turn = np.linspace(0, 2 * np.pi, 48)
        return self._px(np.stack([x + radius * np.cos(turn), y + radius * np.sin(turn)], 1))

    def _empty(self) -> Pixels:
        """The arena without a robot."""
        picture, (wide, deep) = np.full((*self.size[::-1], 3), GROUND, np.uint8), self.arena.size_cm
        along = np.linspace(0, 1, 24)[:, None]  # the lens bends straight lines
        corners = np.array([(0, 0), (wide, 0), (wide, deep), (0, deep), (0, 0)], float)
        edge = self._px(np.concatenate([a + along * (b - a) for a, b in pairwise(corners)]))
        _filled(picture, edge, FLOOR)
        for post in self.arena.cylinders:
            _filled(picture, self._disc(post.x_cm, post.y_cm, post.radius_cm), POST)
        for x0, y0, x1, y1 in self.arena.walls:
            _line(picture, self._px([(x0, y0), (x1, y1)]), EDGE, 2)
        for lamp in self.arena.lamps:
            for x, y in lamp.points():
                _filled(picture, self._disc(x, y, 1.0), LAMP)
        _line(picture, edge, EDGE, 2)
        return picture


def _line(picture: Pixels, points: Floats, colour: object, thick: int = 1) -> None:
    whole = np.rint(points * 2**SHIFT).astype(np.int32)
    cv2.polylines(picture, [whole], False, colour, thick, cv2.LINE_AA, SHIFT)


def _filled(picture: Pixels, points: Floats, colour: object) -> None:
    cv2.fillPoly(picture, [np.rint(points * 2**SHIFT).astype(np.int32)], colour, cv2.LINE_AA, SHIFT)


def _veiled(picture: NDArray[np.floating] | Pixels, veil: Pixels) -> Pixels:
    """A picture under a white veil."""
    return np.asarray(np.rint(picture + (255.0 - picture) * (veil / 255.0)[..., None]), np.uint8)
