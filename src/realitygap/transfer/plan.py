"""Which trials a transfer has: who drives which robot from where, and the folder of each."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from realitygap.errors import StudyError, UsageError
from realitygap.kernels.rng import substream
from realitygap.streams import TRANSFER
from realitygap.study.load import Run, Study
from realitygap.study.plan import run_stream
from realitygap.study.run import WHO
from realitygap.transfer.options import Robot, Transfer

if TYPE_CHECKING:
    from realitygap.film.disk import Disk

__all__ = ["FOLDER", "SOURCES", "Situation", "chosen_runs", "situations", "transfer_stream"]

FOLDER = "transfer"
"""In a study's folder."""

SENSORS, TOP_COMMAND = 8, 10
"""What a Khepera has: sensors of each kind; the largest command that networks give."""

BAUD = 38400
"""What a twin's jumper is set to, if nothing else is requested."""

SOURCES = ("counters", "camera", "film")
"""What a situated path may come from, the surest last."""


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


def chosen_runs(study: Study, options: Transfer) -> list[Run]:
    """The named runs, all that are finished if none is named.

    Raises:
        UsageError: no such run or individual, or one that there is not yet.
    """
    if options.individual not in WHO:
        raise UsageError(f"individual: expected {' or '.join(WHO)}, got {options.individual!r}.")
    if not options.runs:
        finished = [run for run in study.runs if run.finished]
        if not finished:
            raise StudyError(f"{study.folder}: no run is finished yet. {FINISH}")
        return finished
    chosen = list({run.id: run for run in map(study.run, options.runs)}.values())
    for run in chosen:
        if _number(run, options.individual) is None:
            raise StudyError(f"{study.folder}: run {run.id} has no {options.individual} yet. {FINISH}")
    return chosen


def situations(study: Study, options: Transfer) -> Iterator[Situation]:
    """All trials that are requested, robot by robot.

    Raises:
        UsageError: a study whose robot is no Khepera, or runs and individuals that there are not.
    """
    runs = chosen_runs(study, options)
    for robot in options.bodies:
        for run in runs:
            _check_body(study, run.task)
            for start in range(1, options.starts + 1):
                yield _situation(study, options, robot, run, start)


def _situation(study: Study, options: Transfer, robot: Robot, run: Run, start: int) -> Situation:
    number, twin = _number(run, options.individual), robot.port is None
    assert number is not None
    seed = study.config.seed if options.seed is None else options.seed
    seen = twin or options.eye is not None
    name = run.name.replace("/", "-")
    name += "" if options.individual == WHO[1] else f"-{options.individual}"
    return Situation(
        run=run.id,
        name=run.name,
        task=run.task,
        noise=run.noise,
        individual=options.individual,
        evaluation=number,
        robot=robot,
        twin_noise=options.noise,
        seed=seed,
        start=start,
        seconds=study.task(run.task).seconds if options.seconds is None else options.seconds,
        baud=BAUD if options.baud is None and twin else options.baud,
        stream=transfer_stream(seed, run, start),
        film=options.films(run.id),
        watch=options.watch and seen,
        disk=options.worn if seen and not twin else None,
        folder=f"{FOLDER}/{robot.folder(options.noise)}/{name}/start-{start}",
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
