"""Controllers in the simulations: from the same poses, at every level, compared with the twin's paths.

At the measured level also without a camera: by readings and commands.
"""

import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from realitygap.correspondence.names import common_name, namer
from realitygap.correspondence.scale import Scale, exemplar_scale
from realitygap.correspondence.score import compare
from realitygap.correspondence.setting import Setting, setting_of
from realitygap.correspondence.trials import Trial, resampled, trial_of
from realitygap.errors import TrackError
from realitygap.experiments.folder import kept
from realitygap.experiments.noise.plan import Controller, Pair, simulated_file, stream
from realitygap.experiments.noise.situated import Situated, read_situated
from realitygap.experiments.noise.stage import Stage
from realitygap.robots.recording import Recording
from realitygap.study.digest import check_of
from realitygap.track import Trajectory
from realitygap.transfer.apart import distances, in_pseudo_realities
from realitygap.transfer.order import mean
from realitygap.transfer.paths import score

__all__ = ["AS_MEASURED", "LIVED", "compare_all", "lived_apart", "read_compared", "scale_for", "to_json"]

AS_MEASURED = 1.0
"""The noise level of simulations for comparisons without a camera: that of the calibration."""
LIVED = ("readings", "commands", "speeds", "distance", "replay_cm")
"""Means over a unit's trials: see `transfer.without_camera.Lived`."""

FIGURES = ("score", "behaviour", "layout", "noisiness", "responsiveness")
LEAST_TRIALS = 2
"""Smallest number of trials that must remain without those lost by the camera."""


def compare_all(
    stage: Stage, one: Controller, tell: Callable[[float], None] = lambda _: None
) -> dict[str, Any]:
    """Compare a controller's paths on the twin with the simulation at every level.

    Simulated trials of one unit and start have the same draws at every level, scaled by the level, so that
    differences between levels are due to noise, not chance.
    """
    config, units = stage.config, stage.config.driven(one.home, one.individual)
    task, setting = stage.task(one.task), setting_of([], stage.task(one.task))
    driven = read_situated(stage, one)
    situated, fitness, lost = _seen(stage, one, driven)
    cells, names, lived = [], [], {}
    for level in config.levels:
        trajectories, scores = _simulated(stage, one, level, list(situated))
        simulated = {pair: _trial(stage, pair, trajectory) for pair, trajectory in trajectories.items()}
        cell = _cell(stage, [*simulated.values()], [*situated.values()], setting, len(units))
        cell |= _unit_scores(stage, one, simulated, situated, setting)
        cells.append({"comparison_level": level, **cell, "fitness_simulated": mean(scores)})
        if level == one.level:
            body = stage.profile(one.home).body
            names = namer(setting, body.radius_cm).name([*simulated.values()], setting)
        if level == AS_MEASURED and driven.lived is not None and one.individual == "champion":
            apart, pseudo = lived_apart(stage, one, driven, trajectories)
            lived = {"without_camera": apart, "fitness_pseudo": pseudo}
        tell(1.0 / len(config.levels))
    own = next(c for c in cells if c["comparison_level"] == one.level)
    per_unit = {f"fitness_situated_unit_{u}": own for u, own in zip(units, fitness, strict=True)}
    return {
        "name": common_name(names),
        "fitness_simulated": own["fitness_simulated"],
        "fitness_situated": mean(list(per_unit.values())),
        **per_unit,
        "trials": len(situated),
        "trials_lost": lost,
        "task_seconds": task.seconds,
        "cells": cells,
        **lived,
    }


def scale_for(stage: Stage, setting: Setting, units: int) -> Scale:
    """One scale for all comparisons of a task on this many units: the exemplars', for as many pairs of
    trials.

    In pairs a start's contribution to a distance cancels, leaving each trial's noise, so every trial counts,
    on any unit.
    """
    pairs = units * stage.config.starts
    return exemplar_scale(setting.exemplars, pairs, pairs, matched=True, jitter=setting.jitter)


def _unit_scores(
    stage: Stage, one: Controller, simulated: dict[Pair, Trial], situated: dict[Pair, Trial], setting: Setting
) -> dict[str, float]:
    """The score on each unit alone, on the scale for one unit's pairs, which is coarser than that for all
    units.

    An arm of the plan also has its other scores for the calibration unit.
    """
    found = {}
    for unit in stage.config.driven(one.home, one.individual):
        ours = [pair for pair in situated if pair.unit == unit]
        sides = [[side[pair] for pair in ours] for side in (simulated, situated)]
        alone = _cell(stage, sides[0], sides[1], setting, 1, other=unit == one.home)
        found[f"score_unit_{unit}"] = alone["score"]
        if stage.config.arm is not None and unit == one.home:
            found |= {f"{key}_home": alone[key] for key in ("layout", "without_jitter")}
    return found


def read_compared(stage: Stage, one: Controller) -> dict[str, Any]:
    """A controller's stored results.

    Raises:
        StudyError: they are missing or broken.
    """
    file = simulated_file(stage.folder, one)
    with kept(file, "the results of a controller's comparisons"):
        found: dict[str, Any] = json.loads(file.read_text("utf-8"))
        check = found.pop("check", None)  # version 0.1.0 has none
        levels = [cell["comparison_level"] for cell in found["cells"]]
        if check not in (None, check_of(found)) or levels != list(stage.config.levels):
            raise ValueError
    return found


def _seen(stage: Stage, one: Controller, driven: Situated) -> tuple[dict[Pair, Trial], list[float], int]:
    """The twin's comparable trials, mean fitness on each unit, and the number of lost ones."""
    task, robot = stage.task(one.task), stage.profile(one.home)
    trials: dict[Pair, Trial] = {}
    fitness = []
    starts = driven.streams.shape[1]
    for u in driven.units:
        scores = []
        for k in range(1, starts + 1):
            track = driven.track(u, k)
            scores.append(score(track, task, robot))
            try:
                radius, start = robot.body.radius_cm, _start(stage, Pair(u, k))
                trial = resampled(track, start=start, unit=str(u), source=one.name, radius_cm=radius)
            except TrackError:
                continue  # lost for too long: its behaviour is unknown
            if track.found[0] and track.found[-1]:
                trials[Pair(u, k)] = trial
        fitness.append(mean(scores))
    return trials, fitness, driven.streams.size - len(trials)


def _start(stage: Stage, pair: Pair) -> str:
    """A start's name: units with starts of their own share none."""
    return f"{pair.unit}.{pair.start}" if stage.config.starts_by_unit else str(pair.start)


def _simulated(
    stage: Stage, one: Controller, level: float, pairs: Sequence[Pair]
) -> tuple[dict[Pair, Trajectory], list[float]]:
    """A controller in the simulations of all units at a level: trials and their scores."""
    networks = stage.networks(one)
    config = stage.config
    simulations = {u: stage.simulation(one.task, u, one.home, level) for u in {pair.unit for pair in pairs}}
    trials, scores = {}, []
    for pair in pairs:
        name = stream(config, "simulated", *one.key, *pair, seed_set=one.seed_set)
        pose = stage.starts(one.task, one.seed_set, pair.unit)[pair.start - 1]
        trajectory, fitness = simulations[pair.unit].trajectory(networks, stream=name, pose=pose)
        trials[pair] = trajectory
        scores.append(fitness)
    return trials, scores


def _trial(stage: Stage, pair: Pair, trajectory: Trajectory) -> Trial:
    radius = stage.profile(pair.unit).body.radius_cm
    return trial_of(trajectory, start=_start(stage, pair), unit=str(pair.unit), radius_cm=radius)


def _cell(
    stage: Stage, simulated: Sequence[Trial], situated: Sequence[Trial], setting: Setting, units: int,
    *, other: bool = True,
) -> dict[str, float]:  # fmt: skip
    """One comparison's figures over a number of units; NaN if too few trials are left.

    For an arm of the plan also the `other` score, without jitter.
    """
    other = other and stage.config.arm is not None
    if len(situated) < LEAST_TRIALS:
        return dict.fromkeys((*FIGURES, *(("without_jitter",) if other else ())), math.nan)
    found = compare(simulated, situated, setting, scale=scale_for(stage, setting, units), resamples=0)
    calm = {}
    if other:
        setting = replace(setting, jitter=False)
        scale = scale_for(stage, setting, units)
        calm["without_jitter"] = compare(simulated, situated, setting, scale=scale, resamples=0).score
    figures = {key: getattr(found, key) for key in FIGURES}
    return {key: math.nan if value is None else value for key, value in figures.items()} | calm


def lived_apart(
    stage: Stage, one: Controller, kept: Situated, simulated: Mapping[Pair, Trajectory]
) -> tuple[dict[str, dict[str, float]], float]:
    """A controller's distances without a camera on each unit, and its fitness in pseudo-realities.

    Args:
        stage: of the study.
        one: the controller.
        kept: its situated trials.
        simulated: the stored trials, in simulations as noisy as the robots.
    """
    task, found = stage.task(one.task), {}
    for unit in kept.units:
        quiet = stage.simulation(one.task, unit, one.home, 0.0)
        starts = stage.starts(one.task, one.seed_set, unit)
        rows = []
        for pair in (pair for pair in simulated if pair.unit == unit):
            recording, pose = _recording(stage, one, kept, pair), starts[pair.start - 1]
            rows.append(distances(simulated[pair], recording, kept.track(*pair), pose, quiet))
        found[str(unit)] = {key: mean([row[key] for row in rows]) for key in LIVED}
    robots = stream(stage.config, "pseudo", one.task, one.home)
    home = stage.simulation(one.task, one.home, one.home, 0.0).profile
    return found, in_pseudo_realities(task, home, stage.networks(one), robots)


def _recording(stage: Stage, one: Controller, kept: Situated, pair: Pair) -> Recording:
    """A trial's recording, as far as it was kept."""
    assert kept.lived is not None
    place = kept.units.index(pair.unit), pair.start - 1
    readings, commands, speeds = (each[place].astype(np.float64) for each in kept.lived)
    steps, kinds = len(readings), stage.task(one.task).kinds
    ends = np.cumsum([len(stage.profile(pair.unit).channel(kind).sensors) for kind in kinds])[:-1]
    columns = dict.fromkeys(("proximity", "ambient"), np.empty((steps, 0)))
    columns.update(zip(kinds, np.split(readings, ends, axis=1), strict=True))
    unknown = np.full((steps, 2), np.nan)
    return Recording(
        t=np.arange(steps, dtype=np.float64) * kept.period_s, late=np.zeros(steps),
        inputs=np.empty((steps, 0), np.int64),
        commands=commands.astype(np.int64), counters=unknown, speeds=speeds, read=unknown[:, 0],
        ended="finished", proximity=columns["proximity"], ambient=columns["ambient"],
    )  # fmt: skip


def to_json(compared: dict[str, Any]) -> str:
    """The content of a controller's file of comparisons."""
    return json.dumps({**compared, "check": check_of(compared)}, indent=1) + "\n"
