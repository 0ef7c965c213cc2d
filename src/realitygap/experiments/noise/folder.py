"""A noise study's folder: created once, opened only with its own settings; merged from shards."""

import shlex
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from realitygap.calibration.unit_folder import PROFILE
from realitygap.errors import RealityGapError, StudyError
from realitygap.experiments import folder as any_folder
from realitygap.experiments.folder import Seconds
from realitygap.experiments.noise.config import CONFIG, NoiseConfig
from realitygap.experiments.noise.plan import (
    calibration_folder,
    controllers,
    evolved,
    evolved_folder,
    simulated_file,
    situated_file,
)
from realitygap.experiments.noise.second.arms import check_arm, plan_digests
from realitygap.experiments.noise.simulated import read_compared
from realitygap.experiments.noise.situated import read_situated
from realitygap.experiments.noise.stage import Stage
from realitygap.study.merge import merge_runs, new_folder
from realitygap.study.schema import told
from realitygap.study.settings import refuse_difference
from realitygap.toml import read_toml
from realitygap.work.shard import MARK, Mark, Shard

__all__ = ["begun_by", "command_of", "merge_noise", "open_folder"]


def open_folder(
    folder: Path, requested: NoiseConfig | None, *, resume: bool, mark: Mark | None = None
) -> NoiseConfig:
    """Create the requested study in the folder, or open the one there; the lock is held.

    It is marked as a shard before it is created; a refusal changes nothing.

    Args:
        folder: the study's.
        requested: None to continue the one there.
        resume: whether one may be there.
        mark: of a shard.

    Raises:
        StudyError: as of `folder.open_folder`; or an arm that is not the plan's.
    """
    new = not (folder / CONFIG).is_file()
    if new and requested is not None:
        check_arm(folder, requested)
    plan = {"plan": plan_digests()} if requested is not None and requested.arm else {}
    begun = mark if new else None
    try:
        if begun is not None:
            with told(folder):
                begun.write(folder, finished=False)
        made = any_folder.open_folder(folder, NoiseConfig, requested, resume=resume, facts=plan)
    except RealityGapError:
        if begun is not None:
            (folder / MARK).unlink(missing_ok=True)
        raise
    if not new:
        check_arm(folder, made, begun_by(folder))
    return made


def begun_by(folder: Path) -> dict[str, str]:
    """Digests of the plan under which the study in a folder was started; none for a design of your own."""
    return dict(read_toml(folder / CONFIG, StudyError, "").get("plan", {}))


def command_of(config: NoiseConfig) -> str:
    """The command that makes this study, without default options."""
    if config.arm is not None:
        return f"realitygap experiment noise --arm {config.arm}"
    usual = NoiseConfig().to_dict()
    if config.base is not None:
        usual["units"] = config.units  # cannot be set by a user
    changed = {key: value for key, value in config.to_dict().items() if usual.get(key) != value}
    words = [f"--{key.replace('_', '-')} {_typed(value)}" for key, value in changed.items()]
    return " ".join(["realitygap experiment noise", *words])


def _typed(value: Any) -> str:
    """A setting as typed by a person, with all digits."""
    if isinstance(value, list):
        return ",".join(map(_typed, value))
    return repr(value).removesuffix(".0") if isinstance(value, float) else shlex.quote(str(value))


def merge_noise(shards: Mapping[Shard, Path], out: Path) -> None:
    """The study of all shards' controllers, in a folder of its own; `noise_study` resumes it to its tables.

    Args:
        shards: their folders, as `study.merge.all_shards` has them.
        out: the study's folder, created complete or not at all.

    Raises:
        StudyError: shards of different studies or calibrations, a damaged one or file of it, or `out` exists.
    """
    first, *others = shards.values()
    config = NoiseConfig.from_folder(first)
    for other in others:
        _refuse_other(first, other, config)
    with new_folder(out, config.resuming(out)) as half:
        for name in (CONFIG, f".{CONFIG}"):
            shutil.copyfile(first / name, half / name)
        shutil.copytree(first / "calibration", half / "calibration")
        for made in dict.fromkeys(evolved(config, one) for one in controllers(config)):
            parts = {shard: evolved_folder(folder, config, made) for shard, folder in shards.items()}
            merge_runs(parts, evolved_folder(half, config, made))
        stages = [Stage(folder, config) for folder in shards.values()]
        for one in controllers(config):
            for file_of, read in ((situated_file, read_situated), (simulated_file, read_compared)):
                there = [stage for stage in stages if file_of(stage.folder, one).is_file()]
                if not there:
                    raise StudyError(
                        f"{first}: no shard has the controller {one.name}. Finish the shards first."
                    )
                read(there[0], one)  # a damaged file is told while the shard can make it again
                file_of(half, one).parent.mkdir(parents=True, exist_ok=True)
                shutil.copyfile(file_of(there[0].folder, one), file_of(half, one))
        for folder in shards.values():
            for phase, seconds in Seconds(folder).read().items():
                Seconds(half).add(phase, seconds)


def _refuse_other(first: Path, other: Path, config: NoiseConfig) -> None:
    """Refuse shards of different studies, or of units with different calibrations."""
    cure = f"{other} has that. Only shards of one study are merged."
    there = NoiseConfig.from_folder(other).to_dict()
    refuse_difference(f"{first}: the study was made", config.to_dict(), there, cure)
    refuse_difference(f"{first}: the arm was started", begun_by(first), begun_by(other), cure)
    for unit in config.every_unit:
        ours, theirs = (calibration_folder(folder, unit) / PROFILE for folder in (first, other))
        if ours.read_bytes() != theirs.read_bytes():
            raise StudyError(
                f"{ours} and {theirs} differ: the twin was recorded on different kinds of machine. "
                "Start the shards again on one kind."
            )
