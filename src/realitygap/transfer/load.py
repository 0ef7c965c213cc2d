"""Reads finished transfers from a study's folder."""

from dataclasses import dataclass, fields
from functools import cached_property
from os import PathLike
from pathlib import Path
from typing import Any

from realitygap.errors import StudyError
from realitygap.files import as_path, parse_toml, refuse_unknown
from realitygap.track import Track, read_track
from realitygap.transfer.packed import content, every, placed
from realitygap.transfer.plan import FOLDER, SOURCES, Situation
from realitygap.transfer.trial import SIMULATED, SITUATED, TRIAL
from realitygap.values import Pose
from realitygap.work.folder import refuse_difference

__all__ = ["Transferred", "is_done", "load_transfer", "load_transfers", "read_trial"]

LOOSE = (
    "film", "view", "pose", "wished", "fitness", "situated_from", "late_steps", "missed_steps", "lost_steps",
    "film_lead_s", "timing", "trouble", "versions",
)  # fmt: skip
"""Keys of a trial's file that follow from others, or are not compared."""

PLAIN = ("run", "name", "task", "noise", "individual", "start", "seconds", "situated_from", "late_steps")
"""Keys of a trial's file that are copied unchanged."""

CURE = "Move its folder away."

OF_ROBOT = (
    "evaluation", "robot", "unit", "port", "twin_noise", "seed", "baud", "disk", "marker", "controller",
)  # fmt: skip
"""Further keys that the result depends on."""


@dataclass(frozen=True, kw_only=True)
class Transferred:
    """One finished trial on a robot, and its simulation.

    Attributes:
        run, name, task, noise: of the run that it was evolved in; individual: champion, fittest, or
            a controller's own name.
        robot: the folder's name, as twin-1 or serial-ttyUSB0; unit: of the twin, None for a robot.
        twin_noise: the twin's noise scale, None for a robot.
        start: its number, from 1; pose: where both trials began.
        simulated, situated: the tracks, a row a step, the start first.
        situated_from: "film" or "camera" (watched, no film kept), "robot" for its own poses, or "counters" or
            "speeds" for the wheels'.
        filmed: whether the folder holds film.mp4, camera.json, track.csv and tails.png.
        view: the renderer of the camera's frames, None if no camera saw the robot.
        fitness_simulated, fitness_situated: the task's own score of each path, NaN if it has long gaps, or
            the robot's steps came too late.
        late_steps: steps that began more than 10 ms late.
        timing: why the robot's steps came too late to be compared (a gap of more than half a second, or more
            than a fifth of them late), so that the trial is left out of scores; None: they did not.
        missed_steps: steps without an answer in time, None for a robot whose line misses none.
        lost_steps: rows of the situated path without a pose.
        trouble: problems with a live camera's film, or why the robot was lost in it; None: none.
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
    timing: str | None
    missed_steps: int | None
    lost_steps: int
    trouble: str | None

    @cached_property
    def simulated(self) -> Track:
        """The path in the simulation that it was evolved in."""
        return _track(self.folder, SIMULATED, "simulation")

    @cached_property
    def situated(self) -> Track:
        """The path on the robot."""
        return _track(self.folder, SITUATED, self.situated_from)

    def to_dict(self) -> dict[str, Any]:
        """Everything but the paths, ready for JSON."""
        plain = {field.name: getattr(self, field.name) for field in fields(self)}
        return {**plain, "folder": str(self.folder), "pose": self.pose.to_dict()}


def _track(folder: Path, name: str, seen_by: str) -> Track:
    cure = "Delete the trial's folder and make it again."
    with placed(folder, name) as here:
        return read_track(here / name, seen_by=seen_by, error=StudyError, cure=cure)


def load_transfers(study_folder: str | PathLike[str]) -> list[Transferred]:
    """All finished trials on robots in a study's folder, by robot, run and start; [] without any.

    Raises:
        StudyError: no such folder, or a trial's file that cannot be read.
    """
    folder = as_path(study_folder, "study")
    if not folder.is_dir():
        raise StudyError(
            f"{folder}: no such folder. Give a study's folder, such as `realitygap evolve` makes."
        )
    home = folder / FOLDER
    files = [file for file in home.glob(f"*/*/start-*/{TRIAL}") if file.parent.name[6:].isdecimal()]
    found = [load_transfer(file.parent) for file in files]
    packed = ((file, data) for file, data in every(home, TRIAL) if not file.is_file())
    found += [_transferred(file, _read(file, data)) for file, data in packed]
    return sorted(found, key=lambda one: (one.unit is None, one.unit or 0, one.robot, one.run, one.start))


def is_done(folder: Path, one: Situation) -> bool:
    """Whether the trial exists with the requested settings, or from a better source; else it is repeated.

    Raises:
        StudyError: it was made with other settings.
    """
    file = folder / one.folder / TRIAL
    data = content(file)
    if data is None:
        return False
    table = _read(file, data)
    there = {key: value for key, value in table.items() if key not in LOOSE}
    requested = {key: value for key, value in one.facts().items() if value is not None}
    for key in ("disk", "baud"):  # no camera looked for it, or will; any rate is fine
        if key not in there or key not in requested:
            there.pop(key, None), requested.pop(key, None)
    cure = "Leave that as it was, or move the folder away."
    refuse_difference(f"{file.parent}: the trial was made", there, requested, cure)
    there_from = table.get("situated_from")
    return there_from in SOURCES and SOURCES.index(there_from) >= SOURCES.index(one.source)


def load_transfer(folder: Path) -> Transferred:
    """The finished trial of a folder.

    Raises:
        StudyError: its file cannot be read.
    """
    return _transferred(folder / TRIAL, read_trial(folder / TRIAL))


def _transferred(file: Path, table: dict[str, Any]) -> Transferred:
    folder = file.parent
    loose: dict[str, Any] = {
        key: table.get(key) for key in ("unit", "twin_noise", "view", "missed_steps", "timing", "trouble")
    }
    try:
        return Transferred(
            folder=folder,
            robot=folder.parent.parent.name,
            pose=Pose.from_degrees(*(table["pose"][key] for key in ("x_cm", "y_cm", "heading_deg"))),
            filmed=table["film"],
            fitness_simulated=float(table["fitness"]["simulated"]),
            fitness_situated=float(table["fitness"]["situated"]),
            lost_steps=table.get("lost_steps", 0),
            **{key: table[key] for key in PLAIN},
            **loose,
        )
    except (KeyError, TypeError, ValueError) as error:
        raise StudyError(f"{file}: {error}: missing or broken. Move the folder away.") from None


def read_trial(file: Path) -> dict[str, Any]:
    """The content of a trial's file.

    Raises:
        StudyError: it cannot be read, or has a key that no trial has.
    """
    data = content(file)
    if data is None:
        raise StudyError(f"{file}: no such file. {CURE}")
    return _read(file, data)


def _read(file: Path, data: bytes) -> dict[str, Any]:
    try:
        table = parse_toml(data.decode("utf-8-sig"))
    except ValueError as why:
        raise StudyError(f"{file}: not a TOML file: {why}. {CURE}") from None
    refuse_unknown(table, (*PLAIN, *LOOSE, *OF_ROBOT), StudyError, where=str(file))
    return table
