"""Which trials a transfer has: who drives which robot from where, and the folder of each."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from realitygap.errors import StudyError, UsageError
from realitygap.kernels.rng import substream
from realitygap.streams import TRANSFER
from realitygap.study.load import Run, Study
from realitygap.study.plan import run_stream
from realitygap.study.run import WHO

if TYPE_CHECKING:
    from realitygap.film.disk import Disk

__all__ = ["FOLDER", "SOURCES", "Robot", "Situation", "chosen_runs", "situations", "transfer_stream"]

FOLDER = "transfer"
"""In a study's folder."""

SENSORS, TOP_COMMAND = 8, 10
"""What a Khepera has: sensors of each kind; the largest command that networks give."""

BAUD = 38400
"""What a twin's jumper is set to, if nothing else is requested."""

LARGEST_UNIT = 2**63 - 1

SOURCES = ("counters", "camera", "film")
"""What a situated path may come from, the surest last."""


@dataclass(frozen=True, kw_only=True)
class Robot:
    """A unit of the twin, or a robot on a serial port."""

    unit: int | None = None
    port: str | None = None

    @classmethod
    def parse(cls, text: str) -> Self:
        """From "twin", "twin:UNIT" or "serial:PORT".

        Raises:
            UsageError: anything else.
        """
        kind, colon, rest = text.partition(":")
        if kind == "serial" and rest:
            return cls(port=rest)
        if kind == "twin" and not colon:
            return cls(unit=1)
        if kind == "twin" and rest.isascii() and rest.isdecimal() and int(rest) <= LARGEST_UNIT:
            return cls(unit=int(rest))
        if kind == "twin":
            raise UsageError(f"robot: a twin's unit is a whole number from 0 on, got {rest!r} in {text!r}.")
        raise UsageError(f"robot: expected twin, twin:UNIT or serial:PORT, got {text!r}.")

    def __str__(self) -> str:
        return f"twin:{self.unit}" if self.port is None else f"serial:{self.port}"

    def folder(self, twin_noise: float) -> str:
        """Name of its folder: twin-1, twin-1-noise-2 (the noise scale, where it is not 1), serial-ttyUSB0."""
        if self.port is not None:
            return "serial-" + re.sub(r"[^A-Za-z0-9._-]", "-", Path(self.port).name)
        short = f"{twin_noise:g}"
        scale = short if float(short) == twin_noise else repr(twin_noise)
        return f"twin-{self.unit}" if twin_noise == 1 else f"twin-{self.unit}-noise-{scale}"


@dataclass(frozen=True, kw_only=True)
class Situation:
    """One trial to be made: an individual of a run on a robot, from start number `start` (from 1).

    Attributes:
        evaluation: the individual's number.
        baud: rate of the line; None for the first of all that a robot on a port answers at.
        stream: the start and the simulated twin's noise follow from it, and so does the noise of a
            twin unit.
        film: the camera above films it; watch: it is seen by that camera, and no film is kept.
        disk: what a live camera over a real robot looks for; None where there is none, and on a twin.
        folder: from the study's folder.
    """

    run: int
    name: str
    task: str
    noise: float
    individual: str
    evaluation: int
    robot: Robot
    twin_noise: float
    seed: int
    start: int
    seconds: float
    baud: int | None
    stream: int
    film: bool
    watch: bool
    folder: str
    disk: Disk | None = None

    @property
    def source(self) -> str:
        """What the situated path comes from: "film", "camera" or "counters"."""
        return "film" if self.film else "camera" if self.watch else "counters"

    def facts(self) -> dict[str, Any]:
        """What the trial's result depends on, for its file."""
        twin = self.robot.port is None
        return {
            "run": self.run,
            "name": self.name,
            "task": self.task,
            "noise": self.noise,
            "individual": self.individual,
            "evaluation": self.evaluation,
            "robot": str(self.robot),
            "unit": self.robot.unit,
            "port": self.robot.port,
            "twin_noise": self.twin_noise if twin else None,
            "seed": self.seed,
            "start": self.start,
            "seconds": self.seconds,
            "baud": self.baud,
            "disk": None if self.disk is None else self.disk.to_dict(),
        }


FINISH = "Finish the study (`realitygap … --resume`)."


def chosen_runs(study: Study, runs: Sequence[int | str], individual: str) -> list[Run]:
    """The named runs, all that are finished if none is named.

    Raises:
        UsageError: no such run or individual, or one that there is not yet.
    """
    if individual not in WHO:
        raise UsageError(f"individual: expected {' or '.join(WHO)}, got {individual!r}.")
    if not runs:
        finished = [run for run in study.runs if run.finished]
        if not finished:
            raise StudyError(f"{study.folder}: no run is finished yet. {FINISH}")
        return finished
    chosen = list({run.id: run for run in map(study.run, runs)}.values())
    for run in chosen:
        if _number(run, individual) is None:
            raise StudyError(f"{study.folder}: run {run.id} has no {individual} yet. {FINISH}")
    return chosen


def situations(
    study: Study,
    runs: Sequence[Run],
    robots: Sequence[Robot],
    *,
    starts: int,
    individual: str,
    film: bool | Collection[int],
    watch: bool,
    disk: Disk | None,
    twin_noise: float,
    seed: int,
    seconds: float | None,
    baud: int | None,
) -> Iterator[Situation]:
    """All trials, robot by robot. `film`: of all runs, of none, or of those with these ids.

    `watch`: let the camera above see those that are not filmed; `disk`: what a live camera over real robots
    looks for, None where there is none.

    Raises:
        UsageError: a study whose robot is no Khepera.
    """
    for robot in dict.fromkeys(robots):
        for run in runs:
            task = study.task(run.task)
            _check_body(study, run.task)
            number = _number(run, individual)
            assert number is not None
            for start in range(1, starts + 1):
                name = run.name.replace("/", "-") + ("" if individual == WHO[1] else f"-{individual}")
                yield Situation(
                    run=run.id,
                    name=run.name,
                    task=run.task,
                    noise=run.noise,
                    individual=individual,
                    evaluation=number,
                    robot=robot,
                    twin_noise=twin_noise,
                    seed=seed,
                    start=start,
                    seconds=task.seconds if seconds is None else seconds,
                    baud=BAUD if baud is None and robot.port is None else baud,
                    stream=transfer_stream(seed, run, start),
                    film=film if isinstance(film, bool) else run.id in film,
                    watch=watch and (disk is not None or robot.port is None),
                    disk=None if robot.port is None else disk,
                    folder=f"{FOLDER}/{robot.folder(twin_noise)}/{name}/start-{start}",
                )


def transfer_stream(seed: int, run: Run, start: int) -> int:
    """Where the randomness of a run's trial from start number `start` comes from."""
    stream = substream(run_stream(seed, run.task, run.noise, run.index), np.uint64(TRANSFER))
    return int(substream(np.uint64(stream), np.uint64(start)))


def _number(run: Run, individual: str) -> int | None:
    return run.champion_number if individual == "champion" else run.fittest_number


def _check_body(study: Study, task: str) -> None:
    """Refuse controllers that were evolved for another kind of robot."""
    profile = study.profile
    counts = {"proximity": len(profile.infrared.sensors), "ambient": len(profile.ambient.sensors)}
    feeds = study.task(task).feeds
    if counts[feeds] != SENSORS:
        raise UsageError(
            f"task {task!r} was evolved for a robot with {counts[feeds]} {feeds} sensors (profile "
            f"{profile.name!r}); a Khepera has {SENSORS}: its controllers cannot drive one."
        )
    if profile.wheels.top_command != TOP_COMMAND:
        raise UsageError(
            f"profile {profile.name!r} has wheels.top_command = {profile.wheels.top_command:g}; a robot "
            f"takes a network's outputs as they are: only {TOP_COMMAND} can be transferred."
        )
