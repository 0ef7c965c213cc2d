"""Trials on disk: a folder each, FOLDER/ROBOT/RUN/start-N, filled beside its final name.

Finished trials on a twin that kept no film are moved into an archive of their run (`work.archive`): thousands
of them would be a hundred thousand small files.
"""

import re
import shutil
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, fields
from functools import cached_property
from itertools import product
from os import PathLike
from pathlib import Path
from typing import Any

from realitygap.errors import (
    FilmError,
    FrozenError,
    LineError,
    RobotError,
    RobotStoppedError,
    StudyError,
)
from realitygap.files import (
    as_path,
    atomic_write,
    move_whole,
    parse_toml,
    written_together,
)
from realitygap.robots.address import Address
from realitygap.study.folder import exists
from realitygap.study.load import load_study
from realitygap.track import Track, read_track
from realitygap.transfer.spec import FOLDER, SOURCES, TrialSpec
from realitygap.values import Pose
from realitygap.work.archive import (
    MOST_BYTES,
    NAME,
    SIMULATED,
    SITUATED,
    TRIAL,
    opened,
    read_file,
    store,
    unpacked,
)
from realitygap.work.folder import file_errors, lock, refuse_difference, refuse_links
from realitygap.work.shard import Shard, read_mark

__all__ = [
    "TransferredTrial", "archive", "explained", "half_folder", "is_done", "keep", "keep_camera",
    "load_transfer", "load_transfers", "merge_trials", "new_trial", "read_trial",
]  # fmt: skip

FREE = (
    "film", "view", "pose", "wished", "fitness", "situated_from", "late_steps", "missed_steps", "lost_steps",
    "film_lead_s", "timing", "stalls", "stalled_s", "repeated", "trouble", "versions",
)  # fmt: skip
"""Keys of a trial's file that follow from others, or are not compared."""
PLAIN = ("run", "name", "task", "noise", "individual", "start", "seconds", "situated_from", "late_steps")
"""Keys of a trial's file that are copied unchanged."""
CURE = "Move its folder away."


@dataclass(frozen=True, kw_only=True)
class TransferredTrial:
    """One finished trial on a robot, and its simulation.

    Attributes:
        folder: the trial's; of one in an archive there is none of that name.
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
        stalls, stalled_s: how often the line stalled, so that the wheels were stopped, and how long in
            all, s; repeated: whether the trial is the second try, since the first one stalled.
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
    stalls: int = 0
    stalled_s: float = 0.0
    repeated: bool = False

    @cached_property
    def simulated(self) -> Track:
        """The path in the simulation that it was evolved in."""
        return self._track(SIMULATED, "simulation")

    @cached_property
    def situated(self) -> Track:
        """The path on the robot."""
        return self._track(SITUATED, self.situated_from)

    def _track(self, name: str, seen_by: str) -> Track:
        cure = "Delete the trial's folder and make it again."
        with unpacked(self.folder) as here:
            return read_track(here / name, seen_by=seen_by, error=StudyError, cure=cure)

    def to_dict(self) -> dict[str, Any]:
        """Everything but the paths, ready for JSON."""
        plain = {field.name: getattr(self, field.name) for field in fields(self)}
        return {**plain, "folder": str(self.folder), "pose": self.pose.to_dict()}


# Reading


def load_transfers(study_folder: str | PathLike[str]) -> list[TransferredTrial]:
    """All finished trials on robots in a study's folder, by robot, run and start; [] without any.

    Raises:
        StudyError: no such folder, or a trial's file that cannot be read.
    """
    folder = as_path(study_folder, "study")
    if not folder.is_dir():
        raise StudyError(
            f"{folder}: no such folder. Give a study's folder, such as the one `realitygap evolve` makes."
        )
    home = folder / FOLDER
    files = [file for file in home.glob(f"*/*/start-*/{TRIAL}") if file.parent.name[6:].isdecimal()]
    found = [load_transfer(file.parent) for file in files]
    for packed in home.glob("*/[!.]*.zip"):
        run = packed.with_suffix("")
        with opened(packed) as members:
            texts = {name: members.read(name) for name in members.namelist() if name.endswith(f"/{TRIAL}")}
        found += [
            _trial(run / name, _parsed(run / name, text))
            for name, text in texts.items()
            if not (run / name).is_file()
        ]
    return sorted(found, key=lambda one: (one.unit is None, one.unit or 0, one.robot, one.run, one.start))


def load_transfer(folder: Path) -> TransferredTrial:
    """The finished trial of a folder.

    Raises:
        StudyError: its file cannot be read.
    """
    return _trial(folder / TRIAL, read_trial(folder))


def read_trial(folder: Path) -> dict[str, Any]:
    """The content of a trial's file.

    Raises:
        StudyError: it cannot be read.
    """
    data = read_file(folder, TRIAL)
    if data is None:
        raise StudyError(f"{folder / TRIAL}: no such file. {CURE}")
    return _parsed(folder / TRIAL, data)


def is_done(folder: Path, spec: TrialSpec) -> bool:
    """Whether the trial exists with the requested settings, or from a better source; else it is repeated.

    Raises:
        StudyError: it was made with other settings.
    """
    place = folder / spec.folder
    if read_file(place, TRIAL) is None:
        return False
    table = read_trial(place)
    there = {key: value for key, value in table.items() if key not in FREE}
    requested = {key: value for key, value in spec.facts().items() if value is not None}
    for key in ("disk", "baud"):  # no camera looked for it, or will; any rate is fine
        if key not in there or key not in requested:
            there.pop(key, None), requested.pop(key, None)
    cure = "Leave that as it was, or move the folder away."
    refuse_difference(f"{place}: the trial was made", there, requested, cure)
    there_from = table.get("situated_from")
    return there_from in SOURCES and SOURCES.index(there_from) >= SOURCES.index(spec.source)


def _parsed(file: Path, data: bytes) -> dict[str, Any]:
    try:
        return parse_toml(data.decode("utf-8-sig"))
    except ValueError as why:
        raise StudyError(f"{file}: not a TOML file: {why}. {CURE}") from None


def _trial(file: Path, table: dict[str, Any]) -> TransferredTrial:
    folder = file.parent
    free: dict[str, Any] = {
        key: table.get(key) for key in ("unit", "twin_noise", "view", "missed_steps", "timing", "trouble")
    }
    try:
        return TransferredTrial(
            folder=folder,
            robot=folder.parent.parent.name,
            pose=Pose.from_degrees(*(table["pose"][key] for key in ("x_cm", "y_cm", "heading_deg"))),
            filmed=table["film"],
            fitness_simulated=float(table["fitness"]["simulated"]),
            fitness_situated=float(table["fitness"]["situated"]),
            lost_steps=table.get("lost_steps", 0),
            stalls=table.get("stalls", 0),
            stalled_s=float(table.get("stalled_s", 0.0)),
            repeated=bool(table.get("repeated", False)),
            **{key: table[key] for key in PLAIN},
            **free,
        )
    except (KeyError, TypeError, ValueError) as error:
        raise StudyError(f"{file}: {error}: missing or broken. {CURE}") from None


def archive(run: Path) -> None:
    """Move a run's finished, unfilmed trials on a twin into its archive, but for very long ones and
    those with files that no trial has."""
    folders = [folder for folder in sorted(run.glob("start-*")) if folder.name[6:].isdecimal()]
    done = [one for one in folders if (one / TRIAL).is_file() and not read_trial(one).get("film", True)]
    small = [one for one in done if all(map(_fits, one.iterdir()))]
    if small:
        store(run, small)


def _fits(file: Path) -> bool:
    """Whether an archive can give a file back."""
    return bool(re.fullmatch(NAME, file.name)) and file.is_file() and file.stat().st_size <= MOST_BYTES


# Writing


@contextmanager
def new_trial(final: Path, robot: Address) -> Iterator[Path]:
    """The folder to write a trial in; it becomes the final folder at the end.

    Raises:
        RobotError, FilmError: those of the block, with a note on what is kept where.
    """
    half = _begun(final, robot)
    with explained(final, robot), written_together(half):
        yield half
    _put_aside(final, robot, "earlier")
    move_whole(half, final)


def keep(final: Path, robot: Address, files: Mapping[str, bytes], *, finished: bool) -> None:
    """Save a trial that was made elsewhere, complete or as far as it got.

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
        _put_aside(final, robot, "earlier")
        move_whole(half, final)


def keep_camera(file: Path, content: bytes) -> None:
    """Save a camera's calibration, unless it is there."""
    if not file.is_file():
        file.parent.mkdir(parents=True, exist_ok=True)
        atomic_write(file, content)


@contextmanager
def explained(final: Path, robot: Address) -> Iterator[None]:
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


def half_folder(final: Path) -> Path:
    """The folder of a trial in progress."""
    return final.with_name(f"{final.name}.half")


def _begun(final: Path, robot: Address) -> Path:
    half = half_folder(final)
    _put_aside(half, robot, "stopped")
    half.mkdir(parents=True)
    return half


def _put_aside(folder: Path, robot: Address, word: str) -> None:
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


# Shards


def merge_trials(shards: Mapping[Shard, Path], folder: Path) -> list[TransferredTrial]:
    """Copy every trial to the study's folder; existing ones are kept.

    Args:
        shards: their folders, as from `work.shard.all_shards`.
        folder: the study's.

    Returns:
        The shards' trials in the study's folder.

    Raises:
        StudyError: shards of different transfers or of another study, one that lacks trials, or a different
            trial is in the folder or another shard.
    """
    _refuse_other(shards, folder)
    with lock(folder):
        todo: dict[Path, Path] = {}
        for shard in shards.values():
            refuse_links(shard)
            found = load_transfers(shard)
            _refuse_incomplete(shard, found)
            for trial in (one.folder for one in found):
                place = folder / trial.relative_to(shard)
                for there in {place, todo.setdefault(place, trial)} - {trial}:
                    _refuse_overwriting(trial, there)
        with file_errors(folder / FOLDER):
            (folder / FOLDER).mkdir(exist_ok=True)
        for place, trial in todo.items():
            if read_file(place, TRIAL) is None:
                with file_errors(place), unpacked(trial) as here:
                    for camera in trial.parent.parent.glob("camera-*.json"):
                        keep_camera(place.parent.parent / camera.name, camera.read_bytes())
                    files = {path.name: path.read_bytes() for path in here.iterdir() if path.is_file()}
                    robot = Address.parse(read_trial(trial)["robot"])
                    keep(place, robot, files, finished=True)
        for run in {place.parent for place, trial in todo.items() if not trial.is_dir()}:
            with file_errors(run):
                archive(run)
    return [load_transfer(place) for place in todo]


def _refuse_other(shards: Mapping[Shard, Path], folder: Path) -> None:
    """Refuse shards of different transfers, or of another study than this one."""
    first, *others = shards.values()
    facts = {place: dict(mark.facts) for place in (first, *others) if (mark := read_mark(place)) is not None}
    for other in others:
        cure = f"{other} has that. Only shards of one transfer are merged."
        refuse_difference(f"{first}: the trials were made", facts[first], facts[other], cure)
    if not exists(folder) or load_study(folder).digest() != facts[first].get("study"):
        raise StudyError(
            f"{folder} is not the study whose individuals drove in {first}. Give that study (--out)."
        )


def _refuse_incomplete(folder: Path, found: Sequence[TransferredTrial]) -> None:
    """Refuse a shard without all of its trials, as of a copy that was made while it was worked on."""
    mark = read_mark(folder)
    assert mark is not None
    facts = mark.facts
    every = product(facts.get("robots", ()), facts.get("runs", ()), range(1, facts.get("starts", 0) + 1))
    left = Counter((run, start) for _, run, start in mark.shard.own(every))
    for one in found:
        whole = all(read_file(one.folder, name) is not None for name in (SIMULATED, SITUATED))
        left[one.run, one.start] -= whole and one.individual == facts.get("individual")
    for (run, start), lacking in left.items():
        if lacking > 0:
            raise StudyError(
                f"{folder}: a trial of run {run} from start {start} is missing or incomplete, though the "
                "shard is marked as finished: it was copied while it was worked on. Copy it once more."
            )


def _refuse_overwriting(trial: Path, place: Path) -> None:
    there = place.exists() or read_file(place, TRIAL) is not None
    if there and any(read_file(place, name) != read_file(trial, name) for name in (SIMULATED, SITUATED)):
        raise StudyError(
            f"{place}: a trial other than {trial} is there, and is not overwritten. Move it away."
        )
