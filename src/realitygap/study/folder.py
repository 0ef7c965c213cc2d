"""A study's folder: its configuration and its own copies of all that it is made of, and which of its
programs this user trusts.

A study reads only its own folder once it is created. It can be moved, or the user's files changed, and it
still resumes and replays with the same bits.
"""

import os
import shlex
import tempfile
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from contextlib import ExitStack, suppress
from dataclasses import dataclass, replace
from difflib import get_close_matches
from functools import cache
from hashlib import sha256
from pathlib import Path

from realitygap.errors import ConfigError, StudyError
from realitygap.study.config import StudyConfig
from realitygap.study.provenance import versions
from realitygap.study.store import DATABASE, Reader
from realitygap.tasks import TASKS, copy_task, load_task
from realitygap.tasks.task import Task
from realitygap.work.folder import (
    LOCK,
    RunFolder,
    file_errors,
    inside,
    require_only_own,
)
from realitygap.work.pool import Pool, far
from realitygap.work.shard import MARK
from realitygap.world.arena import load_arena
from realitygap.world.robot import Profile, load_profile

__all__ = [
    "CONFIG", "Inputs", "Materials", "exists", "gather", "home_of", "input_files", "inputs_for",
    "open_folder", "open_to_begin", "own", "own_config", "read_config", "read_materials", "read_profile",
    "refuse_other", "require_trusted", "take_back", "trust_contents", "trust_programs", "untrusted",
    "untrusted_programs", "write_files",
]  # fmt: skip

CONFIG, PROFILE = "study.toml", "profile.toml"
OURS = {CONFIG, LOCK, MARK, PROFILE, "arenas", "tasks", "evolution", "encoding", "report"}
OURS |= {f"{DATABASE}{end}" for end in ("", "-wal", "-shm", "-journal")}
OURS |= {"reproduce.toml", "calibration"}
"""What a study that was killed while it was being made may have left."""
LOOSE = ("title", "checkpoint_every")
"""Settings that results do not depend on."""

EXPERIMENTS = {
    "noise-study.toml": "experiment noise",
    "robots.toml": "experiment robots",
    "reproduce.toml": "reproduce",
}
"""Settings of what is no study itself, or not yet, and the command that made them."""

HEAD = """\
# A realitygap study: all that its results depend on. Files are named from this folder.
# To make another like it: realitygap evolve TASK --config THIS_FILE --out ANOTHER_FOLDER
"""


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


def gather(config: StudyConfig) -> Materials:
    """Load and check everything that a configuration names; this runs users' files.

    Raises:
        UsageError: says which file, task or key cannot be used.
    """
    profile = load_profile(config.profile)
    profile = profile.with_between() if config.noise_between else profile
    loaded = {c.task: load_task(c.task) for c in config.conditions}
    sources: dict[str, str | None] = {}
    for task in loaded.values():
        if sources.setdefault(task.name, task.source) != task.source:
            raise ConfigError(
                f"conditions: two different tasks are both named {task.name!r}. Give one another `name`."
            )
    for name in config.arenas:
        if name not in sources:
            near = get_close_matches(name, sources, n=1) or sorted(sources)
            raise ConfigError(f"arenas.{name}: no such task in this study. Did you mean {near[0]!r}?")
    for key, task in loaded.items():
        if task.name in config.arenas:
            task = replace(task, arena=load_arena(config.arenas[task.name]))
        task = replace(task, **config.task.changes()).of(profile)
        task.to_kernel(profile)  # the robot fits the start and has the sensors
        config.evolution.make(config.encoding_for(task))  # the genotype has room for the inputs
        loaded[key] = task
    tasks = tuple(loaded[c.task].under(c.spread or None, c.spread_wheels) for c in config.conditions)
    pairs = Counter((task.name, c.noise) for task, c in zip(tasks, config.conditions, strict=True))
    (name, noise), count = pairs.most_common(1)[0]
    if count > 1:
        cure = "Each is run `runs` times: leave one out."
        raise ConfigError(f"conditions: {name} at noise {noise:g} is there twice. {cure}")
    return Materials(config=config, profile=profile, tasks=tasks)


def _task_files(task: Task) -> dict[str, bytes]:
    """A user's task file and its arena's: relative path and content."""
    with tempfile.TemporaryDirectory(prefix="realitygap-") as name:
        folder = Path(name)
        copy_task(task, folder)
        found = [path for path in sorted(folder.rglob("*")) if path.is_file()]
        return {path.relative_to(folder).as_posix(): path.read_bytes() for path in found}


def _run_folder(folder: Path) -> RunFolder:
    """A study's folder as one with settings."""
    return RunFolder(folder, CONFIG, "study", LOOSE)


def exists(folder: Path) -> bool:
    """Whether a study was created in this folder."""
    return (folder / DATABASE).is_file()


def open_folder(folder: Path, requested: Materials | None, *, resume: bool) -> Materials:
    """Create the requested study in the folder, or open the one there; the lock is held.

    Raises:
        StudyError: there is a study but `resume` is not set, or it was made with another
            configuration, or there is none to resume, or the folder holds something else.
    """
    if exists(folder):
        if not resume:
            open_to_begin(folder)
        if requested is not None:
            own_config(folder)  # edits of the study's own copies are reported as such
            config, files = requested.copies()
            _run_folder(folder).refuse_other(read_config(folder).to_dict(), config.to_dict(), files)
            trust_contents(requested.own_code())
        return read_materials(folder)
    if requested is None:
        cure = "Give the folder of a study; for a new one, its configuration too."
        if any(str(folder) in (name, *name.split("-")) for name in TASKS):
            cure = f"The first argument is a folder; realitygap.evolve({str(folder)!r}) takes a task."
        raise StudyError(f"{folder} holds no study ({DATABASE} is missing). {cure}")
    require_only_own(folder, "study", OURS)
    for task in requested.tasks:
        if task.source is not None:
            task.compiled_score()  # before anything is written, so that errors name the user's own file
    trust_contents(requested.own_code())
    config, files = requested.copies()
    _run_folder(folder).begin(config.to_dict(), head=HEAD, versions=versions(), files=files)
    _create(folder, requested)
    return read_materials(folder)


def _create(folder: Path, materials: Materials) -> None:
    """Create the database."""
    from realitygap.control.encoding import facts_of
    from realitygap.study.plan import plans
    from realitygap.study.store import create

    config, tasks = materials.config, materials.tasks
    local = materials.copies()[0].encoding  # a user's file by its name in the folder
    own = {"kind": local.kind, **local.to_dict()}
    forms = [facts_of(config.encoding_for(task), {**own, "inputs": len(task.sensors)}) for task in tasks]
    rows = [(p.id, p.name, p.task, p.noise, p.index, forms[p.condition]) for p in plans(materials)]
    create(folder / DATABASE, rows, {task.name: task.to_dict() for task in tasks})


def take_back(folder: Path, requested: Materials) -> None:
    """Remove a study that failed to start before any evaluation was saved."""
    if exists(folder) and any(row["evaluations"] for row in Reader(folder / DATABASE).runs()):
        return
    files = [folder / name for name in requested.copies()[1]]
    made = [folder / f"{DATABASE}{end}" for end in ("", "-wal", "-shm")]
    for path in (*made, folder / CONFIG, folder / MARK, *files):
        path.unlink(missing_ok=True)
    folders = {parent for path in files for parent in path.relative_to(folder).parents} - {Path()}
    for name in sorted(folders, reverse=True):
        with suppress(OSError):  # something else is in it
            (folder / name).rmdir()


def open_to_begin(folder: Path) -> None:
    """Check that a study can start in the folder; the lock is held.

    Raises:
        StudyError: the folder holds a study, or something else.
    """
    if exists(folder):
        raise StudyError(f"{folder} already holds a study. Resume it (--resume) or choose another --out.")
    require_only_own(folder, "study", OURS)


def read_config(folder: Path) -> StudyConfig:
    """The configuration that a study was made with, with paths relative to the folder.

    Raises:
        StudyError: no study there, or its file is missing, broken or was edited.
    """
    if not exists(folder):
        what = "no such folder" if not folder.exists() else f"no study there ({DATABASE} is missing)"
        made = next((command for file, command in EXPERIMENTS.items() if (folder / file).is_file()), None)
        cure = "Give a study's folder, such as the one that `realitygap evolve` makes."
        if made is not None:
            again = f"`realitygap {made} --out {shlex.quote(str(folder))} --resume`"
            cure = f"It is an experiment's folder: {again} makes its results and page again."
        elif folder.is_dir() and (near := sorted(file.parent for file in folder.glob(f"*/{DATABASE}"))):
            names = (shlex.quote(os.path.join(folder, one.name)) for one in near[:3])
            cure = f"Did you mean {' or '.join(names)}?"
        raise StudyError(f"{folder}: {what}. {cure}")
    return StudyConfig.from_dict(_run_folder(folder).settings())


def own_config(folder: Path) -> StudyConfig:
    """The same with absolute paths.

    Raises:
        StudyError, ConfigError: as of `read_config`; or a file is missing, leads elsewhere or was edited.
    """
    config = own(read_config(folder), folder)
    _run_folder(folder).check_files()
    return config


def own(config: StudyConfig, folder: Path) -> StudyConfig:
    """A study's configuration with absolute paths, all in its own folder.

    Raises:
        StudyError: a file is missing, or lies elsewhere.
    """

    return config.with_files(lambda name: name if name in TASKS else str(inside(folder, name).resolve()))


def read_materials(folder: Path) -> Materials:
    """A study's robot, tasks and arenas, from its own copies; this runs users' files.

    Raises:
        StudyError: a copy is missing or was edited since, or is a program that is not trusted.
    """
    config = own_config(folder)
    require_trusted(folder, _program_files(config))
    return gather(config)


def read_profile(folder: Path) -> Profile:
    """A study's robot, from its own copy; no task file is run.

    Raises:
        StudyError: the copy is missing or was edited since.
    """
    config = read_config(folder)
    place = inside(folder, config.profile)
    _run_folder(folder).check_files(config.profile)
    return load_profile(place)


def refuse_other(folder: Path, other: Path) -> None:
    """Refuse two different studies where one is expected.

    Raises:
        StudyError: names the first setting or file in which they differ.
    """
    cure = f"{other} has that. Only shards of one study are merged."
    files = {name: (other / name).read_bytes() for name in _run_folder(other).seals()}
    here, there = (read_config(one).to_dict() for one in (folder, other))
    _run_folder(folder).refuse_other(here, there, files, cure)


# Trust


def untrusted_programs(folder: Path) -> list[Path]:
    """The study's programs that this user has not agreed to run.

    Raises:
        StudyError, ConfigError: as of `own_config`.
    """
    return untrusted(_program_files(own_config(folder)))


def trust_programs(folder: Path) -> None:
    """Agree to run the study's programs from now on, whoever wrote them."""
    trust_contents(path.read_bytes() for path in untrusted_programs(folder))


def _program_files(config: StudyConfig) -> list[Path]:
    """The users' own programs that a configuration names: tasks, algorithm, encoding."""
    tasks = [Path(task) for task in dict.fromkeys(c.task for c in config.conditions) if task not in TASKS]
    return [*tasks, *config.own_files().values()]


def trust_contents(contents: Iterable[bytes]) -> None:
    """Agree to run programs of this content from now on."""
    new = {sha256(content).hexdigest() for content in contents} - _known()
    if not new:
        return
    _known().update(new)
    with suppress(OSError):  # the home folder cannot be written: the question will be asked again
        _list().parent.mkdir(parents=True, exist_ok=True)
        with _list().open("a", encoding="utf-8") as lines:
            lines.writelines(f"{one}\n" for one in sorted(new))


def untrusted(files: Iterable[Path]) -> list[Path]:
    """Those of some programs that this user has neither evolved with nor agreed to."""
    return [file for file in files if sha256(file.read_bytes()).hexdigest() not in _known()]


def require_trusted(place: Path, files: Iterable[Path], agreeing: str = "") -> None:
    """Refuse to run such programs, which a study's folder or a configuration names; `agreeing` is how a
    person agrees to it.

    Raises:
        StudyError: names the file and the cure.
    """
    how = f"`realitygap show {shlex.quote(str(place))} --trust`"
    for file in untrusted(files):
        raise StudyError(
            f"{place}: it was made elsewhere and brings a program, {file}, that would be run. "
            f"Read it; if you trust its author, give {agreeing or how} (in Python: trust=True)."
        )


@cache
def _known() -> set[str]:
    """Digests of the files that this user agreed to: those on the list, and those of this process."""
    try:
        return set(_list().read_text("utf-8").split())
    except (OSError, UnicodeDecodeError):
        return set()


def _list() -> Path:
    home = Path(os.environ.get("XDG_STATE_HOME", ""))
    return (home if home.is_absolute() else Path.home() / ".local" / "state") / "realitygap" / "trusted-tasks"


# Workers that do not see the folder

Inputs = tuple[str, Mapping[str, bytes]]
"""A study's folder ("" if workers cannot see it) and the content of its files, as sent to workers."""


def input_files(folder: Path) -> dict[str, bytes]:
    """The content of all files that a study follows from, its configuration too."""
    with file_errors(folder):
        return {name: (folder / name).read_bytes() for name in (CONFIG, *_run_folder(folder).seals())}


def inputs_for(folder: Path, pool: Pool) -> Inputs:
    """What a pool's workers are sent of a study."""
    return "" if far(pool) else str(folder.resolve()), input_files(folder)


def home_of(inputs: Inputs, held: ExitStack) -> Path:
    """The folder that a worker reads a study from: its own, or a temporary one that `held` removes."""
    place, files = Path(inputs[0]), inputs[1]
    if inputs[0] and exists(place) and input_files(place) == files:
        trust_programs(place)  # the parent has asked
        return place
    folder = Path(held.enter_context(tempfile.TemporaryDirectory(prefix="realitygap-")))
    write_files(folder, files)
    materials = gather(own(StudyConfig.from_toml(folder / CONFIG, local=True), folder))
    trust_contents(materials.own_code())
    _create(folder, materials)
    return folder


def write_files(folder: Path, files: Mapping[str, bytes]) -> None:
    """Write files by their names into a folder."""
    for name, content in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(content)
