"""Transfer: evolved individuals on robots, each trial paired with its simulation from the same pose (§6).

    from realitygap.study.load import load_study
    from realitygap.transfer.run import load_transfers, transfer

    transfer(load_study("out/reproduce"), robots=("twin:1", "twin:2"), starts=3)
    for one in load_transfers("out/reproduce"):
        print(one.name, one.robot, one.fitness_simulated, one.fitness_situated)

In a study's folder each trial has one of its own, `transfer/ROBOT/RUN/start-K`.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from contextlib import AbstractContextManager, nullcontext
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING

from realitygap.errors import RobotStoppedError, StudyInterruptedError, UsageError
from realitygap.film.disk import Disk, load_disk
from realitygap.study.folder import lock
from realitygap.study.load import Study, as_study
from realitygap.study.schema import told
from realitygap.study.settings import whole
from realitygap.study.workers import cores, refuse_unguarded_script
from realitygap.transfer.load import Transferred, is_done, load_transfer, load_transfers
from realitygap.transfer.overhead import Found, Overhead, check_eye, open_overhead
from realitygap.transfer.plan import FOLDER, Robot, chosen_runs, situations
from realitygap.transfer.trial import Carry
from realitygap.transfer.work import OnProgress, TransferProgress, by_hand, on_twins

if TYPE_CHECKING:
    from realitygap.film.camera import CameraModel

__all__ = ["TransferProgress", "Transferred", "load_transfers", "transfer"]


def transfer(
    study: Study | str | PathLike[str],
    runs: Sequence[int | str] = (),
    *,
    robots: Sequence[str | Robot] = ("twin",),
    starts: int = 1,
    individual: str = "champion",
    film: bool | Collection[int] = False,
    watch: bool = True,
    twin_noise: float | None = None,
    seed: int | None = None,
    seconds: float | None = None,
    baud: int | None = 38400,
    workers: int | None = None,
    carry: Carry | None = None,
    camera: CameraModel | str | Path | None = None,
    eye: str | int | None = None,
    disk: Disk | str | Path | None = None,
    found: Found | None = None,
    on_progress: OnProgress | None = None,
) -> list[Transferred]:
    """Let individuals of a study drive robots, each from the same poses as in simulation.

    Trials that are there already are kept, so that an interrupted transfer goes on. On the twin a
    trial is a function of unit, seed, run and start: the same bits with any number of workers.

    Args:
        study: its folder gets a folder `transfer`; or that folder.
        runs: ids or names; all finished ones if empty.
        robots: "twin", "twin:UNIT" or "serial:PORT".
        starts: trials of each individual on each robot.
        individual: "champion" or "fittest".
        film: film all trials, none, or those of the runs with these ids.
        watch: take the paths of the others from the camera above too, without keeping a film; else,
            and where no camera sees a real robot, they are reckoned from the wheels' counters.
        twin_noise: the twin's noise scale, 1 if None.
        seed: starts and noise follow from it; the study's own if None.
        seconds: length of a trial; the task's own if None.
        baud: rate of the robots' lines; None tries them all on a port.
        workers: processes for trials on the twin, one a core if None.
        carry: carries a real robot to its start; needed for one.
        camera: the calibration of the live camera over a real robot, or its file.
        eye: the live camera over a real robot: a camera's number, a video file, a stream.
        disk: what a real robot wears, or its file; the shipped one if None.
        found: says whether a real robot starts where the camera sees it; else it has only to be seen.
        on_progress: called a few times a second.

    Returns:
        All trials that were requested, old and new.

    Raises:
        UsageError: what cannot be done, or was done with other settings, by name.
        StudyInterruptedError: Ctrl-C; finished trials are kept.
        RobotError: a line that was lost; the recording is kept.
        FilmError: a camera that does not open, or does not see the robot.
    """
    study = as_study(study)
    whole("starts", starts, 1, 10**6)
    size = cores() if workers is None else workers
    whole("workers", size, 1, 1024)
    refuse_unguarded_script()
    parsed = [Robot.parse(one) if isinstance(one, str) else one for one in robots]
    _check_dial(parsed, twin_noise)
    check_eye(parsed, camera, eye, disk)
    worn = load_disk(disk) if disk is None or isinstance(disk, str | Path) else disk
    if any(robot.port is not None for robot in parsed):
        _check_real(carry, film, eye)
    chosen = chosen_runs(study, runs, individual)
    with lock(study.folder):
        requested = list(
            situations(
                study,
                chosen,
                parsed,
                starts=starts,
                individual=individual,
                film=film,
                watch=watch,
                disk=None if eye is None else worn,
                twin_noise=1.0 if twin_noise is None else twin_noise,
                seed=study.config.seed if seed is None else seed,
                seconds=seconds,
                baud=baud,
            )
        )
        todo = [one for one in requested if not is_done(study.folder, one)]
        with told(study.folder / FOLDER):
            (study.folder / FOLDER).mkdir(exist_ok=True)
        try:
            real = [one for one in todo if one.robot.port is not None]
            if real:
                assert carry is not None
                with _overhead(camera, eye, worn, found) as overhead:
                    for robot in dict.fromkeys(one.robot for one in real):
                        by_hand(study, [one for one in real if one.robot == robot], carry, overhead)
            left = [one for one in todo if one.robot.port is None]
            on_twins(study, left, done=len(requested) - len(left), workers=size, on_progress=on_progress)
        except RobotStoppedError:
            if any(one.robot.port is not None for one in todo):
                raise
            raise _interrupted(study.folder) from None
        except KeyboardInterrupt:
            raise _interrupted(study.folder) from None
    return [load_transfer(study.folder / one.folder) for one in requested]


def _overhead(
    camera: CameraModel | str | Path | None, eye: str | int | None, disk: Disk, found: Found | None
) -> AbstractContextManager[Overhead | None]:
    """The camera over real robots, if there is one."""
    return nullcontext() if camera is None or eye is None else open_overhead(camera, eye, disk, found)


def _check_real(carry: Carry | None, film: bool | Collection[int], eye: str | int | None) -> None:
    """Refuse what a real robot needs and has not."""
    if film and eye is None:
        raise UsageError(
            "film: expected the live camera that films a robot on a serial port, and its calibration "
            "(--eye DEVICE, --camera FILE). A film of your own: `realitygap track FILM`."
        )
    if carry is None:
        raise UsageError("carry: a real robot has to be carried to its starts: expected who does it.")


def _check_dial(robots: list[Robot], twin_noise: float | None) -> None:
    """Refuse a noise scale where there is no twin."""
    if twin_noise is not None and all(robot.port is not None for robot in robots):
        raise UsageError("--twin-noise scales the noise of a twin; a robot has its own noise. Leave it out.")


def _interrupted(folder: Path) -> StudyInterruptedError:
    return StudyInterruptedError(
        f"stopped. Finished trials in {folder / FOLDER} are kept; the same command goes on with the others."
    )
