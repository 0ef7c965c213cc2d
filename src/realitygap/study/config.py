"""A study's configuration: every setting that a result depends on, read from and written to TOML.

A condition is a task at a noise level; each is evolved `runs` times. Omitted settings have the paper's value.
Paths are relative to the file that names them.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, fields, replace
from os import PathLike
from pathlib import Path
from typing import Any, Self

from realitygap.control.encoding import Encoding as Made
from realitygap.control.encoding import Variation
from realitygap.errors import ConfigError
from realitygap.files import as_path, read_toml
from realitygap.plugins import place_of, placed
from realitygap.study.parts import NAMED, Condition, Encoding, Evolution, TaskSettings, with_own
from realitygap.study.settings import LARGEST, apply, whole
from realitygap.tasks.load import reference
from realitygap.tasks.task import Task
from realitygap.world.robot import NOISE_LEVELS, noise_level
from realitygap.world.toml import Value, build, require

__all__ = ["Condition", "Encoding", "Evolution", "StudyConfig", "TaskSettings"]

SIZES = ("inputs", "slots", "links")
"""Of a `Variation`: the encoding has them."""


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
        cure = "Each condition is run `runs` times: leave out the repetition."
        pairs = [(c.task, c.noise, c.spread, c.spread_wheels) for c in self.conditions]
        twice = next((f"{p[0]}, noise {p[1]:g}, twice" for k, p in enumerate(pairs) if p in pairs[:k]), None)
        if twice:
            raise ConfigError(f"conditions: expected different ones, got {twice}. {cure}")
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
        title = "Jakobi, Husbands and Harvey (1995), carried out anew"
        return cls(title=title, runs=runs, evaluations=evaluations, seed=seed, conditions=conditions)

    @classmethod
    def single(cls, task: str | PathLike[str] | Task, noise: str | float = "observed", **others: Any) -> Self:
        """One task at one noise level; `others` are further fields."""
        condition = Condition(task=reference(task), noise=noise_level(noise))
        return cls(conditions=(condition,), **{"runs": 1, **others})

    @classmethod
    def from_dict(cls, table: Mapping[str, Any]) -> Self:
        """From a dictionary with a file's keys (`versions`, which a study adds, is left out)."""
        require(isinstance(table, Mapping), "configuration", "a table of keys and values", table)
        try:
            return build(cls, {key: value for key, value in with_own(table).items() if key != "versions"})
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

        return replace(
            self.with_own_files(lambda _, file: found(str(file))),
            profile=found(self.profile),
            conditions=tuple(replace(c, task=found(c.task)) for c in self.conditions),
            arenas={task: found(arena) for task, arena in self.arenas.items()},
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
