"""Transfer: evolved individuals on robots, each trial paired with its simulation from the same pose (§6).

    from realitygap.study.load import load_study
    from realitygap.study.transfer import load_transfers, transfer

    transfer(load_study("out/reproduce"), robots=("twin:1", "twin:2"), starts=3)
    for one in load_transfers("out/reproduce"):
        print(one.name, one.robot, one.fitness_simulated, one.fitness_situated)

In a study's folder each trial has one of its own, `transfer/ROBOT/RUN/start-K`.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from pathlib import Path

from realitygap.errors import RobotStoppedError, StudyInterruptedError, UsageError
from realitygap.study.folder import lock
from realitygap.study.load import Study
from realitygap.study.schema import told
from realitygap.study.settings import whole
from realitygap.study.transfer_load import Transferred, is_done, load_transfer, load_transfers
from realitygap.study.transfer_plan import FOLDER, Robot, chosen_runs, situations
from realitygap.study.transfer_trial import Carry
from realitygap.study.transfer_work import OnProgress, TransferProgress, by_hand, on_twins
from realitygap.study.workers import cores, refuse_unguarded_script

__all__ = ["TransferProgress", "Transferred", "load_transfers", "transfer"]


def transfer(
    study: Study,
    runs: Sequence[int | str] = (),
    *,
    robots: Sequence[str | Robot] = ("twin",),
    starts: int = 1,
    individual: str = "champion",
    film: bool | Collection[int] = False,
    twin_noise: float = 1.0,
    seed: int | None = None,
    seconds: float | None = None,
    baud: int = 38400,
    workers: int | None = None,
    carry: Carry | None = None,
    on_progress: OnProgress | None = None,
) -> list[Transferred]:
    """Let individuals of a study drive robots, each from the same poses as in simulation.

    Trials that are there already are kept, so that an interrupted transfer goes on. On the twin a
    trial is a function of unit, seed, run and start: the same bits with any number of workers.

    Args:
        study: its folder gets a folder `transfer`.
        runs: ids or names; all finished ones if empty.
        robots: "twin", "twin:UNIT" or "serial:PORT".
        starts: trials of each individual on each robot.
        individual: "champion" or "fittest".
        film: film all trials on the twin, none, or those of the runs with these ids.
        twin_noise: the dial on the twin's noise.
        seed: starts and noise follow from it; the study's own if None.
        seconds: length of a trial; the task's own if None.
        baud: rate of the robots' lines.
        workers: processes for trials on the twin, one a core if None.
        carry: carries a real robot to its start; needed for one.
        on_progress: called a few times a second.

    Returns:
        All trials that were wished, old and new.

    Raises:
        UsageError: what cannot be done, or was done with other settings, by name.
        StudyInterruptedError: Ctrl-C; finished trials are kept.
        RobotError: a line that was lost; the recording is kept.
    """
    whole("starts", starts, 1, 10**6)
    size = cores() if workers is None else workers
    whole("workers", size, 1, 1024)
    refuse_unguarded_script()
    parsed = [Robot.parse(one) if isinstance(one, str) else one for one in robots]
    if any(robot.port is not None for robot in parsed):
        _check_real(carry, film)
    chosen = chosen_runs(study, runs, individual)
    with lock(study.folder):
        wished = list(
            situations(
                study,
                chosen,
                parsed,
                starts=starts,
                individual=individual,
                film=film,
                twin_noise=twin_noise,
                seed=study.config.seed if seed is None else seed,
                seconds=seconds,
                baud=baud,
            )
        )
        todo = [one for one in wished if not is_done(study.folder, one)]
        with told(study.folder / FOLDER):
            (study.folder / FOLDER).mkdir(exist_ok=True)
        try:
            for robot in dict.fromkeys(one.robot for one in todo if one.robot.port is not None):
                assert carry is not None
                by_hand(study, [one for one in todo if one.robot == robot], carry)
            left = [one for one in todo if one.robot.port is None]
            on_twins(study, left, done=len(wished) - len(left), workers=size, on_progress=on_progress)
        except RobotStoppedError:
            if any(one.robot.port is not None for one in todo):
                raise
            raise _interrupted(study.folder) from None
        except KeyboardInterrupt:
            raise _interrupted(study.folder) from None
    return [load_transfer(study.folder / one.folder) for one in wished]


def _check_real(carry: Carry | None, film: bool | Collection[int]) -> None:
    """Refuse what only the twin can do."""
    if film:
        raise UsageError(
            "film: expected no film of a robot on a serial port: this computer has no camera over it. Film "
            "it yourself, then `realitygap track FILM`."
        )
    if carry is None:
        raise UsageError("carry: a real robot has to be carried to its starts: expected who does it.")


def _interrupted(folder: Path) -> StudyInterruptedError:
    return StudyInterruptedError(
        f"stopped. Finished trials in {folder / FOLDER} are kept; the same command goes on with the others."
    )
