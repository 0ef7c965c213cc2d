"""The controllers of a study of noise: their names, their places, where their randomness comes from.

Whatever is drawn is a function of names alone, so that neither the order of work nor what else is
in the study changes a bit.
"""

import hashlib
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import count
from pathlib import Path

from realitygap.experiments.noise.config import NoiseConfig
from realitygap.study.config import StudyConfig
from realitygap.study.parts import Condition, TaskSettings
from realitygap.study.plan import named
from realitygap.work.shard import Shard

__all__ = [
    "Controller", "calibration_folder", "controllers", "evolution", "evolved_folder", "homes", "share",
    "simulated_file", "situated_file", "stream",
]  # fmt: skip

FRESH_TRIALS = 1
"""Of the champion at the paper's levels: no claim needs them, the paths that are compared tell more."""


@dataclass(frozen=True, kw_only=True)
class Controller:
    """The champion of run number `run` (from 1) in its seed set, task and level.

    Attributes:
        home: the unit that the simulation it evolved in was calibrated to.
        run_name: its run's name in the study of its seed set and calibration unit.
    """

    task: str
    seed_set: int
    level: float
    run: int
    home: int
    run_name: str

    @property
    def name(self) -> str:
        """As the names of files and messages have it."""
        return f"{self.task}-set-{self.seed_set}-level-{self.level!r}-run-{self.run}"


def controllers(config: NoiseConfig) -> tuple[Controller, ...]:
    """All of them, grouped by task and calibration unit, so that whoever takes them in order changes robots
    seldom."""
    made = [
        Controller(
            task=task,
            seed_set=seed_set,
            level=level,
            run=run,
            home=home,
            run_name=f"{task}/{named(level)}/{index}",
        )
        for task in config.tasks
        for home in range(1, config.units + 1)
        for seed_set in range(1, config.seed_sets + 1)
        for level in config.levels
        for index, run in enumerate(_runs(config, home), start=1)
    ]
    return tuple(made)


def share(config: NoiseConfig, shard: Shard) -> tuple[Controller, ...]:
    """A shard's controllers: those of its runs in every study of evolution."""
    taken: dict[tuple[int, int], Iterator[bool]] = {}
    every = controllers(config)
    for one in every:
        taken.setdefault(
            (one.seed_set, one.home), (number % shard.of == shard.number - 1 for number in count())
        )
    return tuple(one for one in every if next(taken[one.seed_set, one.home]))


def homes(config: NoiseConfig) -> Iterator[tuple[int, int]]:
    """Seed set and unit of each study of evolution that has runs."""
    for seed_set in range(1, config.seed_sets + 1):
        for unit in range(1, config.units + 1):
            if _runs(config, unit):
                yield seed_set, unit


def evolution(config: NoiseConfig, seed_set: int, unit: int, profile: Path) -> StudyConfig:
    """What evolves in the simulation calibrated to a unit, in one seed set.

    Args:
        config: the whole design.
        seed_set: number of the set.
        unit: of the twin, that the simulation is calibrated to.
        profile: the file of that calibration.
    """
    conditions = (Condition(task=task, noise=level) for task in config.tasks for level in config.levels)
    return StudyConfig(
        title=f"Noise level: seed set {seed_set}, simulation calibrated to unit {unit}",
        seed=stream(config, "evolution", seed_set, unit) >> 1,
        runs=len(_runs(config, unit)),
        evaluations=config.evaluations,
        fresh_trials=FRESH_TRIALS,
        profile=str(profile),
        conditions=tuple(conditions),
        task=TaskSettings(seconds=config.seconds),
        arenas={} if config.arena is None else {config.tasks[0]: config.arena},
    )


def _runs(config: NoiseConfig, unit: int) -> list[int]:
    """Numbers of a seed set's runs calibrated to this unit: the units take turns."""
    return [run for run in range(1, config.runs_in_set + 1) if 1 + (run - 1) % config.units == unit]


def stream(config: NoiseConfig, *names: object) -> int:
    """The stream of whatever these names name, 0 to 2⁶⁴ − 1."""
    text = "/".join(map(repr, (config.seed, *names)))
    return int.from_bytes(hashlib.blake2b(text.encode(), digest_size=8).digest(), "little")


def calibration_folder(folder: Path, unit: int) -> Path:
    """Where a unit was recorded and its profile is."""
    return folder / "calibration" / f"unit-{unit}"


def evolved_folder(folder: Path, seed_set: int, unit: int) -> Path:
    """The study of evolution of a seed set and calibration unit."""
    return folder / "evolved" / f"set-{seed_set}-unit-{unit}"


def situated_file(folder: Path, one: Controller) -> Path:
    """The paths of a controller on the twin's units."""
    return folder / "situated" / f"{one.name}.npz"


def simulated_file(folder: Path, one: Controller) -> Path:
    """What came of the comparison of those with the simulations."""
    return folder / "simulated" / f"{one.name}.json"
