"""A score without a camera: the distance of a robot's readings and commands from the simulated one's.

    from realitygap.transfer.without_camera import without_camera

    found = without_camera("out/reproduce")
    for one in found.controllers:
        print(one.name, one.distance)

If a camera also saw the trials, both orders of controllers are compared. Other published measures are
included: the correlation of fitness (Kadian et al. 2020), the error of replayed commands, and fitness in
pseudo-realities sampled round the profile (Ligot and Birattari 2020).
"""

import math
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from os import PathLike
from typing import Any, NamedTuple

import numpy as np

from realitygap.errors import StudyError
from realitygap.simulation.simulation import Simulation
from realitygap.study.load import Study, as_study
from realitygap.transfer.apart import distances, in_pseudo_realities
from realitygap.transfer.chosen import number_of
from realitygap.transfer.load import Transferred
from realitygap.transfer.order import Order, mean, order_of
from realitygap.transfer.replay import Replay, Replays
from realitygap.transfer.score_row import Job
from realitygap.transfer.score_rows import jobs_of
from realitygap.values import Floats

__all__ = ["Lived", "WithoutCamera", "without_camera"]

SEEN = ("robot", "camera", "film")
"""Sources of a path that show slip."""


@dataclass(frozen=True, kw_only=True)
class Lived:
    """One controller on one kind of robot: means over its trials.

    Attributes:
        run, name, task, noise: of the run; individual: champion or fittest.
        kind: of robot; units, trials: numbers of those compared.
        readings, commands, speeds: distances between simulated and situated trials of a start (`apart`).
        distance: the mean of those of the three that exist.
        correspondence: the camera's score, 0 to 10, mean over units; NaN without a camera.
        replay_cm: distance of the robot's path from the simulated one under the robot's commands.
        fitness_simulated, fitness_situated: of the same trials; fitness_pseudo: in pseudo-realities.
        left_out: trials that this version would simulate differently, or without a recording.
    """

    run: int
    name: str
    task: str
    noise: float
    individual: str
    kind: str
    units: int
    trials: int
    readings: float
    commands: float
    speeds: float
    distance: float
    correspondence: float
    replay_cm: float
    fitness_simulated: float
    fitness_situated: float
    fitness_pseudo: float
    left_out: int


@dataclass(frozen=True, kw_only=True)
class WithoutCamera:
    """All controllers, and the agreement of their orders for each task, individual and kind of robot."""

    controllers: tuple[Lived, ...]
    orders: tuple[Order, ...]

    def to_dict(self) -> dict[str, Any]:
        """Ready for JSON, but with NaN for missing values."""
        return asdict(self)


def without_camera(
    study: Study | str | PathLike[str], *, on_progress: Callable[[int, int], None] | None = None
) -> WithoutCamera:
    """Compare every transferred controller of a study by its robots' readings and commands.

    Args:
        study: with transfers; or its folder.
        on_progress: called with controllers done and in all.

    Raises:
        StudyError: it has no transfers whose readings are known.
    """
    study = as_study(study)
    replays, jobs = Replays(study), [job for job in jobs_of(study) if job.transfers]
    found: dict[tuple[str, str, str], list[tuple[Lived, list[_Unit]]]] = defaultdict(list)
    for k, job in enumerate(jobs):
        if on_progress:
            on_progress(k, len(jobs))
        made = _controller(study, job, replays)
        if made is not None:
            found[job.run.task, job.individual, job.kind].append(made)
    if on_progress and jobs:
        on_progress(len(jobs), len(jobs))
    if not found:
        raise StudyError(
            f"{study.folder}: expected trials on a robot whose readings are known, got none. Make them with "
            "`realitygap transfer`; move away the folders of those of another version, to make them again."
        )
    orders = (_order(names, group) for names, group in found.items())
    return WithoutCamera(
        controllers=tuple(one for group in found.values() for one, _ in group), orders=tuple(orders)
    )


class _Unit(NamedTuple):
    """Both scores of a controller on one robot."""

    robot: str
    distance: float
    correspondence: float


def _controller(study: Study, job: Job, replays: Replays) -> tuple[Lived, list[_Unit]] | None:
    """A controller's figures, and each robot's; None if nothing is known of its trials."""
    run, task = job.run, study.task(job.run.task)
    quiet = Simulation(task, study.profile, 0.0)
    told = [(one, _apart(one, replays.of(one.folder), quiet)) for one in job.transfers]
    known = [(one, row) for one, row in told if row is not None]
    if not known:
        return None
    units = []
    for robot in dict.fromkeys(one.robot for one, _ in known):
        ours = [row["distance"] for one, row in known if one.robot == robot]
        seen = tuple(one for one, _ in known if one.robot == robot and one.situated_from in SEEN)
        score = replace(job, transfers=seen).correspondence if seen else math.nan
        units.append(_Unit(robot, mean(ours), score))
    number = number_of(run, job.individual)
    assert number is not None
    networks = study.networks(run.task, study.genotype(run.id, number))
    made = Lived(
        run=run.id, name=run.name, task=run.task, noise=run.noise, individual=job.individual, kind=job.kind,
        units=len(units), trials=len(known),
        **{key: mean([row[key] for _, row in known]) for key in known[0][1]},
        correspondence=mean([one.correspondence for one in units]),
        fitness_simulated=mean([one.fitness_simulated for one, _ in known]),
        fitness_situated=mean([one.fitness_situated for one, _ in known]),
        fitness_pseudo=in_pseudo_realities(task, study.profile, networks, study.config.seed),
        left_out=len(job.transfers) - len(known),
    )  # fmt: skip
    return made, units


def _apart(one: Transferred, replay: Replay, quiet: Simulation) -> dict[str, float] | None:
    """Distances of a pair of trials; None if either is unfinished or unknown."""
    simulated, situated = replay.simulated, replay.situated
    if simulated is None or situated is None or len(simulated.t) != len(situated.t):
        return None
    return distances(simulated, situated, one.situated, one.pose, quiet)


def _order(names: tuple[str, str, str], group: Sequence[tuple[Lived, list[_Unit]]]) -> Order:
    """Agreement of the measures on the order of a task's controllers."""
    robots = list(dict.fromkeys(unit.robot for _, units in group for unit in units))
    values = np.full((2, len(group), len(robots)), np.nan)
    for i, (_, units) in enumerate(group):
        for unit in units:
            values[:, i, robots.index(unit.robot)] = unit.distance, unit.correspondence
    columns: Mapping[str, Floats] = {
        key: np.array([getattr(one, key) for one, _ in group])
        for key in ("readings", "commands", "speeds", "correspondence", "replay_cm",
                    "fitness_simulated", "fitness_situated", "fitness_pseudo")
    }  # fmt: skip
    return order_of(names, values[0], values[1], columns)
