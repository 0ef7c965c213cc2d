"""Runs any controller on any body at a task: the track, and the task's score."""

import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any

from realitygap.control.controllers import as_controller, named_controller
from realitygap.errors import UsageError
from realitygap.files import atomic_write, to_toml
from realitygap.kernels.rng import substream
from realitygap.robots.address import Address
from realitygap.robots.body import Body
from realitygap.robots.drive import Controller, Recording
from realitygap.simulation.body import SimulatedBody, drive_simulated
from realitygap.simulation.simulation import Simulation
from realitygap.tasks.load import load_task
from realitygap.tasks.task import Task
from realitygap.track import Track
from realitygap.transfer.paths import score
from realitygap.transfer.rig import Rig, driven
from realitygap.transfer.spec import check_fit
from realitygap.values import Pose, as_stream, shown
from realitygap.work.archive import SIMULATED, SITUATED, TRIAL
from realitygap.world.robot import Profile, load_profile

__all__ = ["DriveResult", "Pair", "drive", "pairs"]


@dataclass(frozen=True, kw_only=True)
class DriveResult:
    """The results of a drive.

    Attributes:
        track: a row a step from the start: as the body reports its pose, else by its wheels.
        score: the task's.
        recording: readings, inputs and commands, a row a step.
    """

    track: Track
    score: float
    recording: Recording


def drive(
    body: Body,
    controller: Any,
    *,
    task: Task | str | PathLike[str],
    profile: Profile | str | PathLike[str] | None = None,
    start: Pose | None = None,
    seconds: float | None = None,
) -> DriveResult:
    """Drive a body at a task with a controller, and score its track.

    Args:
        body: the robot: a SimulatedBody, or any other of `robots/body.py`.
        controller: a genotype's, a function decide(inputs) → (left, right), a class or an object that
            has one, or what `--controller` takes: `file.py:name`, a network's file, "braitenberg",
            "constant:5,5"; −10 … 10 in and out.
        task: which sensors are fed, how long, and the score.
        profile: its input ranges and wheels; by default a simulated body's own, else "paper".
        start: where the body is placed, or stands already; by default where it reports itself.
        seconds: length; the task's own if None.

    Raises:
        UsageError: no body; one that does not report its pose, without `start`; an invalid controller; a
            profile of another kind of robot; a pose that cannot be: outside the arena, or too fast.
        RobotError: the robot was lost; it was told to stop.
    """
    given: object = body
    if not isinstance(given, Body):
        expected = "a subclass of realitygap.robots.Body, such as SimulatedBody(simulation)"
        raise UsageError(f"body: expected {expected}, got {shown(body)}.")
    own = body.simulation.profile if isinstance(body, SimulatedBody) else "paper"
    task, profile = load_task(task), load_profile(own if profile is None else profile)
    if isinstance(body, SimulatedBody) and task.arena != body.simulation.task.arena:
        expected = f"one in the body's arena {body.simulation.task.arena.name!r}, such as its simulation.task"
        raise UsageError(f"task: expected {expected}, got one in {task.arena.name!r}.")
    start = body.pose if start is None else start
    if not isinstance(start, Pose):
        expected = "a Pose, such as Pose.from_degrees(25, 25, 90)"
        raise UsageError(f"start: expected {expected}, unless the body knows its place, got {start!r}.")
    if isinstance(controller, str):
        controller = named_controller(controller, task.feeds, len(task.of(profile).sensors), task.name)
    controller = as_controller(controller)
    check_fit(body, profile, task.kinds)
    body.reset(start)
    length = task.seconds if seconds is None else seconds
    made = driven(body, controller, task=task, profile=profile, seconds=length)
    track = made.path(start, task, profile)
    return DriveResult(track=track, score=score(track, task, profile), recording=made.recording)


@dataclass(frozen=True, kw_only=True)
class Pair:
    """A trial on a robot and its simulation from the same start, with the task's scores."""

    start: int
    pose: Pose
    simulated: Track
    track: Track
    score_simulated: float
    score_situated: float

    def to_dict(self) -> dict[str, Any]:
        """Its facts; the tracks are in its folder."""
        fitness = {"simulated": self.score_simulated, "situated": self.score_situated}
        return {"start": self.start, "pose": self.pose.to_dict(), "fitness": fitness, "lost": self.track.lost}


def pairs(
    simulation: Simulation,
    controller: Controller,
    robot: Address,
    *,
    starts: int = 1,
    pose: Pose | None = None,
    seed: int = 0,
    twin_noise: float | None = None,
    seconds: float | None = None,
    folder: Path | None = None,
) -> Iterator[Pair]:
    """Trials of a controller on a robot that places itself, each paired with its simulation.

    Args:
        simulation: task, profile, noise and arena.
        controller: drives both.
        robot: its address.
        starts: trials.
        pose: where all begin; by default drawn by the task.
        seed: of starts and noise.
        twin_noise: noise scale of a twin or of Enki, 1 if None.
        seconds: length; the task's own if None.
        folder: where to save each trial in start-1, start-2, …, as `realitygap score` reads them.

    Raises:
        UsageError: a robot that does not place itself, or of another kind than the profile's; or the folder
            holds trials, perhaps another controller's, with which these would be mixed.
    """
    if folder is not None and any(folder.glob("start-*")):
        raise UsageError(f"{folder} already holds trials (start-1 …). Choose another --out, or remove it.")
    task, profile, scale = simulation.task, simulation.profile, 1.0 if twin_noise is None else twin_noise
    with (
        tempfile.TemporaryDirectory(prefix="realitygap-") as cameras,
        Rig(task, profile, robot=robot, twin_noise=scale, folder_for_camera=cameras) as rig,
    ):
        check_fit(rig.body, profile, task.kinds)
        for number in range(1, starts + 1):
            stream = int(substream(as_stream(seed, "seed"), as_stream(number)))
            start = simulation.start(stream) if pose is None else pose
            lived, simulated = drive_simulated(
                simulation, controller, stream=stream, pose=start, seconds=seconds
            )
            track, _ = rig.drive(controller, stream, start, seconds)
            made = Pair(
                start=number, pose=start, simulated=lived.track, track=track, score_simulated=simulated,
                score_situated=score(track, task, profile),
            )  # fmt: skip
            if folder is not None:
                here = folder / f"start-{number}"
                here.mkdir(parents=True, exist_ok=True)
                made.simulated.write_csv(here / SIMULATED)
                made.track.write_csv(here / SITUATED)
                facts = {"task": task.name, "robot": str(robot), "noise": simulation.noise, **made.to_dict()}
                atomic_write(here / TRIAL, to_toml(facts))
            yield made
