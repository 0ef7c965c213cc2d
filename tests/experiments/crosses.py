"""Synthetic noise studies made under known truths, as values and as an engine's result files."""

from __future__ import annotations

import csv
from collections.abc import Callable
from pathlib import Path

import numpy as np

from realitygap.experiments.noise.crossed import Crossed

TASKS = ("obstacle-avoidance", "light-seeking")
LEVELS = (0.0, 0.5, 1.0, 2.0, 4.0)
Truth = Callable[[np.ndarray, np.ndarray], np.ndarray]


def flat(evolved: np.ndarray, compared: np.ndarray) -> np.ndarray:
    """No effect of any level."""
    return 6 + 0 * evolved + 0 * compared


def comparison(best: float, by: float = 1.5) -> Truth:
    """Scores fall off from one level of comparison, whatever a controller was evolved under."""
    return lambda evolved, compared: 8 - by * np.abs(np.sqrt(compared) - np.sqrt(best)) + 0 * evolved


def evolution(best: float, by: float = 2.5) -> Truth:
    """Scores fall off from one level of evolution, whatever they are compared with."""
    return lambda evolved, compared: 8 - by * np.abs(np.sqrt(evolved) - np.sqrt(best)) + 0 * compared


def study(
    truth: Truth, *, seed: int = 0, runs: int = 20, sets: int = 2, robot: float = 1.0,
    levels: tuple[float, ...] = LEVELS, tasks: tuple[str, ...] = TASKS,
) -> Crossed:  # fmt: skip
    """A crossed study; `runs` in each set. Controllers differ (deviation 1), and so do their cells (1)."""
    draw = np.random.default_rng(seed)
    keys = [(t, s, e, r) for t in tasks for s in range(1, sets + 1) for e in levels for r in range(runs)]
    task, seed_set, evolved, run = (np.array(column) for column in zip(*keys, strict=True))
    n, compared = len(keys), np.array(levels)
    score = truth(evolved[:, None], compared) + draw.normal(size=(n, 1)) + draw.normal(size=(n, len(levels)))
    score = np.clip(score, 0, 10)
    noisiness = 1.2 * (np.sqrt(robot) - np.sqrt(compared)) + draw.normal(scale=0.2, size=score.shape)
    scale = np.where(task == "light-seeking", 2e-6, 0.5)
    simulated = scale * (1 + draw.normal(scale=0.1, size=n))
    situated = simulated - 0.05 * scale * (1 + draw.normal(scale=0.5, size=n))
    return Crossed(
        levels=compared, robot=robot, task=task, seed_set=seed_set, run=run, home=1 + run % 3,
        evolved=evolved, name=np.full(n, "wall follower"), score=score, behaviour=score, layout=score,
        home_score=np.full_like(score, np.nan), noisiness=noisiness, responsiveness=-noisiness,
        simulated=simulated, situated=situated, situated_home=situated,
        situated_foreign=situated - 0.01 * scale,
    )  # fmt: skip


def write(data: Crossed, out: Path) -> Path:
    """The result files of a study, as the engine writes them."""
    folder = out / "results"
    folder.mkdir(parents=True, exist_ok=True)
    keys = ["task", "seed_set", "run", "evolved_level"]
    rows = list(zip(data.task, data.seed_set, data.run, data.evolved, strict=True))
    with (folder / "controllers.csv").open("w", newline="") as file:
        table = csv.writer(file)
        units = [f"fitness_situated_unit_{unit}" for unit in (1, 2, 3)]
        table.writerow([*keys, "home_unit", "name", "fitness_simulated", "fitness_situated", "drop", *units])
        for i, key in enumerate(rows):
            pair = (data.simulated[i], data.situated[i])
            seen = (data.situated_home[i], data.situated_foreign[i])
            of_units = [seen[int(unit != data.home[i])] for unit in (1, 2, 3)]
            table.writerow([*key, data.home[i], data.name[i], *pair, pair[0] - pair[1], *of_units])
    parts = ["score", "behaviour", "layout", "noisiness", "responsiveness"]
    with (folder / "cells.csv").open("w", newline="") as file:
        table = csv.writer(file)
        table.writerow([*keys, "comparison_level", *parts, "fitness_simulated"])
        for i, key in enumerate(rows):
            for k, level in enumerate(data.levels):
                values = [f"{getattr(data, part)[i, k]:.6g}" for part in parts]
                table.writerow([*key, level, *values, data.simulated[i]])
    (folder / "calibration.csv").write_text(
        "unit,channel,model_error,noise,ratio\n1,infrared,20,20,1\n1,ambient,9,4.5,2\n1,wheels,,0.058,\n"
    )
    (folder / "study.toml").write_text(
        f"levels = {data.levels.tolist()}\nruns = 40\nseed_sets = 2\nunits = 3\nstarts = 8\n"
        f"evaluations = 1000\ntwin_noise = {data.robot}\nseed = 1995\n"
        'command = "realitygap study noise"\ntwin_trials = 9600\n'
        '[versions]\nrealitygap = "0.1.0"\n[seconds]\nevolve = 240.0\nsituated = 3000.0\n'
    )
    return out
