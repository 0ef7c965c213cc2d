"""Makes recordings: brings the robot to each place of a plan, reads it, and writes that down at once.

from realitygap.calibration.recorder.record import record, twin_sites

sites = twin_sites(unit=7, noise=1.0, seed=0)
record("all", "unit-7", open_site=sites, facts={"robot": "twin", "unit": 7})
"""

from __future__ import annotations

import hashlib
import math
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from realitygap import whole
from realitygap.calibration.recorder.journal import ARENA, Journal, refuse_another
from realitygap.calibration.recorder.plans import Place, SensorPlan, sensor_plans
from realitygap.calibration.recorder.site import EnoughError, Site, TwinSite
from realitygap.calibration.recorder.wheel_plans import ROOM, Trial, wheel_plan
from realitygap.calibration.recordings.files import POSE, READINGS, STEP_COLUMNS, STEPS, UNITS
from realitygap.calibration.recordings.recording import BODY_RADIUS_CM, HEIGHTS_CM
from realitygap.errors import BaudError
from realitygap.robots.khepera.body import KheperaBody
from realitygap.robots.signals import MOVING, Stopping
from realitygap.values import Command, Pose

__all__ = ["REPEATS", "Made", "OpenSite", "record", "twin_sites"]

REPEATS = 10
APART_S = 0.3
"""Time between two readings at a place: noise that comes and goes slowly shows too."""

FLOOR = "Clear a level floor of 60 by 60 cm; a camera above it is welcome."
SENSORS = 8
STEP_S = 0.1

Progress = Callable[[str, int, int], None]
"""Is told the recording's name, the places done, and all."""

Stop = TypeVar("Stop", Place, Trial)
OpenSite = Callable[[str, Mapping[str, Any]], AbstractContextManager[Site]]
"""Opens the site of a recording: of its name, in a room."""


@dataclass(frozen=True, kw_only=True)
class Made:
    """A recording that was made: places of which so many are `done`, how long it took, and whether the
    person stopped there for today."""

    folder: Path
    name: str
    kind: str
    places: int
    done: int
    seconds: float
    stopped: bool = False

    @property
    def finished(self) -> bool:
        """Whether every place is recorded."""
        return self.done >= self.places


def twin_sites(*, unit: int, noise: float, seed: int) -> OpenSite:
    """Sites with a twin: its noise differs from recording to recording, and from place to place."""

    def open_site(name: str, room: Mapping[str, Any]) -> TwinSite:
        digest = hashlib.sha256(f"{seed}/{name}".encode()).digest()
        own = int.from_bytes(digest[:7])
        return TwinSite(room, unit=unit, noise=noise, seed=own, camera=name == "wheels")

    return open_site


def record(
    plan: str,
    folder: str | Path,
    *,
    open_site: OpenSite,
    facts: Mapping[str, Any],
    object: str | None = None,
    repeats: int = REPEATS,
    seed: int = 0,
    resume: bool = False,
    on_progress: Progress | None = None,
) -> list[Made]:
    """Record a plan: into `folder` itself, or each part into a folder of its own there.

    Args:
        plan: "infrared", "ambient", "wheels" or "all".
        folder: where; made if need be.
        open_site: opens the robot's site for each part.
        facts: of the robot, for recording.toml.
        object: the one object of the infrared's plan; None: a wall and a cylinder.
        repeats: readings at each place; standing starts of each size.
        seed: of what is random in a plan.
        resume: go on with what is there.
        on_progress: is told how far it is, after each place: whoever raises there stops the recording.

    Raises:
        RecordingError: a recording is there already, or another one.
    """
    parts: list[SensorPlan | tuple[Trial, ...]] = [*sensor_plans(plan, object)]
    if plan in ("wheels", "all"):
        parts.append(wheel_plan(repeats, seed))
    known = {"plan": plan, "units": UNITS, **facts, "repeats": repeats, "seed": seed}
    report = on_progress or (lambda name, done, total: None)
    made: list[Made] = []
    names = [part.name if isinstance(part, SensorPlan) else "wheels" for part in parts]
    places = [Path(folder)] if len(parts) == 1 else [Path(folder) / name for name in names]
    for place in places:
        refuse_another(place, resume=resume)
    for part, place in zip(parts, places, strict=True):
        if isinstance(part, SensorPlan):
            made.append(_sensors(part, place, open_site, known, repeats, resume, report))
        else:
            made.append(_wheels(part, place, open_site, known, resume, report))
        if made[-1].stopped:
            break
    return made


def _sensors(
    plan: SensorPlan,
    folder: Path,
    open_site: OpenSite,
    facts: Mapping[str, Any],
    repeats: int,
    resume: bool,
    report: Progress,
) -> Made:
    begun = time.perf_counter()
    own = {"kind": plan.kind, "object": plan.object, "body_radius_cm": BODY_RADIUS_CM, "sensors": SENSORS}
    if plan.arena is not None:
        own |= {"arena": ARENA, **HEIGHTS_CM}
        folder.mkdir(parents=True, exist_ok=True)
    journal = Journal(
        folder,
        facts={**own, **facts, "places": len(plan.places)},
        table=READINGS,
        columns=(*plan.columns, "repeat", *(f"s{i}" for i in range(SENSORS))),
        key=plan.columns,
        rows=lambda key: repeats,
        resume=resume,
    )
    if plan.arena is not None:
        whole.write(folder / ARENA, plan.arena.to_toml())
    left = [place for place in plan.places if _texts(place.where) not in journal.done]
    if not left:
        return _made(journal, plan.name, plan.kind, len(plan.places), begun)

    def visit(site: Site, place: Place) -> None:
        if site.stand(place):
            readings = _read(site, plan.kind, repeats)
            where = _texts(place.where)
            journal.add([(*where, str(k), *map(str, row)) for k, row in enumerate(readings)])
        report(plan.name, len(journal.done), len(plan.places))

    opened = open_site(plan.name, plan.room)
    stopped = _visited(opened, plan.begins, left, visit)
    return _made(journal, plan.name, plan.kind, len(plan.places), begun, stopped=stopped)


def _wheels(
    trials: Sequence[Trial],
    folder: Path,
    open_site: OpenSite,
    facts: Mapping[str, Any],
    resume: bool,
    report: Progress,
) -> Made:
    begun = time.perf_counter()
    lengths = {str(trial.number): len(trial.commands) for trial in trials}
    journal = Journal(
        folder,
        facts={"kind": "wheels", **facts, "places": len(trials)},
        table=STEPS,
        columns=(*STEP_COLUMNS, *POSE),
        key=("trial",),
        rows=lambda key: lengths.get(key[0], -1),
        resume=resume,
    )
    left = [trial for trial in trials if (str(trial.number),) not in journal.done]
    if not left:
        return _made(journal, "wheels", "wheels", len(trials), begun)

    def visit(site: Site, trial: Trial) -> None:
        if site.begin(trial):
            rows = drive_trial(site, trial)
            seen = site.end(trial)
            journal.add([(*row, *_pose(seen.get(k))) for k, row in enumerate(rows)])
        report("wheels", len(journal.done), len(trials))

    opened = open_site("wheels", ROOM)
    stopped = _visited(opened, FLOOR, left, visit)
    return _made(journal, "wheels", "wheels", len(trials), begun, stopped=stopped)


def _visited(
    opened: AbstractContextManager[Site],
    begins: str,
    stops: Sequence[Stop],
    visit: Callable[[Site, Stop], None],
) -> bool:
    """Visit all stops of a part that is not left out; whether the person stops there for today."""
    try:
        with opened as site:
            if site.prepare(begins):
                for stop in stops:
                    visit(site, stop)
    except EnoughError:
        return True
    return False


def drive_trial(site: Site, trial: Trial) -> list[tuple[str, ...]]:
    """Drive one trial as a controller would, step by step; its rows as texts, without poses.

    Raises:
        BaudError: the line has no room for counters and speeds in a step.
    """
    khepera = site.khepera
    body, clock = KheperaBody(khepera), khepera.clock
    if {"H", "E"} - {read.letter for read in body.budget.reads}:
        raise BaudError(
            f"{khepera.baud} baud cannot carry sensors, counters and speeds each {STEP_S * 1000:g} ms; "
            "set the robot to 38400 baud or more"
        )
    khepera.set_counters(0, 0)
    rows = []
    start = due = clock.now()
    with Stopping(() if clock.waits else MOVING) as stopping:
        try:
            for command in trial.commands:
                clock.sleep_until(due)
                now = clock.now()
                body.sense()
                counters, speeds = body.odometry
                body.act(Command(left=command[0], right=command[1]))
                numbers = (*command, *(counters or ()), *(speeds or ()), trial.number)
                rows.append((f"{now - start:.4f}", *map(str, numbers), trial.kind))
                due = max(due + STEP_S, now)
        finally:
            with stopping.held():
                body.stop()
    return rows


def _read(site: Site, kind: str, repeats: int) -> list[tuple[int, ...]]:
    """Repeated readings of a robot that stands."""
    khepera, clock = site.khepera, site.khepera.clock
    readings = []
    for _ in range(repeats):
        clock.sleep_until(clock.now() + APART_S)
        readings.append(khepera.proximity() if kind == "infrared" else khepera.ambient())
    return readings


def _texts(numbers: Sequence[float]) -> tuple[str, ...]:
    return tuple(f"{number:g}" for number in numbers)


def _pose(pose: Pose | None) -> tuple[str, ...]:
    if pose is None:
        return ("", "", "")
    return f"{pose.x:.4f}", f"{pose.y:.4f}", f"{math.degrees(pose.heading):.3f}"


def _made(
    journal: Journal, name: str, kind: str, places: int, begun: float, *, stopped: bool = False
) -> Made:
    if not journal.done:  # left out: an empty table would only be in the way of a calibration
        journal.discard()
    return Made(
        folder=journal.folder, name=name, kind=kind, places=places, done=len(journal.done),
        seconds=time.perf_counter() - begun, stopped=stopped,
    )  # fmt: skip
