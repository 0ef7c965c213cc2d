"""The result tables of an experiment on measuring or randomising, and its planned comparisons."""

import csv
from collections.abc import Iterator, Mapping
from io import BytesIO
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from realitygap import whole
from realitygap.experiments.folder import RESULTS, Seconds, kept, write_table
from realitygap.experiments.noise.contrasts import holm
from realitygap.experiments.randomise.plan import (
    ALL,
    KNOWN,
    LOOKUP,
    NOISES,
    Condition,
    Controller,
    Profiles,
    RandomiseConfig,
    conditions,
    controllers,
)
from realitygap.experiments.randomise.trials import FIGURES, trial_file
from realitygap.study.versions import versions
from realitygap.toml import to_toml
from realitygap.values import Floats

__all__ = [
    "COMPARISONS", "HOURS", "OUTCOMES", "Comparison", "Outcome", "compared_in", "outcomes",
    "write_results",
]  # fmt: skip

OUTCOMES = ("correspondence", "fitness_situated")
HOURS = {"paper": 0.0, "another unit": 0.0, "own, 5 %": 0.2, "own, 20 %": 0.6, ALL: 3.0, LOOKUP: 3.0}
"""For a person who places the robot, 30 s a place: a convention, not a measurement."""
COMPARISONS = ((("own, 5 %", False), ("paper", True)), ((ALL, False), ("own, 20 %", False)))
"""The tests, first against second, over both levels of noise; the rest is only shown."""

TEXTS = ("known", "randomised", "outcome", "first", "second", "found")
"""Columns without numbers."""
CALIBRATION = ("unit", "known", "channel", "model_error", "noise", "ratio", "recordings")


class Outcome(NamedTuple):
    """A condition's mean over units, with its 95 % interval (Student's t)."""

    condition: Condition
    outcome: str
    mean: float
    low: float
    high: float
    units: int


class Comparison(NamedTuple):
    """A planned comparison: the mean difference over units, its 95 % interval, and p, paired by unit."""

    outcome: str
    first: str
    second: str
    difference: float
    low: float
    high: float
    p: float
    p_holm: float
    found: str


def write_results(folder: Path, config: RandomiseConfig, profiles: Profiles) -> Path:
    """Gather all controllers' results.

    Raises:
        StudyError: a controller's file is missing or broken.
    """
    figures = {one: _read(trial_file(folder, one)) for one in controllers(config)}
    place, spread = folder / RESULTS, profiles.spread()
    place.mkdir(parents=True, exist_ok=True)
    order = sorted(figures, key=lambda one: (conditions().index(one.condition), one.run))
    rows = [[*one.condition, one.run, one.unit, *figures[one].tolist()] for one in order]
    write_table(place / "controllers.csv", ("known", "randomised", "noise", "run", "unit", *FIGURES), rows)
    units = {name: _by_unit(figures, name, config) for name in OUTCOMES}
    found = [one for name in OUTCOMES for one in outcomes(name, units[name])]
    head = ("known", "randomised", "noise", "hours", "outcome", "mean", "low", "high", "units")
    told = [[*one.condition, HOURS[one.condition.known], *one[1:]] for one in found]
    write_table(place / "conditions.csv", head, told)
    write_table(place / "comparisons.csv", Comparison._fields, compared(units))
    write_table(place / "calibration.csv", CALIBRATION, _fits(config, profiles))
    facts = {
        **config.to_dict(),
        "spread": spread._asdict(),
        "controllers": len(figures),
        "seconds": Seconds(folder).read(),
        "versions": versions(),
    }
    whole.write(place / "experiment.toml", to_toml(facts))
    return place


def _fits(config: RandomiseConfig, profiles: Profiles) -> list[list[object]]:
    """Accuracy of each unit's own calibrations, and the number of recordings that each could use."""
    own = [known for known, share in KNOWN.items() if share]
    told = [(unit, known, profiles.of(unit, known).provenance) for unit in config.numbers for known in own]
    return [
        [unit, known, fit.channel, fit.model_error, fit.noise, fit.ratio, len(where.files)]
        for unit, known, where in told
        for fit in where.fits
    ]


def outcomes(name: str, units: Mapping[Condition, Floats]) -> list[Outcome]:
    """Each condition's mean over units, from [units] means of one outcome over each unit's runs, NaN if there
    is none."""
    return [Outcome(condition, name, *_interval(values)) for condition, values in units.items()]


def compared(units: Mapping[str, Mapping[Condition, Floats]]) -> list[Comparison]:
    """The planned comparisons of all outcomes, with one Holm correction over them.

    A unit's value is its mean over both levels of noise; Student's t, paired by unit, two-sided.
    With fewer than two units there is no test: p is NaN, and counts as 1 in the correction.
    """
    from scipy.stats import ttest_1samp

    made = []
    for name, values in units.items():
        for first, second in COMPARISONS:
            gap = _both_levels(values, first) - _both_levels(values, second)
            known = gap[np.isfinite(gap)]
            p = 1.0 if len(known) > 1 else np.nan
            p = float(ttest_1samp(known, 0.0).pvalue) if len(known) > 1 and np.ptp(known) > 0 else p
            difference, low, high, _ = _interval(gap)
            made.append(
                Comparison(name, _words(first), _words(second), difference, low, high, p, 1.0, "open")
            )
    corrected = holm([float(np.nan_to_num(one.p, nan=1.0)) for one in made])
    return [
        one._replace(p_holm=one.p, found="no test")
        if np.isnan(one.p)
        else one._replace(p_holm=p, found="open" if p >= 0.05 else "above" if one.difference > 0 else "below")
        for one, p in zip(made, corrected, strict=True)
    ]


def compared_in(results: Path) -> tuple[list[Outcome], list[Comparison]]:
    """The outcomes and comparisons of a folder of results, with the digits of its tables.

    Raises:
        OSError: no such tables.
    """

    def rows(name: str) -> Iterator[dict[str, Any]]:
        for row in csv.DictReader((results / name).read_text("utf-8").splitlines()):
            yield {key: text if key in TEXTS else float(text or "nan") for key, text in row.items()}

    found = [
        Outcome(
            condition=Condition(row["known"], row["randomised"] == "true", row["noise"]),
            outcome=row["outcome"], mean=row["mean"], low=row["low"], high=row["high"],
            units=int(row["units"]),
        )
        for row in rows("conditions.csv")
    ]  # fmt: skip
    return found, [Comparison(**row) for row in rows("comparisons.csv")]


def _by_unit(
    figures: Mapping[Controller, Floats], name: str, config: RandomiseConfig
) -> dict[Condition, Floats]:
    """[units] means over each unit's runs, by condition."""
    column, made = FIGURES.index(name), {}
    for condition in conditions():
        rows: dict[int, list[float]] = {unit: [] for unit in config.numbers}
        for one, values in figures.items():
            if one.condition == condition and np.isfinite(values[column]):
                rows[one.unit].append(float(values[column]))
        made[condition] = np.array([np.mean(row) if row else np.nan for row in rows.values()])
    return made


def _both_levels(values: Mapping[Condition, Floats], which: tuple[str, bool]) -> Floats:
    levels = [values[Condition(*which, noise)] for noise in NOISES]
    mean: Floats = np.mean(levels, axis=0)
    return mean


def _interval(values: Floats) -> tuple[float, float, float, int]:
    """Mean, its 95 % interval, and the number of values."""
    from scipy.stats import t

    known = values[np.isfinite(values)]
    if not len(known):
        return np.nan, np.nan, np.nan, 0
    mean, n = float(known.mean()), len(known)
    half = float(t.ppf(0.975, n - 1) * known.std(ddof=1) / np.sqrt(n)) if n > 1 else np.nan
    return mean, mean - half, mean + half, n


def _words(which: tuple[str, bool]) -> str:
    return which[0] + ", randomised" * which[1]


def _read(file: Path) -> Floats:
    with kept(file, "the results of a controller's trials"):
        with np.load(BytesIO(file.read_bytes())) as arrays:
            figures: Floats = arrays["figures"]
        if figures.shape != (len(FIGURES),):
            raise ValueError
    return figures
