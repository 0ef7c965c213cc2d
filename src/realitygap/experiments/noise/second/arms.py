"""The arms of the second study and the rest of its plan, which does not change once there are data."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from realitygap.errors import ConfigError, StudyError
from realitygap.experiments.noise.config import NoiseConfig
from realitygap.study.digest import check_of
from realitygap.study.settings import refuse_difference
from realitygap.toml import read_toml

__all__ = ["arm", "arm_names", "check_arm", "plan_digests"]

STATED = Path(__file__).parent
"""Folder of the plan's files: arms and claims."""

_REINSTALL = "Install realitygap again."


def arm_names() -> tuple[str, ...]:
    """All arms, in order."""
    return tuple(_stated()["arm"])


def arm(name: str) -> NoiseConfig:
    """An arm's design.

    Raises:
        ConfigError: no such arm.
    """
    stated = _stated()
    if name not in stated["arm"]:
        raise ConfigError(f"arm: expected one of {', '.join(stated['arm'])}, got {name!r}.")
    design = stated["design"]
    seeds = design["seeds"]
    return NoiseConfig(arm=name, seed=seeds[0], seed_sets=len(seeds), **design, **stated["arm"][name])


def plan_digests() -> dict[str, str]:
    """A digest of each file of the plan, ignoring comments."""
    return {
        file.name: check_of(read_toml(file, ConfigError, _REINSTALL))
        for file in sorted(STATED.glob("*.toml"))
    }


def check_arm(folder: Path, config: NoiseConfig, begun_by: Mapping[str, str] | None = None) -> None:
    """Refuse a study that differs from the plan's arm, or was started under another plan (by digests).

    Raises:
        StudyError: names the setting that differs, or the file of the plan.
        ConfigError: no such arm.
    """
    if config.arm is None:
        return
    cure = "A design of your own names no arm."
    refuse_difference(
        f"{folder}: arm {config.arm} is planned", arm(config.arm).to_dict(), config.to_dict(), cure
    )
    now = plan_digests()
    if begun_by is not None and begun_by != now:
        other = next(name for name in {**now, **begun_by} if now.get(name) != begun_by.get(name))
        raise StudyError(
            f"{folder}: arm {config.arm} was started under another plan: {other} has changed. Continue "
            "with the version that began it, or begin again in another folder."
        )


def _stated() -> dict[str, Any]:
    return read_toml(STATED / "arms.toml", ConfigError, _REINSTALL)
