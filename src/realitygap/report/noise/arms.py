"""Reads the results of an arm of the second study, judges it, and checks its calibration."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from realitygap.errors import StudyError
from realitygap.experiments.noise.claims import Split, split_diagonal
from realitygap.experiments.noise.crossed import Crossed
from realitygap.experiments.noise.second.arms import plan_digests
from realitygap.experiments.noise.second.stratified import Tested
from realitygap.experiments.noise.second.verdicts import PLAN, Judgement, by_mixed_models, judge
from realitygap.report.noise.orders import read_orders
from realitygap.report.noise.results import Misfit, read_calibration
from realitygap.report.noise.words import CHANNEL_TASKS
from realitygap.table import Table, read_table
from realitygap.toml import read_toml
from realitygap.transfer.order import Order
from realitygap.values import Floats

__all__ = ["BEYOND", "Arm", "arm_folder", "read_arm"]

KEY = ("task", "seed_set", "run", "evolved_level", "individual")
FITNESS = ("fitness_simulated", "fitness_situated", "fitness_situated_home", "fitness_situated_foreign")
PARTS = (
    "score", "score_home", "behaviour", "layout", "layout_home", "noisiness", "responsiveness",
    "without_jitter", "without_jitter_home",
)  # fmt: skip
BEYOND = "without units beyond the limit"
AGAIN = "Let the arm finish, or copy its results again."
RESTORE = "Restore it from a copy."
"""Where it may as well be a study's."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Arm:
    """One arm: its champions, and alternatively the fittest individuals; and other scores of both.

    Attributes:
        data: champions that were seen. fittest: judged on their calibration unit, the only one that they
            drove.
        others: the champions again, by another score. lost: champions that the camera lost.
        orders: agreement of measures without a camera with the camera's score, by task, where known.
    """

    name: str
    folder: Path
    settings: Mapping[str, Any]
    data: Crossed
    fittest: Crossed
    others: Mapping[str, Crossed]
    lost: int
    calibration: tuple[Misfit, ...]
    orders: tuple[Order, ...] = ()

    @cached_property
    def beyond(self) -> list[int]:
        """Units whose model errs by more than the limit in a channel that a task feeds."""
        fed = {channel for channel, task in CHANNEL_TASKS.items() if task in self.data.tasks}
        return sorted({m.unit for m in self.calibration if m.channel in fed and m.too_far})

    @property
    def void(self) -> bool:
        """Whether the model errs too much, on too many units, for any claim about noise."""
        of = len({m.unit for m in self.calibration})
        return len(self.beyond) > PLAN.misfit * of

    @cached_property
    def judged(self) -> Judgement:
        """The planned analysis."""
        return judge(self.data)

    @property
    def again(self) -> dict[str, Crossed]:
        """Other scores, other individuals, and champions without units whose model errs too much."""
        kept = {BEYOND: self.data.only(~np.isin(self.data.home, self.beyond))} if self.beyond else {}
        every = {**self.others, "fittest individual": self.fittest, **kept}
        return {name: data for name, data in every.items() if len(data)}

    @cached_property
    def robust(self) -> dict[str, Judgement]:
        """The planned analysis of each of those, with fewer permutations."""
        quick = replace(PLAN, permutations=PLAN.permutations // 10)
        return {
            name: judge(data, replace(quick, bound=0.0) if name == "fitness" else quick)
            for name, data in self.again.items()
        }

    @cached_property
    def mixed(self) -> dict[tuple[str, str], Tested]:
        """Mixed models beside (b) and (d)."""
        return by_mixed_models(self.data)

    @cached_property
    def split(self) -> tuple[Split, ...]:
        """The diagonal's difference from each other level, on the calibration unit, in both orders."""
        data = self.data.only(np.asarray(np.isfinite(self.data.home_score).all(axis=1)))
        there = np.isin(data.levels, data.evolved)
        home = data.home_score[:, there]
        return split_diagonal(replace(data, levels=data.levels[there], score=home), resamples=PLAN.resamples)


def arm_folder(folder: str | Path) -> Path | None:
    """The folder of an arm's tables: this one, or `results` in it; None if it is not an arm."""
    for one in (Path(folder), Path(folder) / "results"):
        file = one / "study.toml"
        if file.is_file() and "arm" in read_toml(file, StudyError, RESTORE, broken=RESTORE):
            return one
    return None


def read_arm(folder: str | Path) -> Arm:
    """Read a finished arm's results.

    Args:
        folder: with controllers.csv, cells.csv, calibration.csv and study.toml.

    Raises:
        StudyError: a file is missing, unfinished or broken: names the file, the line and the column; or the
            arm was started under another plan, with other claims.
    """
    folder = Path(folder)
    settings = read_toml(folder / "study.toml", StudyError, AGAIN, broken=AGAIN)
    now = plan_digests()
    if settings.get("plan", now) != now:
        cure = "Judge it with the version that started it."
        raise StudyError(f"{folder / 'study.toml'}: plan: expected {now}, got {settings['plan']}. {cure}")
    table = read_table(folder / "controllers.csv", StudyError, needs=(*KEY, "home_unit", "name", *FITNESS),
                       cure=AGAIN)  # fmt: skip
    keys = {key: i for i, key in enumerate(_keys(table))}
    if len(keys) < len(table.rows) or not keys:
        raise StudyError(f"{table.path}: expected each controller exactly once. {AGAIN}")
    levels, parts = _cells(folder / "cells.csv", keys)
    task, seed_set, run, evolved, individual = (np.array(column) for column in zip(*keys, strict=True))
    fitness = [table.numbers(name, empty=True) for name in FITNESS]
    whole = Crossed(
        levels=levels, robot=PLAN.robot, task=task, seed_set=seed_set, run=run, evolved=evolved,
        home=table.whole("home_unit"), name=np.array(table.texts("name")), home_score=parts["score_home"],
        simulated=fitness[0], situated=fitness[1], situated_home=fitness[2], situated_foreign=fitness[3],
        **{name: parts[name] for name in ("score", "behaviour", "layout", "noisiness", "responsiveness")},
    )  # fmt: skip
    needed = {PLAN.robot, *PLAN.against}
    for name, found in (("comparison_level", levels), ("evolved_level", evolved)):
        if not needed <= set(found.tolist()):
            raise StudyError(f"{folder}: {name}: expected levels {sorted(needed)} among others, got "
                             f"{sorted(set(found.tolist()))}. {AGAIN}")  # fmt: skip
    seen, champion = np.isfinite(parts["score"]).all(axis=1), individual == "champion"
    kept = champion & seen
    of_fitness = _fitness(whole.only(kept))
    calm = replace(whole, score=parts["without_jitter"], home_score=parts["without_jitter_home"])
    rooms = replace(whole, score=whole.layout, home_score=parts["layout_home"])
    homes = dict(zip(keys, whole.home.tolist(), strict=True))
    at_home = np.isfinite(whole.home_score).all(axis=1) & (individual == "fittest")
    return Arm(
        name=str(settings.get("arm")), folder=folder, settings=settings, data=whole.only(kept),
        fittest=replace(whole, score=whole.home_score).only(at_home),
        others={"without jitter": calm.only(kept), "layout alone": rooms.only(kept), "fitness": of_fitness},
        lost=int((champion & ~seen).sum()), calibration=tuple(read_calibration(folder / "calibration.csv")),
        orders=read_orders(folder, settings.get("robot", "twin"), AGAIN, homes),
    )  # fmt: skip


def _fitness(data: Crossed) -> Crossed:
    """Fitness on the robot in place of the scores, standardised within the task; nothing for (a)."""
    made = []
    for values in (data.situated, data.situated_home):
        scaled = np.full(len(data), np.nan)
        for task in data.tasks:
            own = data.task == task
            scaled[own] = (values[own] - np.nanmean(values[own])) / (np.nanstd(values[own]) or 1.0)
        made.append(np.tile(scaled[:, None], len(data.levels)))
    return replace(data, score=made[0], home_score=made[1])


def _cells(file: Path, keys: Mapping[tuple[Any, ...], int]) -> tuple[Floats, dict[str, Floats]]:
    """Comparison levels, and each part [controllers, levels]; nan for a lost controller."""
    table = read_table(file, StudyError, needs=(*KEY, "comparison_level", *PARTS), cure=AGAIN)
    compared = table.numbers("comparison_level")
    levels, at = np.unique(compared, return_inverse=True)
    found = _keys(table)
    unknown = np.array([key not in keys for key in found])
    table.refuse(unknown, "run", "a controller of controllers.csv", [" ".join(map(str, k)) for k in found])
    places = np.array([keys[key] for key in found]), at
    count = np.zeros((len(keys), len(levels)), np.int64)
    np.add.at(count, places, 1)
    if (count != 1).any():
        who = list(keys)[int(np.argwhere(count != 1)[0][0])]
        raise StudyError(f"{file}: expected every controller once at each of levels {levels.tolist()}, not "
                         f"so {' '.join(map(str, who))}. {AGAIN}")  # fmt: skip
    parts = {}
    for name in PARTS:
        parts[name] = np.full(count.shape, np.nan)
        parts[name][places] = table.numbers(name, empty=True)
    return levels, parts


def _keys(table: Table) -> list[tuple[Any, ...]]:
    numbers = (table.whole(name).tolist() for name in ("seed_set", "run"))
    levels = table.numbers("evolved_level").tolist()
    return list(zip(table.texts("task"), *numbers, levels, table.texts("individual"), strict=True))
