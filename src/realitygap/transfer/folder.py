"""The folder of a trial: made beside the final one, which appears when everything is in it."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from realitygap import whole
from realitygap.errors import FilmError, FrozenError, LineError, RobotError, RobotStoppedError
from realitygap.robots.address import Address

__all__ = ["half_folder", "made"]


@contextmanager
def made(final: Path, robot: Address) -> Iterator[Path]:
    """The folder that a trial is made in; the final folder at the end.

    Raises:
        RobotError, FilmError: those of the block, which then say what is kept where.
    """
    half = half_folder(final)
    _put_aside(half, robot, "stopped")
    half.mkdir(parents=True)
    try:
        with whole.together(half):
            yield half
    except RobotStoppedError as error:
        raise RobotStoppedError(f"{error}; its recording is kept in {half}") from None
    except (LineError, FrozenError) as error:
        raise type(error)(f"{robot}: {error}; its recording is kept in {half}") from None
    except RobotError as error:
        raise RobotError(f"{robot}: {error}") from None
    except FilmError as error:
        raise FilmError(f"{error} What was recorded is kept in {half}.") from None
    _put_aside(final, robot, "earlier")
    whole.move(half, final)


def half_folder(final: Path) -> Path:
    """Where a trial is while it is being made."""
    return final.with_name(f"{final.name}.half")


def _put_aside(folder: Path, robot: Address, word: str) -> None:
    """Make room for another try; what a real robot recorded is never thrown away."""
    if not folder.exists():
        return
    if robot.unit is not None:
        shutil.rmtree(folder)
        return
    k, name = 1, folder.name.removesuffix(".half")
    while (aside := folder.with_name(f"{name}.{word}-{k}")).exists():
        k += 1
    folder.rename(aside)
