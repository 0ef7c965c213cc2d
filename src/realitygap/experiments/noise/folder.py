"""A noise study's folder: made once, opened only by the settings it was made with; merged of its shards."""

import json
import shlex
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from realitygap import whole
from realitygap.calibration.unit_folder import PROFILE
from realitygap.errors import StudyError
from realitygap.experiments.noise.config import CONFIG, NoiseConfig
from realitygap.experiments.noise.plan import (
    Controller,
    calibration_folder,
    controllers,
    evolved,
    evolved_folder,
    simulated_file,
    situated_file,
)
from realitygap.experiments.noise.second.arms import check_arm, plan_digests
from realitygap.study.lock import refuse_strangers
from realitygap.study.merge import merge_runs, new_folder
from realitygap.study.schema import told
from realitygap.study.settings import refuse_difference, refuse_edited_settings
from realitygap.study.versions import versions
from realitygap.toml import read_toml, to_toml
from realitygap.work.shard import MARK, Shard

__all__ = [
    "MADE", "RESULTS", "Seconds", "begun_by", "command_of", "merge_noise", "missing", "open_folder",
    "resuming",
]  # fmt: skip

RESULTS = "results"
"""Folder of the tables that come out: all that a report needs."""
SECONDS = "seconds.json"
MADE = f".{CONFIG}"
"""The settings once more: a person may have edited those that are shown."""

_HEADER = """\
# A study of the level of noise: all that its results depend on.
# To go on with it: {again}
"""


def open_folder(folder: Path, requested: NoiseConfig | None, *, resume: bool) -> NoiseConfig:
    """Make the requested study in the folder, or open the one that is there; the lock is held.

    Raises:
        StudyError: there is one but `resume` is not set, or it was made with other settings, or
            there is none to resume, or the folder holds something else; or an arm that is not the plan's.
    """
    if not (folder / CONFIG).is_file():
        if requested is None:
            raise StudyError(f"{folder}: no study of the level of noise there. Start it without --resume.")
        refuse_strangers(folder, "study of the level of noise", (MARK,))
        check_arm(folder, requested)
        plan = {"plan": plan_digests()} if requested.arm else {}
        text = to_toml({**requested.to_dict(), "versions": versions(), **plan})
        with told(folder):
            whole.write(folder / MADE, text)
            header = _HEADER.format(again=resuming(requested, "THIS_FOLDER"))
            whole.write(folder / CONFIG, f"{header}\n{text}")
        return requested
    there = NoiseConfig.from_folder(folder)
    _refuse_edited(folder, there)
    if not resume:
        done = "a finished" if (folder / RESULTS / "study.toml").is_file() else "an unfinished"
        cure = "Resume it (--resume) or choose another --out."
        raise StudyError(f"{folder} already holds {done} study of the level of noise. {cure}")
    if requested is not None:
        refuse_difference(f"{folder}: the study was made", there.to_dict(), requested.to_dict())
    check_arm(folder, there, begun_by(folder))
    return there


def begun_by(folder: Path) -> dict[str, str]:
    """Digests of the plan that the study in a folder was begun by; none of a design of one's own."""
    return dict(read_toml(folder / CONFIG, StudyError, "").get("plan", {}))


def command_of(config: NoiseConfig) -> str:
    """The command that makes this study; what is as usual is left out."""
    if config.arm is not None:
        return f"realitygap experiment noise --arm {config.arm}"
    usual = NoiseConfig().to_dict()
    if config.base is not None:
        usual["units"] = config.units  # nobody may say it
    changed = {key: value for key, value in config.to_dict().items() if usual.get(key) != value}
    words = [f"--{key.replace('_', '-')} {_typed(value)}" for key, value in changed.items()]
    return " ".join(["realitygap experiment noise", *words])


def resuming(config: NoiseConfig, folder: str | Path) -> str:
    """The command that goes on with a study: a robot of one's own is a program, run only when it is named."""
    named = "" if config.robot is None else f" --robot {shlex.quote(config.robot)}"
    named = named if config.arm is None else f" --arm {config.arm}"
    return f"realitygap experiment noise --out {shlex.quote(str(folder))}{named} --resume"


def _typed(value: Any) -> str:
    """A setting as a person types it, all digits kept."""
    if isinstance(value, list):
        return ",".join(map(_typed, value))
    return repr(value).removesuffix(".0") if isinstance(value, float) else shlex.quote(str(value))


def missing(files: dict[Controller, Path]) -> list[Controller]:
    """Whose file is not there yet; files appear as a whole or not at all."""
    return [one for one, file in files.items() if not file.is_file()]


class Seconds:
    """How long each phase took, over all sessions, kept in the study's folder."""

    def __init__(self, folder: Path) -> None:
        self._file = folder / SECONDS

    def read(self) -> dict[str, float]:
        """Seconds by phase; a file that cannot be read tells nothing, and no result hangs on it."""
        try:
            return {str(key): float(value) for key, value in json.loads(self._file.read_text()).items()}
        except (OSError, ValueError, AttributeError, TypeError, ArithmeticError, RecursionError):
            return {}

    def add(self, phase: str, seconds: float) -> None:
        """So much more."""
        table = self.read()
        table[phase] = round(table.get(phase, 0.0) + seconds, 1)
        whole.write(self._file, json.dumps(table, indent=1) + "\n")


def _refuse_edited(folder: Path, there: NoiseConfig) -> None:
    """Refuse settings that are not those that the study was made with (one of 0.1.0 keeps no copy)."""
    if not (folder / MADE).is_file():
        return
    made = NoiseConfig.from_dict(read_toml(folder / MADE, StudyError, "", broken="Restore it from a copy."))
    refuse_edited_settings(folder / CONFIG, made.to_dict(), there.to_dict())


def merge_noise(shards: Mapping[Shard, Path], out: Path) -> None:
    """The study of all shards' controllers, in a folder of its own; `noise_study` resumes it to its tables.

    Args:
        shards: their folders, as `study.merge.all_shards` has them.
        out: the study's, made whole or not at all.

    Raises:
        StudyError: shards of different studies, or calibrated otherwise, a damaged one, or `out` exists.
    """
    first, *others = shards.values()
    config = NoiseConfig.from_folder(first)
    for other in others:
        _refuse_other(first, other, config)
    with new_folder(out) as half:
        for name in (CONFIG, MADE):
            shutil.copyfile(first / name, half / name)
        shutil.copytree(first / "calibration", half / "calibration")
        for made in dict.fromkeys(evolved(config, one) for one in controllers(config)):
            parts = {shard: evolved_folder(folder, config, made) for shard, folder in shards.items()}
            merge_runs(parts, evolved_folder(half, config, made))
        for one in controllers(config):
            for file_of in (situated_file, simulated_file):
                there = [file for folder in shards.values() if (file := file_of(folder, one)).is_file()]
                if there:
                    file_of(half, one).parent.mkdir(parents=True, exist_ok=True)
                    shutil.copyfile(there[0], file_of(half, one))
        lost = missing({one: simulated_file(half, one) for one in controllers(config)})
        if lost:
            raise StudyError(f"{first}: no shard has the controller {lost[0].name}. Finish the shards first.")
        for folder in shards.values():
            for phase, seconds in Seconds(folder).read().items():
                Seconds(half).add(phase, seconds)


def _refuse_other(first: Path, other: Path, config: NoiseConfig) -> None:
    """Refuse shards of different studies, or of units that were measured otherwise."""
    cure = f"{other} has that. Only shards of one study are merged."
    there = NoiseConfig.from_folder(other).to_dict()
    refuse_difference(f"{first}: the study was made", config.to_dict(), there, cure)
    refuse_difference(f"{first}: the arm was begun", begun_by(first), begun_by(other), cure)
    for unit in config.every_unit:
        ours, theirs = (calibration_folder(folder, unit) / PROFILE for folder in (first, other))
        if ours.read_bytes() != theirs.read_bytes():
            raise StudyError(
                f"{ours} and {theirs} differ: the twin was recorded on different kinds of machine. "
                "Start the shards again on one kind."
            )
