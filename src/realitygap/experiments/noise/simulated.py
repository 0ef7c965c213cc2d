"""Controllers in the simulations: from the same poses, at every level, held against the twin's paths."""

import json
import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from realitygap import whole
from realitygap.correspondence.names import common_name, namer
from realitygap.correspondence.scale import Scale, exemplar_scale
from realitygap.correspondence.score import compare
from realitygap.correspondence.setting import Setting, setting_of
from realitygap.correspondence.trials import Trial, resampled, trial_of
from realitygap.errors import StudyError, TrackError
from realitygap.experiments.noise.plan import Controller, simulated_file, stream
from realitygap.experiments.noise.situated import read_situated
from realitygap.experiments.noise.stage import Stage
from realitygap.study.digest import check_of
from realitygap.transfer.paths import score

__all__ = ["compare_all", "keep_compared", "read_compared", "scale_for"]

LEAST_TRIALS = 2
"""So many have to be left, when those that the camera lost are taken out."""


class Pair(NamedTuple):
    """A place in the design: unit and start, both from 1."""

    unit: int
    start: int


def compare_all(
    stage: Stage, one: Controller, tell: Callable[[float], None] = lambda _: None
) -> dict[str, Any]:
    """Hold a controller's paths on the twin against the simulation at every level.

    Simulated trials of one unit and start have the same draws at every level, which differ in how
    loud they are: so a difference between levels is one of noise, and not of luck.
    """
    config = stage.config
    task, setting = stage.task(one.task), setting_of([], stage.task(one.task))
    scale = scale_for(stage, setting, config.units)
    situated, fitness, lost = _seen(stage, one)
    cells, names = [], []
    for level in config.levels:
        simulated, scores = _simulated(stage, one, level, list(situated))
        cell = _cell([*simulated.values()], [*situated.values()], setting, scale)
        cell |= _unit_scores(stage, simulated, situated, setting)
        cells.append({"comparison_level": level, **cell, "fitness_simulated": _mean(scores)})
        if level == one.level:
            body = stage.profile(one.home).body
            names = namer(setting, body.radius_cm).name([*simulated.values()], setting)
        tell(1.0 / len(config.levels))
    own = next(c for c in cells if c["comparison_level"] == one.level)
    per_unit = {f"fitness_situated_unit_{u}": fitness[u - 1] for u in range(1, config.units + 1)}
    return {
        "name": common_name(names),
        "fitness_simulated": own["fitness_simulated"],
        "fitness_situated": _mean(list(per_unit.values())),
        **per_unit,
        "trials": len(situated),
        "trials_lost": lost,
        "task_seconds": task.seconds,
        "cells": cells,
    }


def scale_for(stage: Stage, setting: Setting, units: int) -> Scale:
    """One scale for all comparisons of a task on so many units: the exemplars', for so many pairs of trials.

    In pairs a start's own share drops out of a distance, and what is left is each trial's noise: so
    every trial counts, on whichever unit.
    """
    pairs = units * stage.config.starts
    return exemplar_scale(setting.exemplars, pairs, pairs, matched=True)


def _unit_scores(
    stage: Stage, simulated: dict[Pair, Trial], situated: dict[Pair, Trial], setting: Setting
) -> dict[str, float]:
    """The score on each unit alone, on the scale for one unit's pairs: it is coarser than all units' own."""
    scale, found = scale_for(stage, setting, 1), {}
    for unit in range(1, stage.config.units + 1):
        ours = [pair for pair in situated if pair.unit == unit]
        sides = [[side[pair] for pair in ours] for side in (simulated, situated)]
        found[f"score_unit_{unit}"] = _cell(sides[0], sides[1], setting, scale)["score"]
    return found


def read_compared(stage: Stage, one: Controller) -> dict[str, Any]:
    """What came of a controller, as it was kept.

    Raises:
        StudyError: it is not there, or broken.
    """
    file = simulated_file(stage.folder, one)
    try:
        found: dict[str, Any] = json.loads(file.read_text("utf-8"))
        check = found.pop("check", None)  # one of 0.1.0 has none
        if check not in (None, check_of(found)):
            raise ValueError
        if [cell["comparison_level"] for cell in found["cells"]] != list(stage.config.levels):
            raise ValueError
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
        cure = "Delete it and resume: it is made again."
        raise StudyError(f"{file}: expected what came of a controller's comparisons. {cure}") from None
    return found


def _seen(stage: Stage, one: Controller) -> tuple[dict[Pair, Trial], list[float], int]:
    """The twin's trials that can be compared, mean fitness on each unit, and how many are lost."""
    task, robot = stage.task(one.task), stage.profile(one.home)
    trials: dict[Pair, Trial] = {}
    fitness = []
    kept = read_situated(stage, one)
    units, starts = kept.streams.shape
    for u in range(1, units + 1):
        scores = []
        for k in range(1, starts + 1):
            track = kept.track(u, k)
            scores.append(score(track, task, robot))
            try:
                radius = robot.body.radius_cm
                trial = resampled(track, start=str(k), unit=str(u), source=one.name, radius_cm=radius)
            except TrackError:
                continue  # lost for too long: nobody knows what it did
            if track.found[0] and track.found[-1]:
                trials[Pair(u, k)] = trial
        fitness.append(_mean(scores))
    return trials, fitness, units * starts - len(trials)


def _simulated(
    stage: Stage, one: Controller, level: float, pairs: Sequence[Pair]
) -> tuple[dict[Pair, Trial], list[float]]:
    """A controller in the simulations of all units at a level: trials and their scores."""
    networks = stage.networks(one)
    starts, config = stage.starts(one.task, one.seed_set), stage.config
    simulations = {u: stage.simulation(one.task, u, one.home, level) for u in {pair.unit for pair in pairs}}
    trials, scores = {}, []
    for pair in pairs:
        names = (one.task, one.seed_set, one.level, one.run, *pair)
        trajectory, fitness = simulations[pair.unit].trajectory(
            networks, stream=stream(config, "simulated", *names), pose=starts[pair.start - 1]
        )
        radius = simulations[pair.unit].profile.body.radius_cm
        trials[pair] = trial_of(trajectory, start=str(pair.start), unit=str(pair.unit), radius_cm=radius)
        scores.append(fitness)
    return trials, scores


def _cell(
    simulated: Sequence[Trial], situated: Sequence[Trial], setting: Setting, scale: Scale
) -> dict[str, float]:
    """One comparison's figures; NaN where too few trials are left to compare."""
    if len(situated) < LEAST_TRIALS:
        return dict.fromkeys(("score", "behaviour", "layout", "noisiness", "responsiveness"), math.nan)
    found = compare(simulated, situated, setting, scale=scale, resamples=0)
    response = math.nan if found.responsiveness is None else found.responsiveness
    return {
        "score": found.score,
        "behaviour": found.behaviour,
        "layout": found.layout,
        "noisiness": found.noisiness,
        "responsiveness": response,
    }


def _mean(values: Sequence[float]) -> float:
    """Of those that are known; NaN of none."""
    known = [value for value in values if math.isfinite(value)]
    return math.fsum(known) / len(known) if known else math.nan


def keep_compared(folder: Path, one: Controller, kept: dict[str, Any]) -> None:
    """Write down what came of a controller's comparisons."""
    file = simulated_file(folder, one)
    file.parent.mkdir(parents=True, exist_ok=True)
    whole.write(file, json.dumps({**kept, "check": check_of(kept)}, indent=1) + "\n")
