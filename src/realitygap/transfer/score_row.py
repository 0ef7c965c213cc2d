"""A score row: the judgement of one individual as in a row of table 1 or 2 (§6), computed.

Type and behaviour score are of the simulation, "after repeated testing"; differences and correspondence are
of its transfers, trial by trial from the same poses.
"""

import hashlib
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cache, cached_property
from importlib.metadata import version
from typing import Any

import numpy as np

from realitygap.correspondence.names import Namer, common_name, namer
from realitygap.correspondence.score import (
    Scale,
    behaviour_score,
    compare,
    ends_of,
    exemplar_scale,
    matched_starts,
)
from realitygap.correspondence.setting import Setting, fits, setting_of
from realitygap.correspondence.trials import SHORTEST_S, Trial, resampled, trial_of
from realitygap.errors import TrackError, UsageError
from realitygap.kernels.rng import substream
from realitygap.simulation.simulation import Simulation, batch_streams
from realitygap.streams import NAMED
from realitygap.study.load import Run, Study
from realitygap.study.provenance import project_commit
from realitygap.tasks.task import Task
from realitygap.track import Track
from realitygap.transfer.apart import DISTANCES, distances
from realitygap.transfer.load import Transferred
from realitygap.transfer.packed import content
from realitygap.transfer.replay import Replays

__all__ = ["Bench", "Job", "ScoreRow"]

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
            (`apart`), means over those whose recordings are known.
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
class Bench:
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
class Job:
    """One score row to compute."""

    bench: Bench
    run: Run
    individual: str
    kind: str
    transfers: tuple[Transferred, ...]

    @cached_property
    def key(self) -> str:
        """A digest of everything that the score row follows from, and of the version that computes it."""
        number = self.run.fittest_number if self.individual == "fittest" else self.run.champion_number
        scale = self.bench.scales.get((self.kind, self.individual))
        folder = self.bench.study.folder
        paths = [folder / "study.toml", folder / "profile.toml", folder / f"arenas/{self.run.task}.toml"]
        paths += [one.folder / name for one in self.transfers for name in ("simulated.csv", "situated.csv")]
        tests = self.run.tests.get((self.individual, self.run.noise), np.zeros(0)).tobytes()
        words = [self.run.name, self.individual, self.kind, number, scale, *_version()]
        found = hashlib.blake2b(digest_size=16)
        for part in (repr(words).encode(), tests, *(content(path) or b"none" for path in paths)):
            found.update(part)
        return found.hexdigest()

    def mark(self) -> ScoreRow:
        """Name it, score it, compare it."""
        run, individual = self.run, self.individual
        plain = ScoreRow(
            run=run.id, name=run.name, task=run.task, noise=run.noise, index=run.index,
            individual=individual, kind=self.kind, behaviour=self._behaviour(),
        )  # fmt: skip
        try:
            name, share = self._type(self._fresh())
            plain = replace(plain, type=name, share=share)
        except UsageError as error:
            plain = replace(plain, why=f"no type: {error}")
        if not self.transfers:
            return _noted(plain, "no transfer: it has not driven a robot")
        simulated, situated, lost = self._pairs()
        plain = replace(plain, starts=len({t.start for t in situated}), units=len({t.unit for t in situated}))
        plain = _noted(ScoreRow(**{**plain.to_dict(), **self._distances()}), *lost)
        if not situated:
            return plain
        try:
            return self._compared(plain, simulated, situated)
        except UsageError as error:
            return _noted(plain, f"no correspondence score: {error}")

    def _distances(self) -> dict[str, float | None]:
        """Means over the trials that are known in full on both sides, and agree in length."""
        replays, rows = self.bench.replays, []
        for one in self.transfers:
            made = replays.of(one.folder)
            if (
                one.timing is None
                and made.simulated
                and made.situated
                and len(made.simulated.t) == len(made.situated.t)
            ):
                rows.append(
                    distances(made.simulated, made.situated, one.situated, one.pose, replays.quiet(one.task))
                )
        known = {key: [row[key] for row in rows if math.isfinite(row[key])] for key in DISTANCES}
        return {key: math.fsum(values) / len(values) if values else None for key, values in known.items()}

    def _compared(self, plain: ScoreRow, simulated: Sequence[Trial], situated: Sequence[Trial]) -> ScoreRow:
        bench = self.bench
        scale = bench.scale(self.kind, self.individual, matched=bool(matched_starts(simulated, situated)))
        made = compare(simulated, situated, bench.setting, scale=scale)
        low, high = made.interval or (None, None)
        return replace(
            plain, differences=made.differences, correspondence=made.score, low=low, high=high,
            situated_type=self._type(situated)[0],
        )  # fmt: skip

    def _behaviour(self) -> float | None:
        """From the run's fresh trials at its own noise, for the paper's own tasks."""
        scores = self.run.tests.get((self.individual, self.run.noise))
        task = self.bench.task
        dark = task.plain_name == "light-seeking" and not task.arena.lamps
        if scores is None or task.source is not None or dark:
            return None
        return behaviour_score(scores, ends_of(self.bench.task, self.bench.study.profile))

    def _fresh(self) -> list[Trial]:
        """Trials in simulation at its own noise, on separate streams."""
        run, bench = self.run, self.bench
        if bench.task.seconds < SHORTEST_S:
            raise TrackError(f"trials of {bench.task.seconds:g} s show too little; {SHORTEST_S:g} s do.")
        genes = run.fittest if self.individual == "fittest" else run.champion
        assert genes is not None
        networks = bench.study.networks(run.task, genes)
        simulation = Simulation(bench.task, bench.study.profile, run.noise)
        streams = batch_streams(int(substream(run.plan.stream, np.uint64(NAMED))), TRIALS)
        made = [simulation.trajectory(networks, stream=one)[0] for one in streams.tolist()]
        radius = bench.study.profile.body.radius_cm
        return [trial_of(trajectory, start=str(k), radius_cm=radius) for k, trajectory in enumerate(made)]

    def _type(self, trials: Sequence[Trial]) -> tuple[str, float]:
        """The most common name of some trials, and its share."""
        names = self.bench.namer.name(trials, self.bench.setting)
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

    def _trial(self, track: Track, one: Transferred, unit: str) -> Trial:
        body = self.bench.study.profile.body
        made = resampled(track, start=str(one.start), unit=unit, radius_cm=body.radius_cm)
        # A path from counters may leave the arena. An outline's near side may touch what is in it.
        if not fits(self.bench.task.arena, made.x, made.y, body.depth_cm(0.0, 0.0)):
            raise TrackError("its path leaves the room or goes through what stands there.")
        return made


def _noted(mark: ScoreRow, *words: str) -> ScoreRow:
    return replace(mark, why="; ".join(w for w in (mark.why, *words) if w))


@cache
def _version() -> tuple[str, str]:
    return version("realitygap"), project_commit()
