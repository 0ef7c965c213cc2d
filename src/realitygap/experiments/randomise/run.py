"""Carries out an experiment on measuring or randomising: calibrate, evolve, drive, gather; or continues one.

from realitygap.experiments.randomise.plan import RandomiseConfig
from realitygap.experiments.randomise.run import measure_or_randomise

measure_or_randomise("out/measure", RandomiseConfig(units=2, runs=2))
"""

from collections.abc import Iterator
from functools import cache, partial
from pathlib import Path

from realitygap.calibration.unit import calibrated_again, calibrated_unit
from realitygap.calibration.unit_folder import PROFILE
from realitygap.experiments.folder import missing, open_folder
from realitygap.experiments.phases import Phase, Phases, Recorded, session
from realitygap.experiments.randomise import plan
from realitygap.experiments.randomise.plan import ALL, KNOWN, LOOKUP, Controller, Profiles, RandomiseConfig
from realitygap.experiments.randomise.results import write_results
from realitygap.experiments.randomise.trials import Bench, Job, trial_file
from realitygap.streams import named_stream
from realitygap.study.config import StudyConfig
from realitygap.study.load import Study
from realitygap.work.pool import Pool, Setup
from realitygap.work.progress import OnProgress
from realitygap.work.workers import Workers, far, near

__all__ = ["measure_or_randomise"]

CALIBRATION_COST, RUN_COST, EVALUATION_COST, TRIAL_COST = 90.0, 0.4, 1.3e-3, 0.3
"""Approximate times on one core, s: a unit's calibrations, a run's retest, an evaluation, a trial. Only used
to estimate the time left."""
PARTS = ("wheels", "infrared-wall", "infrared-cylinder")
"""The recordings of a unit: the task has no lamp."""
AGAIN = [known for known, share in KNOWN.items() if share and known != ALL]
"""Further calibrations from its recordings, in this order."""


def measure_or_randomise(
    folder: str | Path,
    config: RandomiseConfig | None = None,
    *,
    workers: Workers = None,
    engine: str = "cores",
    resume: bool = False,
    on_progress: OnProgress | None = None,
) -> Path:
    """Carry out an experiment in a folder, or continue the one that is there.

    Neither `workers` nor interruptions change a bit of its tables.

    Args:
        folder: created if it does not exist.
        config: the settings; None to resume an experiment with its own.
        workers: processes, one a core if None, 1 stays in this process; or a pool.
        engine: for evolution's trials; randomised ones need "cores".
        resume: continue the experiment in the folder; without one, create it from `config`.
        on_progress: called a few times a second.

    Returns:
        The folder `results` with controllers.csv, conditions.csv, comparisons.csv, calibration.csv and
        experiment.toml.

    Raises:
        UsageError: wrong settings, or a folder that cannot be used.
        StudyInterruptedError: Ctrl-C; finished work is kept.
        RobotError: a unit does not follow its commands.
    """
    folder = Path(folder)
    with session(folder, workers) as pool:
        made = open_folder(folder, RandomiseConfig, config, resume=resume)
        left = _Left(folder.resolve(), made, pool, on_progress)
        left.carry_out(near(workers), engine)
        return write_results(folder, made, left.profiles)


class _Left(Phases):
    def __init__(
        self, folder: Path, config: RandomiseConfig, pool: Pool, on_progress: OnProgress | None
    ) -> None:
        self.folder, self.config, self.pool = folder, config, pool
        self.profiles = Profiles(folder, config)
        self.every = plan.controllers(config)
        self.left = missing({one: trial_file(folder, one) for one in self.every})
        units = {unit: plan.calibrated_folder(folder, unit, AGAIN[-1]) / PROFILE for unit in config.numbers}
        self.uncalibrated = missing(units)
        self.studies: dict[tuple[int, str], Study] = {}
        self.study = cache(self._study)
        every, left = len(self.every), len(self.left)
        run, trials = RUN_COST + config.evaluations * EVALUATION_COST, TRIAL_COST * config.starts
        self.phases = (
            Phase("calibrate", "calibrating to the units", "units", len(units), len(self.uncalibrated),
                  CALIBRATION_COST),
            Phase("evolve", "evolving", "runs", every, left, run),
            Phase("situated", "on the units", "controllers", every, left, trials),
        )  # fmt: skip
        super().__init__(folder, pool, self.phases, on_progress)

    def carry_out(self, recorders: Workers, engine: str) -> None:
        """Carry out every unfinished phase; calibration has its own workers, evolution may have an engine."""
        calibrating, evolving, driving = self.phases

        def setup() -> Setup:
            return Setup(Bench, (self.config, None if far(self.pool) else self.folder))

        record = partial(self._record, recorders)
        self.calibrate(calibrating, self.uncalibrated, record, len(PARTS) + 1 + len(AGAIN))
        keys = list(dict.fromkeys((one.unit, one.condition.known) for one in self.every))
        made = self.evolve(evolving, (self._place(*key) for key in keys), engine=engine)
        self.studies = dict(zip(keys, made, strict=True))
        self.drive(driving, setup, self._jobs())

    def _record(self, recorders: Workers, unit: int, heard: Recorded) -> None:
        """Record a unit once, and fit all of its recordings, shares of them and a table."""
        config, place = self.config, plan.calibrated_folder(self.folder, unit, ALL)
        calibrated_unit(
            place, unit=unit if config.robot == "twin" else str(config.address(unit)),
            noise=config.twin_noise, seed=named_stream(config.seed, "calibration", unit) >> 1,
            workers=recorders, parts=PARTS, on_progress=heard,
        )  # fmt: skip
        for known in AGAIN:
            calibrated_again(
                plan.calibrated_folder(self.folder, unit, known), of=place, share=KNOWN[known],
                form="lookup" if known == LOOKUP else None, workers=recorders,
            )  # fmt: skip
            heard(known, 1, 1)

    def _place(self, unit: int, known: str) -> tuple[Path, StudyConfig, int]:
        """The runs of a unit in a state of knowledge: folder, configuration and number."""
        study, names = self.study(unit, known)
        place = self.folder / "evolved" / f"unit-{unit}" / known.replace(" %", "").replace(", ", "-")
        return place, study, len(names)

    def _study(self, unit: int, known: str) -> tuple[StudyConfig, dict[Controller, str]]:
        profile = self.profiles.file(unit, known)
        return plan.evolution(self.config, unit, known, profile, self.profiles.spread())

    def _jobs(self) -> Iterator[Job]:
        for one in self.left:
            key = (one.unit, one.condition.known)
            champion = self.studies[key].run(self.study(*key)[1][one]).champion
            assert champion is not None
            profile, truth = self.profiles.of(*key), self.profiles.of(one.unit, ALL)
            yield Job(one, champion, profile, truth, self.profiles.spread())
