"""Carries out a transfer: evolved individuals on robots, each trial paired with a simulated one.

from realitygap.study.load import load_study
from realitygap.transfer.options import Transfer
from realitygap.transfer.run import run_transfer

run_transfer(load_study("out/reproduce"), Transfer(robots=("twin:1", "twin:2"), starts=3))
"""

from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from os import PathLike
from pathlib import Path
from typing import Any, NamedTuple

from realitygap.errors import RobotStoppedError, StudyInterruptedError, UsageError
from realitygap.files import must_be
from realitygap.film.camera import CameraModel, load_camera
from realitygap.study.folder import exists
from realitygap.study.load import Study, as_study
from realitygap.transfer.load import Transferred, is_done, load_transfer, load_transfers
from realitygap.transfer.options import Transfer
from realitygap.transfer.overhead import Found, Overhead
from realitygap.transfer.packed import MANY
from realitygap.transfer.plan import FOLDER, Situation, situations
from realitygap.transfer.trial import Carry
from realitygap.transfer.work import by_hand, on_twins
from realitygap.work.folder import file_errors, lock
from realitygap.work.pool import Workers, opened
from realitygap.work.progress import OnProgress
from realitygap.work.shard import Shard, marked

__all__ = [
    "CONTROLLERS", "WORK", "Attendant", "Transfer", "Transferred", "load_transfers", "place_of",
    "run_transfer", "shard_folder",
]  # fmt: skip

WORK = "transfer"
"""The kind of work that a shard divides."""
CONTROLLERS = "controllers"
"""In a study's folder: trials of controllers of your own, a folder each; the report omits them."""


class Attendant(NamedTuple):
    """The person beside a real robot.

    Attributes:
        carry: puts the robot at a start, and returns when it is there.
        found: decides whether to start where the camera sees it; without it, being seen is enough.
        says: called with the reason why the camera does not see it, if known.
    """

    carry: Carry
    found: Found | None = None
    says: Callable[[str], object] | None = None


def run_transfer(
    study: Study | str | PathLike[str],
    options: Transfer | None = None,
    *,
    workers: Workers = None,
    attendant: Attendant | None = None,
    shard: Shard | str | None = None,
    on_progress: OnProgress | None = None,
) -> list[Transferred]:
    """Drive robots with individuals of a study, each from the same poses as in simulation.

    Existing trials are kept, so that an interrupted transfer continues.

    Args:
        study: the study or its folder, which gets a folder `transfer`.
        options: who drives where; by default all champions, once, on unit 1 of the twin.
        workers: processes for trials on the twin, one a core if None; or a pool.
        attendant: carries a real robot; required for one.
        shard: the share of the trials to make, such as "1/2", in a folder of its own beside the study's.
        on_progress: called a few times a second.

    Returns:
        All requested trials (for a shard its own), old and new.

    Raises:
        RobotError, FilmError: a robot or a camera fails; recordings are kept.
        UsageError: something is impossible, or was done with other settings; names it.
        StudyInterruptedError: Ctrl-C; finished trials are kept.
    """
    study, options = as_study(study), options or Transfer()
    must_be(options, Transfer, "options", "Transfer(robots=…, starts=…) makes one.")
    shard = None if shard is None else Shard.parse(shard)
    if shard is not None and options.named is not None:
        raise UsageError("shard: expected none with a controller of your own. Leave it out.")
    place = place_of(study.folder, options) if shard is None else shard_folder(study.folder, shard)
    with opened(workers) as pool, lock(place):
        requested = list(situations(study, options))
        mark, many = None, len(requested) >= MANY
        if shard is not None:
            mark = marked(place, shard, WORK, begun=exists(place), **_facts(study, options, requested))
            requested = shard.own(requested)
        if attendant is None and not all(one.placed for one in requested):
            raise UsageError(
                "carry: expected a function that asks a person to carry the real robot to its starts."
            )
        real, twins = _left(place, requested)  # a refusal leaves the mark unchanged
        with file_errors(place / FOLDER):
            (place / FOLDER).mkdir(exist_ok=True)
            if mark is not None:
                mark.write(place, finished=False)
        with _interrupted(place, real=bool(real)):
            _on_ports(study, place, real, options, attendant)
            done = len(requested) - len(twins)
            pack = many if options.pack is None else options.pack
            on_twins(study, place, twins, pack=pack, done=done, pool=pool, on_progress=on_progress)
        if mark is not None:
            mark.write(place, finished=True)
    return [load_transfer(place / one.folder) for one in requested]


def place_of(study: Path, options: Transfer) -> Path:
    """The folder that gets a folder `transfer`: the study's, or that of a controller of your own."""
    return study if options.named is None else study / CONTROLLERS / options.named.name


def shard_folder(study: Path, shard: Shard) -> Path:
    """The folder of a shard of a study's transfer: beside the study's, and beside its shards."""
    study = study if study.name.strip(".") else study.resolve()
    return shard.folder(study.with_name(f"{study.name}-{WORK}"))


def _facts(study: Study, options: Transfer, requested: Sequence[Situation]) -> dict[str, Any]:
    """Facts that all shards of a transfer must share."""
    keys = ("starts", "individual", "watch", "twin_noise", "seed", "seconds")
    return {
        "study": study.digest(),
        "runs": list(dict.fromkeys(one.run for one in requested)),
        "robots": [str(robot) for robot in options.bodies],
        "film": options.film if isinstance(options.film, bool) else sorted(options.film, key=str),
        "marker": str(options.worn),
        **{key: getattr(options, key) for key in keys},
    }


def _left(place: Path, requested: Sequence[Situation]) -> tuple[list[Situation], list[Situation]]:
    """The trials left to do: on robots placed by a person, and on those that place themselves."""
    todo = [one for one in requested if not is_done(place, one)]
    real = [one for one in todo if not one.placed]
    return real, [one for one in todo if one.placed]


def _on_ports(
    study: Study, place: Path, todo: Sequence[Situation], options: Transfer, attendant: Attendant | None
) -> None:
    """Make trials on real robots, one robot after the other, with a camera if there is one."""
    if not todo:
        return
    assert attendant is not None
    with _overhead(options, attendant) as overhead:
        for robot in dict.fromkeys(one.robot for one in todo):
            by_hand(study, place, [one for one in todo if one.robot == robot], attendant.carry, overhead)


def _overhead(options: Transfer, attendant: Attendant) -> AbstractContextManager[Overhead | None]:
    """The camera over real robots, if there is one."""
    if options.camera is None or options.eye is None:
        return nullcontext()
    camera = options.camera if isinstance(options.camera, CameraModel) else load_camera(options.camera)
    return Overhead(options.eye, camera, options.worn, attendant.found, attendant.says)


@contextmanager
def _interrupted(folder: Path, *, real: bool) -> Iterator[None]:
    """Turn Ctrl-C into one message; stopping a real robot has a message of its own."""
    try:
        yield
    except (RobotStoppedError, KeyboardInterrupt) as stop:
        if real and isinstance(stop, RobotStoppedError):
            raise
        kept = f"Finished trials in {folder / FOLDER} are kept; the same command continues with the others."
        raise StudyInterruptedError(f"stopped. {kept}") from None
