"""Runs measure-or-randomise as planned (plan.md): knowledge of a robot against random constants.

    python studies/measure-or-randomise/run.py --out out/measure-or-randomise/E
    python studies/measure-or-randomise/run.py --robot twin --out out/measure-or-randomise/T

The tables reported here were made by the versions that README.md names; today's come to other digits.
Stopped, it goes on with --resume. `--runs 1 --units 2` is a small one to try.
"""

import argparse
import math
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from io import BytesIO
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from common import told
from parts import calibrated_again

from realitygap.calibration.unit import PROFILE, calibrated_unit
from realitygap.control.encoding import genotype_of
from realitygap.correspondence.score import compare, exemplar_scale
from realitygap.correspondence.setting import setting_of
from realitygap.correspondence.trials import resampled
from realitygap.errors import TrackError
from realitygap.experiments.experiment import (
    RESULTS,
    Made,
    Phase,
    Phases,
    Recorded,
    Seconds,
    Settings,
    kept,
    missing,
    open_folder,
    session,
    write_table,
)
from realitygap.files import atomic_write, to_toml
from realitygap.robots.address import Address
from realitygap.simulation.simulation import Simulation
from realitygap.streams import named_stream
from realitygap.study.config import Condition as Evolved
from realitygap.study.config import StudyConfig, TaskSettings
from realitygap.study.plan import named
from realitygap.study.provenance import versions
from realitygap.tasks.load import load_task
from realitygap.tasks.task import Task
from realitygap.track import Track
from realitygap.transfer.paths import score
from realitygap.transfer.rig import Rig
from realitygap.values import Floats, Pose
from realitygap.work.pool import Setup, Tell, Workers, far, near
from realitygap.world.robot import Profile, load_profile

TASK = "obstacle-avoidance"
PARTS = ("wheels", "infrared-wall", "infrared-cylinder")
"""The recordings of a unit: the task has no lamp."""
NOISES = (0.0, 1.0)
ALL, LOOKUP = "own, all", "look-up table"
KNOWN = {"paper": 0.0, "another unit": 0.0, "own, 5 %": 0.05, "own, 20 %": 0.2, ALL: 1.0, LOOKUP: 1.0}
"""What the simulation may know of the unit, and the share of the standard recording that it needs."""
AGAIN = [known for known, share in KNOWN.items() if share and known != ALL]
"""Further calibrations from a unit's recordings, in this order."""
FIGURES = ("correspondence", "behaviour", "layout", "fitness_situated", "fitness_simulated", "lost")
LEAST_TRIALS = 2
COSTS = (90.0, 0.4, 1.3e-3, 0.3)
"""Approximate times on one core, s: a unit's calibrations, a run's retest, an evaluation, a trial."""


@dataclass(frozen=True, kw_only=True)
class Design(Settings):
    """The design: `runs` of each condition take turns with the units; `starts` trials of each on its unit."""

    FILE, FACTS = "measure-or-randomise.toml", "experiment.toml"
    WHAT, COMMAND = "experiment of measuring or randomising", "python studies/measure-or-randomise/run.py"

    robot: str = "enki:khepera"
    units: int = 16
    first_unit: int = 101
    runs: int = 20
    starts: int = 4
    evaluations: int = 1000
    twin_noise: float = 1.0
    seed: int = 20263
    seconds: float | None = None

    @property
    def numbers(self) -> range:
        return range(self.first_unit, self.first_unit + self.units)

    @property
    def task(self) -> Task:
        """Obstacle avoidance with its duration."""
        task = load_task(TASK)
        return task if self.seconds is None else replace(task, seconds=self.seconds)

    def runs_of(self, unit: int) -> list[int]:
        """Numbers of a condition's runs on this unit: the units alternate."""
        return [run for run in range(1, self.runs + 1) if self.numbers[(run - 1) % self.units] == unit]


class Condition(NamedTuple):
    """What the simulation is based on, whether constants are randomised, and its noise."""

    known: str
    randomised: bool
    noise: float

    @property
    def name(self) -> str:
        """Its name in files."""
        return f"{_file(self.known)}{'-randomised' * self.randomised}-noise-{self.noise:g}"


class Controller(NamedTuple):
    """The champion of a run, from 1, of a condition; `unit` is the number of its calibration unit."""

    condition: Condition
    run: int
    unit: int


def _file(known: str) -> str:
    return known.replace(" %", "").replace(", ", "-").replace(" ", "-")


def conditions() -> list[Condition]:
    """All conditions, in the order of the tables; a look-up table has no constants to randomise."""
    drawn = {known: (False,) if known == LOOKUP else (False, True) for known in KNOWN}
    return [Condition(known, r, noise) for known in KNOWN for r in drawn[known] for noise in NOISES]


class Spread(NamedTuple):
    """Shares within which constants are drawn: sensors' sensitivities; wheels and track."""

    infrared: float
    wheels: float


def spread_of(units: list[Profile]) -> Spread:
    """Shares, in whole hundredths, for which uniform draws vary as much as some units do.

    For sensors from the median relative deviation between units of readings near a wall; for wheels from the
    root mean square deviation of speeds and track. A uniform draw within ±s has deviation s/√3.
    """

    def share(deviation: float) -> float:
        return min(0.9, max(0.01, round(math.sqrt(3.0) * deviation, 2)))

    readings = np.array([_readings(one) for one in units])
    mean = readings.mean(axis=0)
    known = mean > 0.15 * units[0].infrared.top  # lower readings show a sensor's dark value
    turns = np.array([[*one.wheels.speed_per_unit_cm_s, one.wheels.track_cm] for one in units])
    wheels = turns.std(axis=0, ddof=1) / turns.mean(axis=0)
    infrared = np.median(readings.std(axis=0, ddof=1)[known] / mean[known]) if known.any() else 0.0
    return Spread(share(float(infrared)), share(float(np.sqrt((wheels**2).mean()))))


def _readings(one: Profile) -> Floats:
    """[places · sensors] noise-free counts in front of the left wall of the task's arena."""
    simulation = Simulation(TASK, one, 0.0)
    middle, radius = simulation.task.arena.size_cm[1] / 2, one.body.radius_cm
    poses = [Pose.from_degrees(radius + d, middle, h) for d in (1.0, 2.0, 3.0) for h in range(0, 360, 45)]
    return np.concatenate([simulation.probe(pose)[0][0] for pose in poses])


class Job(NamedTuple):
    """A controller to drive its unit.

    Attributes:
        controller: the driver; genes: its champion's.
        profile: of its simulation; truth: the unit's full calibration, by which all of its tracks are scored.
        spread: of randomised constants.
    """

    controller: Controller
    genes: Any
    profile: Profile
    truth: Profile
    spread: Spread


class Experiment:
    """The experiment in a folder: who there is, what evolves where, and each unit's profiles."""

    def __init__(self, folder: Path, config: Design) -> None:
        self.folder, self.config = folder, config
        self.of = cache(lambda unit, known: load_profile(self.file(unit, known)))
        self.spread = cache(lambda: spread_of([self.of(unit, ALL) for unit in config.numbers]))
        self.controllers = [
            Controller(condition, run, unit)
            for unit in config.numbers for condition in conditions() for run in config.runs_of(unit)
        ]  # fmt: skip

    def calibrated(self, unit: int, known: str) -> Path:
        """The folder of a unit's profile by its own recording, a share of it, or a look-up table."""
        name = "table" if known == LOOKUP else f"{100 * KNOWN[known]:g}"
        return self.folder / "calibration" / f"unit-{unit}" / name

    def file(self, unit: int, known: str) -> str:
        """The profile of a state of knowledge of a unit: a file, or a shipped one's name."""
        if known == "paper":
            return known
        numbers = self.config.numbers
        if known == "another unit":
            unit, known = numbers[(numbers.index(unit) + 1) % len(numbers)], ALL
        return str(self.calibrated(unit, known) / PROFILE)

    def trials(self, one: Controller) -> Path:
        """The file of a controller's trials."""
        return self.folder / "trials" / f"unit-{one.unit}" / f"{one.condition.name}-run-{one.run}.npz"


def evolution(
    config: Design, unit: int, known: str, profile: str, spread: Spread
) -> tuple[StudyConfig, dict[Controller, str]]:
    """The study of a unit in one state of knowledge, and each controller's run in it, by name.

    All states of a unit have the same seeds.
    """
    mine, runs = [one for one in conditions() if one.known == known], config.runs_of(unit)
    drawn = {"spread": spread.infrared, "spread_wheels": spread.wheels}
    evolved = {one: Evolved(task=TASK, noise=one.noise, **(drawn if one.randomised else {})) for one in mine}
    study = StudyConfig(
        title=f"Measure or randomise: {config.robot}:{unit}, known: {known}",
        seed=named_stream(config.seed, "evolution", unit) >> 1, runs=len(runs),
        evaluations=config.evaluations, fresh_trials=1, profile=profile, conditions=tuple(evolved.values()),
        task=TaskSettings(seconds=config.seconds),
    )  # fmt: skip
    names = {
        Controller(condition, run, unit):
            f"{config.task.under(one.spread, one.spread_wheels).name}/{named(one.noise)}/{index}"
        for condition, one in evolved.items() for index, run in enumerate(runs, start=1)
    }  # fmt: skip
    return study, names


class Bench:
    """Lets controllers drive their units, in a worker; `folder` keeps cameras, None if it cannot be seen."""

    def __init__(self, config: Design, folder: Path | None) -> None:
        self._config, self._rig = config, None
        self._home = tempfile.TemporaryDirectory()
        self._cameras = Path(self._home.name) if folder is None else folder / "cameras"

    def carry_out(self, job: Job, tell: Tell) -> None:
        """A controller's trials, on its unit and simulated; sends shares of the work, then the content of its
        file: poses [2 sides, starts, rows, 3] x, y (cm), heading (rad); figures."""
        one, config = job.controller, self._config
        rig, task = self._ready(one.unit, job.truth), config.task
        rig.profile = job.profile
        study, _ = evolution(config, one.unit, one.condition.known, "paper", job.spread)
        encoding = study.encoding_for(task.of(job.profile))
        drawn = task.under(*job.spread) if one.condition.randomised else task
        simulation = Simulation(drawn, job.profile, one.condition.noise)
        driver, networks = genotype_of(encoding, job.genes).controller(), encoding.decode(job.genes[None])
        start, pairs = Simulation(task, job.truth).start, []
        for k in range(1, config.starts + 1):
            pose, names = start(named_stream(config.seed, "start", one.unit, k)), (*one.condition, one.run, k)
            situated, _ = rig.drive(driver, named_stream(config.seed, "situated", *names), pose, task.seconds)
            stream = named_stream(config.seed, "simulated", *names)
            made, _ = simulation.trajectory(networks, stream=stream, pose=pose)
            pairs.append((made.track, situated))
            tell(1.0 / config.starts)
        poses = [[np.stack([t.x, t.y, t.heading], axis=1) for t in side] for side in zip(*pairs, strict=True)]
        file = BytesIO()
        figures = self._figures(pairs, job.truth)
        np.savez_compressed(file, poses=np.array(poses, np.float32), figures=figures)
        tell(Made(str(Experiment(Path(), config).trials(one)), file.getvalue()))

    def _figures(self, driven: list[tuple[Track, Track]], truth: Profile) -> Floats:
        """Values of FIGURES, NaN if too few trials are left."""
        task, radius = self._config.task, truth.body.radius_cm
        setting, pairs = setting_of([], task), []
        for k, both in enumerate(driven, start=1):
            try:
                pairs.append([resampled(track, start=str(k), radius_cm=radius) for track in both])
            except TrackError:
                continue  # lost for too long: its behaviour is unknown
        situated, simulated = (np.mean([score(pair[i], task, truth) for pair in driven]) for i in (1, 0))
        scores = (math.nan, math.nan, math.nan)
        if len(pairs) >= LEAST_TRIALS:
            scale = exemplar_scale(setting.exemplars, len(driven), len(driven), matched=True)
            here, there = ([pair[i] for pair in pairs] for i in (0, 1))
            found = compare(here, there, setting, scale=scale, resamples=0)
            scores = (found.score, found.behaviour, found.layout)
        return np.array([*scores, situated, simulated, len(driven) - len(pairs)])

    def _ready(self, unit: int, truth: Profile) -> Rig:
        """The unit in the task's arena, under a camera calibrated for its true body."""
        config = self._config
        address = Address.parse(f"{config.robot}:{unit}")
        if self._rig is None or self._rig.robot != address:
            if self._rig is not None:
                self._rig.close()
            self._rig = Rig(config.task, truth, robot=address, twin_noise=config.twin_noise,
                            folder_for_camera=self._cameras)  # fmt: skip
            _ = self._rig.tracker  # before the profile is replaced
        return self._rig

    def close(self) -> None:
        """Release everything."""
        if self._rig is not None:
            self._rig.close()
        self._home.cleanup()


class Left(Phases):
    """The phases that are not finished: calibrate, evolve, drive."""

    def __init__(self, made: Experiment, pool: Any) -> None:
        self.made, self.pool, config = made, pool, made.config
        self.left = missing({one: made.trials(one) for one in made.controllers})
        units = {unit: made.calibrated(unit, AGAIN[-1]) / PROFILE for unit in config.numbers}
        self.uncalibrated = missing(units)
        every, left = len(made.controllers), len(self.left)
        unit, run, evaluation, trial = COSTS
        self.phases = (
            Phase("calibrate", "calibrating to the units", "units", len(units), len(self.uncalibrated), unit),
            Phase("evolve", "evolving", "runs", every, left, run + config.evaluations * evaluation),
            Phase("situated", "on the units", "controllers", every, left, trial * config.starts),
        )  # fmt: skip
        super().__init__(made.folder, pool, self.phases, told)

    def carry_out(self, recorders: Workers) -> None:
        """Carry out every unfinished phase."""
        calibrating, evolving, driving = self.phases
        made, parts = self.made, len(PARTS) + 1 + len(AGAIN)
        self.calibrate(calibrating, self.uncalibrated, partial(self._record, recorders), parts)
        keys = list(dict.fromkeys((one.unit, one.condition.known) for one in made.controllers))
        designs = {key: evolution(made.config, *key, made.file(*key), made.spread()) for key in keys}
        places = {(u, known): made.folder / "evolved" / f"unit-{u}" / _file(known) for u, known in keys}
        studies = self.evolve(evolving, ((places[k], designs[k][0], len(designs[k][1])) for k in keys))
        evolved = dict(zip(keys, studies, strict=True))

        def jobs() -> Iterator[Job]:
            for one in self.left:
                key = (one.unit, one.condition.known)
                champion = evolved[key].run(designs[key][1][one]).champion
                yield Job(one, champion, made.of(*key), made.of(one.unit, ALL), made.spread())

        setup = Setup(Bench, (made.config, None if far(self.pool) else made.folder))
        self.drive(driving, lambda: setup, jobs())

    def _record(self, recorders: Workers, unit: int, heard: Recorded) -> None:
        """Record a unit once, and fit all of its recordings, shares of them and a table."""
        config, place = self.made.config, self.made.calibrated(unit, ALL)
        calibrated_unit(
            place, unit=unit if config.robot == "twin" else f"{config.robot}:{unit}", noise=config.twin_noise,
            seed=named_stream(config.seed, "calibration", unit) >> 1, workers=recorders, parts=PARTS,
            on_progress=heard,
        )  # fmt: skip
        for known in AGAIN:
            calibrated_again(
                self.made.calibrated(unit, known), of=place, share=KNOWN[known],
                form="lookup" if known == LOOKUP else None, workers=recorders,
            )  # fmt: skip
            heard(known, 1, 1)


def write_results(made: Experiment) -> Path:
    """controllers.csv and calibration.csv, from which `analyse.py` takes all else; experiment.toml."""
    config, place = made.config, made.folder / RESULTS
    place.mkdir(parents=True, exist_ok=True)
    order = sorted(made.controllers, key=lambda one: (conditions().index(one.condition), one.run))
    rows: list[dict[str, object]] = []
    for one in order:
        with (
            kept(made.trials(one), "the results of a controller's trials"),
            np.load(made.trials(one)) as arrays,
        ):
            figures = dict(zip(FIGURES, arrays["figures"].tolist(), strict=True))
        rows.append({**one.condition._asdict(), "run": one.run, "unit": one.unit, **figures})
    write_table(place / "controllers.csv", rows)
    own = [known for known, share in KNOWN.items() if share]
    profiles = [(unit, known, made.of(unit, known).provenance) for unit in config.numbers for known in own]
    fits = [
        {"unit": unit, "known": known, "channel": fit.channel, "model_error": fit.model_error,
         "noise": fit.noise, "ratio": fit.ratio, "recordings": len(where.files)}
        for unit, known, where in profiles for fit in where.fits
    ]  # fmt: skip
    write_table(place / "calibration.csv", fits, ("unit", "known", "channel", "model_error", "noise", "ratio",
                                                  "recordings"))  # fmt: skip
    facts = {
        **config.to_dict(), "spread": made.spread()._asdict(), "controllers": len(order),
        "seconds": Seconds(made.folder).read(), "versions": versions(),
    }  # fmt: skip
    atomic_write(place / config.FACTS, to_toml(facts))
    return place


def main(words: Sequence[str] | None = None) -> None:
    """Carry it out, and say where its tables are."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("out/measure-or-randomise"))
    parser.add_argument("--robot", default="enki:khepera", choices=("enki:khepera", "twin", "stranger"))
    for key in ("units", "first-unit", "runs", "starts", "evaluations", "seed"):
        usual = getattr(Design, key.replace("-", "_"))
        parser.add_argument(f"--{key}", type=int, default=usual, help="[%(default)s]")
    parser.add_argument("--twin-noise", type=float, default=1.0, help="[%(default)s]")
    parser.add_argument("--seconds", type=float, help="length of a trial, to try it out")
    parser.add_argument("--workers", type=int, help="processes [one a core]")
    parser.add_argument("--resume", action="store_true", help="go on with the experiment in the folder")
    asked = vars(parser.parse_args(words))
    out, workers, resume = (asked.pop(key) for key in ("out", "workers", "resume"))
    with session(out, workers) as pool:
        config = open_folder(out, Design, None if resume else Design(**asked), resume=resume)
        made = Experiment(out.resolve(), config)
        Left(made, pool).carry_out(near(workers))
        print(f"results {write_results(made)}")


if __name__ == "__main__":
    main()
