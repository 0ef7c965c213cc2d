"""The trials of a transfer: which individuals drive which robot from where, and how each is seen."""

import math
from collections.abc import Iterable, Iterator
from contextlib import closing
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np

from realitygap.control.controllers import OwnController, named_controller
from realitygap.control.genotype import NetworkController
from realitygap.errors import StudyError, UsageError
from realitygap.film.disk import Disk
from realitygap.film.tag import Marker, Tag
from realitygap.kernels.rng import substream
from realitygap.robots.address import BAUD, Address
from realitygap.robots.body import Body
from realitygap.streams import TRANSFER
from realitygap.study.load import Run, Study
from realitygap.study.plan import run_stream
from realitygap.study.store import WHO
from realitygap.transfer.options import Named, Transfer
from realitygap.values import steps_in
from realitygap.world.robot import Profile

__all__ = [
    "FOLDER", "SOURCES", "TrialSpec", "check_body", "check_fit", "chosen_runs", "controller_for",
    "median_run", "shown_runs", "transfer_stream", "trial_specs",
]  # fmt: skip

FOLDER = "transfer"
"""The folder in a study's folder."""

SOURCES = ("speeds", "counters", "robot", "camera", "film")
"""Sources of a situated path, the most reliable last: speeds measured by motors, counters of wheels, poses
reported by the robot, a camera."""


@dataclass(frozen=True, kw_only=True)
class TrialSpec:
    """One trial to make: an individual of a run on a robot, from start number `start` (from 1).

    Attributes:
        evaluation: the individual's number; None for a controller of your own, which replaces it.
        controller: the controller of your own.
        baud: rate of the line; None for the first at which a robot on a port answers.
        stream: of the start, and of the noise of the simulation and of a twin's unit.
        source: of the situated path, one of SOURCES.
        view: renderer of a twin's film, "drawn" or "mujoco".
        placed: whether the robot places itself.
        marker: what a camera over a robot looks for; None without one, and for a twin's disk.
        folder: relative to the study's folder.
    """

    run: int
    name: str
    task: str
    noise: float
    individual: str
    evaluation: int | None
    robot: Address
    twin_noise: float
    seed: int
    start: int
    seconds: float
    baud: int | None
    stream: int
    source: str
    view: str
    placed: bool
    folder: str
    marker: Marker | None = None
    controller: Named | None = None

    @property
    def film(self) -> bool:
        """Whether its film is kept."""
        return self.source == "film"

    def facts(self) -> dict[str, Any]:
        """Everything that the trial's result depends on, for its file."""
        own = {} if self.controller is None else {"controller": str(self.controller)}
        driver = ("run", "name", "task", "noise", "individual", "evaluation")
        return {
            **own,
            **{key: getattr(self, key) for key in driver},
            "robot": str(self.robot),
            "unit": self.robot.unit,
            "port": self.robot.port,
            "twin_noise": None if self.robot.unit is None else self.twin_noise,
            **{key: getattr(self, key) for key in ("seed", "start", "seconds", "baud")},
            "disk": self.marker.to_dict() if isinstance(self.marker, Disk) else None,
            "marker": str(self.marker) if isinstance(self.marker, Tag) else None,
        }


OTHER_ROBOT = "profile: expected the robot's, got one of"
SAME_SCALE = 0.1
"""Full scales that differ by at most this share are one: a Thymio's 4500 counts are 4525 on some robots."""


def trial_specs(study: Study, options: Transfer) -> Iterator[TrialSpec]:
    """All requested trials, robot by robot.

    Raises:
        UsageError: a study of another robot, or runs and individuals that do not exist or are to be filmed
            but do not drive.
    """
    runs, own = chosen_runs(study, options), options.named
    _check_films({run.id for run in runs}, options)
    tasks = dict.fromkeys(run.task for run in runs)
    if own is not None:
        for task in tasks:
            controller_for(study, task, own, at=task)  # refuses an invalid one before anything is done
    who = options.individual if own is None else own.name
    seed = study.config.seed if options.seed is None else options.seed
    for robot in options.bodies:
        twin, (placed, usual) = (
            robot.unit is not None,
            _without_camera(robot, study, tasks, options.path_from),
        )
        camera, worn = twin or options.camera_device is not None, options.worn
        usual = "camera" if camera and options.path_from == "camera" else usual
        for run, start in product(runs, range(1, options.starts + 1)):
            source = "film" if camera and options.films(run.id, start) else usual
            if source is None:
                raise UsageError(
                    f"robot {robot}: expected a way to know where it is: a camera above it (--camera-device, "
                    "--camera), `pose` of its own, counters, or `speeds` that it measures."
                )
            asked = study.task(run.task).seconds if options.seconds is None else options.seconds
            steps = steps_in(asked, study.profile.period_s)
            name = run.name.replace("/", "-") + ("" if who == WHO[1] else f"-{who}")
            yield TrialSpec(
                run=run.id,
                name=run.name,
                task=run.task,
                noise=run.noise,
                individual=who,
                evaluation=number_of(run, who) if own is None else None,
                robot=robot,
                twin_noise=options.noise,
                seed=seed,
                start=start,
                seconds=round(steps * study.profile.period_s, 6),
                baud=None if robot.is_file else BAUD if options.baud is None and twin else options.baud,
                stream=transfer_stream(seed, run, start),
                source=source,
                view=options.view,
                placed=placed,
                marker=worn if camera and (isinstance(worn, Tag) or not twin) else None,  # a twin's disk
                controller=own,
                folder=f"{FOLDER}/{robot.folder(options.noise)}/{name}/start-{start}",
            )


def _without_camera(
    robot: Address, study: Study, tasks: Iterable[str], path_from: str
) -> tuple[bool, str | None]:
    """Whether a robot places itself, and where its path comes from without a camera; None: from nowhere.

    Raises:
        UsageError: it is of another kind than the study's, or cannot be opened.
    """
    if robot.port is not None:  # it is connected later
        return False, "speeds" if robot.kind == "thymio" else "counters"
    with closing(robot.open()) as body:
        for task in tasks:
            check_body(study, task, body)
        poses = body.knows_pose and (path_from == "camera" or not body.counts_turns)
        sources = {"robot": poses, "counters": body.counts_turns, "speeds": body.measures_speeds}
        return body.places_itself, next((source for source, known in sources.items() if known), None)


def _check_films(driven: set[int], options: Transfer) -> None:
    """Refuse films of trials that are not made."""
    for one in () if isinstance(options.film, bool) else options.film:
        run, start = one if isinstance(one, tuple) else (one, 1)
        if run not in driven or not 1 <= start <= options.starts:
            expected = (
                f"runs that drive ({', '.join(map(str, sorted(driven)))}), starts 1 to {options.starts}"
            )
            raise UsageError(f"film: expected {expected}, got {one}.")


def controller_for(study: Study, task: str, named: Named, at: str = "") -> OwnController | NetworkController:
    """A controller of your own at a task of a study; `at` as the task of `named_controller`.

    Raises:
        UsageError: no such controller; says why.
    """
    facts = study.facts(task)
    return named_controller(named.spec, str(facts["feeds"]), len(facts["sensors"]), at)


def transfer_stream(seed: int, run: Run, start: int) -> int:
    """The random stream of a run's trial from start number `start`."""
    stream = substream(run_stream(seed, run.task, run.noise, run.index), np.uint64(TRANSFER))
    return int(substream(np.uint64(stream), np.uint64(start)))


def check_body(study: Study, task: str, body: Body) -> None:
    """Refuse controllers that were evolved for another kind of robot.

    Raises:
        UsageError: as of `check_fit`.
    """
    evolved = f"task {task!r} was evolved for a robot with"
    check_fit(body, study.profile, study.task(task).kinds, evolved)


def check_fit(body: Body, profile: Profile, kinds: Iterable[str], wanted: str = OTHER_ROBOT) -> None:
    """Refuse a robot of another kind than a profile's, whose period it keeps to from now on.

    Args:
        body: the robot.
        profile: of the required kind of robot.
        kinds: of sensors to check.
        wanted: start of the message, which continues with the profile's values.

    Raises:
        UsageError: other sensors, a full scale that differs by more than a tenth, or a period that it cannot
            keep to.
    """
    name = f"(profile {profile.name!r})"
    for kind in kinds:
        law, one = profile.channel(kind), body.channel(kind)
        if len(law.sensors) != one.sensors:
            raise UsageError(
                f"{wanted} {len(law.sensors)} {kind} sensors {name}; this robot has {one.sensors}: use its "
                "own profile."
            )
        if abs(law.top - one.high) > SAME_SCALE * law.top:
            raise UsageError(
                f"{wanted} {kind} counts up to {law.top:g} {name}; this robot's go up to {one.high}: "
                "calibrate it, and use its own profile."
            )
    body.pace(profile.period_s)
    if body.period_s != profile.period_s:
        raise UsageError(
            f"{wanted} a period of {profile.period_s:g} s {name}; this robot's is {body.period_s:g} s. State "
            "one `period_s` in both, or give the robot a `pace`."
        )


FINISH = "Finish the study (`realitygap … --resume`)."


def chosen_runs(study: Study, options: Transfer) -> list[Run]:
    """The named runs, or all finished ones; for a controller of your own, one run of each task and noise.

    Raises:
        UsageError: no such run or individual, or one that does not exist yet.
    """
    if options.named is not None:
        first = {
            (run.task, run.noise): run
            for run in [*map(study.run, reversed(options.runs))] or study.runs[::-1]
        }
        return list(first.values())[::-1]
    if options.individual not in WHO:
        raise UsageError(f"individual: expected {' or '.join(WHO)}, got {options.individual!r}.")
    if not options.runs:
        finished = [run for run in study.runs if run.finished]
        if not finished:
            raise StudyError(f"{study.folder}: no run is finished yet. {FINISH}")
        return finished
    chosen = list({run.id: run for run in map(study.run, options.runs)}.values())
    for run in chosen:
        if number_of(run, options.individual) is None:
            raise StudyError(f"{study.folder}: run {run.id} has no {options.individual} yet. {FINISH}")
    return chosen


def number_of(run: Run, individual: str) -> int | None:
    """Evaluation number of a run's champion or fittest; None: there is none yet."""
    return run.champion_number if individual == "champion" else run.fittest_number


def median_run(runs: Iterable[Run]) -> Run | None:
    """The median run of a condition, by its champion's fresh trials at its own noise.

    Where those are missing, by stored fitness; of an even number the lower of the middle two.
    """
    ranked = sorted((run for run in runs if run.evaluations), key=lambda run: (_worth(run), -run.id))
    return ranked[(len(ranked) - 1) // 2] if ranked else None


def shown_runs(study: Study) -> list[Run]:
    """One finished run of each condition, in the study's order: those in figures 3 and 5."""
    conditions = dict.fromkeys((run.task, run.noise) for run in study.runs)
    chosen = (median_run(r for r in study.runs if (r.task, r.noise) == pair) for pair in conditions)
    return [run for run in chosen if run is not None and run.finished]


def _worth(run: Run) -> float:
    """Quality of a run's champion, as far as it is known."""
    fresh = run.tests.get(("champion", run.noise))
    if fresh is not None and fresh.size:
        return float(fresh.mean())
    return -math.inf if run.best_fitness is None else run.best_fitness
