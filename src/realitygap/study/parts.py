"""The tables of a study's configuration: its conditions and what they share."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any

from realitygap.controller.operators import Variation
from realitygap.errors import ConfigError, UsageError
from realitygap.evolution import make_algorithm
from realitygap.evolution.algorithm import Algorithm
from realitygap.study.settings import whole
from realitygap.tasks.load import reference
from realitygap.world.files import Value, require
from realitygap.world.noise import NOISE_LEVELS, noise_level, noise_name

__all__ = ["Condition", "Encoding", "Evolution", "TaskSettings"]


@dataclass(frozen=True, kw_only=True)
class Condition(Value):
    """A task (its name or file, or itself) at a noise level (zero, observed, double or a number)."""

    task: str
    noise: float = 1.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "task", reference(self.task))
        object.__setattr__(self, "noise", noise_level(self.noise))
        super().__post_init__()

    def to_dict(self) -> dict[str, Any]:
        """The condition as in its file."""
        named = self.noise in NOISE_LEVELS.values()
        return {"task": self.task, "noise": noise_name(self.noise) if named else self.noise}


@dataclass(frozen=True, kw_only=True)
class TaskSettings(Value):
    """Changes to every task of the study; None leaves what the task says."""

    seconds: float | None = None
    trials: int | None = None
    sensors: Sequence[int] | None = None

    def _check(self) -> None:
        if self.trials is not None:
            whole("trials", self.trials, 1, 1000)
        if self.sensors is not None:
            listed = isinstance(self.sensors, list | tuple)
            require(listed, "sensors", "a list of sensor numbers", self.sensors)
            object.__setattr__(self, "sensors", tuple(self.sensors))

    def changes(self) -> dict[str, Any]:
        """What is set."""
        return {f.name: v for f in fields(self) if (v := getattr(self, f.name)) is not None}

    def to_dict(self) -> dict[str, Any]:
        """What is set, ready for TOML."""
        return {key: list(v) if isinstance(v, tuple) else v for key, v in self.changes().items()}


@dataclass(frozen=True, kw_only=True)
class Encoding(Value):
    """The size of a genotype (§5.2); its inputs are the task's sensors."""

    slots: int = 30
    links: int = 8

    def _check(self) -> None:
        whole("slots", self.slots, 3, 128)
        whole("links", self.links, 1, 128)


@dataclass(frozen=True, kw_only=True)
class Evolution(Value):
    """The algorithm: "torus" (rows, columns), "panmictic" or "random" (size)."""

    algorithm: str = "torus"
    rows: int | None = None
    columns: int | None = None
    size: int | None = None

    def _check(self) -> None:
        try:
            algorithm = self.make(Variation())
        except UsageError as error:
            raise ConfigError(f"algorithm {self.algorithm!r}: {error}") from None
        for key in ("rows", "columns", "size"):
            object.__setattr__(self, key, getattr(algorithm, key, None))

    def make(self, variation: Variation) -> Algorithm:
        """The algorithm, on genotypes of a variation."""
        settings = self.to_dict()
        return make_algorithm(settings.pop("algorithm"), variation, **settings)

    def to_dict(self) -> dict[str, Any]:
        """The algorithm and its own settings."""
        return {f.name: v for f in fields(self) if (v := getattr(self, f.name)) is not None}
