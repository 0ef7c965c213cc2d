"""The folder of a trial: filled beside the final one, which appears when it is complete."""

import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from realitygap.errors import FilmError, FrozenError, LineError, RobotError, RobotStoppedError
from realitygap.files import atomic_write, move_whole, written_together
from realitygap.robots.address import Address

__all__ = ["blamed", "files_in", "half_folder", "keep", "keep_camera", "made", "put_aside"]


@contextmanager
def made(final: Path, robot: Address) -> Iterator[Path]:
    """The folder to write a trial in; it becomes the final folder at the end.

    Raises:
        RobotError, FilmError: those of the block, with a note on what is kept where.
    """
    half = _begun(final, robot)
    with blamed(final, robot), written_together(half):
        yield half
    put_aside(final, robot, "earlier")
    move_whole(half, final)


def keep(final: Path, robot: Address, files: Mapping[str, bytes], *, finished: bool) -> None:
    """Save a trial that was made elsewhere.

    Args:
        final: its folder.
        robot: the robot.
        files: content by name.
        finished: whether it is complete.
    """
    half = _begun(final, robot)
    for name, content in files.items():
        (half / name).write_bytes(content)
    if finished:
        put_aside(final, robot, "earlier")
        move_whole(half, final)


def keep_camera(file: Path, content: bytes) -> None:
    """Save a camera's calibration, unless it is there."""
    if not file.is_file():
        file.parent.mkdir(parents=True, exist_ok=True)
        atomic_write(file, content)


def files_in(folder: Path) -> dict[str, bytes]:
    """The content of a trial's files by their names."""
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir()) if path.is_file()}


@contextmanager
def blamed(final: Path, robot: Address) -> Iterator[None]:
    """Add to errors of a trial what is kept where."""
    half = half_folder(final)
    try:
        yield
    except RobotStoppedError as error:
        raise RobotStoppedError(f"{error}; its recording is kept in {half}") from None
    except (LineError, FrozenError) as error:
        raise type(error)(f"{robot}: {error}; its recording is kept in {half}") from None
    except RobotError as error:
        raise RobotError(f"{robot}: {error}") from None
    except FilmError as error:
        raise FilmError(f"{error} What was recorded is kept in {half}.") from None


def _begun(final: Path, robot: Address) -> Path:
    half = half_folder(final)
    put_aside(half, robot, "stopped")
    half.mkdir(parents=True)
    return half


def half_folder(final: Path) -> Path:
    """The folder of a trial in progress."""
    return final.with_name(f"{final.name}.half")


def put_aside(folder: Path, robot: Address, word: str) -> None:
    """Make room for another attempt; a real robot's recording is never deleted."""
    if not folder.exists():
        return
    if robot.unit is not None:
        shutil.rmtree(folder)
        return
    k, name = 1, folder.name.removesuffix(".half")
    while (aside := folder.with_name(f"{name}.{word}-{k}")).exists():
        k += 1
    folder.rename(aside)
