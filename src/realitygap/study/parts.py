"""The tables of a study's configuration: its conditions and their common settings."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import Any

from realitygap.control.encoding import SLOTS, Variation, make_encoding
from realitygap.control.encoding import Encoding as Made
from realitygap.errors import ConfigError, UsageError
from realitygap.evolution import make_algorithm
from realitygap.evolution.algorithm import Algorithm
from realitygap.plugins import place_of
from realitygap.study.settings import whole
from realitygap.tasks.load import reference
from realitygap.tasks.task import check_spread
from realitygap.world.robot import NOISE_LEVELS, noise_level, noise_name
from realitygap.world.toml import Value, require

__all__ = ["NAMED", "Condition", "Encoding", "Evolution", "TaskSettings", "with_own"]


@dataclass(frozen=True, kw_only=True)
class Condition(Value):
    """A task (its name or file, or itself) at a noise level (zero, observed, double or a number).

    With a `spread` constants are drawn for each trial, and runs belong to a task named after it;
    `spread_wheels` is the spread of wheels and track if it differs.
    """

    task: str
    noise: float = 1.0
    spread: float = 0.0
    spread_wheels: float | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "task", reference(self.task))
        object.__setattr__(self, "noise", noise_level(self.noise))
        super().__post_init__()

    def to_dict(self) -> dict[str, Any]:
        """The condition as in its file."""
        named = self.noise in NOISE_LEVELS.values()
        noise = noise_name(self.noise) if named else self.noise
        spread = {"spread": self.spread} if self.spread else {}
        wheels = {} if self.spread_wheels is None else {"spread_wheels": self.spread_wheels}
        return {"task": self.task, "noise": noise, **spread, **wheels}

    def _check(self) -> None:
        check_spread(self.spread, self.spread_wheels)


@dataclass(frozen=True, kw_only=True)
class TaskSettings(Value):
    """Changes to every task of the study; None keeps the task's value."""

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
        """The settings that are not None."""
        return {f.name: v for f in fields(self) if (v := getattr(self, f.name)) is not None}

    def to_dict(self) -> dict[str, Any]:
        """The same, ready for TOML."""
        return {key: list(v) if isinstance(v, tuple) else v for key, v in self.changes().items()}


@dataclass(frozen=True, kw_only=True)
class Encoding(Value):
    """How genes encode networks: "slots" (§5.2) with numbers of slots and links, or FILE.py:NAME.

    A network's inputs are the task's sensors. `own` are the settings of a user's encoding, from its table;
    they are checked when its file is run.
    """

    kind: str = SLOTS
    slots: int | None = None
    links: int | None = None
    own: Mapping[str, Any] = field(default_factory=dict)

    def _check(self) -> None:
        if place_of(self.kind):
            return
        require(not self.own, "own", "nothing: it belongs to FILE.py:NAME", self.own)
        require(self.kind == SLOTS, "kind", f'"{SLOTS}" or FILE.py:NAME', self.kind)
        for key, most, usual in (("slots", 128, 30), ("links", 128, 8)):
            value = usual if getattr(self, key) is None else getattr(self, key)
            whole(key, value, 3 if key == "slots" else 1, most)
            object.__setattr__(self, key, value)

    def make(self, inputs: int, variation: Variation) -> Made:
        """The encoding of networks with `inputs` inputs; `variation` has rates of the slots' operators."""
        settings = {key: value for key, value in self.to_dict().items() if key != "kind"}
        return make_encoding(self.kind, variation, settings, inputs=inputs)

    def to_dict(self) -> dict[str, Any]:
        """Its own settings, and its name unless it is the paper's, as files of any version have it."""
        return {key: value for key, value in _set(self).items() if (key, value) != ("kind", SLOTS)}


@dataclass(frozen=True, kw_only=True)
class Evolution(Value):
    """The algorithm: "torus" (rows, columns), "panmictic" or "random" (size), or FILE.py:NAME.

    `own` are the settings of a user's algorithm, from its table; they are checked when its file is run.
    """

    algorithm: str = "torus"
    rows: int | None = None
    columns: int | None = None
    size: int | None = None
    own: Mapping[str, Any] = field(default_factory=dict)

    def _check(self) -> None:
        if place_of(self.algorithm):
            return
        require(not self.own, "own", "nothing: it belongs to FILE.py:NAME", self.own)
        try:
            algorithm = self.make(Variation())
        except UsageError as error:
            raise ConfigError(f"algorithm {self.algorithm!r}: {error}") from None
        for key in ("rows", "columns", "size"):
            object.__setattr__(self, key, getattr(algorithm, key, None))

    def make(self, encoding: Made) -> Algorithm[Any]:
        """The algorithm, for individuals of an encoding."""
        settings = self.to_dict()
        return make_algorithm(settings.pop("algorithm"), encoding, **settings)

    def to_dict(self) -> dict[str, Any]:
        """The algorithm and its own settings."""
        return _set(self)


NAMED = {"evolution": "algorithm", "encoding": "kind"}
"""Tables of a configuration that may name a user's file, and the key that does."""


def with_own(table: Mapping[str, Any]) -> dict[str, Any]:
    """A configuration's dictionary with the settings of users' programs moved to `own`."""
    made = dict(table)
    for part, key in NAMED.items():
        inner = table.get(part)
        if isinstance(inner, Mapping) and place_of(inner.get(key, "")):
            made[part] = {key: inner[key], "own": {k: v for k, v in inner.items() if k != key}}
    return made


def _set(part: Encoding | Evolution) -> dict[str, Any]:
    plain = {f.name: v for f in fields(part) if f.name != "own" and (v := getattr(part, f.name)) is not None}
    return {**plain, **part.own}
