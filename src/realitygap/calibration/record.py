"""Makes recordings: brings the robot to each stop of a plan, reads it, and writes its rows at once.

    from realitygap.calibration.plan import Plan
    from realitygap.calibration.record import record
    from realitygap.robots.address import Address

    record(Plan(kind="all"), "unit-7", Address.parse("twin:7").open())

A kill loses the stop that was being recorded at most; `resume` goes on with the next.
"""

from __future__ import annotations

import contextlib
import hashlib
import math
import os
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, closing
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from realitygap.calibration import load
from realitygap.calibration.plan import KHEPERA, Place, Plan, Task, Trial, camera_places, tasks_of
from realitygap.calibration.recordings import CHANNELS, HEIGHTS_CM
from realitygap.errors import BaudError, RecordingError, UsageError
from realitygap.files import atomic_write, naming_errors, read_toml, to_toml
from realitygap.robots.body import Body, checked_readings
from realitygap.robots.drive import MOVING, StopOnSignal, raise_pending
from realitygap.track import read_track
from realitygap.values import Closing, Command, Pose
from realitygap.world.robot import load_profile

if TYPE_CHECKING:
    from realitygap.film.tag import Marker
    from realitygap.twin.camera import Plate

__all__ = ["Result", "StoppedByUserError", "record"]

Ask = Callable[[str], str]
"""Says something to a person and returns the answer."""
Progress = Callable[[str, int, int], None]
"""Called with the recording's name, the places done, and all places."""

ARENA, STUDY = "arena.toml", "study.db"
STEP_S = 0.1
FRAMES = 10_000
"""Frame numbers reserved for each trial: more than its steps."""
APART_S = 0.3
"""Time between two readings at a place, s, so that slow noise shows too."""

SAME = ("plan", "kind", "object", "robot", "unit", "twin_noise", "marker", "seed", "repeats", "bearings",
        "distances_cm", "places")  # fmt: skip
"""Facts that must not change when a recording is resumed."""


class StoppedByUserError(Exception):
    """The person stops for today."""


@dataclass(frozen=True, kw_only=True)
class Result:
    """A finished recording: how many places of the plan are `done`, the time it took, and whether the person
    stopped early."""

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


# Recording


def record(
    plan: Plan,
    folder: str | Path,
    body: Body,
    *,
    ask: Ask | None = None,
    resume: bool = False,
    on_progress: Progress | None = None,
) -> list[Result]:
    """Record a plan into `folder`, or each of several recordings into a folder of its own there.

    Args:
        plan: what, and how.
        folder: created if missing.
        body: the robot; the caller closes it.
        ask: asks the person who places the robot; not needed if it places itself.
        resume: continue the recordings in the folder.
        on_progress: called after each place; an exception raised there stops the recording.

    Raises:
        RecordingError: the folder holds a recording already, or another one, or another process
            records there.
        UsageError: the robot lacks the sensors, or they differ from those of `base`.
    """
    if plan.base is None and "base" in (own := body.description()):
        plan = replace(plan, base=load_profile(own["base"]))
    tasks, folder = tasks_of(plan, body), Path(folder)
    places = [folder / task.name if len(tasks) > 1 else folder for task in tasks]
    made: list[Result] = []
    with _alone(folder):
        for place in places:
            if (place / load.DRIVE).exists() or (not resume and (place / load.FACTS).exists()):
                cure = "choose another folder, or go on with --resume."
                raise RecordingError(f"{place}: already holds a recording; {cure}")
        for task, place in zip(tasks, places, strict=True):
            with _site(body, ask, task, plan) as site:
                made.append(
                    _record(task, place, plan, body, site, on_progress or (lambda name, done, total: None))
                )
            if made[-1].stopped:
                break
    return made


def _record(task: Task, folder: Path, plan: Plan, body: Body, site: Site, report: Progress) -> Result:
    """Bring the robot to each stop that is not done, and write its rows at once."""
    begun, stopped = time.perf_counter(), False
    stops = {stop.key: stop for stop in task.stops}
    facts = _facts(task, plan, body)
    if task.kind == "wheels":
        one, table = body.channels[0], load.STEPS
        lacks = () if body.counts_turns else load.WHEEL_COUNTS
        columns = (*(name for name in load.STEP_COLUMNS if name not in lacks), *load.POSE)
    else:
        one, table = body.channel(CHANNELS[task.kind]), load.READINGS
        columns = (*task.key, "repeat", *(f"s{i}" for i in range(one.sensors)))

    def rows_of(key: tuple[str, ...]) -> int:
        stop = stops.get(key)
        if task.kind == "wheels":
            return len(stop.commands) if isinstance(stop, Trial) else -1
        return plan.repeats

    def read(stop: Place | Trial) -> list[tuple[str, ...]]:
        if not site.go(stop):
            return []
        if isinstance(stop, Trial):
            rows, poses = drive_trial(body, stop)
            seen = {**poses, **site.poses(stop)}
            return [(*row, *_pose(seen.get(k))) for k, row in enumerate(rows)]
        return [
            (*stop.key, str(k), *row) for k, row in enumerate(read_standing(body, one.name, plan.repeats))
        ]

    journal = Journal(folder, facts=facts, table=table, columns=columns, key=task.key, rows=rows_of)
    if task.arena is not None:
        atomic_write(folder / ARENA, task.arena.to_toml())
    left = [stop for key, stop in stops.items() if key not in journal.done]
    if left:
        body.attend(one.name, turns=task.kind == "wheels")
    try:
        if left and site.prepare(task.begins):
            for stop in left:
                if rows := read(stop):
                    journal.add(rows)
                report(task.name, len(journal.done), len(stops))
    except StoppedByUserError:
        stopped = True
    if not journal.done:  # skipped: an empty table would only hinder a calibration
        journal.discard()
    return Result(
        folder=folder, name=task.name, kind=task.kind, places=len(stops), done=len(journal.done),
        seconds=time.perf_counter() - begun, stopped=stopped,
    )  # fmt: skip


def _facts(task: Task, plan: Plan, body: Body) -> dict[str, Any]:
    """The content of recording.toml."""
    known = {key: value for key, value in body.description().items() if key in load.KNOWN}
    facts, base = {"kind": task.kind, **task.facts}, plan.base
    if task.kind != "wheels":
        shape, one = base.body if base else KHEPERA, body.channel(CHANNELS[task.kind])
        facts["body_radius_cm"] = shape.radius_cm
        if shape.outline_cm:
            facts["body_outline_cm"] = [list(corner) for corner in shape.outline_cm]
        facts["sensors"] = one.sensors
        if one.high != load_profile("paper").channel(one.name).top:
            facts["full_scale"] = one.high
    elif plan.marker is not None:
        known["marker"] = plan.marker
    if task.kind == "infrared" and plan.reflectance != 1.0:
        facts["reflectance"] = plan.reflectance if math.isfinite(plan.reflectance) else load.UNKNOWN
    if task.arena is not None:
        heights = (base.body.height_cm, base.ambient.sensor_height_cm) if base else HEIGHTS_CM.values()
        facts |= {"arena": ARENA, **(dict(zip(HEIGHTS_CM, heights, strict=True)) if all(heights) else {})}
    units = load.UNITS.format(known.pop("units", "units of the robot's own"))
    placed_by = "program" if body.places_itself else "person"
    facts |= {"plan": plan.kind, "units": units, "placed_by": placed_by}
    facts |= {key: value for key, value in known.items() if key not in facts}
    return facts | {
        "notes": plan.notes, "repeats": plan.repeats, "seed": plan.seed, "places": len(task.stops),
    }  # fmt: skip


def drive_trial(body: Body, trial: Trial) -> tuple[list[tuple[str, ...]], dict[int, Pose]]:
    """Drive one trial as a controller would, step by step.

    Returns:
        Its rows as texts, without poses; and the poses that the robot reported, by step, where a camera
        looks.

    Raises:
        BaudError: the line has no room for counters and speeds in a step.
    """
    clock = body.clock
    body.reset()
    rows, poses, looks = [], {}, trial.seen() if body.knows_pose else ()
    start = due = clock.now()
    with StopOnSignal(() if clock.waits else MOVING) as stopping:
        try:
            for k, command in enumerate(trial.commands):
                clock.sleep_until(due)
                now = clock.now()
                body.sense()
                counters, speeds = body.odometry
                if body.counts_turns and (counters is None or speeds is None):
                    raise BaudError(
                        "robot: expected counters and speeds at each step, got only one of them. A line "
                        "needs 38400 baud or more; a body of your own gives Odometry(counters=…, speeds=…)."
                    )
                if k in looks and body.knows_pose:
                    poses[k] = body.known_pose()
                raise_pending()
                body.act(Command(left=command[0], right=command[1]))
                turned = (*(counters or ()), *(speeds or ())) if body.counts_turns else ()
                numbers = (*command, *turned, trial.number)
                rows.append((f"{now - start:.4f}", *map(str, numbers), trial.kind))
                due = max(due + body.period_s, now)
        finally:
            with stopping.held():
                body.stop()
    return rows, poses


def read_standing(body: Body, kind: str, repeats: int) -> list[list[str]]:
    """Repeated readings [repeats][sensors] of a standing robot, as texts."""
    clock = body.clock
    readings = []
    for _ in range(repeats):
        clock.sleep_until(clock.now() + APART_S)
        asked = clock.now()
        read = body.sense()
        while body.read_at is not None and body.read_at < asked:  # a missing answer is not a reading
            read = body.sense()
        raise_pending()
        checked_readings(body, read)
        counts = read.proximity if kind == "proximity" else read.ambient
        readings.append([f"{count:.10g}" for count in counts.tolist()])
    return readings


def _pose(pose: Pose | None) -> tuple[str, ...]:
    if pose is None:
        return ("", "", "")
    return f"{pose.x:.4f}", f"{pose.y:.4f}", f"{math.degrees(pose.heading):.3f}"


# Who brings the robot to a stop


class OwnSite(Closing):
    """A robot that places itself; `seed` of its noise, together with the stop: none affects the next;
    `camera`: whether to use the camera over the floor, if it has one; `marker`: what it wears there."""

    def __init__(
        self,
        body: Body,
        room: Mapping[str, Any],
        *,
        seed: int,
        camera: bool = False,
        marker: str | None = None,
    ) -> None:
        self._body, self._room, self._seed = body, room, seed
        self._stack, self._camera = ExitStack(), None
        if camera and body.is_filmed:
            with ExitStack() as stack:
                self._camera = stack.enter_context(closing(FloorCamera(room, body, seed, marker)))
                self._film = Path(stack.enter_context(tempfile.TemporaryDirectory())) / "film.csv"
                self._stack = stack.pop_all()

    def prepare(self, says: str) -> bool:
        """Does nothing: its room is built already."""
        return True

    def go(self, stop: Place | Trial) -> bool:
        """Place the robot, with noise seeded by the stop's name, and film a trial from now on."""
        digest = hashlib.sha256(f"{self._seed}/{'/'.join(stop.key)}".encode()).digest()
        self._body.enter(self._room, int.from_bytes(digest[:7]), stop.pose)
        if self._camera and isinstance(stop, Trial) and stop.filmed and self._body.is_filmed:
            self._body.film(self._film)
        return True

    def poses(self, trial: Trial) -> Mapping[int, Pose]:
        """The poses that the camera saw in the trial that ends here, by step."""
        if not (self._camera and trial.filmed and self._body.is_filmed):
            return {}
        self._body.film(None)
        return self._camera.poses(self._film, trial.seen(), trial.number)

    def close(self) -> None:
        self._stack.close()


class FloorCamera:
    """The camera over the wheels' floor of a twin, calibrated with frames of the robot at known places.

    Its pictures go through the tracker like any film's; the twin's true poses only draw them.
    """

    def __init__(self, room: Mapping[str, Any], body: Body, seed: int, worn: str | None) -> None:
        from realitygap.film.calibrate import KnownFrame, calibrate_camera
        from realitygap.film.tag import load_marker
        from realitygap.twin.camera import OverheadCamera

        self._marker = load_marker(worn) if worn else load_marker()
        self._camera = OverheadCamera(
            room, unit=body.facts["unit"], noise=body.facts["twin_noise"], seed=seed,
            plate=plate_of(self._marker), grey=True,
        )  # fmt: skip
        try:
            frames = [
                KnownFrame(name=str(k), picture=self._camera.frame(pose, k), pose=pose)
                for k, pose in enumerate(camera_places())
            ]
            self._model = calibrate_camera(frames, self._marker).camera
        except BaseException:
            self._camera.close()
            raise

    def poses(self, film: Path, steps: Sequence[int], trial: int) -> dict[int, Pose]:
        """Tracked poses at steps (100 ms) of a trial's film, without those at which the robot is lost."""
        from realitygap.film.tracker import Tracker

        truth, tracker = read_track(film, seen_by="truth"), Tracker(self._model, self._marker)
        seen: dict[int, Pose] = {}
        for step in steps:
            row = int(np.searchsorted(truth.t, truth.t[0] + STEP_S * step + 1e-6, side="right")) - 1
            pose = Pose.reached(truth.x[row], truth.y[row], truth.heading[row])
            found = tracker.see(self._camera.frame(pose, FRAMES * (trial + 1) + step))
            if found is not None:
                seen[step] = found[0]
        return seen

    def close(self) -> None:
        self._camera.close()


def plate_of(marker: Marker | None) -> Plate | None:
    """How a twin's camera draws a tag on the robot; None: it wears the disk."""
    from realitygap.film.tag import Tag
    from realitygap.twin.camera import Plate

    if not isinstance(marker, Tag):
        return None
    return Plate(marker.cells, marker.points / 100, marker.height_cm / 100)


class PersonSite(Closing):
    """A person who places the robot as asked: an empty answer continues, "s" skips, "q" stops."""

    def __init__(self, ask: Ask) -> None:
        self._ask = ask
        self._start: Pose | None = None

    def prepare(self, says: str) -> bool:
        """Say what is needed, and ask whether it is ready; False: it is left out."""
        while True:
            answer = self._ask(f"{says} [Enter: ready, s: leave out, q: stop here]").strip().lower()
            if answer in ("", "s"):
                return not answer
            if answer == "q":
                raise StoppedByUserError

    def go(self, stop: Place | Trial) -> bool:
        """Say where to place the robot, or how much room a trial needs, and ask where that starts."""
        if isinstance(stop, Place):
            return self.prepare(f"Place: {stop.says}.")
        name = f"Trial {stop.number} ({stop.kind})"
        ready = self.prepare(f"{name}: the robot will move; it needs {stop.says}.")
        self._start = self._measured("Where does it stand?") if ready and stop.filmed else None
        return ready

    def poses(self, trial: Trial) -> Mapping[int, Pose]:
        """Ask where a trial ended."""
        if self._start is None:
            return {}
        end = self._measured("Where does it stand now?")
        return {0: self._start} if end is None else {0: self._start, len(trial.commands) - 1: end}

    def _measured(self, says: str) -> Pose | None:
        """A pose that the person measured or read off the camera's track."""
        while True:
            words = (
                self._ask(f"{says} [x_cm y_cm heading_deg; Enter: not measured]").replace(",", " ").split()
            )
            if words == ["q"]:
                raise StoppedByUserError
            if not words:
                return None
            with contextlib.suppress(ValueError):
                x, y, heading = map(float, words)
                if all(map(math.isfinite, (x, y, heading))):
                    return Pose.from_degrees(x, y, heading)

    def close(self) -> None:
        """No resources to release."""


Site = OwnSite | PersonSite


def _site(body: Body, ask: Ask | None, task: Task, plan: Plan) -> Site:
    if body.places_itself:
        own = int.from_bytes(hashlib.sha256(f"{plan.seed}/{task.name}".encode()).digest()[:7])
        return OwnSite(body, task.room, seed=own, camera=task.kind == "wheels", marker=plan.marker)
    if plan.marker is not None:
        raise UsageError(
            "marker: expected a robot with a camera of its own over it, as a twin's; this one is filmed by "
            "whoever places it: `realitygap camera track FILM --marker …`."
        )
    if ask is None:
        raise UsageError("ask: expected a function that asks a person to place the robot, got none.")
    return PersonSite(ask)


# The folder


class Journal:
    """One recording's folder; `done` has the rows of the stops that are finished, by their keys (columns
    `key`); `rows` says how many rows a finished stop has, by its key."""

    def __init__(
        self,
        folder: Path,
        *,
        facts: Mapping[str, Any],
        table: str,
        columns: Sequence[str],
        key: Sequence[str],
        rows: Callable[[tuple[str, ...]], int],
    ) -> None:
        self.folder, self.path, self.columns = folder, folder / table, tuple(columns)
        self._key = [self.columns.index(name) for name in key]
        self.done: dict[tuple[str, ...], Sequence[Sequence[str]]] = {}
        if (folder / load.FACTS).exists():
            self._check(facts)
            self._take_up(rows)
            return
        folder.mkdir(parents=True, exist_ok=True)
        atomic_write(self.path, ",".join(self.columns) + "\n")
        date = datetime.now().astimezone().isoformat(timespec="seconds")
        atomic_write(folder / load.FACTS, to_toml({**facts, "date": date}))

    def add(self, rows: Sequence[Sequence[str]]) -> None:
        """Write all rows of a finished stop."""
        text = "".join(",".join(row) + "\n" for row in rows)
        with naming_errors(self.path), self.path.open("ab", buffering=0) as file:
            file.write(text.encode("utf-8"))
        self.done[self._name(rows[0])] = rows

    def discard(self) -> None:
        """Remove an empty recording's files, and its folder if nothing else is in it."""
        for name in (self.path.name, ARENA, load.FACTS):
            (self.folder / name).unlink(missing_ok=True)
        with contextlib.suppress(OSError):
            self.folder.rmdir()

    def _name(self, row: Sequence[str]) -> tuple[str, ...]:
        return tuple(row[i] for i in self._key)

    def _check(self, facts: Mapping[str, Any]) -> None:
        path, cure = self.folder / load.FACTS, "Begin the recording anew, in another folder."
        there = read_toml(path, RecordingError, cure)
        for name in SAME:
            if there.get(name) != facts.get(name):
                begun, asked = (repr(said[name]) if name in said else "the usual" for said in (there, facts))
                raise RecordingError(
                    f"{path}: {name}: this recording was begun with {begun}, not {asked}; "
                    "resume it as it was begun, or choose another folder."
                )

    def _take_up(self, rows: Callable[[tuple[str, ...]], int]) -> None:
        """Keep the table's finished stops; drop an incomplete one that a kill left."""
        if not self.path.is_file():
            return
        data = self.path.read_bytes()
        lines = data[: data.rfind(b"\n") + 1].decode("utf-8", "replace").splitlines()
        head, stops = ",".join(self.columns), dict[tuple[str, ...], list[list[str]]]()
        for number, line in enumerate(lines, 1):
            row = line.split(",")
            if line != head if number == 1 else len(row) != len(self.columns):
                raise RecordingError(f"{self.path}, line {number}: expected columns {head}, got {line!r}.")
            if number > 1:
                stops.setdefault(self._name(row), []).append(row)
        self.done = {key: kept for key, kept in stops.items() if len(kept) == rows(key)}
        kept = [head, *(",".join(row) for stop in self.done.values() for row in stop)]
        text = "".join(f"{line}\n" for line in kept)
        if text.encode() != data:
            atomic_write(self.path, text)


@contextlib.contextmanager
def _alone(folder: Path) -> Iterator[None]:
    """A folder to record into, for one process at a time; an empty one is removed at the end."""
    import fcntl

    if (folder / STUDY).exists():
        raise RecordingError(f"{folder}: holds a study ({STUDY}). Choose another folder.")
    folder.mkdir(parents=True, exist_ok=True)
    held = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(held, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        os.close(held)
        cure = "Wait until it ends, stop it, or choose another folder."
        raise RecordingError(f"{folder}: another process records there. {cure}") from None
    except OSError:
        pass  # a file system without locks
    try:
        yield
    finally:
        os.close(held)
        with contextlib.suppress(OSError):  # something is in it
            folder.rmdir()
