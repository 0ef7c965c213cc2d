"""Put a study of the level of noise together of its shards."""

import shutil
from collections.abc import Mapping
from pathlib import Path

from realitygap.calibration.unit import PROFILE
from realitygap.errors import StudyError
from realitygap.experiments.noise.config import CONFIG, NoiseConfig
from realitygap.experiments.noise.folder import MADE, Seconds, missing
from realitygap.experiments.noise.plan import (
    calibration_folder,
    controllers,
    evolved_folder,
    homes,
    simulated_file,
    situated_file,
)
from realitygap.study.merge import merge_runs, new_folder
from realitygap.study.settings import refuse_difference
from realitygap.work.shard import Shard

__all__ = ["merge_noise"]


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
        for seed_set, unit in homes(config):
            evolved = {shard: evolved_folder(folder, seed_set, unit) for shard, folder in shards.items()}
            merge_runs(evolved, evolved_folder(half, seed_set, unit))
        for one in controllers(config):
            for file_of in (situated_file, simulated_file):
                made = [file for folder in shards.values() if (file := file_of(folder, one)).is_file()]
                if made:
                    file_of(half, one).parent.mkdir(parents=True, exist_ok=True)
                    shutil.copyfile(made[0], file_of(half, one))
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
    for unit in range(1, config.units + 1):
        ours, theirs = (calibration_folder(folder, unit) / PROFILE for folder in (first, other))
        if ours.read_bytes() != theirs.read_bytes():
            raise StudyError(
                f"{ours} and {theirs} differ: the twin was recorded on different kinds of machine. "
                "Start the shards again on one kind."
            )
