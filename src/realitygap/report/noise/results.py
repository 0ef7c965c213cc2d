"""Reads the results of a study of noise from its folder `results`; refuses missing or broken files."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from realitygap.calibration.misfit import LIMITS
from realitygap.errors import StudyError
from realitygap.experiments.noise.crossed import Crossed, robot_level
from realitygap.table import Table, read_table
from realitygap.toml import read_toml
from realitygap.world.profile import load_profile

__all__ = ["Misfit", "NoiseResults", "read_calibration", "read_results", "real_misfits"]

PARTS = ("score", "behaviour", "layout", "noisiness", "responsiveness")
NEEDED = 3
"""The first of these columns are always present; a controller whose trials were all lost has no values in
them."""
AGAIN = "Let the study finish (realitygap experiment noise --resume), or copy its results again."

Key = tuple[str, int, float, int]
KEY = ("task", "seed_set", "run", "evolved_level")
NEEDS = {
    "controllers.csv": ("home_unit", "name", "fitness_simulated", "fitness_situated"),
    "cells.csv": ("comparison_level", *PARTS), "home.csv": ("comparison_level", "score"),
    "calibration.csv": ("unit", "channel", "model_error", "noise", "ratio"),
}  # fmt: skip
"""Columns of each table."""


class Misfit(NamedTuple):
    """Error of a unit's calibrated model in one channel; above `limit` it exceeds the noise.

    Unit 0 is a real robot. `ratio_over_all` includes dark readings; it is NaN for older calibrations, whose
    `ratio` includes them too.
    """

    unit: int
    channel: str
    model_error: float
    noise: float
    ratio: float
    limit: float
    ratio_over_all: float = math.nan

    @property
    def too_far(self) -> bool:
        """Whether model error exceeds noise here."""
        return self.ratio > self.limit

    @property
    def judged(self) -> bool:
        """Whether `ratio` is of held-out readings that are neither dark nor saturated."""
        return math.isfinite(self.ratio_over_all)


@dataclass(frozen=True, kw_only=True, eq=False)
class NoiseResults:
    """A study's results: scores and fitness, accuracy of the calibration, and settings.

    Attributes:
        lost: number of controllers that are not in `data` because the camera lost them too often.
    """

    folder: Path
    data: Crossed
    lost: int
    calibration: tuple[Misfit, ...]
    settings: Mapping[str, object]


def read_results(folder: str | Path) -> NoiseResults:
    """Read the results of a finished study of noise.

    Args:
        folder: with controllers.csv, cells.csv, calibration.csv and study.toml. A study whose cells.csv
            has no columns for single units may have a home.csv: the score on the calibration unit alone.

    Raises:
        StudyError: a file is missing, unfinished or broken: names the file, the line and the column.
    """
    folder = Path(folder)
    settings = _settings(folder / "study.toml")
    levels = sorted(map(float, settings["levels"]))
    table = _table(folder / "controllers.csv")
    if not table.rows:
        raise StudyError(f"{table.path}: expected a row for each controller, got none. {AGAIN}")
    known = {key: i for i, key in enumerate(_keys(table, levels))}
    if len(known) < len(table.rows):
        raise StudyError(f"{table.path}: expected each controller once. {AGAIN}")
    task, seed_set, evolved, run = (np.array(column) for column in zip(*known, strict=True))
    facts = _controllers(table)
    scores, home_score = _cells(folder / "cells.csv", levels, known, facts["home"])
    if (folder / "home.csv").is_file():
        at_home = _table(folder / "home.csv")
        home_score[_places(at_home, levels, known)] = at_home.numbers("score", empty=True)
    whole = Crossed(
        levels=np.array(levels), robot=robot_level(levels), task=task, seed_set=seed_set, run=run,
        evolved=evolved, home_score=home_score, **facts,
        **{part: scores[:, :, k] for k, part in enumerate(PARTS)},
    )  # fmt: skip
    seen = np.isfinite(scores[:, :, :NEEDED]).all(axis=(1, 2)) & np.isfinite(whole.situated)
    data = whole.only(seen)
    _refuse_holes(folder, data, levels)
    calibration = tuple(read_calibration(folder / "calibration.csv"))
    lost = len(whole) - len(data)
    return NoiseResults(folder=folder, data=data, lost=lost, settings=settings, calibration=calibration)


def _settings(file: Path) -> dict[str, Any]:
    table = read_toml(file, StudyError, f"It holds the results of a study of noise. {AGAIN}", broken=AGAIN)
    levels, noise = table.get("levels"), table.get("twin_noise")
    if not isinstance(levels, list) or not levels or not all(_is_level(level) for level in levels):
        raise StudyError(f"{file}: levels: expected a list of noise levels, got {levels!r}. {AGAIN}")
    if not _is_level(noise):
        raise StudyError(f"{file}: twin_noise: expected a number from 0 on, got {noise!r}. {AGAIN}")
    return table


def _is_level(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and 0 <= value < math.inf


def _table(file: Path) -> Table:
    needs = [*(() if file.name == "calibration.csv" else KEY), *NEEDS[file.name]]
    return read_table(file, StudyError, needs=needs, cure=AGAIN)


def _keys(table: Table, levels: list[float]) -> list[Key]:
    """Task, seed set, evolved level and run of each row."""
    own = [levels[place] for place in _levels(table, "evolved_level", levels)]
    numbers = (table.whole(name).tolist() for name in ("seed_set", "run"))
    return [
        (task, seeds, level, run)
        for task, level, seeds, run in zip(table.texts("task"), own, *numbers, strict=True)
    ]


def _levels(table: Table, column: str, levels: list[float]) -> list[int]:
    """Indices of a column's levels among the study's; tables hold five digits of them."""
    values = table.numbers(column)
    near: NDArray[np.bool_] = np.isclose(values[:, None], levels, rtol=1e-4, atol=0)
    known = ", ".join(f"{level:g}" for level in levels)
    table.refuse(np.logical_not(near.any(axis=1)), column, f"one of the study's levels {known}", values)
    return [int(place) for place in near.argmax(axis=1)]


def _units(table: Table, prefix: str, home: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A figure on each row's calibration unit, and its mean over the others; NaN if it was not kept."""
    names = [name for name in table.columns if name.removeprefix(prefix).isdecimal()]
    units = {int(name.removeprefix(prefix)): table.numbers(name, empty=True).tolist() for name in names}
    own, foreign = np.full((2, len(table.rows)), math.nan)
    for k, unit in enumerate(home.tolist()):
        others = [values[k] for other, values in units.items() if other != unit]
        own[k] = units[unit][k] if unit in units else math.nan
        foreign[k] = math.fsum(others) / len(others) if others else math.nan
    return own, foreign


def _controllers(table: Table) -> dict[str, np.ndarray]:
    home = table.whole("home_unit")
    own, foreign = _units(table, "fitness_situated_unit_", home)
    return {
        "home": home, "name": np.array(table.texts("name")), "simulated": table.numbers("fitness_simulated"),
        "situated": table.numbers("fitness_situated", empty=True), "situated_home": own,
        "situated_foreign": foreign,
    }  # fmt: skip


def _places(table: Table, levels: list[float], known: Mapping[Key, int]) -> tuple[list[int], list[int]]:
    """Indices [controllers, levels] of the rows of a table with each controller at most once a level."""
    keys, places = _keys(table, levels), _levels(table, "comparison_level", levels)
    seen = set()
    for k, (key, at) in enumerate(zip(keys, places, strict=True)):
        if key not in known or (key, at) in seen:
            word = "twice" if key in known else "but not in controllers.csv"
            raise StudyError(f"{table.at(k)}: expected each controller once a level, got {_who(key)} {word}.")
        seen.add((key, at))
    return [known[key] for key in keys], places


def _cells(
    file: Path, levels: list[float], known: Mapping[Key, int], homes: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Scores [controllers, levels, parts], which must be complete; and those of the calibration unit."""
    table = _table(file)
    places = _places(table, levels, known)
    found = np.full((len(known), len(levels), len(PARTS)), np.nan)
    seen, at_home = np.zeros(found.shape[:2], bool), np.full(found.shape[:2], np.nan)
    found[places] = np.stack([table.numbers(part, empty=True) for part in PARTS], axis=1)
    at_home[places] = _units(table, "score_unit_", homes[places[0]])[0]
    seen[places] = True
    if not seen.all():
        missing, at = map(int, np.argwhere(~seen)[0])
        raise StudyError(
            f"{file}: expected every controller at every level, got none at {levels[at]:g} for "
            f"{_who(list(known)[missing])}. {AGAIN}"
        )
    return found, at_home


def _refuse_holes(folder: Path, data: Crossed, levels: list[float]) -> None:
    """Require controllers with scores of every level in every task and seed set."""
    there = set(zip(data.task.tolist(), data.seed_set.tolist(), data.evolved.tolist(), strict=True))
    for task, seed_set, _ in sorted(there):
        for level in levels:
            if (task, seed_set, level) not in there:
                raise StudyError(
                    f"{folder / 'controllers.csv'}: expected controllers of every level that the camera saw, "
                    f"got none evolved at {level:g} for {task}, seed set {seed_set}. {AGAIN}"
                )


def _who(key: Key) -> str:
    return f"{key[0]}, seed set {key[1]}, evolved at {key[2]:g}, run {key[3]}"


def real_misfits(*, judged: bool = True) -> tuple[Misfit, ...]:
    """Model errors of the fit to a real robot's tables, from the provenance of the profile khepera.

    Over all readings if not `judged`, for comparison with older calibrations.
    """
    fits = load_profile("khepera").provenance.fits
    known = [
        Misfit(0, fit.channel, fit.model_error, fit.noise, fit.ratio, LIMITS[fit.channel], fit.ratio_over_all)
        for fit in fits if fit.channel in LIMITS
    ]  # fmt: skip
    return tuple(known if judged else map(_over_all, known))


def _over_all(m: Misfit) -> Misfit:
    ratio = m.ratio_over_all
    return m._replace(model_error=ratio * m.noise, ratio=ratio, ratio_over_all=math.nan)


def read_calibration(file: Path) -> Iterator[Misfit]:
    """Rows with a ratio; channels without one (wheels) are left out."""
    table = _table(file)
    error, noise, ratio = (table.numbers(name, empty=True) for name in ("model_error", "noise", "ratio"))
    name = "ratio_over_all"
    over_all = table.numbers(name, empty=True) if name in table.columns else np.full(len(ratio), math.nan)
    for k, (unit, channel) in enumerate(
        zip(table.whole("unit").tolist(), table.texts("channel"), strict=True)
    ):
        if math.isfinite(ratio[k]):
            limit = LIMITS.get(channel, LIMITS["infrared"])
            yield Misfit(
                unit, channel, float(error[k]), float(noise[k]), float(ratio[k]), limit, float(over_all[k])
            )
