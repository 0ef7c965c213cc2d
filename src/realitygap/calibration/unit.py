"""One call from a twin's unit, or a robot of your own, to its profile: record, fit, write robot.toml.

    from realitygap.calibration.unit import calibrated_unit

    profile = calibrated_unit("units/7", unit=7, noise=1.0, seed=0, workers=2)

A unit's folder holds unit.toml, the settings that it was made with; `recordings/`, each complete or absent;
and robot.toml, the profile.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, closing
from pathlib import Path
from typing import TYPE_CHECKING, Any

from realitygap.calibration.load import FACTS, load_recording
from realitygap.calibration.recordings import Recording
from realitygap.errors import CalibrationError
from realitygap.files import as_path, atomic_write, move_whole, read_toml, to_toml, written_together
from realitygap.robots.address import Address, as_scale
from realitygap.values import as_stream
from realitygap.work.pool import Pool, Processes, Setup, Tell, Workers, opened, size_of
from realitygap.world.robot import Profile, load_profile

if TYPE_CHECKING:
    from realitygap.calibration.calibrate import Calibration

__all__ = ["PARTS", "PROFILE", "Unit", "calibrated_robot", "calibrated_unit"]

PROFILE, SETTINGS, RECORDINGS = "robot.toml", "unit.toml", "recordings"
PARTS = ("ambient", "wheels", "infrared-wall", "infrared-cylinder")
"""The recordings, the longest kind first, so that two workers finish at about the same time."""
TURNS = "turns"
NEEDS = {"ambient": "ambient", "wheels": TURNS, "infrared": "proximity"}
"""What a robot must have for each plan."""
RECIPE = 9
"""Increased whenever the same settings would make another profile."""
FIT = "fit"

Work = Callable[[], None]
Progress = Callable[[str, int, int], None]
"""Called with the recording's name (or "fit"), the places done, and all places."""


def calibrated_unit(
    folder: str | Path,
    *,
    unit: int | str,
    noise: float,
    seed: int,
    workers: Workers = 1,
    parts: Sequence[str] | None = None,
    bearings: int | None = None,
    distances_cm: Sequence[float] | None = None,
    meanwhile: Sequence[Work] = (),
    on_progress: Progress | None = None,
) -> Path:
    """The profile of a twin's unit, recorded through its serial line and fitted.

    Existing recordings are not repeated. An interrupted call that is repeated, with any number of workers,
    ends with the same bits.

    Args:
        folder: the unit's own; created if missing.
        unit: its number in the population, or the address of one of Enki's, as "enki:epuck:3".
        noise: the twin's noise scale, or Enki's.
        seed: of its noise, and of what is random in the plans.
        workers: processes that record at the same time, one a core if None; or a pool.
        parts: those of PARTS that are recorded, all that it has if None; the rest stays as in its base.
        bearings, distances_cm: of the infrared's places, as `realitygap record` takes them; the robot's own
            if None.
        meanwhile: what they do besides, functions that can be sent to them.
        on_progress: is told how far it is; whoever raises there stops the work.

    Returns:
        The path of `folder/robot.toml`.

    Raises:
        CalibrationError: the folder belongs to another unit or other settings.
        StudyError: its process died repeatedly.
    """
    from realitygap.calibration.plan import Plan

    known = _known_of(unit) if isinstance(unit, str) else {"unit": Address.parse(f"twin:{unit}").unit}
    if parts is not None and not (parts and set(parts) <= set(PARTS)):
        raise CalibrationError(f"parts: expected a list of some of {', '.join(PARTS)}, got {parts!r}.")
    Plan(kind="infrared", bearings=bearings, distances_cm=distances_cm).grid(None)  # or refuses them
    distances = None if distances_cm is None else list(map(float, distances_cm))
    asked = {"bearings": bearings, "distances_cm": distances, "parts": None if parts is None else list(parts)}
    known |= {key: value for key, value in asked.items() if value is not None}
    known |= {"twin_noise": as_scale(noise, "noise"), "seed": int(as_stream(seed, "seed"))}
    return _calibrated(folder, known, workers, on_progress, meanwhile)


def calibrated_robot(
    folder: str | Path,
    *,
    robot: str,
    base: str,
    seed: int,
    workers: Workers = 1,
    on_progress: Progress | None = None,
) -> Path:
    """The profile of a robot of your own that places itself, recorded with the sensors that it has.

    Args:
        robot: its address, `file.py:Class` or `module:Class`.
        base: its approximate profile, by name or file.
        folder, seed, workers, on_progress: as of `calibrated_unit`.

    Returns:
        The path of `folder/robot.toml`.

    Raises:
        UsageError: no such robot, or its sensors differ from the base's.
        CalibrationError: the folder belongs to another robot or other settings.
    """
    known = {"base": str(as_path(base, "base")), "seed": int(as_stream(seed, "seed"))}
    return _calibrated(folder, known | _known_of(robot, base), workers, on_progress)


def _known_of(robot: str, base: str | None = None) -> dict[str, Any]:
    """A robot by its address, which fits its base; the parts that it can record, and its own places."""
    from realitygap.calibration.plan import Plan, tasks_of

    plan = Plan(kind="all", base=None if base is None else load_profile(base))
    with closing(Address.parse(str(robot)).open()) as body:
        tasks_of(plan, body)
        kinds = {one.name for one in body.channels} | ({TURNS} if body.counts_turns else set())
        grid, objects = body.infrared_grid, body.infrared_objects
    places = {"bearings": grid[0], "distances_cm": list(grid[1])} if grid else {}
    parts = [name for name in PARTS if NEEDS[_kind_of(name)] in kinds]
    parts = [name for name in parts if _kind_of(name) != "infrared" or name.partition("-")[2] in objects]
    return {"robot": robot, "parts": parts, **places}


def _kind_of(part: str) -> str:
    """The plan of a part, without its object."""
    return part.partition("-")[0]


def _calibrated(
    folder: str | Path,
    settings: dict[str, Any],
    workers: Workers,
    on_progress: Progress | None = None,
    meanwhile: Sequence[Work] = (),
) -> Path:
    """Make missing recordings and fit, one job for each kind: one kind is fitted while another is recorded,
    and other work is done meanwhile. A fit that all workers share begins when all parts are recorded."""
    folder = as_path(folder, "folder").resolve()
    size_of(1 if isinstance(workers, Pool) else workers)
    _claim(folder, {"recipe": RECIPE, **settings})
    if (folder / PROFILE).is_file():
        return folder / PROFILE
    unit, report = Unit(folder), on_progress or (lambda name, done, total: None)
    kinds = list(dict.fromkeys(map(_kind_of, unit.parts)))
    left = {name for name in unit.parts if not unit.has(name)}
    fits: list[Calibration] = []

    def heard(told: Calibration | tuple[str, int, int]) -> None:
        if isinstance(told, tuple):
            report(*told)
            left.difference_update(told[:1] if told[1] == told[2] else ())
        else:
            fits.append(told)
        if not left:
            report(FIT, len(fits), len(kinds))

    def searching(done: int, total: int) -> None:
        report(FIT, len(fits) * total + done, len(kinds) * total)

    shared = [name for name in unit.parts if _kind_of(name) == "infrared" and unit.form != "extended"]
    jobs = [*meanwhile, *dict.fromkeys(name if name in shared else _kind_of(name) for name in unit.parts)]
    with _recorders(workers) as pool:
        pool.work(Setup(Unit, (str(folder),)), jobs, heard)
        if shared:
            fits.append(unit.fitted(shared, workers=pool, on_progress=searching))
    atomic_write(folder / PROFILE, unit.profile(fits))
    return folder / PROFILE


def _claim(folder: Path, settings: dict[str, Any]) -> None:
    """Mark the folder as this robot's, or check that it is."""
    path, cure = folder / SETTINGS, "Choose another folder, or remove this one."
    if not path.is_file():
        if folder.is_dir() and any(folder.iterdir()):
            raise CalibrationError(
                f"{folder}: expected a new folder, or one with {SETTINGS}; it holds something else. {cure}"
            )
        folder.mkdir(parents=True, exist_ok=True)
        atomic_write(path, to_toml(settings))
        return
    there = read_toml(path, CalibrationError, cure, broken=cure)
    if odd := [key for key in {**settings, **there} if settings.get(key) != there.get(key)]:
        wanted, found = ({key: one[key] for key in odd if key in one} for one in (settings, there))
        raise CalibrationError(
            f"{path}: expected {wanted}, got {found}: another calibration is there, or one that was made by "
            f"another version. {cure}"
        )


def _recorders(workers: Workers) -> AbstractContextManager[Pool]:
    """Always other processes: this one may have several threads, from which small matrices gain nothing."""
    if isinstance(workers, Pool):
        return opened(workers)
    return closing(Processes(size_of(workers), one_thread=True))


class Unit:
    """A unit's folder, and what its workers do there, which must be able to see it."""

    def __init__(self, folder: str | Path) -> None:
        self.folder = Path(folder)
        self.settings = read_toml(self.folder / SETTINGS, CalibrationError, "Calibrate the unit first.")
        self.parts: list[str] = list(self.settings.get("parts", PARTS))
        # On the twin the printed form has the smallest error, which "auto" finds in three times the time.
        self.form = "extended" if "unit" in self.settings else "auto"
        self.recordings = self.folder / RECORDINGS

    def has(self, part: str) -> bool:
        """Whether a part is recorded, completely."""
        return (self.recordings / part / FACTS).is_file()

    def carry_out(self, job: str | Work, tell: Tell) -> None:
        """Make the missing recordings of a part or of a kind, and report progress; fit a kind, and send the
        calibration."""
        if not isinstance(job, str):
            job()
            return
        names = [name for name in self.parts if job in (name, _kind_of(name))]
        for name in names:
            if not self.has(name):
                self.record(name, lambda *said: tell(said))
        if job == _kind_of(job):
            tell(self.fitted(names))

    def close(self) -> None:
        """No resources to release."""

    def record(self, part: str, report: Progress) -> None:
        """Record one part of all plans, complete or not at all."""
        from realitygap.calibration.plan import CYLINDER, Plan
        from realitygap.calibration.record import record

        known, finished = self.settings, self.recordings / part
        address = Address.parse(known["robot"] if "robot" in known else f"twin:{known['unit']}")
        unfinished = finished.with_name(f"{part}.part")
        shutil.rmtree(unfinished, ignore_errors=True)  # left by an interrupted call
        kind, _, shape = part.partition("-")
        plan = Plan(
            kind=kind, object={"wall": "wall", "cylinder": CYLINDER}.get(shape), seed=known["seed"],
            base=load_profile(known["base"]) if "base" in known else None,
            bearings=known.get("bearings"), distances_cm=known.get("distances_cm"),
        )  # fmt: skip
        with written_together(unfinished), closing(address.open(noise=known.get("twin_noise", 1.0))) as body:
            record(plan, unfinished, body, on_progress=report)
        move_whole(unfinished, finished)

    def fitted(self, parts: Sequence[str], **how: Any) -> Calibration:
        """The calibration by some of the parts; `how` is for `calibrate`."""
        from realitygap.calibration.calibrate import calibrate

        recordings = [load_recording(self.recordings / name) for name in sorted(parts)]
        return calibrate(recordings, self.base(recordings), beside=False, form=self.form, **how)

    def profile(self, fits: Sequence[Calibration]) -> str:
        """The profile of all fits together, as TOML."""
        from realitygap.calibration.calibrate import joined

        known = self.settings
        name = f"twin-{known['unit']}" if "unit" in known else Address.parse(known["robot"]).folder()
        used = [fit for fit in fits if fit.recordings]
        used.sort(key=lambda one: Path(one.recordings[0].source).name)
        recordings = [one for fit in used for one in fit.recordings]
        # The date is in the recordings: the same settings make the same file on any day.
        return joined(used, self.base(recordings)).named(name, date="").profile.to_toml()

    def base(self, recordings: Sequence[Recording]) -> Profile:
        """The profile that the fits start from."""
        from realitygap.calibration.calibrate import base_of

        return load_profile(self.settings.get("base", base_of(recordings)))
