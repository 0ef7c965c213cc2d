"""A study's configuration: every setting that a result depends on, read from and written to TOML.

A condition is a task at a noise level; each is evolved `runs` times. Omitted settings have the paper's value.
Paths are relative to the file that names them.
"""

import copy
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from os import PathLike
from pathlib import Path
from typing import Any, Self

from realitygap.control.encoding import SLOTS, Variation, make_encoding
from realitygap.control.encoding import Encoding as Made
from realitygap.errors import ConfigError, UsageError
from realitygap.evolution import make_algorithm
from realitygap.evolution.algorithm import Algorithm
from realitygap.files import as_path, parse_toml, read_toml, refuse_unknown
from realitygap.plugins import place_of, placed
from realitygap.tasks.load import reference
from realitygap.tasks.task import Task, check_spread
from realitygap.work.folder import settings_in
from realitygap.world.robot import NOISE_LEVELS, noise_level, noise_name
from realitygap.world.toml import Value, build, require

__all__ = ["LARGEST", "Condition", "Encoding", "Evolution", "StudyConfig", "TaskSettings", "whole"]

LARGEST = 2**63 - 1
"""The largest seed."""
SIZES = ("inputs", "slots", "links")
"""Of a `Variation`: the encoding has them."""


def whole(key: str, value: object, low: int, high: int) -> None:
    """Refuse anything but a whole number from `low` to `high`.

    Args:
        key: its name in the message.
        value: to be checked.
        low, high: the limits, both allowed.

    Raises:
        ConfigError: names the key.
    """
    if isinstance(value, bool) or not isinstance(value, int) or not low <= value <= high:
        limits = f"from {low} to {high}" if high < 2**62 else f", {low} or more"
        raise ConfigError(f"{key}: expected a whole number {limits}, got {value!r}.".replace(" ,", ","))


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


@dataclass(frozen=True, kw_only=True)
class StudyConfig(Value):
    """A study's whole configuration.

    Attributes:
        title: for people, on the report.
        seed: random seed.
        runs: evolutionary runs of each condition; evaluations: in each run, the first population
            included.
        retest_trials: trials that choose the champion among the last population.
        fresh_trials: trials of the fittest and the champion at each of the paper's levels and at their own.
        checkpoint_every: evaluations that a kill can lose; does not affect results.
        profile: the robot, a shipped name or a TOML file.
        conditions: tasks and noise levels, in this order.
        task: changes to every task, such as `task.seconds`.
        evolution, encoding: the algorithm, and how genes encode networks; variation: rates of the operators
            on the paper's genotypes.
        arenas: another arena for a task, by the task's name.

    Raises:
        ConfigError: names the key, what was expected and what came.
    """

    title: str = ""
    seed: int = 1995
    runs: int = 5
    evaluations: int = 1000
    retest_trials: int = 20
    fresh_trials: int = 200
    checkpoint_every: int = 100
    profile: str = "paper"
    conditions: tuple[Condition, ...] = ()
    task: TaskSettings = field(default_factory=TaskSettings)
    evolution: Evolution = field(default_factory=Evolution)
    variation: Variation = field(default_factory=Variation)
    encoding: Encoding = field(default_factory=Encoding)
    arenas: dict[str, str] = field(default_factory=dict)

    def _check(self) -> None:
        whole("seed", self.seed, 0, LARGEST)
        whole("runs", self.runs, 1, 10**6)
        whole("evaluations", self.evaluations, 1, 10**9)
        for key in ("retest_trials", "fresh_trials"):
            whole(key, getattr(self, key), 1, 10**6)
        whole("checkpoint_every", self.checkpoint_every, 1, 10**5)
        require(bool(self.conditions), "conditions", "one or more, each a task and a noise level", [])
        for key in SIZES:
            size = getattr(self.variation, key)
            plain = size == getattr(Variation, key)
            require(plain, f"variation.{key}", "nothing: use encoding.slots and encoding.links", size)
        texts = isinstance(self.arenas, Mapping) and all(isinstance(v, str) for v in self.arenas.values())
        expected = 'task names with an arena each, such as light-seeking = "mine.toml"'
        require(texts, "arenas", expected, self.arenas)

    @classmethod
    def reproduction(cls, *, runs: int = 5, evaluations: int = 1000, seed: int = 1995) -> Self:
        """The paper's study (§6): two tasks at three noise levels."""
        conditions = tuple(
            Condition(task=task, noise=noise)
            for task in ("obstacle-avoidance", "light-seeking")
            for noise in NOISE_LEVELS.values()
        )
        title = "Noise and the Reality Gap (1995), reproduced"
        return cls(title=title, runs=runs, evaluations=evaluations, seed=seed, conditions=conditions)

    @classmethod
    def single(cls, task: str | PathLike[str] | Task, noise: str | float = "observed", **others: Any) -> Self:
        """One task at one noise level; `others` are further fields."""
        condition = Condition(task=reference(task), noise=noise_level(noise))
        return cls(conditions=(condition,), **{"runs": 1, **others})

    @classmethod
    def from_dict(cls, table: Mapping[str, Any]) -> Self:
        """From a dictionary with a file's keys; what a study adds (`versions`, `sha256`) is left out."""
        require(isinstance(table, Mapping), "configuration", "a table of keys and values", table)
        try:
            return build(cls, with_own(settings_in(table)))
        except ConfigError:
            raise
        except ValueError as error:  # the algorithm's and the variation's own keys
            raise ConfigError(str(error)) from None

    @classmethod
    def from_toml(cls, path: str | Path, *, local: bool = False, task: str | None = None) -> Self:
        """From a file; relative paths in it become absolute, unless they are to stay `local`.

        A file without conditions is completed by `task` at observed noise.

        Raises:
            ConfigError: names the file and the key or the line.
        """
        path = as_path(path, "configuration")
        table = read_toml(path, ConfigError, "Give the path of a study's TOML file.")
        try:
            if task is not None:
                table.setdefault("conditions", [{"task": task}])
            config = cls.from_dict(table)
            return config if local else config.beside(path.parent)
        except ConfigError as error:
            raise ConfigError(f"{path}: {error}") from None

    def beside(self, folder: Path) -> Self:
        """A copy with relative file names resolved against `folder`."""

        def found(name: str) -> str:
            path = Path(name).expanduser()
            return str((folder / path).resolve()) if path.suffix in (".py", ".toml") else name

        return self.with_files(found)

    def with_files(self, moved: Callable[[str], str]) -> Self:
        """A copy with every name of a task, profile, arena or program as `moved` says."""
        return replace(
            self.with_own_files(lambda _, file: moved(file.as_posix())),
            profile=moved(self.profile),
            conditions=tuple(replace(c, task=moved(c.task)) for c in self.conditions),
            arenas={task: moved(arena) for task, arena in self.arenas.items()},
        )

    def with_settings(self, settings: Iterable[str]) -> Self:
        """A copy with settings such as "variation.mutation=0.1" applied.

        Raises:
            ConfigError: names the key, with the nearest known one, or what was expected of it.
        """
        return self.from_dict(apply(self.to_dict(), settings))

    def own_files(self) -> dict[str, Path]:
        """The files of a user's algorithm and encoding, by the table that names each."""
        named = {part: place_of(getattr(getattr(self, part), key)) for part, key in NAMED.items()}
        return {part: place[0] for part, place in named.items() if place is not None}

    def with_own_files(self, moved: Callable[[str, Path], str]) -> Self:
        """A copy with those files moved to where `moved` says for a table and a file."""
        changes = {}
        for part, file in self.own_files().items():
            table = getattr(self, part)
            name = placed(getattr(table, NAMED[part]), moved(part, file))
            changes[part] = replace(table, **{NAMED[part]: name})
        return replace(self, **changes)

    def encoding_for(self, task: Task) -> Made:
        """The encoding of networks with an input for each of the task's sensors."""
        return self.encoding.make(len(task.sensors), self.variation)

    def to_dict(self) -> dict[str, Any]:
        """The configuration as a dictionary with a file's keys."""
        rates = {f.name: getattr(self.variation, f.name) for f in fields(Variation) if f.name not in SIZES}
        plain = {f.name: getattr(self, f.name) for f in fields(self)}
        return {
            **plain,
            "conditions": [c.to_dict() for c in self.conditions],
            "task": self.task.to_dict(),
            "evolution": self.evolution.to_dict(),
            "variation": rates,
            "encoding": self.encoding.to_dict(),
            "arenas": dict(self.arenas),
        }


def apply(table: Mapping[str, Any], settings: Iterable[str]) -> dict[str, Any]:
    """A configuration's dictionary with settings "key=value" applied; `key` may have dots.

    Raises:
        ConfigError: a text that is not a setting, or an unknown first part of a key.
    """
    changed = copy.deepcopy(dict(table))
    pairs = [_pair(text) for text in settings]
    for named in ("evolution.algorithm", "encoding.kind"):
        if any(key == named for key, _ in pairs):
            changed[named.partition(".")[0]] = {}  # the settings of one algorithm are not those of another
    for key, value in pairs:
        first, *rest = key.split(".")
        refuse_unknown([first], changed, ConfigError)
        *middle, last = [first, *rest]
        inner: Any = changed
        for part in middle:
            inner = inner.get(part) if isinstance(inner, dict) else None
        if not isinstance(inner, dict):
            raise ConfigError(f"{key}: unknown key. {first!r} has no parts of that name.")
        inner[last] = value
    return changed


def _pair(text: str) -> tuple[str, Any]:
    """Key and value of "key=value": the value as TOML, or else as text."""
    key, sign, value = text.partition("=")
    key, value = key.strip(), value.strip()
    if not sign or not key or not value:
        raise ConfigError(f"expected a setting key=value, such as variation.mutation=0.1, got {text!r}.")
    try:
        return key, parse_toml(f"value = {value}")["value"]
    except (ValueError, KeyError):
        return key, value
