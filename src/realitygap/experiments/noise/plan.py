"""The controllers of a study of noise: their names, folders and random streams.

Every draw is a function of names alone, so that neither the order of work nor the rest of the study affects
results.
"""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

from realitygap.experiments.noise.config import NoiseConfig
from realitygap.streams import named_stream
from realitygap.study.config import StudyConfig
from realitygap.study.parts import Condition, TaskSettings
from realitygap.study.plan import named
from realitygap.work.shard import Shard

__all__ = [
    "Controller", "Evolved", "Pair", "calibration_folder", "controllers", "evolution", "evolved",
    "evolved_folder", "share", "simulated_file", "situated_file", "stream",
]  # fmt: skip

FRESH_TRIALS = 1
"""Of the champion at the paper's levels: no claim needs them, and the compared paths are more informative."""


@dataclass(frozen=True, kw_only=True)
class Controller:
    """An individual of run number `run` (from 1) of its seed set, task and level.

    Attributes:
        home: its calibration unit.
        run_name: its run's name in its study of evolution.
        individual: champion, or fittest: of the last population, by its stored fitness.
    """

    task: str
    seed_set: int
    level: float
    run: int
    home: int
    run_name: str
    individual: str = "champion"

    @property
    def key(self) -> tuple[object, ...]:
        """The names of the streams of its trials."""
        who = () if self.individual == "champion" else (self.individual,)
        return (self.task, self.seed_set, self.level, self.run, *who)

    @property
    def name(self) -> str:
        """Its name in files and messages."""
        who = "" if self.individual == "champion" else f"-{self.individual}"
        return f"{self.task}-set-{self.seed_set}-level-{self.level!r}-run-{self.run}{who}"


class Pair(NamedTuple):
    """Unit and start of a trial, both from 1."""

    unit: int
    start: int


class Evolved(NamedTuple):
    """A study of evolution: a seed set, a calibration unit, and the levels with this many runs there."""

    seed_set: int
    unit: int
    runs: int
    levels: tuple[float, ...]


def controllers(config: NoiseConfig) -> tuple[Controller, ...]:
    """All controllers, grouped by task and calibration unit, so that work in order rarely changes robots."""
    return tuple(replace(one, individual=who) for one in _champions(config) for who in config.individuals)


def _champions(config: NoiseConfig) -> list[Controller]:
    return [
        Controller(
            task=task,
            seed_set=seed_set,
            level=level,
            run=run,
            home=home,
            run_name=f"{task}/{named(level)}/{index}",
        )
        for task in config.tasks
        for home in config.every_unit
        for seed_set in range(1, config.seed_sets + 1)
        for level in config.levels
        for index, run in enumerate(_runs(config, home, level), start=1)
    ]


def share(config: NoiseConfig, shard: Shard) -> tuple[Controller, ...]:
    """A shard's controllers: those of its runs in every study of evolution."""
    studies: dict[Evolved, list[Controller]] = {}
    for one in _champions(config):
        studies.setdefault(evolved(config, one), []).append(one)
    own = {one for several in studies.values() for one in shard.own(several)}
    return tuple(one for one in controllers(config) if replace(one, individual="champion") in own)


def evolved(config: NoiseConfig, one: Controller) -> Evolved:
    """The study that a controller evolved in: levels with other numbers of runs have a separate one."""
    runs = len(_runs(config, one.home, one.level))
    alike = tuple(level for level in config.levels if len(_runs(config, one.home, level)) == runs)
    return Evolved(one.seed_set, one.home, runs, alike)


def evolution(config: NoiseConfig, made: Evolved, profile: Path) -> StudyConfig:
    """The configuration of a study of evolution; `profile` is the file of its unit's calibration."""
    conditions = (Condition(task=task, noise=level) for task in config.tasks for level in made.levels)
    return StudyConfig(
        title=f"Noise level: seed set {made.seed_set}, simulation calibrated to unit {made.unit}",
        seed=stream(config, "evolution", made.seed_set, made.unit, seed_set=made.seed_set) >> 1,
        runs=made.runs,
        evaluations=config.evaluations,
        fresh_trials=FRESH_TRIALS,
        profile=str(profile),
        conditions=tuple(conditions),
        task=TaskSettings(seconds=config.seconds),
        arenas={} if config.arena is None else {config.tasks[0]: config.arena},
    )


def _runs(config: NoiseConfig, unit: int, level: float) -> range:
    """Numbers of a seed set's runs at a level calibrated to this unit: units alternate."""
    return range(unit - config.first_unit + 1, config.runs_in_set(level) + 1, config.units)


def stream(config: NoiseConfig, *names: object, seed_set: int | None = None) -> int:
    """The stream of these names, 0 to 2⁶⁴ − 1; from a seed set's own seed, if it has one."""
    seed = config.seeds[seed_set - 1] if seed_set and config.seeds else config.seed
    return named_stream(seed, *names)


def calibration_folder(folder: Path, unit: int) -> Path:
    """The folder of a unit's recordings and profile."""
    return folder / "calibration" / f"unit-{unit}"


def evolved_folder(folder: Path, config: NoiseConfig, made: Evolved) -> Path:
    more = "" if len(made.levels) == len(config.levels) else f"-runs-{made.runs}"
    return folder / "evolved" / f"set-{made.seed_set}-unit-{made.unit}{more}"


def situated_file(folder: Path, one: Controller) -> Path:
    """The file of a controller's paths on the twin's units."""
    return folder / "situated" / f"{one.name}.npz"


def simulated_file(folder: Path, one: Controller) -> Path:
    """The file of the comparisons of those with the simulations."""
    return folder / "simulated" / f"{one.name}.json"
