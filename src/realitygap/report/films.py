"""Films on the page: the last frame under the track's tail, and the way to the film."""

from __future__ import annotations

import base64
import io
import shutil
from dataclasses import dataclass
from pathlib import Path

from realitygap import whole
from realitygap.report.gather import TaskPart
from realitygap.report.transfers import Pair

__all__ = ["Film", "film_of"]

FILM_PX = 720
"""Width of a film's last frame on the page."""


@dataclass(frozen=True, kw_only=True)
class Film:
    """A film's last frame under its track's tail, and the copy of the film, as seen from the page."""

    head: str
    caption: str
    alt: str
    picture: str
    """A data URI."""
    size: tuple[int, int]
    link: str


def film_of(part: TaskPart, pair: Pair, report: Path) -> Film | None:
    """A film's last frame, if there is one and it can be read; the film is copied into the report.

    So the report's folder can be given away without the study's, and its films still play.
    """
    path = pair.folder / "tails.png"
    if not (pair.filmed and path.is_file()):
        return None
    picture, size = _embedded(path)
    film, link = pair.folder / "film.mp4", ""
    if film.is_file():
        link = f"films/{pair.folder.parent.name}-{pair.robot}-{pair.folder.name}.mp4"
        _copy(film, report / link)
    head = f"{part.names[pair.level]}, #{pair.row.index}"
    return Film(
        head=head,
        caption=f"{pair.where}, start {pair.start}",
        alt=f"Last frame of the film of {head} on {pair.where}, from above, with its tail in white.",
        picture=picture,
        size=size,
        link=link,
    )


def _copy(film: Path, copy: Path) -> None:
    copy.parent.mkdir(parents=True, exist_ok=True)
    with whole.new(copy) as spare:
        shutil.copyfile(film, spare)


def _embedded(path: Path) -> tuple[str, tuple[int, int]]:
    """A picture made small enough for a page, as a data URI, and its size in px."""
    from PIL import Image

    with Image.open(path) as whole:
        wide = min(FILM_PX, whole.width)
        size = (wide, max(1, round(whole.height * wide / whole.width)))
        small = whole.convert("RGB").resize(size, Image.Resampling.LANCZOS)
    buffer = io.BytesIO()
    small.save(buffer, "JPEG", quality=82, optimize=True)
    return f"data:image/jpeg;base64,{base64.b64encode(buffer.getvalue()).decode('ascii')}", size
