"""Score rows: the judgement of one individual as in a row of table 1 or 2 (§6), computed.

    from realitygap import load_study, marks_of

    for one in marks_of(load_study("out/reproduce")):
        print(one.name, one.type, one.behaviour, one.differences, one.correspondence)

Type and behaviour score are of the simulation, "after repeated testing"; differences and correspondence are
of its transfers, trial by trial from the same poses. A row follows from the study, its transfers and the
version that computes it; valid rows in `marks.json` are not computed again.
"""

import contextlib
import hashlib
import json
import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cache, cached_property
from importlib.metadata import version
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from realitygap.correspondence.distances import matched_starts
from realitygap.correspondence.names import Namer, common_name, namer
from realitygap.correspondence.score import Scale, behaviour_score, compare, ends_of, exemplar_scale
from realitygap.correspondence.setting import Setting, fits, setting_of
from realitygap.correspondence.trials import SHORTEST_S, Trial, resampled, trial_of
from realitygap.errors import TrackError, UsageError
from realitygap.files import atomic_write
from realitygap.kernels.rng import substream
from realitygap.robots.address import ROBOT, StandIn
from realitygap.robots.drive import Recording
from realitygap.simulation.body import drive_simulated
from realitygap.simulation.simulation import Simulation, batch_streams
from realitygap.streams import NAMED
from realitygap.study.load import Run, Study, as_study
from realitygap.study.provenance import project_commit
from realitygap.tasks.task import Task
from realitygap.track import Track, Trajectory
from realitygap.transfer.record import TransferredTrial, load_transfers
from realitygap.transfer.replay import Replays
from realitygap.values import Closing, Command, Floats, Pose, fed
from realitygap.work.archive import SIMULATED, SITUATED, read_file
from realitygap.work.pool import Setup, Tell, Workers, near, opened
from realitygap.world.robot import TOP_INPUT, Profile

__all__ = ["DISTANCES", "MARKS", "ScoreJob", "ScoreRow", "distances", "jobs_of", "kind_of", "marks_of"]

TRIALS = 20
"""Trials for naming a behaviour: one does not always show its kind."""


@dataclass(frozen=True, kw_only=True)
class ScoreRow:
    """A row of table 1 or 2: one individual in simulation, and on one kind of robot.

    Attributes:
        run, name, task, noise, index: of the run; individual: champion or fittest.
        type: of behaviour, by the paper's names, over trials in simulation; share: of those trials.
        behaviour: score, 0 to 10, of its fresh trials at its own noise.
        kind: of robot: "robot", "twin", "twin with 2 times its noise"; "" without one.
        situated_type: its type on that robot.
        differences: of the robot's behaviour from the simulation's, in the paper's words.
        correspondence: score, 0 to 10; low, high: its 95 % interval, None with a single start.
        starts, units: numbers behind the score.
        readings, commands, speeds, replay_cm: distances of simulated and situated trials that need no camera
            (`distances`), means over those whose recordings are known.
        why: what is missing, and why.
    """

    run: int
    name: str
    task: str
    noise: float
    index: int
    individual: str
    type: str | None = None
    share: float | None = None
    behaviour: float | None = None
    kind: str = ""
    situated_type: str | None = None
    differences: str | None = None
    correspondence: float | None = None
    low: float | None = None
    high: float | None = None
    starts: int = 0
    units: int = 0
    readings: float | None = None
    commands: float | None = None
    speeds: float | None = None
    replay_cm: float | None = None
    why: str = ""

    def to_dict(self) -> dict[str, Any]:
        """Ready for JSON."""
        return asdict(self)


@dataclass(frozen=True, kw_only=True)
class ScoreContext:
    """Common parts of one task's score rows, created when first needed."""

    study: Study
    task: Task
    scales: Mapping[tuple[str, str], int]
    """Starts of a run, by kind of robot and individual: one scale for a whole table."""

    @cached_property
    def setting(self) -> Setting:
        return setting_of([], self.task)

    @cached_property
    def replays(self) -> Replays:
        return Replays(self.study)

    @cached_property
    def namer(self) -> Namer:
        return namer(self.setting, self.study.profile.body.radius_cm)

    def scale(self, kind: str, individual: str, *, matched: bool) -> Scale:
        starts = self.scales[kind, individual]
        return exemplar_scale(self.setting.exemplars, starts, starts, matched=matched)


@dataclass(frozen=True, kw_only=True)
class ScoreJob:
    """One score row to compute."""

    context: ScoreContext
    run: Run
    individual: str
    kind: str
    transfers: tuple[TransferredTrial, ...]

    @cached_property
    def key(self) -> str:
        """A digest of everything that the score row follows from, and of the version that computes it."""
        number = self.run.fittest_number if self.individual == "fittest" else self.run.champion_number
        scale = self.context.scales.get((self.kind, self.individual))
        folder = self.context.study.folder
        paths = [folder / "study.toml", folder / "profile.toml", folder / f"arenas/{self.run.task}.toml"]
        tests = self.run.tests.get((self.individual, self.run.noise), np.zeros(0)).tobytes()
        words = [self.run.name, self.individual, self.kind, number, scale, *_version()]
        found = hashlib.blake2b(digest_size=16)
        parts = [repr(words).encode(), tests, *(path.read_bytes() for path in paths if path.is_file())]
        for one in self.transfers:
            parts += [read_file(one.folder, name) or b"none" for name in (SIMULATED, SITUATED, "steps.csv")]
        for part in parts:
            found.update(part)
        return found.hexdigest()

    def row(self) -> ScoreRow:
        """Name it, score it, compare it."""
        run = self.run
        made: dict[str, Any] = {
            "run": run.id, "name": run.name, "task": run.task, "noise": run.noise, "index": run.index,
            "individual": self.individual, "kind": self.kind, "behaviour": self._behaviour(),
        }  # fmt: skip
        why = [] if self.transfers else ["no transfer: it has not driven a robot"]
        try:
            made["type"], made["share"] = self._type(self._fresh())
        except UsageError as error:
            why.insert(0, f"no type: {error}")
        if self.transfers:
            simulated, situated, lost = self._pairs()
            made |= {"starts": len({t.start for t in situated}), "units": len({t.unit for t in situated})}
            made |= self._distances()
            why += lost
            try:
                made |= self._compared(simulated, situated) if situated else {}
            except UsageError as error:
                why.append(f"no correspondence score: {error}")
        return ScoreRow(**made, why="; ".join(why))

    def _distances(self) -> dict[str, float | None]:
        """Means over the trials that are known in full on both sides, and agree in length."""
        replays, rows = self.context.replays, []
        for one in self.transfers:
            _, lived, kept = replays.of(one.folder)
            if one.timing is None and lived and kept and len(lived.t) == len(kept.t):
                rows.append(distances(lived, kept, one.situated, one.pose, replays.quiet(one.task)))
        known = {key: [row[key] for row in rows if math.isfinite(row[key])] for key in DISTANCES}
        return {key: math.fsum(values) / len(values) if values else None for key, values in known.items()}

    def _compared(self, simulated: Sequence[Trial], situated: Sequence[Trial]) -> dict[str, Any]:
        context = self.context
        scale = context.scale(self.kind, self.individual, matched=bool(matched_starts(simulated, situated)))
        made = compare(simulated, situated, context.setting, scale=scale)
        low, high = made.interval or (None, None)
        return {
            "differences": made.differences, "correspondence": made.score, "low": low, "high": high,
            "situated_type": self._type(situated)[0],
        }  # fmt: skip

    def _behaviour(self) -> float | None:
        """From the run's fresh trials at its own noise, for the paper's own tasks."""
        scores = self.run.tests.get((self.individual, self.run.noise))
        task = self.context.task
        dark = task.plain_name == "light-seeking" and not task.arena.lamps
        if scores is None or task.source is not None or dark:
            return None
        return behaviour_score(scores, ends_of(self.context.task, self.context.study.profile))

    def _fresh(self) -> list[Trial]:
        """Trials in simulation at its own noise, on separate streams."""
        run, context = self.run, self.context
        if context.task.seconds < SHORTEST_S:
            raise TrackError(f"trials of {context.task.seconds:g} s show too little; {SHORTEST_S:g} s do.")
        genes = run.fittest if self.individual == "fittest" else run.champion
        assert genes is not None
        networks = context.study.networks(run.task, genes)
        simulation = Simulation(context.task, context.study.profile, run.noise)
        streams = batch_streams(int(substream(run.stream, np.uint64(NAMED))), TRIALS)
        made = [simulation.trajectory(networks, stream=one)[0] for one in streams.tolist()]
        radius = context.study.profile.body.radius_cm
        return [trial_of(trajectory, start=str(k), radius_cm=radius) for k, trajectory in enumerate(made)]

    def _type(self, trials: Sequence[Trial]) -> tuple[str, float]:
        """The most common name of some trials, and its share."""
        names = self.context.namer.name(trials, self.context.setting)
        name = common_name(names)
        return name, sum(one.name == name for one in names) / len(names)

    def _pairs(self) -> tuple[list[Trial], list[Trial], list[str]]:
        """Simulated and situated trials that can be compared; what was left out, and why."""
        simulated: dict[tuple[str, str], Trial] = {}
        situated, lost = [], []
        for one in self.transfers:
            unit = one.robot
            if one.timing is not None:
                lost.append(f"{unit}, start {one.start}: {one.timing}")
                continue
            try:
                there = self._trial(one.situated, one, unit)
                here = self._trial(one.simulated, one, "")
            except UsageError as error:
                lost.append(f"{unit}, start {one.start}: {error}")
                continue
            place = (here.start, "" if one.unit is not None else unit)  # units share starts
            simulated.setdefault(place, here)
            situated.append(there)
        return list(simulated.values()), situated, lost

    def _trial(self, track: Track, one: TransferredTrial, unit: str) -> Trial:
        body = self.context.study.profile.body
        made = resampled(track, start=str(one.start), unit=unit, radius_cm=body.radius_cm)
        # A path from counters may leave the arena. An outline's near side may touch what is in it.
        if not fits(self.context.task.arena, made.x, made.y, body.depth_cm(0.0, 0.0)):
            raise TrackError("its path leaves the room or goes through what stands there.")
        return made


@cache
def _version() -> tuple[str, str]:
    return version("realitygap"), project_commit()


MARKS = "marks.json"

OnProgress = Callable[[int, int], None]

FEW = 4
"""Up to this number rows are computed before other processes could load what they need."""
TOGETHER = 5
"""Rows in a job: those of one task share their study and their namer, which arrive and are made once."""


def marks_of(
    study: Study | str | PathLike[str], *, workers: Workers = 1, on_progress: OnProgress | None = None
) -> list[ScoreRow]:
    """A score row for each finished run, individual and kind of robot; the champion's if none drove a robot.

    Args:
        study: with its transfers, if any; or its folder.
        workers: processes (None: one a core), or a pool; does not affect the results.
        on_progress: called with score rows done and in all.
    """
    study = as_study(study)
    kept = _read(study.folder / MARKS)
    jobs = jobs_of(study)
    keys = [job.key for job in jobs]
    left = [k for k, key in enumerate(keys) if key not in kept]
    tell, made = on_progress or (lambda done, total: None), dict[int, ScoreRow]()

    def heard(message: tuple[int, ScoreRow]) -> None:
        made[message[0]] = message[1]
        tell(len(jobs) - len(left) + len(made), len(jobs))

    tell(len(jobs) - len(left), len(jobs))
    with opened(1 if len(left) <= FEW else near(workers)) as pool:
        some = (left[first : first + TOGETHER] for first in range(0, len(left), TOGETHER))
        pool.work(Setup(_Scorer), [[(k, jobs[k]) for k in rows] for rows in some], heard)
    kept |= {keys[k]: made[k].to_dict() for k in left}
    if left:
        _write(study.folder / MARKS, {key: row for key, row in kept.items() if key in keys})
    return [ScoreRow(**kept[key]) for key in keys]


def _read(file: Path) -> dict[str, dict[str, Any]]:
    """Stored rows, by key; a broken file counts as empty."""
    with contextlib.suppress(OSError, ValueError, TypeError, AttributeError, RecursionError):
        return {key: ScoreRow(**row).to_dict() for key, row in json.loads(file.read_text("utf-8")).items()}
    return {}


def _write(file: Path, rows: Mapping[str, dict[str, Any]]) -> None:
    """Store rows, but not through a link; a file that cannot be written is ignored."""
    if not file.is_symlink():
        with contextlib.suppress(OSError):
            atomic_write(file, json.dumps(rows, indent=1))


class _Scorer(Closing):
    """Computes score rows; a job contains everything that its rows follow from except the trials' files."""

    def carry_out(self, job: list[tuple[int, ScoreJob]], tell: Tell) -> None:
        """Some rows, each with its number."""
        for k, one in job:
            tell((k, one.row()))


def kind_of(one: TransferredTrial) -> str:
    """The kind of robot: trials of one kind are judged together."""
    stand_in = StandIn.of_folder(one.robot)
    return ROBOT if stand_in is None else stand_in.kind


def jobs_of(study: Study) -> list[ScoreJob]:
    """The score rows to compute, task by task, in the order of its runs; robots before twins."""
    every, tasks = load_transfers(study.folder), dict.fromkeys(run.task for run in study.runs)
    return [job for task in tasks for job in _of_task(study, task, every)]


def _of_task(study: Study, task: str, every: list[TransferredTrial]) -> list[ScoreJob]:
    runs = [run for run in study.runs if run.task == task and run.finished]
    found: dict[tuple[int, str, str], list[TransferredTrial]] = {}
    for one in every:
        if one.task == task:
            found.setdefault((one.run, kind_of(one), one.individual), []).append(one)
    counts: dict[tuple[str, str], Counter[int]] = {}
    for (_, kind, individual), several in found.items():
        counts.setdefault((kind, individual), Counter())[len({one.start for one in several})] += 1
    usual = {key: min(count, key=lambda starts: (-count[starts], starts)) for key, count in counts.items()}
    context = ScoreContext(study=study, task=study.task(task), scales=usual)
    order = sorted(usual, key=lambda key: (key[0] != ROBOT, len(key[0]), key)) or [("", "champion")]
    return [
        ScoreJob(context=context, run=run, individual=individual, kind=kind,
             transfers=tuple(found.get((run.id, kind, individual), ())))
        for kind, individual in order
        for run in runs
    ]  # fmt: skip


# Distances that need no camera

DISTANCES = ("readings", "commands", "speeds", "replay_cm")


def distances(
    simulated: Trajectory, situated: Recording, track: Track, pose: Pose, quiet: Simulation
) -> dict[str, float]:
    """DISTANCES of a pair of trials; NaN where one side has no such column.

    In readings, commands and speeds they are Wasserstein's first distance, sensor by sensor and wheel by
    wheel, of the distributions over the trial: readings in widths of the input range, commands and speeds in
    top commands, so that 1 is much. `replay_cm` is the robot's path's from the simulation's under the robot's
    commands.

    Args:
        simulated: the trial in simulation.
        situated: the same on the robot.
        track: where the robot was.
        pose: where both began.
        quiet: the simulation without noise.
    """
    from scipy.stats import wasserstein_distance

    profile, feeds = quiet.profile, quiet.task.feeds
    top = profile.wheels.top_command
    widths = [high - low for low, high in profile.bands(feeds)]
    pairs = {
        "readings": (fed(simulated, feeds) / widths, fed(situated, feeds) / widths),
        "commands": (simulated.commands / TOP_INPUT, situated.commands / top),
        "speeds": (simulated.wheels / top, situated.speeds / top),
    }

    def between(first: Floats, second: Floats) -> float:
        if np.isnan(second).any() or not second.size:
            return math.nan
        return float(np.mean([wasserstein_distance(*pair) for pair in zip(first.T, second.T, strict=True)]))

    far = {name: between(*pair) for name, pair in pairs.items()}
    return {**far, "replay_cm": _replayed(quiet, situated, track, pose)}


class _Replayer:
    """Replays a robot's commands, one a step, whatever the inputs."""

    def __init__(self, commands: NDArray[np.int64], profile: Profile) -> None:
        self._outputs = np.rint(commands * (TOP_INPUT / profile.wheels.top_command)).astype(int)
        self._k = 0

    def reset(self) -> None:
        self._k = 0

    def decide(self, inputs: Sequence[int]) -> Command:
        left, right = self._outputs[self._k]
        self._k += 1
        return Command(left=int(left), right=int(right))


def _replayed(simulation: Simulation, situated: Recording, track: Track, pose: Pose) -> float:
    """Mean distance (cm) of a robot's path from the simulation's under its commands; NaN without a path."""
    replayer = _Replayer(situated.commands, simulation.profile)
    seconds = len(situated.t) * simulation.profile.period_s
    try:
        lived, _ = drive_simulated(simulation, replayer, pose=pose, seconds=seconds)
    except UsageError:  # it began where the simulated robot does not fit
        return math.nan
    path = lived.track
    if len(path) != len(track) or not track.found.any():
        return math.nan
    return float(np.nanmean(np.hypot(path.x - track.x, path.y - track.y)))
