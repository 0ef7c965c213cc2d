"""Makes recordings: brings the robot to each place of a plan, reads it, and writes the readings at once.

from realitygap.calibration.recorder.record import Wanted, record
from realitygap.robots.address import Address

record(Wanted(plan="all"), "unit-7", Address.parse("twin:7").open())
"""

import math
import time
from collections.abc import Callable, Container, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from realitygap.calibration.recorder.acts import drive_trial, read_standing
from realitygap.calibration.recorder.edges import FINE, TWICE, look_between
from realitygap.calibration.recorder.grid import Grid
from realitygap.calibration.recorder.journal import ARENA, Journal, alone, refuse_another
from realitygap.calibration.recorder.plans import KHEPERA, Part, Place, SensorPlan, sensor_plans
from realitygap.calibration.recorder.site import Ask, EnoughError, Site, site_of
from realitygap.calibration.recorder.wheel_plans import ROOM, Trial, wheel_plan
from realitygap.calibration.recordings.body import stated_heights, stated_shape
from realitygap.calibration.recordings.facts import UNKNOWN
from realitygap.calibration.recordings.files import EDGES, POSE, STEP_COLUMNS, UNFINISHED, UNITS
from realitygap.calibration.recordings.recording import CHANNELS
from realitygap.errors import UsageError
from realitygap.files import atomic_write
from realitygap.robots.body import Body
from realitygap.values import Pose
from realitygap.world.robot import Profile, load_profile

__all__ = ["REPEATS", "Made", "Wanted", "check_period", "parts_for", "record"]

REPEATS = 10

FLOOR = "Clear a level floor of 60 by 60 cm; a camera above it is welcome."
OWN_UNITS = "units of the robot's own"
OF_COUNTERS = ("counter_", "speed_")
"""Prefixes of columns that only wheels with counters have."""

Progress = Callable[[str, int, int], None]
"""Called with the recording's name, the places done, and all places."""


@dataclass(frozen=True, kw_only=True)
class Wanted:
    """What is to be recorded.

    Attributes:
        plan: "infrared", "ambient", "wheels" or "all" (that the robot has).
        object: the one object of the infrared's plan; None: a wall and a cylinder.
        reflectance: of its surface, relative to the surfaces that the constants are for; NaN: unknown, to be
            fitted.
        repeats: readings at each place; standing starts of each size.
        seed: of what is random in a plan, and of the noise of a robot that places itself.
        notes: kept with the recording.
        base: the robot's approximate profile (radius, heights, top command and speed); None: the robot's own
            base, or a Khepera.
        marker: what the robot wears under a camera over the wheels' floor, as `load_marker` reads it; None:
            the disk.
        bearings, distances_cm: of the infrared's plan, as of `Grid`; None: the robot's own, or the usual.
    """

    plan: str
    object: str | None = None
    reflectance: float = 1.0
    repeats: int = REPEATS
    seed: int = 0
    notes: str = ""
    base: Profile | None = None
    marker: str | None = None
    bearings: int | None = None
    distances_cm: tuple[float, ...] | None = None

    def grid(self, body: Body) -> Grid:
        """Where an object stands for this robot's infrared."""
        usual = Grid()
        bearings, distances = body.infrared_grid or (usual.bearings, usual.distances_cm)
        return Grid(
            bearings=bearings if self.bearings is None else self.bearings,
            distances_cm=distances if self.distances_cm is None else self.distances_cm,
        )


@dataclass(frozen=True, kw_only=True)
class Made:
    """A finished call of `record`: how many places of the plan are `done`, how many others between them where
    readings jump, the time it took, and whether the person stopped early."""

    folder: Path
    name: str
    kind: str
    places: int
    done: int
    seconds: float
    between: int = 0
    stopped: bool = False

    @property
    def finished(self) -> bool:
        """Whether every place is recorded."""
        return self.done >= self.places


def record(
    wanted: Wanted,
    folder: str | Path,
    body: Body,
    *,
    ask: Ask | None = None,
    resume: bool = False,
    on_progress: Progress | None = None,
) -> list[Made]:
    """Record a plan into `folder`, or each of several parts into a folder of its own there.

    Args:
        wanted: the plan and its settings.
        folder: created if missing.
        body: the robot; the caller closes it.
        ask: asks the person who places the robot; not needed if it places itself.
        resume: continue the recording in the folder.
        on_progress: called after each place; an exception raised there stops the recording.

    Raises:
        RecordingError: the folder holds a recording already, or another one, or another process
            records there.
        UsageError: the robot lacks the sensors, or they differ from those of `base`.
    """
    if wanted.base is None and "base" in (own := body.description()):
        wanted = replace(wanted, base=load_profile(own["base"]))
    parts = parts_for(wanted, body)
    places = [Path(folder) / part.name if len(parts) > 1 else Path(folder) for part in parts]
    made: list[Made] = []
    with alone(Path(folder)):
        for place in places:
            refuse_another(place, resume=resume)
        for part, place in zip(parts, places, strict=True):
            how: dict[str, Any] = {"part": part.name, "seed": wanted.seed, "marker": wanted.marker}
            with site_of(body, ask, part.room, **how) as site:
                report = on_progress or (lambda name, done, total: None)
                made.append(_recorded(part, place, wanted, body, site, report))
            if made[-1].stopped:
                break
    return made


def parts_for(wanted: Wanted, body: Body) -> list[Part]:
    """The parts of the plan for which the robot has sensors.

    Raises:
        UsageError: it lacks the requested sensors, or they differ from the base's.
    """
    base, kinds = wanted.base, [one.name for one in body.channels]
    parts: list[Part] = []
    shape, grid = base.body if base else KHEPERA, wanted.grid(body)
    for part in sensor_plans(wanted.plan, wanted.object, shape, wanted.reflectance, grid):
        kind = CHANNELS[part.kind]
        if wanted.plan != "all" or kind in kinds:
            parts.append(_sensors(part, wanted, body))
    if base is not None:
        _check_sensors(body, base, {part.channel for part in parts})
        check_period(body, base)
    followed = not body.counts_turns and (body.knows_pose or body.is_filmed)
    if wanted.plan == "wheels" or (wanted.plan == "all" and (body.counts_turns or followed)):
        wheels = base.wheels if base else None
        plan = wheel_plan(wanted.repeats, wanted.seed, wheels, period_s=body.period_s, followed=followed)
        parts.append(_wheels(plan, body))
    return parts


def _check_sensors(body: Body, base: Profile, kinds: Container[str]) -> None:
    """Refuse a robot whose sensors are not its base's: its commands would be another robot's. The base may
    lack sensors but for the `kinds` that are recorded."""
    for one in body.channels:
        theirs = len(base.channel(one.name).sensors)
        if theirs != one.sensors and (theirs or one.name in kinds):
            raise UsageError(
                f"robot: expected {theirs} {one.name} sensors, as the base {base.name!r} has; this one has "
                f"{one.sensors}. Take a base with as many (--base), or a plan without them."
            )


def check_period(body: Body, base: Profile) -> None:
    """Refuse a robot whose step differs from its base's.

    Raises:
        UsageError: names both periods and the cure.
    """
    if base.period_s != body.period_s:
        raise UsageError(
            f"robot: expected a period of {base.period_s:g} s, as the base {base.name!r} has; this one's is "
            f"{body.period_s:g} s. Set period_s in the base."
        )


def _sensors(plan: SensorPlan, wanted: Wanted, body: Body) -> Part:
    one = body.channel(CHANNELS[plan.kind])
    own = {"kind": plan.kind, "object": plan.object, **plan.facts, **stated_shape(wanted.base, one)}
    if plan.reflectance != 1.0:
        own["reflectance"] = plan.reflectance if math.isfinite(plan.reflectance) else UNKNOWN
    if plan.arena is not None:
        own |= {"arena": ARENA, **stated_heights(wanted.base)}

    def read(site: Site, place: Place, repeats: int = wanted.repeats) -> list[tuple[str, ...]]:
        if not site.stand(place):
            return []
        readings = read_standing(body, one.name, repeats)
        return [(*place.key, str(k), *row) for k, row in enumerate(readings)]

    return Part(
        name=plan.name, own=own, room=plan.room, begins=plan.begins, channel=one.name,
        columns=(*plan.columns, "repeat", *(f"s{i}" for i in range(one.sensors))), key=plan.columns,
        stops={place.key: place for place in plan.places}, rows=lambda key: wanted.repeats,
        read=read, arena=plan.arena, at=plan.at,
        fine=body.places_itself and wanted.grid(body).bearings >= FINE and wanted.repeats > 1,
    )  # fmt: skip


def _wheels(trials: Sequence[Trial], body: Body) -> Part:
    counted = [name for name in STEP_COLUMNS if body.counts_turns or not name.startswith(OF_COUNTERS)]
    stops: dict[tuple[str, ...], Trial] = {(str(trial.number),): trial for trial in trials}

    def read(site: Site, trial: Trial) -> list[tuple[str, ...]]:
        if not site.begin(trial):
            return []
        rows, poses = drive_trial(body, trial)
        seen = {**poses, **site.end(trial)}
        return [(*row, *_pose(seen.get(k))) for k, row in enumerate(rows)]

    return Part(
        name="wheels", own={"kind": "wheels"}, room=ROOM, begins=FLOOR, channel=body.channels[0].name,
        columns=(*counted, *POSE), key=("trial",), stops=stops,
        rows=lambda key: len(stops[key].commands) if key in stops else -1, read=read,
    )  # fmt: skip


def _recorded(part: Part, folder: Path, wanted: Wanted, body: Body, site: Site, report: Progress) -> Made:
    """Bring the robot to each stop of a part that is not done, and write its rows at once."""
    begun, kind, stopped, between = time.perf_counter(), part.own["kind"], False, 0
    facts = {**part.own, **_facts(part, wanted, body), **({"between": UNFINISHED} if part.fine else {})}
    journal = Journal(folder, facts=facts, columns=part.columns, key=part.key, rows=part.rows)
    if part.arena is not None:
        atomic_write(folder / ARENA, part.arena.to_toml())
    left = [stop for key, stop in part.stops.items() if key not in journal.done]
    if left or part.fine:
        body.attend(part.channel, turns=kind == "wheels")
    try:
        if left and site.prepare(part.begins):
            for stop in left:
                if rows := part.read(site, stop):
                    journal.add(rows)
                report(part.name, len(journal.done), len(part.stops) + part.fine)
        if part.fine and part.at is not None and len(journal.done) == len(part.stops):
            edges = Journal(
                folder, facts=facts, columns=part.columns, key=part.key, rows=lambda key: TWICE, table=EDGES
            )
            read = partial(part.read, site, repeats=TWICE)
            between = look_between(
                journal, edges, part.at, read, body.channel(part.channel).high,
                lambda done, many: report(part.name, len(part.stops) + done, len(part.stops) + many),
            )  # fmt: skip
            edges.state("between", between)
    except EnoughError:
        stopped = True
    if not journal.done:  # skipped: an empty table would only hinder a calibration
        journal.discard()
    return Made(
        folder=folder, name=part.name, kind=kind, places=len(part.stops), done=len(journal.done),
        seconds=time.perf_counter() - begun, between=between, stopped=stopped,
    )  # fmt: skip


def _facts(part: Part, wanted: Wanted, body: Body) -> dict[str, Any]:
    """The content of recording.toml."""
    known = dict(body.description())
    units = UNITS.format(known.pop("units", OWN_UNITS))
    if part.name == "wheels" and wanted.marker is not None:
        known["marker"] = wanted.marker
    asked = {"notes": wanted.notes, "repeats": wanted.repeats, "seed": wanted.seed}
    return {"plan": wanted.plan, "units": units, **known, **asked, "places": len(part.stops)}


def _pose(pose: Pose | None) -> tuple[str, ...]:
    if pose is None:
        return ("", "", "")
    return f"{pose.x:.4f}", f"{pose.y:.4f}", f"{math.degrees(pose.heading):.3f}"
