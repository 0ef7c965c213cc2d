"""Carry out a study of the level of noise: calibrate, evolve, drive, compare, gather; or go on with one.

from realitygap.experiments.noise.config import NoiseConfig
from realitygap.experiments.noise.run import noise_study

noise_study("out/noise", NoiseConfig(runs=8, starts=4))
"""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from realitygap.calibration.unit_folder import PROFILE
from realitygap.errors import StudyInterruptedError
from realitygap.experiments.noise.config import CONFIG, NoiseConfig
from realitygap.experiments.noise.folder import Seconds, missing, open_folder
from realitygap.experiments.noise.plan import (
    Controller,
    calibration_folder,
    controllers,
    evolution,
    evolved,
    evolved_folder,
    share,
    simulated_file,
    situated_file,
    stream,
)
from realitygap.experiments.noise.simulated import keep_compared
from realitygap.experiments.noise.situated import Situated, check_robot, keep_situated
from realitygap.experiments.noise.stage import Stage
from realitygap.experiments.noise.work import Job, Made, bench_in, words_for
from realitygap.study.folder import exists
from realitygap.study.lock import lock
from realitygap.study.runner import COMPILING, FINISHED, run_study
from realitygap.study.schema import told
from realitygap.work.pool import Pool, Setup
from realitygap.work.progress import OnProgress, Progress, Reporter
from realitygap.work.shard import Shard, marked
from realitygap.work.workers import Workers, far, near, opened

__all__ = ["WORK", "noise_study"]

WORK = "experiment noise"
"""Of whose controllers a shard is a share."""

TWIN_COSTS, ENKI_COSTS = (130.0, 0.37), (45.0, 0.15)
EVALUATION_COST, RETEST_COST, CELL_COST = 1.35e-3, 0.35, 0.08
"""About how long things take on one core, s: a unit's calibration and a trial on it, on the twin and on
Enki's robots; an evaluation, a run's retest, a comparison with a level. Hints for the time that is left,
nothing else."""

CALIBRATING = "calibrating to the units"
EVOLVING = "evolving"
DRIVING = "on the twin"
COMPARING = "comparing with the simulations"

FIRST_GUESS_S = 2.0
"""Before so much time is spent on work that is done nobody can say how long the rest takes."""

KEEP_S = 10.0
"""How often the time that a phase has taken is written down."""

IN_FILES = {CALIBRATING: "calibrate", EVOLVING: "evolve", DRIVING: "situated", COMPARING: "simulated"}
"""Phases as study.toml names them."""


def noise_study(
    folder: str | Path,
    config: NoiseConfig | None = None,
    *,
    workers: Workers = None,
    engine: str = "cores",
    resume: bool = False,
    shard: Shard | None = None,
    on_progress: OnProgress | None = None,
) -> Path:
    """Carry out a study in a folder, or go on with the one that is there.

    Neither `workers` nor an interruption at any moment changes a bit of its tables.

    Args:
        folder: made if it does not exist.
        config: what to do; None to resume a study as it was made.
        workers: processes, one a core if None, 1 stays in this process; or a pool.
        engine: what evolution's trials run on: see `run_study`.
        resume: go on with the study that is in the folder; without one, make it from `config`.
        shard: the share of the controllers to evolve, drive and compare; one that was begun is gone on with
            as it was. `merge_noise` makes the study of all shards' folders.
        on_progress: called a few times a second.

    Returns:
        The folder `results` with controllers.csv, cells.csv, calibration.csv and study.toml; of a shard its
        folder.

    Raises:
        UsageError: wrong settings, or a folder that cannot be used.
        StudyInterruptedError: Ctrl-C; what was done is kept.
        RobotError: a twin that does not do what it was told.
    """
    from realitygap.experiments.noise.results import write_results

    folder = Path(folder)
    if config is not None:
        check_robot(config)
    try:
        with opened(workers) as pool, lock(folder):
            mark = marked(folder, shard, WORK, begun=(folder / CONFIG).is_file())
            if mark is not None:
                with told(folder):
                    mark.write(folder, finished=False)
            made = open_folder(folder, config, resume=resume)
            own = None if mark is None else mark.shard
            _Phases(folder.resolve(), made, pool, own, on_progress).carry_out(near(workers), engine)
            if mark is None:
                return write_results(Stage(folder, made))
            mark.write(folder, finished=True)
            return folder
    except KeyboardInterrupt:
        kept = f"What was done in {folder} is kept: resume it (--resume)."
        raise StudyInterruptedError(f"stopped. {kept}") from None


class _Phases:
    """All that is left to do, phase by phase; each leaves files that the next reads."""

    def __init__(
        self,
        folder: Path,
        config: NoiseConfig,
        pool: Pool,
        shard: Shard | None,
        on_progress: OnProgress | None,
    ) -> None:
        self.folder, self.config, self.pool, self.shard = folder, config, pool, shard
        self.every = controllers(config) if shard is None else share(config, shard)
        self.runs = [one for one in self.every if one.individual == "champion"]
        self.to_drive = missing({one: situated_file(folder, one) for one in self.every})
        self.to_compare = missing({one: simulated_file(folder, one) for one in self.every})
        unit, trial = ENKI_COSTS if (config.robot or "").startswith("enki") else TWIN_COSTS
        jobs = config.controllers * len(config.individuals)
        self.costs = {
            CALIBRATING: unit,
            EVOLVING: config.evaluations * EVALUATION_COST + RETEST_COST,
            DRIVING: trial * config.twin_trials / jobs,
            COMPARING: CELL_COST * len(config.levels),
        }
        self.studies = tuple(dict.fromkeys(evolved(config, one) for one in controllers(config)))
        begun = all(exists(evolved_folder(folder, config, study)) for study in self.studies)
        left = {
            CALIBRATING: len(self._uncalibrated()),
            EVOLVING: len(self.runs) if self.to_drive or not begun else 0,
            DRIVING: len(self.to_drive),
            COMPARING: len(self.to_compare),
        }
        self.reporter = Reporter(
            on_progress, {name: left[name] * self.costs[name] for name in left}, patience_s=FIRST_GUESS_S
        )

    def carry_out(self, recorders: Workers, engine: str) -> None:
        """Every phase that is not over; calibration has workers of its own, evolution may have an engine."""
        phases: dict[str, Callable[[], None]] = {
            CALIBRATING: lambda: self._calibrate(recorders),
            EVOLVING: lambda: self._evolve(engine),
            DRIVING: lambda: self._trials(DRIVING, self.to_drive),
            COMPARING: lambda: self._trials(COMPARING, self.to_compare),
        }
        for name, work in phases.items():
            with self._timed(name):
                work()
            self.reporter.end()

    @contextmanager
    def _timed(self, name: str) -> Iterator[None]:
        self._phase, self._since = name, time.monotonic()
        try:
            yield
        finally:
            self._keep_time()

    def _keep_time(self, every_s: float = 0.0) -> None:
        """Write down what the phase took; now and then as it goes, so that no kill makes it look quick."""
        now = time.monotonic()
        if now - self._since >= every_s:
            Seconds(self.folder).add(IN_FILES[self._phase], now - self._since)
            self._since = now

    def _uncalibrated(self) -> list[int]:
        units = self.config.every_unit
        return [u for u in units if not (calibration_folder(self.folder, u) / PROFILE).is_file()]

    def _calibrate(self, recorders: Workers) -> None:
        """A profile of each unit, as the twin is in this study: its noise is the unit's too."""
        from realitygap.calibration.unit import calibrated_robot, calibrated_unit
        from realitygap.calibration.unit_folder import PARTS

        left, units, steps = self._uncalibrated(), self.config.units, len(PARTS) + 1
        self.reporter.phase(CALIBRATING, done=units - len(left), total=units, what="units")
        for unit in left:
            shares: dict[str, float] = {}

            def heard(name: str, done: int, total: int, shares: dict[str, float] = shares) -> None:
                before = sum(shares.values())
                shares[name] = done / max(total, 1)
                self.reporter.add(self.costs[CALIBRATING] * max(0.0, sum(shares.values()) - before) / steps)
                self._keep_time(KEEP_S)

            place, config = calibration_folder(self.folder, unit), self.config
            seed = stream(config, "calibration", unit) >> 1
            if config.base is None:
                which = unit if config.robot is None else config.address(unit)
                calibrated_unit(
                    place,
                    unit=which,
                    noise=config.twin_noise,
                    seed=seed,
                    workers=recorders,
                    on_progress=heard,
                )
            else:
                calibrated_robot(
                    place, robot=config.address(unit), base=config.base, seed=seed, workers=recorders,
                    on_progress=heard,
                )  # fmt: skip
            self.reporter.add(0.0, done=1)

    def _evolve(self, engine: str) -> None:
        """The runs of every seed set, each in the simulation of its calibration unit."""
        total, before = len(self.runs), 0
        self.reporter.phase(EVOLVING, done=0, total=total, what="runs")
        for study in self.studies:
            place = evolved_folder(self.folder, self.config, study)
            profile = calibration_folder(self.folder, study.unit) / PROFILE
            requested = evolution(self.config, study, profile)

            def heard(event: Progress, before: int = before) -> None:
                done = before + event.runs_done
                share = event.done / max(event.total, 1) * event.runs_total
                tell = self.reporter.found if event.phase in (COMPILING, FINISHED) else self.reporter.reach
                tell(done, self.costs[EVOLVING] * (total - before - share))
                self._keep_time(KEEP_S)

            run_study(
                place, requested, workers=self.pool, engine=engine, resume=exists(place), shard=self.shard,
                on_progress=heard,
            )  # fmt: skip
            before += sum(evolved(self.config, one) == study for one in self.runs)

    def _trials(self, phase: str, left: list[Controller]) -> None:
        """A phase whose jobs are controllers."""
        total, cost, reporter = len(self.every), self.costs[phase], self.reporter
        reporter.phase(phase, done=total - len(left), total=total, what="controllers")
        stage = Stage(self.folder, self.config)

        def jobs() -> Iterator[Job]:
            for one in left:
                seen = None if phase == DRIVING else b""
                if far(self.pool) and phase == COMPARING:
                    seen = situated_file(self.folder, one).read_bytes()
                yield Job(one, stage.genes(one), seen)

        def heard(message: float | Made) -> None:
            if isinstance(message, Made):
                with told(self.folder):
                    _keep(self.folder, message)
                reporter.add(0.0, done=1)
            else:
                reporter.add(cost * message)
            self._keep_time(KEEP_S)

        if left:
            with told(self.folder):
                words = words_for(self.folder, self.config, self.pool)
            self.pool.work(Setup(bench_in, (words,)), jobs(), heard)


def _keep(folder: Path, made: Made) -> None:
    """Write down what came of a job."""
    if isinstance(made.content, Situated):
        keep_situated(folder, made.controller, made.content)
    else:
        keep_compared(folder, made.controller, made.content)
