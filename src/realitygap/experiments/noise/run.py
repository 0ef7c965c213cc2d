"""Carries out a study of noise levels: calibrate, evolve, drive, compare, gather; or continues one.

from realitygap.experiments.noise.config import NoiseConfig
from realitygap.experiments.noise.run import noise_study

noise_study("out/noise", NoiseConfig(runs=8, starts=4))
"""

from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

from realitygap.calibration.unit_folder import PARTS, PROFILE
from realitygap.experiments.folder import missing
from realitygap.experiments.noise import plan
from realitygap.experiments.noise.config import CONFIG, NoiseConfig
from realitygap.experiments.noise.folder import open_folder
from realitygap.experiments.noise.plan import Controller
from realitygap.experiments.noise.results import write_results
from realitygap.experiments.noise.situated import check_robot
from realitygap.experiments.noise.stage import Stage
from realitygap.experiments.noise.work import Job, bench_in, words_for
from realitygap.experiments.phases import Phase, Phases, Recorded, session
from realitygap.streams import named_stream
from realitygap.study.config import StudyConfig
from realitygap.study.folder import exists
from realitygap.study.schema import told
from realitygap.work.pool import Pool, Setup
from realitygap.work.progress import OnProgress
from realitygap.work.shard import Shard, marked
from realitygap.work.workers import Workers, far, near

__all__ = ["WORK", "noise_study"]

WORK = "experiment noise"
"""The kind of work that a shard divides."""

TWIN_COSTS, ENKI_COSTS = (130.0, 0.37), (45.0, 0.15)
EVALUATION_COST, RETEST_COST, CELL_COST = 1.35e-3, 0.35, 0.08
"""Approximate times on one core, s: a unit's calibration and a trial on it, on the twin and on Enki's robots;
an evaluation, a run's retest, a comparison with a level. Only used to estimate the time left."""


def noise_study(
    folder: str | Path,
    config: NoiseConfig | None = None,
    *,
    workers: Workers = None,
    engine: str = "cores",
    resume: bool = False,
    shard: Shard | str | None = None,
    on_progress: OnProgress | None = None,
) -> Path:
    """Carry out a study in a folder, or continue the one that is there.

    Neither `workers` nor interruptions change a bit of its tables.

    Args:
        folder: created if it does not exist.
        config: the settings; None to resume a study with its own.
        workers: processes, one a core if None, 1 stays in this process; or a pool.
        engine: for evolution's trials: see `run_study`.
        resume: continue the study in the folder; without one, create it from `config`.
        shard: the share of the controllers to evolve, drive and compare; a started one keeps its share.
            `merge_noise` makes the study from all shards' folders.
        on_progress: called a few times a second.

    Returns:
        The folder `results` with controllers.csv, cells.csv, calibration.csv and study.toml; for a shard its
        folder.

    Raises:
        UsageError: wrong settings, or a folder that cannot be used.
        StudyInterruptedError: Ctrl-C; finished work is kept.
        RobotError: a twin does not follow its commands.
    """
    folder = Path(folder)
    shard = None if shard is None else Shard.parse(shard)
    if config is not None:
        check_robot(config)
    with session(folder, workers) as pool:
        mark = marked(folder, shard, WORK, begun=(folder / CONFIG).is_file())
        made = open_folder(folder, config, resume=resume, mark=mark)
        own = None if mark is None else mark.shard
        _Noise(folder.resolve(), made, pool, own, on_progress).carry_out(near(workers), engine)
        if mark is None:
            return write_results(Stage(folder, made))
        mark.write(folder, finished=True)
        return folder


class _Noise(Phases):
    def __init__(
        self,
        folder: Path,
        config: NoiseConfig,
        pool: Pool,
        shard: Shard | None,
        on_progress: OnProgress | None,
    ) -> None:
        self.folder, self.config, self.pool, self.shard = folder, config, pool, shard
        every = plan.controllers(config) if shard is None else plan.share(config, shard)
        self.runs = [one for one in every if one.individual == "champion"]
        self.to_drive = missing({one: plan.situated_file(folder, one) for one in every})
        self.to_compare = missing({one: plan.simulated_file(folder, one) for one in every})
        units = {unit: plan.calibration_folder(folder, unit) / PROFILE for unit in config.every_unit}
        self.uncalibrated = missing(units)
        self.studies = tuple(dict.fromkeys(plan.evolved(config, one) for one in plan.controllers(config)))
        begun = all(exists(plan.evolved_folder(folder, config, study)) for study in self.studies)
        to_evolve = len(self.runs) if self.to_drive or not begun else 0
        unit, trial = ENKI_COSTS if (config.robot or "").startswith("enki") else TWIN_COSTS
        run = config.evaluations * EVALUATION_COST + RETEST_COST
        trials = trial * config.twin_trials / (config.controllers * len(config.individuals))
        compared = CELL_COST * len(config.levels)
        jobs = ("controllers", len(every))
        self.phases = (
            Phase("calibrate", "calibrating to the units", "units", len(units), len(self.uncalibrated), unit),
            Phase("evolve", "evolving", "runs", len(self.runs), to_evolve, run),
            Phase(
                "situated", f"on the {'robot' if config.robot else 'twin'}", *jobs, len(self.to_drive), trials
            ),
            Phase("simulated", "comparing with the simulations", *jobs, len(self.to_compare), compared),
        )
        super().__init__(folder, pool, self.phases, on_progress)

    def carry_out(self, recorders: Workers, engine: str) -> None:
        """Carry out every unfinished phase; calibration has its own workers, evolution may have an engine."""
        calibrating, evolving, driving, comparing = self.phases

        def setup() -> Setup:
            with told(self.folder):
                return Setup(bench_in, words_for(self.folder, self.config, self.pool))

        self.calibrate(calibrating, self.uncalibrated, partial(self._record, recorders), len(PARTS) + 1)
        self.evolve(evolving, self._studies(), engine=engine, shard=self.shard)
        self.drive(driving, setup, self._jobs(self.to_drive))
        self.drive(comparing, setup, self._jobs(self.to_compare, compared=True))

    def _record(self, recorders: Workers, unit: int, heard: Recorded) -> None:
        """Make a unit's profile with the study's twin noise, which belongs to the unit."""
        from realitygap.calibration.unit import calibrated_robot, calibrated_unit

        place, config = plan.calibration_folder(self.folder, unit), self.config
        seed = named_stream(config.seed, "calibration", unit) >> 1
        how: dict[str, Any] = {"seed": seed, "workers": recorders, "on_progress": heard}
        if config.base is None:
            which = unit if config.robot is None else config.address(unit)
            calibrated_unit(place, unit=which, noise=config.twin_noise, **how)
        else:
            calibrated_robot(place, robot=config.address(unit), base=config.base, **how)

    def _studies(self) -> Iterator[tuple[Path, StudyConfig, int]]:
        """The runs of every seed set, each in the simulation of its calibration unit."""
        for study in self.studies:
            profile = plan.calibration_folder(self.folder, study.unit) / PROFILE
            runs = sum(plan.evolved(self.config, one) == study for one in self.runs)
            yield (
                plan.evolved_folder(self.folder, self.config, study),
                plan.evolution(self.config, study, profile),
                runs,
            )

    def _jobs(self, left: list[Controller], *, compared: bool = False) -> Iterator[Job]:
        stage = Stage(self.folder, self.config)
        for one in left:
            seen = b"" if compared else None
            if far(self.pool) and compared:
                seen = plan.situated_file(self.folder, one).read_bytes()
            yield Job(one, stage.genes(one), seen)
