"""The result tables of a study of noise: small, in plain text, with everything that a report needs."""

import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from realitygap import whole
from realitygap.calibration.unit_folder import PROFILE
from realitygap.errors import StudyError
from realitygap.experiments.folder import RESULTS, Seconds, write_table
from realitygap.experiments.noise.config import CONFIG, NoiseConfig
from realitygap.experiments.noise.folder import begun_by, command_of
from realitygap.experiments.noise.plan import Controller, calibration_folder, controllers
from realitygap.experiments.noise.simulated import AS_MEASURED, LIVED, read_compared
from realitygap.experiments.noise.stage import Stage
from realitygap.study.versions import versions
from realitygap.toml import read_toml, to_toml
from realitygap.transfer.order import mean

__all__ = ["write_results"]

CELL = ("score", "behaviour", "layout", "noisiness", "responsiveness", "fitness_simulated")
OF_ARM = ("layout_home", "without_jitter", "without_jitter_home")
"""Further columns of an arm's cells, after those of the calibration unit and of foreign ones."""
WITHOUT_CAMERA = "without-camera.csv"
CALIBRATION = ("unit", "channel", "model_error", "noise", "ratio", "ratio_over_all")


def write_results(stage: Stage) -> Path:
    """Gather all controllers' results: controllers.csv, cells.csv, calibration.csv, study.toml.

    For an arm of the plan also all profiles, and rows by calibration unit and foreign ones; if readings and
    commands are known, without-camera.csv.

    Raises:
        StudyError: a controller's file is missing or broken.
    """
    folder, config = stage.folder / RESULTS, stage.config
    folder.mkdir(parents=True, exist_ok=True)
    order = sorted(
        controllers(config),
        key=lambda one: (config.tasks.index(one.task), one.seed_set, one.level, one.run, one.individual),
    )
    found = {one: read_compared(stage, one) for one in order}
    _table(folder / "controllers.csv", [_controller(one, kept, config) for one, kept in found.items()])
    cells = [row for one, kept in found.items() for row in _cells(one, kept, config)]
    _table(folder / "cells.csv", cells)
    write_table(folder / "calibration.csv", CALIBRATION, _calibration(stage))
    champions = {one: kept for one, kept in found.items() if one.individual == "champion"}
    if all("without_camera" in kept for kept in champions.values()):
        rows = [row for one, kept in champions.items() for row in _without_camera(one, kept, config)]
        _table(folder / WITHOUT_CAMERA, rows)
    facts = {
        "command": command_of(config),
        **config.to_dict(),
        "controllers": config.controllers,
        "twin_trials": config.twin_trials,
        "twin_trials_lost": sum(int(kept["trials_lost"]) for kept in found.values()),
        "trial_seconds": {task: stage.task(task).seconds for task in config.tasks},
        "seconds": Seconds(stage.folder).read(),
        "versions": versions(),
        "versions_at_start": read_toml(stage.folder / CONFIG, StudyError, "").get("versions", {}),
    }
    if config.arm is not None:
        facts["plan"] = begun_by(stage.folder)
        (folder / "profiles").mkdir(exist_ok=True)
        for unit in config.every_unit:
            profile = calibration_folder(stage.folder, unit) / PROFILE
            whole.write(folder / "profiles" / f"unit-{unit}.toml", profile.read_text("utf-8"))
    whole.write(folder / "study.toml", to_toml(facts))
    return folder


def _controller(one: Controller, kept: Mapping[str, Any], config: NoiseConfig) -> dict[str, object]:
    simulated, situated = kept["fitness_simulated"], kept["fitness_situated"]
    if config.arm is None:
        units = {key: kept[key] for key in kept if key.startswith("fitness_situated_unit_")}
    else:
        home, foreign = _home_and_foreign(one, kept, config, "fitness_situated")
        units = {"fitness_situated_home": home, "fitness_situated_foreign": foreign}
    return {
        **_who(one, config),
        "home_unit": one.home,
        "name": kept["name"],
        "fitness_simulated": simulated,
        "fitness_situated": situated,
        "drop": simulated - situated,
        **units,
        "trials": kept["trials"],
    }


def _cells(one: Controller, kept: Mapping[str, Any], config: NoiseConfig) -> Iterator[dict[str, object]]:
    """A row for each level; older comparisons without scores of single units have none."""
    for cell in kept["cells"]:
        level = {"comparison_level": cell["comparison_level"]}
        if config.arm is None:
            alone = {key: cell.get(key, math.nan) for key in (f"score_unit_{u}" for u in config.every_unit)}
        else:
            home, foreign = _home_and_foreign(one, cell, config, "score")
            alone = {"score_home": home, "score_foreign": foreign, **{key: cell[key] for key in OF_ARM}}
        yield {**_who(one, config), **level, **{key: cell[key] for key in CELL}, **alone}


def _without_camera(
    one: Controller, kept: Mapping[str, Any], config: NoiseConfig
) -> Iterator[dict[str, object]]:
    """A row for each unit: measures without a camera, and the camera's scores of the same trials."""
    cell = next(cell for cell in kept["cells"] if cell["comparison_level"] == AS_MEASURED)
    for unit in config.driven(one.home):
        yield {
            **_who(one, config),
            "unit": unit,
            **{key: kept["without_camera"][str(unit)][key] for key in LIVED},
            "correspondence": cell[f"score_unit_{unit}"],
            "fitness_simulated": cell["fitness_simulated"],
            "fitness_situated": kept[f"fitness_situated_unit_{unit}"],
            "fitness_pseudo": kept["fitness_pseudo"],
        }


def _home_and_foreign(
    one: Controller, table: Mapping[str, Any], config: NoiseConfig, key: str
) -> tuple[float, float]:
    """A figure on the calibration unit, and its mean over the other units."""
    units = {unit: table[f"{key}_unit_{unit}"] for unit in config.driven(one.home, one.individual)}
    home = units.pop(one.home)
    return home, mean(list(units.values()))


def _who(one: Controller, config: NoiseConfig) -> dict[str, object]:
    who = {"task": one.task, "seed_set": one.seed_set, "run": one.run, "evolved_level": one.level}
    return who if config.arm is None else {**who, "individual": one.individual}


def _calibration(stage: Stage) -> Iterator[tuple[object, ...]]:
    """Accuracy of each unit's sensor fits: counts, and the model's error over the noise."""
    for unit in stage.config.every_unit:
        for fit in stage.profile(unit).provenance.fits:
            if fit.noise > 0:
                over_all = fit.ratio_over_all or math.nan
                yield unit, fit.channel, fit.model_error, fit.noise, fit.ratio, over_all


def _table(file: Path, rows: Sequence[Mapping[str, object]]) -> None:
    write_table(file, rows[0], ([row[key] for key in rows[0]] for row in rows))
