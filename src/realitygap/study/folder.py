"""A study's folder: created once, locked while in use, opened only with its original configuration."""

import shlex
import tomllib
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path

from realitygap.errors import ConfigError, StudyError
from realitygap.files import atomic_write, to_toml
from realitygap.study.config import StudyConfig
from realitygap.study.lock import LOCK, refuse_strangers
from realitygap.study.materials import Materials, gather, own, program_files
from realitygap.study.reader import DATABASE, Reader
from realitygap.study.schema import told
from realitygap.study.settings import refuse_difference, refuse_edited_settings
from realitygap.study.sources import agree_to, changed, inside, refuse_edited, refuse_strange, strange
from realitygap.study.versions import versions
from realitygap.work.shard import MARK
from realitygap.world.robot import Profile, load_profile

__all__ = [
    "CONFIG", "agree", "exists", "open_folder", "open_to_begin", "own_config", "programs", "read_config",
    "read_materials", "read_profile", "refuse_other", "take_back",
]  # fmt: skip

CONFIG = "study.toml"
OURS = {CONFIG, LOCK, MARK, "profile.toml", "arenas", "tasks", "evolution", "encoding", "report"}
OURS |= {f"{DATABASE}{end}" for end in ("", "-wal", "-shm", "-journal", ".new", ".new-journal")}
OURS |= {"reproduce.toml", "calibration"}
"""What a study that was killed while it was being made may have left."""

EXPERIMENTS = {
    "noise-study.toml": "experiment noise",
    "measure-or-randomise.toml": "experiment measure-or-randomise",
    "realities.toml": "experiment robots",
    "reproduce.toml": "reproduce",
}
"""Settings of what is no study itself, or not yet, and the command that made them."""

_HEADER = """\
# A realitygap study: all that its results depend on. Files are named from this folder.
# To make another like it: realitygap evolve TASK --config THIS_FILE --out ANOTHER_FOLDER
"""


def exists(folder: Path) -> bool:
    """Whether a study was created in this folder."""
    return (folder / DATABASE).is_file()


def open_folder(folder: Path, requested: Materials | None, *, resume: bool) -> Materials:
    """Create the requested study in the folder, or open the one there; the lock is held.

    Raises:
        StudyError: there is a study but `resume` is not set, or it was made with another
            configuration, or there is none to resume, or the folder holds something else.
    """
    from realitygap.study.store import create  # includes the engine, which reading a study does not need

    if exists(folder):
        if not resume:
            open_to_begin(folder)
        if requested is not None:
            _refuse_difference(folder, requested)
            agree_to(requested.own_code())
        return read_materials(folder)
    if requested is None:
        raise StudyError(f"{folder} holds no study ({DATABASE} is missing). Give the folder of a study.")
    refuse_strangers(folder, "study", OURS)
    for task in requested.tasks:
        if task.source is not None:
            task.compiled_score()  # before anything is written, so that errors name the user's own file
    agree_to(requested.own_code())
    local, files = requested.copies()
    text = f"{_HEADER}\n{to_toml({**local.to_dict(), 'versions': versions()})}"
    sources = {**files, CONFIG: _encoded(text)}
    with told(folder):
        for name, content in sources.items():
            path = folder / name
            path.parent.mkdir(parents=True, exist_ok=True)
            atomic_write(path, content)
    create(folder / DATABASE, requested, sources)
    return read_materials(folder)


def _encoded(text: str) -> bytes:
    """A configuration as it is written; a name in bytes of another encoding is refused."""
    try:
        return text.encode()
    except UnicodeEncodeError as why:
        line = text[: why.start].count("\n")
        raise ConfigError(
            f"{CONFIG}: expected text in UTF-8, got {text.splitlines()[line]!r}. Name the title or file anew."
        ) from None


def take_back(folder: Path, requested: Materials) -> None:
    """Remove a study that failed to start before any evaluation was saved."""
    if exists(folder):
        with Reader(folder / DATABASE).reading() as database:
            if database.execute("SELECT sum(evaluations) FROM run").fetchone()[0]:
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
    refuse_strangers(folder, "study", OURS)


def read_config(folder: Path) -> StudyConfig:
    """The configuration that a study was made with, with paths relative to the folder.

    Raises:
        StudyError: no study there.
        ConfigError: its file is broken.
    """
    path = folder / CONFIG
    if not exists(folder):
        what = "no such folder" if not folder.exists() else f"no study there ({DATABASE} is missing)"
        raise StudyError(f"{folder}: {what}. {_cure(folder)}")
    if not path.is_file():
        raise StudyError(f"{path}: missing. Restore it from a copy: the study cannot be read without it.")
    there = StudyConfig.from_toml(path, local=True)
    sources = Reader(folder / DATABASE).sources()
    made = StudyConfig.from_dict(tomllib.loads(sources[CONFIG].decode()))
    refuse_edited_settings(path, _decisive(made.to_dict()), _decisive(there.to_dict()))
    return there


def _cure(folder: Path) -> str:
    """What to do about a folder without a study."""
    made = next((command for file, command in EXPERIMENTS.items() if (folder / file).is_file()), None)
    if made is None:
        return "Give a study's folder, such as `realitygap evolve` makes."
    again = f"`realitygap {made} --out {shlex.quote(str(folder))} --resume`"
    return f"It is an experiment's folder: {again} makes its results and page again; its studies are in it."


def own_config(folder: Path) -> StudyConfig:
    """The same with absolute paths.

    Raises:
        StudyError, ConfigError: as of `read_config`; or a file is missing, leads elsewhere or was edited.
    """
    config = read_config(folder)
    sources = Reader(folder / DATABASE).sources()
    refuse_edited(folder, {name: was for name, was in sources.items() if name != CONFIG})
    return own(config, folder)


def read_materials(folder: Path) -> Materials:
    """A study's robot, tasks and arenas, from its own copies; this runs users' files.

    Raises:
        StudyError: a copy is missing or was edited since, or is a program that is not trusted.
    """
    config = own_config(folder)
    refuse_strange(folder, program_files(config))
    return gather(config)


def read_profile(folder: Path) -> Profile:
    """A study's robot, from its own copy; no task file is run.

    Raises:
        StudyError: the copy is missing or was edited since.
    """
    config = read_config(folder)
    sources = Reader(folder / DATABASE).sources()
    refuse_edited(folder, {name: was for name, was in sources.items() if name == config.profile})
    return load_profile(inside(folder, config.profile))


def programs(folder: Path) -> list[Path]:
    """The study's programs that this user has not agreed to run.

    Raises:
        StudyError, ConfigError: as of `own_config`.
    """
    return strange(program_files(own_config(folder)))


def agree(folder: Path) -> None:
    """Agree to run the study's programs from now on, whoever wrote them."""
    agree_to(path.read_bytes() for path in programs(folder))


def _refuse_difference(folder: Path, requested: Materials) -> None:
    """Refuse to resume with a configuration that differs from the study's."""
    own_config(folder)  # edits of the study's own copies are reported as such
    config, files = requested.copies()
    cure = "Leave it as it was, or choose another --out."
    there = _decisive(read_config(folder).to_dict())
    refuse_difference(f"{folder}: the study was made", there, _decisive(config.to_dict()), cure)
    for name, content in files.items():
        path = inside(folder, name)
        with told(path):
            kept = path.read_bytes()
        where = changed(name, kept, content)
        if where is not None:
            raise StudyError(
                f"{folder}: the study keeps a different {name} from the one given now: {where}. {cure}"
            )


def _decisive(table: Mapping[str, object]) -> dict[str, object]:
    """A configuration without settings that do not affect results."""
    return {key: value for key, value in table.items() if key not in ("title", "checkpoint_every")}


def refuse_other(folder: Path, other: Path) -> None:
    """Refuse two different studies where one is expected.

    Raises:
        StudyError: names the first setting or file in which they differ.
    """
    cure = "Only shards of one study are merged."
    for one in (folder, other):
        own_config(one)  # its files are as they were
    here, there = (_decisive(read_config(one).to_dict()) for one in (folder, other))
    refuse_difference(f"{folder}: the study was made", here, there, f"{other} has that. {cure}")
    ours, theirs = (Reader(one / DATABASE).sources() for one in (folder, other))
    for name in sorted((ours.keys() | theirs.keys()) - {CONFIG}):
        where = changed(name, ours.get(name, b""), theirs.get(name, b""))
        if where is not None:
            raise StudyError(f"{folder} and {other} keep different files {name}: {where}. {cure}")
