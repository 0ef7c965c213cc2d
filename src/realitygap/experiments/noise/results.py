"""The tables that come out of a study of noise: small, in plain text, with all that a report needs."""

import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from realitygap import whole
from realitygap.errors import StudyError
from realitygap.experiments.noise.config import CONFIG
from realitygap.experiments.noise.folder import RESULTS, Seconds, command_of
from realitygap.experiments.noise.plan import Controller, controllers
from realitygap.experiments.noise.simulated import read_compared
from realitygap.experiments.noise.stage import Stage
from realitygap.study.versions import versions
from realitygap.text import to_csv
from realitygap.toml import read_toml, to_toml

__all__ = ["write_results"]

DIGITS = 5
CELL = ("score", "behaviour", "layout", "noisiness", "responsiveness", "fitness_simulated")
CALIBRATION = ("unit", "channel", "model_error", "noise", "ratio", "ratio_over_all")


def write_results(stage: Stage) -> Path:
    """Gather what came of all controllers: controllers.csv, cells.csv, calibration.csv, study.toml.

    Raises:
        StudyError: a controller's file is missing or broken.
    """
    folder, config = stage.folder / RESULTS, stage.config
    folder.mkdir(parents=True, exist_ok=True)
    found = {one: read_compared(stage, one) for one in sorted(controllers(config), key=_order(stage))}
    _table(folder / "controllers.csv", [_controller(one, kept) for one, kept in found.items()])
    cells = [row for one, kept in found.items() for row in _cells(one, kept, config.units)]
    _table(folder / "cells.csv", cells)
    _table(folder / "calibration.csv", list(_calibration(stage)))
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
    whole.write(folder / "study.toml", to_toml(facts))
    return folder


def _order(stage: Stage) -> Any:
    """Rows as a person looks for them: task, seed set, level, run."""
    tasks = stage.config.tasks
    return lambda one: (tasks.index(one.task), one.seed_set, one.level, one.run)


def _controller(one: Controller, kept: Mapping[str, Any]) -> dict[str, object]:
    simulated, situated = kept["fitness_simulated"], kept["fitness_situated"]
    units = {key: kept[key] for key in kept if key.startswith("fitness_situated_unit_")}
    return {
        **_who(one),
        "home_unit": one.home,
        "name": kept["name"],
        "fitness_simulated": simulated,
        "fitness_situated": situated,
        "drop": simulated - situated,
        **units,
        "trials": kept["trials"],
    }


def _cells(one: Controller, kept: Mapping[str, Any], units: int) -> Iterator[dict[str, object]]:
    """A row a level; comparisons that were made before units had scores of their own have none."""
    for cell in kept["cells"]:
        level = {"comparison_level": cell["comparison_level"]}
        alone = {key: cell.get(key, math.nan) for key in (f"score_unit_{u}" for u in range(1, units + 1))}
        yield {**_who(one), **level, **{key: cell[key] for key in CELL}, **alone}


def _who(one: Controller) -> dict[str, object]:
    return {"task": one.task, "seed_set": one.seed_set, "run": one.run, "evolved_level": one.level}


def _calibration(stage: Stage) -> Iterator[dict[str, object]]:
    """How well each unit's sensors were fitted: counts, and the model's error over the noise."""
    for unit in range(1, stage.config.units + 1):
        for fit in stage.profile(unit).provenance.fits:
            if fit.noise > 0:
                over_all = fit.ratio_over_all or math.nan
                values = (unit, fit.channel, fit.model_error, fit.noise, fit.ratio, over_all)
                yield dict(zip(CALIBRATION, values, strict=True))


def _table(file: Path, rows: Sequence[Mapping[str, object]]) -> None:
    """A CSV file; what is not known is empty."""
    head = list(rows[0]) if rows else list(CALIBRATION)
    whole.write(file, to_csv([head, *([_text(row[key]) for key in head] for row in rows)]))


def _text(value: object) -> str:
    if isinstance(value, float):
        return f"{value:.{DIGITS}g}" if math.isfinite(value) else ""
    return str(value)
