"""Trials in archives: RUN.zip beside the folder RUN holds start-N/FILE, as that folder would.

A finished trial's own folder takes precedence over what the archive holds under its name.
"""

import re
import shutil
import tempfile
import zipfile
import zlib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from functools import lru_cache
from pathlib import Path

from realitygap.errors import StudyError
from realitygap.files import atomic_path
from realitygap.work.folder import file_errors

__all__ = [
    "MOST_BYTES",
    "NAME",
    "SIMULATED",
    "SITUATED",
    "STALLED",
    "TRIAL",
    "archived",
    "opened",
    "read_file",
    "store",
    "unpacked",
]

TRIAL, SIMULATED, SITUATED, STALLED = "transfer.toml", "simulated.csv", "situated.csv", "stalled"
"""A trial's files: its facts, without which it is not finished, and its two tracks."""
PROFILE = "profile.toml"
"""A study's robot, with whose radius its trials are scored."""
NAME = r"\w[\w.-]*"
"""Of a trial's file, a regular expression."""
MOST_BYTES = 36_000 * 600
"""Of a trial's file: the steps of an hour, each a row of some sixty numbers."""
DENSEST = 200
"""Bytes of a file for one of the archive: even equal rows differ in their time."""


def archived(run: Path) -> Path:
    """Where a run's archive is, or would be."""
    return run.parent / f"{run.name}.zip"


def _is_archive(file: Path) -> bool:
    """Whether a file is an archive of trials, not somebody's other .zip; a broken one is refused later."""
    return file.is_file() and _holds_trials(file, _stamp(file))


@lru_cache(64)
def _holds_trials(file: Path, _: tuple[int, int, int]) -> bool:
    if not zipfile.is_zipfile(file):
        return True
    with zipfile.ZipFile(file) as made:
        return any(name.endswith(f"/{TRIAL}") for name in made.namelist())


def _stamp(file: Path) -> tuple[int, int, int]:
    """Which version of a file is there."""
    found = file.stat()
    return found.st_ino, found.st_mtime_ns, found.st_size


@contextmanager
def opened(packed: Path) -> Iterator[zipfile.ZipFile]:
    """An archive of trials' files, to read.

    Raises:
        StudyError: it is damaged, or holds something else, or more than trials can.
    """
    with file_errors(packed):
        try:
            yield _checked(packed, _stamp(packed))
        except (zipfile.BadZipFile, zlib.error, EOFError, ValueError, RuntimeError) as why:
            raise StudyError(f"{packed}: {why}. Restore the file from a copy.") from None


@lru_cache(4)
def _checked(packed: Path, _: tuple[int, int, int]) -> zipfile.ZipFile:
    """It stays open, for its table of contents is long."""
    made = zipfile.ZipFile(packed)
    for entry in made.infolist():
        if not re.fullmatch(r"start-\d+/\w[\w.-]*", entry.filename):
            raise ValueError(f"{entry.filename!r} is not a trial's file")
        if entry.file_size > min(MOST_BYTES, 4096 + DENSEST * entry.compress_size):
            raise ValueError(f"{entry.filename}, {entry.file_size} bytes long, is more than a trial can hold")
    return made


def read_file(folder: Path, name: str) -> bytes | None:
    """A file of a trial's folder, or of an archived one; None if there is none."""
    packed = archived(folder.parent)
    if (folder / TRIAL).is_file() or not packed.is_file():
        with file_errors(folder):
            return (folder / name).read_bytes() if (folder / name).is_file() else None
    with opened(packed) as archive, suppress(KeyError):
        return archive.read(f"{folder.name}/{name}")
    return None


@contextmanager
def unpacked(path: Path) -> Iterator[Path]:
    """A study, its transfers or a part of those, down to a trial's file, with archived trials as folders too,
    temporarily; the path itself if nothing in it is archived."""
    full = path.resolve()
    run = next((one for one in (full, *full.parents[:2]) if _is_archive(archived(one))), None)
    inside = full.relative_to(run).parts[:1] if run else ()
    if run and inside and (run / inside[0] / TRIAL).is_file():  # its own folder counts
        run = None
    top = run or full
    others = filter(_is_archive, full.rglob("[!.]*.zip"))
    packed = {archived(run): run} if run else {file: file.with_suffix("") for file in others}
    if not packed:
        yield path
        return
    study = next((one for one in (top, *top.parents) if (one / PROFILE).is_file()), top)
    with tempfile.TemporaryDirectory(prefix="realitygap-") as name:
        home = Path(name, top.relative_to(study))
        if (study / PROFILE).is_file():
            shutil.copy(study / PROFILE, name)
        if top.is_dir() and not inside:
            ignored = shutil.ignore_patterns("*.mp4", "*.zip")
            shutil.copytree(top, home, dirs_exist_ok=True, ignore=ignored)
        for file, run in packed.items():
            with opened(file) as archive:
                for one in archive.namelist():
                    start = one.partition("/")[0]
                    if start in (inside or (start,)) and not (run / start / TRIAL).is_file():
                        place = home / run.relative_to(top) / one
                        place.parent.mkdir(parents=True, exist_ok=True)
                        place.write_bytes(archive.read(one))
        yield home / full.relative_to(top)


def store(run: Path, folders: Sequence[Path]) -> None:
    """Move trials' folders of a run into its archive; a kill loses none."""
    packed, new = archived(run), {folder.name for folder in folders}
    with atomic_path(packed) as spare, zipfile.ZipFile(spare, "w", zipfile.ZIP_DEFLATED) as made:
        if packed.is_file():
            with opened(packed) as before:
                for name in before.namelist():
                    if name.partition("/")[0] not in new:
                        made.writestr(zipfile.ZipInfo(name), before.read(name), zipfile.ZIP_DEFLATED)
        for folder in folders:
            for file in sorted(folder.iterdir()):
                entry = zipfile.ZipInfo(f"{folder.name}/{file.name}")
                made.writestr(entry, file.read_bytes(), zipfile.ZIP_DEFLATED)
    for folder in folders:
        (folder / TRIAL).unlink()  # without it the archive counts, should the rest be cut short
        shutil.rmtree(folder)
    with suppress(OSError):  # a film is in it
        run.rmdir()
