"""A study whose folder cannot be seen: rebuilt from its files' content, without its evaluations."""

import tempfile
from collections.abc import Mapping
from pathlib import Path

from realitygap.study.config import StudyConfig
from realitygap.study.folder import CONFIG, agree, exists
from realitygap.study.materials import gather, own
from realitygap.study.reader import DATABASE, Reader
from realitygap.study.sources import agree_to
from realitygap.study.store import create
from realitygap.values import Closing
from realitygap.work.pool import Pool
from realitygap.work.workers import far

__all__ = ["Home", "Words", "home_of", "words_for"]

Words = tuple[str, Mapping[str, bytes]]
"""A study's folder ("" if workers cannot see it) and the content of its files, as sent to workers."""


class Home(Closing):
    """The folder that a worker reads a study from: its own, or a temporary one that `close` removes."""

    def __init__(self, folder: Path, made: tempfile.TemporaryDirectory[str] | None = None) -> None:
        self.folder, self._made = folder, made

    def close(self) -> None:
        """Remove a temporary folder."""
        if self._made is not None:
            self._made.cleanup()


def words_for(folder: Path, pool: Pool) -> Words:
    """What a pool's workers are sent of a study."""
    place = "" if far(pool) else str(folder.resolve())
    return place, Reader(folder / DATABASE).sources()


def home_of(words: Words) -> Home:
    """The study's folder, in a worker."""
    place, sources = Path(words[0]), words[1]
    if words[0] and exists(place) and Reader(place / DATABASE).sources() == sources:
        agree(place)  # the parent has asked
        return Home(place)
    made = tempfile.TemporaryDirectory(prefix="realitygap-")
    folder = Path(made.name)
    for name, content in sources.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)
    config = own(StudyConfig.from_toml(folder / CONFIG, local=True), folder)
    materials = gather(config)
    agree_to(materials.own_code())
    create(folder / DATABASE, materials, sources)
    return Home(folder, made)
