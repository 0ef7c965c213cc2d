"""Synthetic arms of the second study made under known truths, as values and as an arm's tables."""

from __future__ import annotations

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np

from realitygap.experiments.noise.crossed import Crossed
from realitygap.toml import to_toml
from tests.experiments.crosses import TASKS, Truth, flat, study

UNITS = 16
KEYS = ("task", "seed_set", "run", "evolved_level", "individual")
PARTS = ("score", "behaviour", "layout", "noisiness", "responsiveness")


def arm(
    truth: Truth = flat, *, seed: int = 0, runs: int = 32, fall: float = 0.0, failing: float = 0.0,
    tasks: tuple[str, ...] = TASKS, sets: int = 2,
) -> Crossed:  # fmt: skip
    """An arm with sixteen calibration units; `runs` of a task and level in each set.

    `fall`: by how many deviations fitness falls less abroad for each root of the level; `failing`: the share
    of those evolved at another level than 1 that fail besides.
    """
    data, draw = study(truth, seed=seed, runs=runs, tasks=tasks, sets=sets), np.random.default_rng(seed + 1)
    lost = draw.normal(size=len(data)) - fall * np.sqrt(data.evolved)
    fails = ((draw.random(len(data)) < failing) & (data.evolved != 1))[:, None]
    home = 101 + data.run % UNITS
    score = np.where(fails, 2.0, data.score)
    return replace(
        data, home=home, score=score, behaviour=score, layout=score, home_score=score,
        situated_home=data.situated, situated_foreign=data.situated - lost,
    )  # fmt: skip


def write(data: Crossed, folder: Path, *, name: str = "T", error: float = 20.0) -> Path:
    """The tables of a finished arm; the fittest individuals score as the champions do."""
    folder.mkdir(parents=True, exist_ok=True)
    controllers, cells = [], []
    for individual in ("champion", "fittest"):
        champion = individual == "champion"
        for i in range(len(data)):
            who = [data.task[i], data.seed_set[i], data.run[i], data.evolved[i], individual]
            fitness = (data.simulated[i], data.situated[i], data.simulated[i] - data.situated[i])
            abroad = data.situated_foreign[i] if champion else ""
            controllers.append([*who, data.home[i], data.name[i] if champion else "", *fitness,
                                data.situated_home[i], abroad, 16 if champion else 4])  # fmt: skip
            for k, level in enumerate(data.levels):
                score = [getattr(data, part)[i, k] for part in PARTS]
                at_home = data.home_score[i, k]
                more = [at_home, data.score[i, k] if champion else "", at_home, score[0], at_home]
                cells.append([*who, level, *score, data.simulated[i], *more])
    _write(folder / "controllers.csv", [*KEYS, "home_unit", "name", "fitness_simulated", "fitness_situated",
           "drop", "fitness_situated_home", "fitness_situated_foreign", "trials"], controllers)  # fmt: skip
    _write(folder / "cells.csv", [*KEYS, "comparison_level", *PARTS, "fitness_simulated", "score_home",
           "score_foreign", "layout_home", "without_jitter", "without_jitter_home"], cells)  # fmt: skip
    channels = {"infrared": 20.0, "ambient": 9.0}
    rows = [[unit, channel, error * noise / 20, noise, error / 20, error / 20]
            for unit in sorted(set(data.home.tolist())) for channel, noise in channels.items()]  # fmt: skip
    head = ["unit", "channel", "model_error", "noise", "ratio", "ratio_over_all"]
    _write(folder / "calibration.csv", head, rows)
    facts = {"arm": name, "tasks": list(data.tasks), "versions": {"commit": "0" * 40}}
    (folder / "study.toml").write_text(to_toml(facts), "utf-8")
    return folder


def _write(file: Path, head: list[str], rows: list[list[object]]) -> None:
    with file.open("w", newline="") as opened:
        csv.writer(opened).writerows([head, *rows])
