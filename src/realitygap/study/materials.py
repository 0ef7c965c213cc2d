"""What a study is made of: its robot, tasks and arenas, and its copies of them.

A study reads only its own folder once it is created. It can be moved, or the user's files changed, and it
still resumes and replays with the same bits.
"""

import tempfile
from collections.abc import Iterator
from dataclasses import dataclass, replace
from difflib import get_close_matches
from pathlib import Path

from realitygap.errors import ConfigError
from realitygap.study.config import StudyConfig
from realitygap.study.sources import inside
from realitygap.tasks import TASKS, copy_task, load_task
from realitygap.tasks.task import Task
from realitygap.world.arena import load_arena
from realitygap.world.robot import Profile, load_profile

__all__ = ["Materials", "gather", "own", "program_files"]

PROFILE = "profile.toml"


@dataclass(frozen=True, kw_only=True)
class Materials:
    """A study's robot and tasks (with its settings and arenas), loaded and checked."""

    config: StudyConfig
    profile: Profile
    tasks: tuple[Task, ...]
    """One for each condition, in order."""

    def task(self, name: str) -> Task:
        """The task of a name.

        Raises:
            ConfigError: the study has no such task.
        """
        for task in self.tasks:
            if task.name == name:
                return task
        known = ", ".join(dict.fromkeys(task.name for task in self.tasks))
        raise ConfigError(f"task: expected one of the study's ({known}), got {name!r}.")

    def own_code(self) -> Iterator[bytes]:
        """The text of each program that is not the package's: tasks, algorithm, encoding."""
        tasks = [Path(task.source) for task in self.tasks if task.source is not None]
        return (path.read_bytes() for path in (*tasks, *self.config.own_files().values()))

    def copies(self) -> tuple[StudyConfig, dict[str, bytes]]:
        """The configuration with every file name inside the study's folder, and those files."""
        files = {PROFILE: self.profile.to_toml().encode()}
        arenas: dict[str, str] = {}
        conditions = []
        for condition, task in zip(self.config.conditions, self.tasks, strict=True):
            name = task.plain_name
            arenas[name] = f"arenas/{name}.toml"
            files[arenas[name]] = task.arena.to_toml().encode()
            if task.source is not None:
                home = f"tasks/{name}"
                name = f"{home}/{Path(task.source).name}"
                files.update({f"{home}/{path}": content for path, content in _task_files(task).items()})
            conditions.append(replace(condition, task=name))
        for part, file in self.config.own_files().items():
            files[f"{part}/{file.name}"] = file.read_bytes()
        config = self.config.with_own_files(lambda part, file: f"{part}/{file.name}")
        config = replace(config, profile=PROFILE, conditions=tuple(conditions), arenas=arenas)
        return config, files


def own(config: StudyConfig, folder: Path) -> StudyConfig:
    """A study's configuration with absolute paths, all in its own folder.

    Raises:
        StudyError: a file is missing, or lies elsewhere.
    """

    def place(name: str) -> str:
        return str(inside(folder, name).resolve())

    return replace(
        config.with_own_files(lambda _, file: place(file.as_posix())),
        profile=place(config.profile),
        conditions=tuple(c if c.task in TASKS else replace(c, task=place(c.task)) for c in config.conditions),
        arenas={task: place(arena) for task, arena in config.arenas.items()},
    )


def gather(config: StudyConfig) -> Materials:
    """Load and check everything that a configuration names; this runs users' files.

    Raises:
        UsageError: says which file, task or key cannot be used.
    """
    profile = load_profile(config.profile)
    loaded = {c.task: load_task(c.task) for c in config.conditions}
    _refuse_same_name(list(loaded.values()))
    names = {task.name for task in loaded.values()}
    for name in config.arenas:
        if name not in names:
            near = get_close_matches(name, names, n=1) or sorted(names)
            raise ConfigError(f"arenas.{name}: no such task in this study. Did you mean {near[0]!r}?")
    for key, task in loaded.items():
        if task.name in config.arenas:
            task = replace(task, arena=load_arena(config.arenas[task.name]))
        task = replace(task, **config.task.changes()).of(profile)
        task.to_kernel(profile)  # the robot fits the start and has the sensors
        config.evolution.make(config.encoding_for(task))  # the genotype has room for the inputs
        loaded[key] = task
    tasks = tuple(loaded[c.task].under(c.spread or None, c.spread_wheels) for c in config.conditions)
    _refuse_repetition([(task.name, c.noise) for task, c in zip(tasks, config.conditions, strict=True)])
    return Materials(config=config, profile=profile, tasks=tasks)


def program_files(config: StudyConfig) -> list[Path]:
    """The users' own programs that a configuration names: tasks, algorithm, encoding."""
    tasks = [Path(task) for task in dict.fromkeys(c.task for c in config.conditions) if task not in TASKS]
    return [*tasks, *config.own_files().values()]


def _refuse_same_name(tasks: list[Task]) -> None:
    sources: dict[str, str | None] = {}
    for task in tasks:
        if sources.setdefault(task.name, task.source) != task.source:
            raise ConfigError(
                f"conditions: two different tasks are both named {task.name!r}. Give one another `name`."
            )


def _refuse_repetition(pairs: list[tuple[str, float]]) -> None:
    for i, pair in enumerate(pairs):
        if pair in pairs[:i]:
            raise ConfigError(
                f"conditions[{i}]: {pair[0]} at noise {pair[1]:g} appears twice. Leave one out."
            )


def _task_files(task: Task) -> dict[str, bytes]:
    """A user's task file and its arena's: relative path and content."""
    with tempfile.TemporaryDirectory(prefix="realitygap-") as name:
        folder = Path(name)
        copy_task(task, folder)
        found = [path for path in sorted(folder.rglob("*")) if path.is_file()]
        return {path.relative_to(folder).as_posix(): path.read_bytes() for path in found}
