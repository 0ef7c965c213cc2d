"""Controllers on their units, each compared with the simulation in which it evolved: as jobs."""

import math
from io import BytesIO
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from realitygap import temporary
from realitygap.controller.encoding import controller_of
from realitygap.correspondence.scale import exemplar_scale
from realitygap.correspondence.score import compare
from realitygap.correspondence.setting import setting_of
from realitygap.correspondence.trials import resampled
from realitygap.errors import TrackError
from realitygap.evolution.algorithm import Genes
from realitygap.experiments.phases import Made
from realitygap.experiments.randomise.plan import Controller, RandomiseConfig, Spread, evolution
from realitygap.simulation.simulation import Simulation
from realitygap.streams import named_stream
from realitygap.track import Track
from realitygap.transfer.order import mean
from realitygap.transfer.paths import score
from realitygap.transfer.rig import Rig
from realitygap.values import Pose
from realitygap.work.pool import Tell
from realitygap.world.profile import Profile

__all__ = ["FIGURES", "Bench", "Job", "trial_file"]

FIGURES = ("correspondence", "behaviour", "layout", "fitness_situated", "fitness_simulated", "lost")
"""The stored figures of a controller: scores 0 to 10, the task's own scores, and trials that the camera lost.
"""
LEAST_TRIALS = 2


def trial_file(folder: Path, one: Controller) -> Path:
    """The file of a controller's trials."""
    return folder / "trials" / f"unit-{one.unit}" / f"{one.name}.npz"


class Job(NamedTuple):
    """A controller to drive its unit.

    Attributes:
        controller: the driver.
        genes: the champion's.
        profile: of its simulation.
        truth: the unit's full calibration, used to score all of the unit's tracks.
        spread: of randomised constants.
    """

    controller: Controller
    genes: Genes
    profile: Profile
    truth: Profile
    spread: Spread


class Bench:
    """Carries out jobs; created once in a worker. `folder` keeps cameras, None if it cannot be seen."""

    def __init__(self, config: RandomiseConfig, folder: Path | None) -> None:
        self._config = config
        self._home = temporary.Folder("randomise")
        self._cameras = Path(self._home.name) if folder is None else folder / "cameras"
        self._rig: Rig | None = None

    def carry_out(self, job: Job, tell: Tell) -> None:
        """A controller's trials, on its unit and simulated; sends shares of the work, then the file's
        content."""
        one, config = job.controller, self._config
        rig, task = self._ready(one.unit, job.truth), config.task
        rig.profile = job.profile
        study, _ = evolution(config, one.unit, one.condition.known, "paper", job.spread)
        encoding = study.encoding_for(task.of(job.profile))
        drawn = task.under(*job.spread) if one.condition.randomised else task
        simulation = Simulation(drawn, job.profile, one.condition.noise)
        driver, networks = controller_of(encoding, job.genes), encoding.decode(job.genes[None])
        lived: list[tuple[Track, Track]] = []
        for k, pose in enumerate(self._starts(one.unit, job.truth), start=1):
            names = (*one.condition, one.run, k)
            situated, _ = rig.drive(driver, named_stream(config.seed, "situated", *names), pose, task.seconds)
            drawn_by = named_stream(config.seed, "simulated", *names)
            made, _ = simulation.trajectory(networks, stream=drawn_by, pose=pose)
            lived.append((made.track, situated))
            tell(1.0 / config.starts)
        file = str(trial_file(Path(), one))
        tell(Made(file, _content(lived, self._figures(lived, job.truth))))

    def _figures(self, lived: list[tuple[Track, Track]], truth: Profile) -> NDArray[np.float64]:
        """Values of FIGURES, NaN if too few trials are left."""
        task, radius = self._config.task, truth.body.radius_cm
        setting, pairs = setting_of([], task), []
        for k, both in enumerate(lived, start=1):
            try:
                pairs.append([resampled(track, start=str(k), radius_cm=radius) for track in both])
            except TrackError:
                continue  # lost for too long: its behaviour is unknown
        situated, simulated = (mean([score(pair[i], task, truth) for pair in lived]) for i in (1, 0))
        scores = (math.nan, math.nan, math.nan)
        if len(pairs) >= LEAST_TRIALS:
            scale = exemplar_scale(setting.exemplars, len(lived), len(lived), matched=True)
            sides = [[pair[i] for pair in pairs] for i in (0, 1)]
            found = compare(sides[0], sides[1], setting, scale=scale, resamples=0)
            scores = (found.score, found.behaviour, found.layout)
        return np.array([*scores, situated, simulated, len(lived) - len(pairs)])

    def _ready(self, unit: int, truth: Profile) -> Rig:
        """The unit in the task's arena, under a camera calibrated for its true body."""
        address, noise = self._config.address(unit), self._config.twin_noise
        if self._rig is None or self._rig.robot != address:
            self.close_rig()
            self._rig = Rig(
                self._config.task, truth, robot=address, twin_noise=noise, folder_for_camera=self._cameras
            )
            _ = self._rig.watcher  # before the profile is replaced
        return self._rig

    def _starts(self, unit: int, truth: Profile) -> list[Pose]:
        """Starts of a unit's trials, the same for all controllers."""
        simulation = Simulation(self._config.task, truth)
        numbers = range(1, self._config.starts + 1)
        return [simulation.start(named_stream(self._config.seed, "start", unit, k)) for k in numbers]

    def close_rig(self) -> None:
        """Release the unit."""
        if self._rig is not None:
            self._rig.close()
        self._rig = None

    def close(self) -> None:
        """Release everything."""
        self.close_rig()
        self._home.cleanup()


def _content(lived: list[tuple[Track, Track]], figures: NDArray[np.float64]) -> bytes:
    """The file of a controller: `poses` [2 sides, starts, rows, 3] x, y (cm), heading (rad); `figures`."""
    poses = [[np.stack([t.x, t.y, t.heading], axis=1) for t in side] for side in zip(*lived, strict=True)]
    file = BytesIO()
    np.savez_compressed(file, poses=np.array(poses, np.float32), figures=figures)
    return file.getvalue()
