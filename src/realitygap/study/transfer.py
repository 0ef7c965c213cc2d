"""Transfer: evolved individuals on robots, each trial paired with its simulation from the same pose (§6).

    from realitygap.study.load import load_study
    from realitygap.study.transfer import load_transfers, transfer

    transfer(load_study("out/reproduce"), robots=("twin:1", "twin:2"), starts=3)
    for one in load_transfers("out/reproduce"):
        print(one.name, one.robot, one.fitness_simulated, one.fitness_situated)

In a study's folder each trial has one of its own, `transfer/ROBOT/RUN/start-K`.
"""

from __future__ import annotations

import tomllib
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from pathlib import Path
from typing import Any

from realitygap.errors import RobotStoppedError, StudyError, StudyInterruptedError, UsageError
from realitygap.study.folder import lock
from realitygap.study.load import Study
from realitygap.study.schema import told
from realitygap.study.settings import whole
from realitygap.study.transfer_paths import Table, read_path
from realitygap.study.transfer_plan import FOLDER, Robot, Situation, chosen_runs, situations
from realitygap.study.transfer_trial import SIMULATED, SITUATED, TRIAL, Carry
from realitygap.study.transfer_work import OnProgress, TransferProgress, by_hand, on_twins
from realitygap.study.workers import cores, refuse_unguarded_script
from realitygap.values import Pose

__all__ = ["TransferProgress", "Transferred", "load_transfers", "transfer"]

LOOSE = ("film", "view", "pose", "fitness", "situated_from", "late_steps", "versions")
"""Keys of a trial's file that follow from the others, or are not compared."""


@dataclass(frozen=True, kw_only=True)
class Transferred:
    """One finished trial on a robot, and its simulation.

    Attributes:
        run, name, task, noise: of the run that it was evolved in; individual: champion or fittest.
        robot: the folder's name, as twin-1 or serial-ttyUSB0; unit: of the twin, None for a robot.
        twin_noise: the dial of the twin's noise, None for a robot.
        start: its number, from 1; pose: where both trials began.
        simulated, situated: the paths: t_s, x_cm, y_cm, heading_deg, a row a step, the start first.
        situated_from: "film", or "counters" for the wheels' own.
        filmed: whether the folder holds film.mp4, camera.json, track.csv and tails.png.
        view: what made the film's frames, None without a film.
        fitness_simulated, fitness_situated: the task's own score of each path.
        late_steps: how many of the drive's steps began more than 10 ms late.
    """

    folder: Path
    run: int
    name: str
    task: str
    noise: float
    individual: str
    robot: str
    unit: int | None
    twin_noise: float | None
    start: int
    pose: Pose
    seconds: float
    filmed: bool
    view: str | None
    situated_from: str
    fitness_simulated: float
    fitness_situated: float
    late_steps: int

    @cached_property
    def simulated(self) -> Table:
        """The path in the simulation that it was evolved in."""
        return read_path(self.folder / SIMULATED)

    @cached_property
    def situated(self) -> Table:
        """The path on the robot."""
        return read_path(self.folder / SITUATED)

    def to_dict(self) -> dict[str, Any]:
        """Everything but the paths, ready for JSON."""
        plain = {field.name: getattr(self, field.name) for field in fields(self)}
        pose = {"x_cm": self.pose.x, "y_cm": self.pose.y, "heading_deg": self.pose.heading_deg}
        return {**plain, "folder": str(self.folder), "pose": pose}


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
        todo = [one for one in wished if not _is_done(study.folder, one)]
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
    return [_load(study.folder / one.folder) for one in wished]


def load_transfers(study_folder: str | Path) -> list[Transferred]:
    """All finished trials on robots in a study's folder, by robot, run and start; [] without any.

    Raises:
        StudyError: a trial's file that cannot be read.
    """
    files = Path(study_folder, FOLDER).glob(f"*/*/start-*/{TRIAL}")
    found = [_load(file.parent) for file in files if file.parent.name[6:].isdecimal()]
    return sorted(found, key=lambda one: (one.unit is None, one.unit or 0, one.robot, one.run, one.start))


def _check_real(carry: Carry | None, film: bool | Collection[int]) -> None:
    """Refuse what only the twin can do."""
    if film:
        raise UsageError(
            "film: expected no film of a robot on a serial port: this computer has no camera over it. Film "
            "it yourself, then `realitygap track FILM`."
        )
    if carry is None:
        raise UsageError("carry: a real robot has to be carried to its starts: expected who does it.")


def _is_done(folder: Path, one: Situation) -> bool:
    """Whether the trial is there, made as it is wished now; one on the twin is made again to film it.

    Raises:
        StudyError: it was made with other settings.
    """
    file = folder / one.folder / TRIAL
    if not file.is_file():
        return False
    table = _read(file)
    there = {key: value for key, value in table.items() if key not in LOOSE}
    wished = {key: value for key, value in one.facts().items() if value is not None}
    for key in {**wished, **there}:
        if there.get(key) != wished.get(key):
            raise StudyError(
                f"{file.parent}: the trial was made with {key} = {there.get(key)!r}, not "
                f"{wished.get(key)!r}. Leave that as it was, or move the folder away."
            )
    return bool(table.get("film")) or not one.film


def _load(folder: Path) -> Transferred:
    file = folder / TRIAL
    table = _read(file)
    try:
        return Transferred(
            folder=folder,
            robot=folder.parent.parent.name,
            pose=Pose.from_degrees(*(table["pose"][key] for key in ("x_cm", "y_cm", "heading_deg"))),
            filmed=table["film"],
            fitness_simulated=float(table["fitness"]["simulated"]),
            fitness_situated=float(table["fitness"]["situated"]),
            unit=table.get("unit"),
            twin_noise=table.get("twin_noise"),
            view=table.get("view"),
            **{key: table[key] for key in PLAIN},
        )
    except (KeyError, TypeError, ValueError) as error:
        raise StudyError(f"{file}: {error}: missing or broken. Move the folder away.") from None


PLAIN = ("run", "name", "task", "noise", "individual", "start", "seconds", "situated_from", "late_steps")
"""Keys of a trial's file that are taken as they are."""


def _read(file: Path) -> Mapping[str, Any]:
    try:
        return tomllib.loads(file.read_text(encoding="utf-8"))
    except (OSError, tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise StudyError(f"{file}: cannot be read: {error}. Move its folder away.") from None


def _interrupted(folder: Path) -> StudyInterruptedError:
    return StudyInterruptedError(
        f"stopped. Finished trials in {folder / FOLDER} are kept; the same command goes on with the others."
    )
