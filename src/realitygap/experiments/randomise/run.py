"""Carry out an experiment of measuring or randomising: calibrate, evolve, drive, gather; or go on with one.

from realitygap.experiments.randomise.plan import RandomiseConfig
from realitygap.experiments.randomise.run import measure_or_randomise

measure_or_randomise("out/measure", RandomiseConfig(units=2, runs=2))
"""

from collections.abc import Iterator, Mapping
from pathlib import Path

from realitygap import whole
from realitygap.calibration.unit import calibrated_share, calibrated_unit
from realitygap.calibration.unit_folder import PROFILE
from realitygap.errors import StudyError, StudyInterruptedError
from realitygap.experiments.randomise.known import ALL, Profiles, calibrated_folder
from realitygap.experiments.randomise.plan import (
    CONFIG,
    KNOWN,
    Controller,
    RandomiseConfig,
    controllers,
    evolution,
    stream,
)
from realitygap.experiments.randomise.results import trial_file, write_results
from realitygap.experiments.randomise.trials import Job, Made, Words, bench_in
from realitygap.study.config import StudyConfig
from realitygap.study.folder import exists
from realitygap.study.load import Study
from realitygap.study.lock import lock, refuse_strangers
from realitygap.study.runner import run_study
from realitygap.study.schema import told
from realitygap.study.settings import refuse_difference
from realitygap.study.versions import versions
from realitygap.toml import to_toml
from realitygap.work.pool import Pool, Setup
from realitygap.work.progress import OnProgress, Progress, Reporter
from realitygap.work.workers import Workers, far, near, opened

__all__ = ["measure_or_randomise", "resuming"]

CALIBRATING, EVOLVING, DRIVING = "calibrating to the units", "evolving", "on the units"
CALIBRATION_COST, RUN_COST, EVALUATION_COST, TRIAL_COST = 90.0, 0.4, 1.3e-3, 0.3
"""About how long things take on one core, s: a unit's calibrations, a run's retest, an evaluation, a trial.
Hints for the time that is left, nothing else."""
PARTS = ("wheels", "infrared-wall", "infrared-cylinder")
"""What is recorded of a unit: the task has no lamp."""


def measure_or_randomise(
    folder: str | Path,
    config: RandomiseConfig | None = None,
    *,
    workers: Workers = None,
    engine: str = "cores",
    resume: bool = False,
    on_progress: OnProgress | None = None,
) -> Path:
    """Carry out an experiment in a folder, or go on with the one that is there.

    Neither `workers` nor an interruption at any moment changes a bit of its tables.

    Args:
        folder: made if it does not exist.
        config: what to do; None to resume an experiment as it was made.
        workers: processes, one a core if None, 1 stays in this process; or a pool.
        engine: what evolution's trials run on; randomised ones need "cores".
        resume: go on with the experiment that is in the folder; without one, make it from `config`.
        on_progress: called a few times a second.

    Returns:
        The folder `results` with controllers.csv, conditions.csv, comparisons.csv, calibration.csv and
        experiment.toml.

    Raises:
        UsageError: wrong settings, or a folder that cannot be used.
        StudyInterruptedError: Ctrl-C; what was done is kept.
        RobotError: a unit that does not do what it was told.
    """
    folder = Path(folder)
    try:
        with opened(workers) as pool, lock(folder):
            made = _open(folder, config, resume=resume)
            phases = _Phases(folder.resolve(), made, pool, on_progress)
            phases.calibrate(near(workers))
            phases.evolve(engine)
            phases.drive()
            return write_results(folder, made, phases.profiles)
    except KeyboardInterrupt:
        kept = f"What was done in {folder} is kept: resume it (--resume)."
        raise StudyInterruptedError(f"stopped. {kept}") from None


def resuming(folder: str | Path) -> str:
    """The command that goes on with an experiment."""
    import shlex

    return f"realitygap experiment measure-or-randomise --out {shlex.quote(str(folder))} --resume"


def _open(folder: Path, requested: RandomiseConfig | None, *, resume: bool) -> RandomiseConfig:
    """Make the requested experiment, or open the one that is there; the lock is held."""
    if not (folder / CONFIG).is_file():
        if requested is None:
            raise StudyError(
                f"{folder}: no experiment of measuring or randomising there. Leave out --resume."
            )
        refuse_strangers(folder, "experiment of measuring or randomising")
        with told(folder):
            again = f"# To go on with this experiment: {resuming('THIS_FOLDER')}\n"
            whole.write(folder / CONFIG, again + to_toml({**requested.to_dict(), "versions": versions()}))
        return requested
    there = RandomiseConfig.from_folder(folder)
    if not resume:
        cure = "Resume it (--resume) or choose another --out."
        raise StudyError(f"{folder} already holds an experiment of measuring or randomising. {cure}")
    if requested is not None:
        refuse_difference(f"{folder}: the experiment was made", there.to_dict(), requested.to_dict())
    return there


class _Phases:
    """All that is left to do, phase by phase; each leaves files that the next reads."""

    def __init__(
        self, folder: Path, config: RandomiseConfig, pool: Pool, on_progress: OnProgress | None
    ) -> None:
        self.folder, self.config, self.pool = folder, config, pool
        self.profiles = Profiles(folder, config)
        self.every = controllers(config)
        self.left = [one for one in self.every if not trial_file(folder, one).is_file()]
        self.run_cost = RUN_COST + config.evaluations * EVALUATION_COST
        work = {
            CALIBRATING: CALIBRATION_COST * len(self._uncalibrated()),
            EVOLVING: self.run_cost * len(self.left),
            DRIVING: TRIAL_COST * config.starts * len(self.left),
        }
        self.reporter = Reporter(on_progress, work, patience_s=2.0)
        self.studies: dict[tuple[int, str], Study] = {}

    def _uncalibrated(self) -> list[int]:
        """Units that lack the last of their profiles."""
        last = [known for known in KNOWN if KNOWN[known]][-2]
        folders = {unit: calibrated_folder(self.folder, unit, last) for unit in self.config.numbers}
        return [unit for unit, folder in folders.items() if not (folder / PROFILE).is_file()]

    def calibrate(self, recorders: Workers) -> None:
        """Record each unit once, and fit it by all of its recordings and by shares of them."""
        left, config, units = self._uncalibrated(), self.config, self.config.units
        self.reporter.phase(CALIBRATING, done=units - len(left), total=units, what="units")
        for unit in left:
            whole_folder = calibrated_folder(self.folder, unit, ALL)
            calibrated_unit(
                whole_folder, unit=unit if config.robot == "twin" else str(config.address(unit)),
                noise=config.twin_noise, seed=stream(config, "calibration", unit) >> 1, workers=recorders,
                parts=PARTS, on_progress=lambda *_: self.reporter.add(0.0),
            )  # fmt: skip
            self.reporter.add(CALIBRATION_COST / 2)
            for known in (known for known, share in KNOWN.items() if 0 < share < 1):
                place = calibrated_folder(self.folder, unit, known)
                calibrated_share(place, of=whole_folder, share=KNOWN[known], workers=recorders)
                self.reporter.add(CALIBRATION_COST / 4)
            self.reporter.add(0.0, done=1)
        self.reporter.end()

    def evolve(self, engine: str) -> None:
        """The runs of every unit in every state of knowledge, a study each."""
        before, total = 0, len(self.every)
        self.reporter.phase(EVOLVING, done=0, total=total, what="runs")
        for unit, known in dict.fromkeys((one.unit, one.condition.known) for one in self.every):
            study, names = self._study(unit, known)
            place = self.folder / "evolved" / f"unit-{unit}" / known.replace(" %", "").replace(", ", "-")

            def heard(event: Progress, before: int = before) -> None:
                share = event.done / max(event.total, 1) * event.runs_total
                self.reporter.reach(before + event.runs_done, self.run_cost * (total - before - share))

            self.studies[unit, known] = run_study(
                place, study, workers=self.pool, engine=engine, resume=exists(place), on_progress=heard
            )
            before += len(names)
        self.reporter.end()

    def _study(self, unit: int, known: str) -> tuple[StudyConfig, dict[Controller, str]]:
        profile = self.profiles.file(unit, known)
        return evolution(self.config, unit, known, profile, self.profiles.spread())

    def drive(self) -> None:
        """Every champion on its unit, as jobs of the pool."""
        cost, reporter = TRIAL_COST * self.config.starts, self.reporter
        reporter.phase(
            DRIVING, done=len(self.every) - len(self.left), total=len(self.every), what="controllers"
        )

        def heard(made: Made) -> None:
            file = trial_file(self.folder, made.controller)
            with told(self.folder):
                file.parent.mkdir(parents=True, exist_ok=True)
                whole.write(file, made.content)
            reporter.add(cost, done=1)

        if self.left:
            words = Words(self.config, None if far(self.pool) else self.folder)
            self.pool.work(Setup(bench_in, (words,)), self._jobs(), heard)
        reporter.end()

    def _jobs(self) -> Iterator[Job]:
        spread = self.profiles.spread()
        names: dict[tuple[int, str], Mapping[Controller, str]] = {}
        for one in self.left:
            key = (one.unit, one.condition.known)
            if key not in names:
                names[key] = self._study(*key)[1]
            champion = self.studies[key].run(names[key][one]).champion
            assert champion is not None
            profile, truth = self.profiles.of(*key), self.profiles.of(one.unit, ALL)
            yield Job(one, champion, profile, truth, spread)
