"""Controllers on the twin: every unit, every start, through its line and under its camera.

A robot of your own that replaces the twin is its only unit.
"""

from collections.abc import Callable
from contextlib import closing
from io import BytesIO
from typing import Any, NamedTuple
from zipfile import ZipFile

import numpy as np
from numpy.typing import NDArray

from realitygap.calibration.recorder.record import check_period
from realitygap.controller.network import NetworkController
from realitygap.errors import LineError, UsageError
from realitygap.experiments.folder import kept
from realitygap.experiments.noise.config import NoiseConfig
from realitygap.experiments.noise.plan import Controller, situated_file, stream
from realitygap.experiments.noise.stage import Stage
from realitygap.robots.address import Address
from realitygap.robots.body import Placing, Seen
from realitygap.robots.recording import Recording
from realitygap.tasks.load import TASKS, load_task
from realitygap.track import Track, settled
from realitygap.transfer.rig import Rig
from realitygap.values import Floats, Pose, fed
from realitygap.world.profile import load_profile

__all__ = ["Lived", "Rigs", "Situated", "check_robot", "read_situated", "situate", "to_npz"]

TRIES = 3
"""Of a trial whose line is lost, as when a computer stalls: the trial is the same each time."""


class Lived(NamedTuple):
    """Readings and commands of a controller's robots, [units, starts, steps, n]: in single precision, as on
    file.

    Attributes:
        readings: [… sensors] counts, of the fed kinds.
        commands: [… 2] in the robot's units.
        speeds: [… 2] likewise; NaN if not measured.
    """

    readings: NDArray[np.float32]
    commands: NDArray[np.float32]
    speeds: NDArray[np.float32]


class Situated(NamedTuple):
    """A controller's trials on the twin, as arrays like in the file, not Tracks.

    Attributes:
        units: numbers of the units that it drove.
        poses: [units, starts, rows, 3]: x, y (cm), heading (rad), a row a step from the start; NaN where the
            camera lost the robot.
        streams: [units, starts], of the twin's noise.
        period_s: of a step.
        lived: readings and commands; None in a study of an earlier version.
    """

    units: tuple[int, ...]
    poses: Floats
    streams: NDArray[np.uint64]
    period_s: float
    lived: Lived | None = None

    def track(self, unit: int, start: int) -> Track:
        """One trial, by the unit's number and the start's, from 1."""
        x, y, heading = self.poses[self.units.index(unit), start - 1].T
        t = np.arange(len(x), dtype=np.float64) * self.period_s
        return Track(t=t, x=x, y=y, heading=settled(heading, wrapped=False))


class Rigs:
    """Units of the twin that stay open while controllers of one task and calibration unit take turns."""

    def __init__(self, stage: Stage) -> None:
        self._stage = stage
        self._group: tuple[str, int] | None = None
        self._ready: dict[int, Rig] = {}

    def rig(self, one: Controller, unit: int) -> Rig:
        """A unit in the arena of the controller's task, with the input range of its calibration unit."""
        if self._group != (one.task, one.home):
            self.close()
            self._group = (one.task, one.home)
        if unit not in self._ready:
            self._ready[unit] = Rig(
                self._stage.task(one.task),
                self._stage.profile(one.home),
                robot=self._stage.config.address(unit),
                twin_noise=self._stage.config.twin_noise,
                folder_for_camera=self._stage.folder / "situated" / "cameras",
            )
        return self._ready[unit]

    def close(self) -> None:
        ready, self._ready = self._ready, {}
        for rig in ready.values():
            rig.close()


def check_robot(config: NoiseConfig) -> None:
    """Refuse a robot of your own that cannot do the trials, before any work.

    Raises:
        UsageError: it does not place itself, its path is unknown, it lacks a task's sensors, its period
            differs from its base's, or a trial is not a whole number of its steps.
        ConfigError: its base is not a profile.
    """
    if config.robot is None:
        return
    base = None if config.base is None else load_profile(config.base)
    with closing(Address.parse(config.address(config.first_unit)).open()) as body:
        who = f"robot {config.robot}: expected"
        if not isinstance(body, Placing):
            cure = "Give it one; a robot that a person carries is driven by `realitygap transfer`."
            raise UsageError(f"{who} one that places itself; it has no `enter`. {cure}")
        if not (isinstance(body, Seen) or body.counts_turns):
            raise UsageError(f"{who} one whose path is known; it has neither a `pose` nor counters.")
        if base is not None:
            check_period(body, base)
        kinds = [one.name for one in body.channels]
    fit = [name for name in TASKS if load_task(name).feeds in kinds]
    for name in config.tasks:
        if name not in fit:
            needs = f"{who} {load_task(name).feeds} sensors for {name}; it has {', '.join(kinds)}."
            raise UsageError(f"{needs} Leave that task out: --tasks {','.join(fit)}.")
        if base is not None:
            config.task(name).steps_of(base)


def situate(
    stage: Stage, rigs: Rigs, one: Controller, tell: Callable[[float], None] = lambda _: None
) -> Situated:
    """Let a controller drive its units from every start.

    Args:
        stage: of the study.
        rigs: the units.
        one: the driver.
        tell: called with the share of the work done since its last call.
    """
    config, units = stage.config, stage.config.driven(one.home, one.individual)
    driver = stage.driver(one)
    home, task = stage.profile(one.home), stage.task(one.task)
    rows = task.steps_of(home) + 1
    poses = np.full((len(units), config.starts, rows, 3), np.nan)
    streams = np.zeros((len(units), config.starts), np.uint64)
    lived: list[tuple[NDArray[Any], ...]] = []
    for u, unit in enumerate(units):
        rig = rigs.rig(one, unit)
        for k, pose in enumerate(stage.starts(one.task, one.seed_set, unit)):
            streams[u, k] = stream(config, "situated", *one.key, unit, k + 1, seed_set=one.seed_set)
            track, made = _driven(rig, driver, int(streams[u, k]), pose)
            poses[u, k] = np.stack([track.x, track.y, track.heading], axis=1)
            lived.append((fed(made, task.feeds), made.commands, made.speeds))
            tell(1.0 / streams.size)
    kept = (
        np.array(each, np.float32).reshape(*streams.shape, *each[0].shape)
        for each in zip(*lived, strict=True)
    )
    return Situated(units, poses, streams, home.period_s, Lived(*kept))


def _driven(rig: Rig, driver: NetworkController, name: int, pose: Pose) -> tuple[Track, Recording]:
    """A trial; repeated if the line to the unit is lost.

    Raises:
        LineError: lost repeatedly.
    """
    for _ in range(TRIES - 1):
        try:
            return rig.drive(driver, name, pose)
        except LineError:
            continue  # the rig has released its unit, and opens it again
    return rig.drive(driver, name, pose)


def read_situated(stage: Stage, one: Controller) -> Situated:
    """A controller's stored trials.

    Raises:
        StudyError: they are missing, or the file is broken.
    """
    file = situated_file(stage.folder, one)
    config, home = stage.config, stage.profile(one.home)
    units = config.driven(one.home, one.individual)
    shape = (len(units), config.starts, stage.task(one.task).steps_of(home) + 1, 3)
    with kept(file, f"paths {list(shape)} of a controller"):
        with ZipFile(file) as parts:
            if parts.testzip() is not None:  # before a damaged header is trusted
                raise ValueError
        with np.load(file) as arrays:
            lived = Lived(*(arrays[name] for name in Lived._fields)) if Lived._fields[0] in arrays else None
            found = Situated(units, arrays["poses"], arrays["streams"], home.period_s, lived)
        steps = (*shape[:2], shape[2] - 1)
        if found.poses.shape != shape or any(each.shape[:3] != steps for each in lived or ()):
            raise ValueError
    return found


def to_npz(made: Situated) -> bytes:
    """The content of a controller's file."""
    file = BytesIO()
    lived = {} if made.lived is None else made.lived._asdict()
    np.savez_compressed(file, poses=made.poses, streams=made.streams, **lived)
    return file.getvalue()
