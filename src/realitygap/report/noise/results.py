"""Reads what a study of noise left in its folder `results`; refuses what is missing or broken."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from realitygap.errors import StudyError
from realitygap.experiments.noise.crossed import Crossed, robot_level
from realitygap.toml import read_toml

__all__ = ["Misfit", "NoiseResults", "read_results", "real_misfits"]

PARTS = ("score", "behaviour", "layout", "noisiness", "responsiveness")
NEEDED = 3
"""Of these the first so many; a controller whose trials were all lost has none of them."""
AGAIN = "Let the study finish (realitygap experiment noise --resume), or copy its results again."

Key = tuple[str, int, float, int]


class Misfit(NamedTuple):
    """How far a unit's calibrated model is from it in one channel; beyond `limit` noise explains nothing.

    Unit 0 is a real robot.
    """

    unit: int
    channel: str
    model_error: float
    noise: float
    ratio: float
    limit: float

    @property
    def too_far(self) -> bool:
        """Whether model error exceeds noise here."""
        return self.ratio > self.limit


@dataclass(frozen=True, kw_only=True, eq=False)
class NoiseResults:
    """All that a study found: scores and fitness, how well it was calibrated, and its settings.

    Attributes:
        lost: how many controllers are not in `data`, for the camera lost them too often.
    """

    folder: Path
    data: Crossed
    lost: int
    calibration: tuple[Misfit, ...]
    settings: Mapping[str, object]


class _Row:
    """One line of a table: its columns, asked for by name."""

    def __init__(self, file: Path, line: int, columns: Mapping[str, str]) -> None:
        self.where, self.columns = f"{file}, line {line}", columns

    def text(self, column: str) -> str:
        value = self.columns.get(column)
        if value is None:
            raise StudyError(f"{self.where}: expected a column {column}, got none. {AGAIN}")
        return str(value).strip()

    def number(self, column: str, *, may_lack: bool = False) -> float:
        text = self.text(column)
        if may_lack and text in ("", "None", "nan"):
            return math.nan
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            raise StudyError(f"{self.where}: {column}: expected a number, got {text!r}. {AGAIN}")
        return value

    def units(self, prefix: str) -> dict[int, float]:
        """A figure for each unit; columns that a study did not keep yet are none."""
        found = {}
        for name in self.columns:
            before, _, unit = str(name).rpartition(prefix)
            if not before and unit.isdecimal():
                found[int(unit)] = self.number(name, may_lack=True)
        return found

    def key(self, levels: list[float]) -> Key:
        """Whose row it is: task, seed set, evolved level, run."""
        level = levels[self.level("evolved_level", levels)]
        return self.text("task"), int(self.number("seed_set")), level, int(self.number("run"))

    def level(self, column: str, levels: list[float]) -> int:
        """Place of a level among the study's; tables hold five digits of it."""
        value = self.number(column)
        for place, level in enumerate(levels):
            if math.isclose(value, level, rel_tol=1e-4):
                return place
        known = ", ".join(f"{level:g}" for level in levels)
        raise StudyError(
            f"{self.where}: {column}: expected one of the study's levels {known}, got {value:g}. {AGAIN}"
        )


def read_results(folder: str | Path) -> NoiseResults:
    """What a finished study of noise left.

    Args:
        folder: with controllers.csv, cells.csv, calibration.csv and study.toml. A study whose cells.csv
            has no columns for single units may have a home.csv: the score on the calibration unit alone.

    Raises:
        StudyError: a file is missing, unfinished or broken: names the file, the line and the column.
    """
    folder = Path(folder)
    settings = _settings(folder / "study.toml")
    levels = sorted(map(float, settings["levels"]))
    who = list(_controllers(folder / "controllers.csv", levels))
    known = {key: i for i, (key, _) in enumerate(who)}
    if len(known) < len(who):
        raise StudyError(f"{folder / 'controllers.csv'}: expected each controller once. {AGAIN}")
    task, seed_set, evolved, run = (np.array(column) for column in zip(*known, strict=True))
    facts = {name: np.array([getattr(one, name) for _, one in who]) for name in _Facts._fields}
    scores, home_score = _cells(folder / "cells.csv", levels, known, facts["home"])
    if (folder / "home.csv").is_file():
        _home(folder / "home.csv", levels, known, home_score)
    whole = Crossed(
        levels=np.array(levels), robot=robot_level(levels), task=task, seed_set=seed_set, run=run,
        evolved=evolved, home_score=home_score, **facts,
        **{part: scores[:, :, k] for k, part in enumerate(PARTS)},
    )  # fmt: skip
    seen = np.isfinite(scores[:, :, :NEEDED]).all(axis=(1, 2)) & np.isfinite(whole.situated)
    data = whole.only(seen)
    _refuse_holes(folder, data, levels)
    calibration = tuple(_calibration(folder / "calibration.csv"))
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


def _rows(file: Path) -> Iterator[_Row]:
    try:
        with file.open(newline="", encoding="utf-8") as stream:
            table = csv.DictReader(stream, strict=True)
            for columns in table:
                yield _Row(file, table.line_num, columns)
    except FileNotFoundError:
        raise StudyError(f"{file}: expected a table of the study, got no such file. {AGAIN}") from None
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise StudyError(f"{file}: expected a CSV file, got {error}. {AGAIN}") from None


class _Facts(NamedTuple):
    """A row of controllers.csv."""

    home: int
    name: str
    simulated: float
    situated: float
    situated_home: float
    situated_foreign: float


def _controllers(file: Path, levels: list[float]) -> Iterator[tuple[Key, _Facts]]:
    empty = True
    for row in _rows(file):
        empty = False
        fitness = row.number("fitness_simulated"), row.number("fitness_situated", may_lack=True)
        home, units = int(row.number("home_unit")), row.units("fitness_situated_unit_")
        own = units.pop(home, math.nan)
        foreign = math.fsum(units.values()) / len(units) if units else math.nan
        yield row.key(levels), _Facts(home, row.text("name"), *fitness, own, foreign)
    if empty:
        raise StudyError(f"{file}: expected a row for each controller, got none. {AGAIN}")


def _placed(file: Path, levels: list[float], known: Mapping[Key, int]) -> Iterator[tuple[_Row, int, int]]:
    """Rows of a table that has each controller at most once a level, with their places [n, L]."""
    seen = set()
    for row in _rows(file):
        key, at = row.key(levels), row.level("comparison_level", levels)
        if key not in known or (key, at) in seen:
            word = "twice" if key in known else "but not in controllers.csv"
            raise StudyError(f"{row.where}: expected each controller once a level, got {_who(key)} {word}.")
        seen.add((key, at))
        yield row, known[key], at


def _home(file: Path, levels: list[float], known: Mapping[Key, int], into: np.ndarray) -> None:
    """Fill in scores on the calibration unit [controllers, levels] that were made after the study's own
    tables."""
    for row, one, at in _placed(file, levels, known):
        into[one, at] = row.number("score", may_lack=True)


def _cells(
    file: Path, levels: list[float], known: Mapping[Key, int], homes: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Scores [controllers, levels, parts], of which none may be missing; and those of the calibration
    unit."""
    found = np.full((len(known), len(levels), len(PARTS)), np.nan)
    seen, at_home = np.zeros(found.shape[:2], bool), np.full(found.shape[:2], np.nan)
    for row, one, at in _placed(file, levels, known):
        found[one, at] = [row.number(part, may_lack=True) for part in PARTS]
        at_home[one, at] = row.units("score_unit_").get(int(homes[one]), math.nan)
        seen[one, at] = True
    if not seen.all():
        missing, at = map(int, np.argwhere(~seen)[0])
        raise StudyError(
            f"{file}: expected every controller at every level, got none at {levels[at]:g} for "
            f"{_who(list(known)[missing])}. {AGAIN}"
        )
    return found, at_home


def _refuse_holes(folder: Path, data: Crossed, levels: list[float]) -> None:
    """Every task and seed set must have controllers of every level, with a score."""
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


def real_misfits() -> tuple[Misfit, ...]:
    """How near the fit came to a real robot's tables: the provenance of the profile khepera."""
    from realitygap.calibration.judge import LIMITS
    from realitygap.world.profile import load_profile

    fits = load_profile("khepera").provenance.fits
    return tuple(
        Misfit(0, fit.channel, fit.model_error, fit.noise, fit.ratio, LIMITS[fit.channel])
        for fit in fits if fit.channel in LIMITS
    )  # fmt: skip


def _calibration(file: Path) -> Iterator[Misfit]:
    """Rows with a ratio; a channel without one (wheels) is left out."""
    from realitygap.calibration.judge import LIMITS

    for row in _rows(file):
        channel, ratio = row.text("channel"), row.number("ratio", may_lack=True)
        if math.isfinite(ratio):
            error, noise = (row.number(c, may_lack=True) for c in ("model_error", "noise"))
            limit = LIMITS.get(channel, LIMITS["infrared"])
            yield Misfit(int(row.number("unit")), channel, error, noise, ratio, limit)
