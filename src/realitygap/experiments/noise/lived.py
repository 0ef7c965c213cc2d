"""Whether a camera is needed: how far apart a controller's trials are in what was read and done, by unit."""

from collections.abc import Mapping

import numpy as np

from realitygap.experiments.noise.plan import Controller, Pair, stream
from realitygap.experiments.noise.situated import Situated
from realitygap.experiments.noise.stage import Stage
from realitygap.robots.recording import Recording
from realitygap.track import Trajectory
from realitygap.transfer.apart import apart, in_pseudo_realities, replayed
from realitygap.transfer.order import mean

__all__ = ["AS_MEASURED", "LIVED", "lived_apart"]

AS_MEASURED = 1.0
"""The level of the simulations that robots are held against: as noisy as calibration found these."""

LIVED = ("readings", "commands", "speeds", "distance", "replay_cm")
"""Means over a unit's trials: see `transfer.without_camera.Lived`."""


def lived_apart(
    stage: Stage, one: Controller, kept: Situated, simulated: Mapping[Pair, Trajectory]
) -> tuple[dict[str, dict[str, float]], float]:
    """A controller's distances without a camera on each unit, and its fitness in pseudo-realities.

    Args:
        stage: of the study.
        one: who drove.
        kept: its trials on the robots, with what these read and did.
        simulated: the same trials, by unit and start, in the simulations that are as noisy as the robots.
    """
    task, found = stage.task(one.task), {}
    for unit in kept.units:
        quiet = stage.simulation(one.task, unit, one.home, 0.0)
        rows = []
        for pair in (pair for pair in simulated if pair.unit == unit):
            recording = _recording(stage, one, kept, pair)
            far = apart(simulated[pair], recording, quiet.profile, task)
            pose = stage.starts(one.task, one.seed_set, unit)[pair.start - 1]
            error = replayed(quiet, recording, kept.track(*pair), pose)
            rows.append({**far, "distance": mean(list(far.values())), "replay_cm": error})
        found[str(unit)] = {key: mean([row[key] for row in rows]) for key in LIVED}
    robots = stream(stage.config, "pseudo", one.task, one.home)
    home = stage.simulation(one.task, one.home, one.home, 0.0).profile
    return found, in_pseudo_realities(task, home, stage.networks(one), robots)


def _recording(stage: Stage, one: Controller, kept: Situated, pair: Pair) -> Recording:
    """A trial's recording, as much of it as was kept."""
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
