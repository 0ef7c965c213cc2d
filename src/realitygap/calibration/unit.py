"""One call from a twin's unit, or a robot of your own, to its profile: record, fit, write robot.toml.

from realitygap.calibration.unit import calibrated_unit

profile = calibrated_unit("units/7", unit=7, noise=1.0, seed=0, workers=2)
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, closing
from pathlib import Path
from typing import TYPE_CHECKING, Any

from realitygap.calibration.unit_folder import (
    MEASURING,
    PARTS,
    PROFILE,
    claim,
    form_of,
    is_recorded,
    kind_of,
    parts_in,
    parts_of,
    recordings_of,
    settings_of,
)
from realitygap.errors import UsageError
from realitygap.files import as_path, atomic_write, move_whole, written_together
from realitygap.robots.address import Address, as_scale
from realitygap.values import as_stream
from realitygap.work.pool import Pool, Processes, Setup, Tell
from realitygap.work.workers import Workers, opened, size_of
from realitygap.world.robot import Profile, load_profile

if TYPE_CHECKING:
    from realitygap.calibration.calibrate import Calibration
    from realitygap.calibration.recordings.recording import Recording

__all__ = ["calibrated_again", "calibrated_robot", "calibrated_unit"]

UNFINISHED = ".part"
TURNS = "turns"
NEEDS = {"ambient": "ambient", "wheels": TURNS, "infrared": "proximity"}
"""What a robot must have for each plan."""
FIT = "fit"
RECIPE, MEASURED_RECIPE = 4, 6
"""Of printed and of measured sensors: increased whenever the same settings would make another profile."""

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

    Recordings are kept in `folder/recordings`, each complete or absent; existing ones are not repeated. An
    interrupted call that is repeated, with any number of workers, ends with the same bits.

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
    from realitygap.calibration.recorder.grid import given

    which = _known_of(unit) if isinstance(unit, str) else {"unit": Address.parse(f"twin:{unit}").unit}
    chosen = given(bearings, distances_cm) | ({} if parts is None else {"parts": parts_in(parts)})
    chosen |= {"twin_noise": as_scale(noise, "noise"), "seed": int(as_stream(seed, "seed"))}
    settings = {"recipe": RECIPE, **which, **chosen}
    return _calibrated(folder, settings, workers, on_progress, meanwhile)


def calibrated_again(
    folder: str | Path, *, of: Path, share: float = 1.0, form: str | None = None, workers: Workers = 1
) -> Path:
    """Another profile of a unit from its recordings, or from a share of their places (`share.py`).

    Args:
        folder: the profile's own; created if missing.
        of: the unit's folder, with all of its recordings.
        share: of the places of each recording of sensors, above 0; one place at least.
        form: as of `calibrate`; None: the unit's own.
        workers: as of `calibrated_unit`.

    Returns:
        The path of `folder/robot.toml`.
    """
    settings = settings_of(of) | ({"share": share} if share < 1 else {}) | ({"form": form} if form else {})
    if form in MEASURING:
        settings["recipe"] = MEASURED_RECIPE
    settings["of"] = os.path.relpath(of.resolve(), Path(folder).resolve())
    return _calibrated(folder, settings, workers)


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
    from realitygap.calibration.recorder.record import Wanted, parts_for

    wanted = Wanted(plan="all", base=None if base is None else load_profile(base))
    with closing(Address.parse(str(robot)).open()) as body:
        parts_for(wanted, body)
        kinds = {one.name for one in body.channels} | ({TURNS} if body.counts_turns else set())
        grid = body.infrared_grid
    places = {"bearings": grid[0], "distances_cm": list(grid[1])} if grid else {}
    parts = [name for name in PARTS if NEEDS[kind_of(name)] in kinds]
    return {"recipe": MEASURED_RECIPE, "robot": robot, "parts": parts, **places}


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
    if not isinstance(meanwhile, Sequence) or not all(map(callable, meanwhile)):
        raise UsageError(f"meanwhile: expected a list of functions, got {meanwhile!r}.")
    claim(folder, settings)
    if (folder / PROFILE).is_file():
        return folder / PROFILE
    report = on_progress or (lambda name, done, total: None)
    parts = parts_of(folder)
    kinds = list(dict.fromkeys(kind_of(name) for name in parts))
    left = {name for name in parts if not is_recorded(folder, name)}
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

    shared = [name for name in parts if kind_of(name) == "infrared" and form_of(folder) in MEASURING]
    jobs = [*meanwhile, *dict.fromkeys(name if name in shared else kind_of(name) for name in parts)]
    with _recorders(workers) as pool:
        pool.work(Setup(Bench, (str(folder),)), jobs, heard)
        if shared:
            fits.append(fitted(folder, shared, workers=pool, on_progress=searching))
    atomic_write(folder / PROFILE, _profile(folder, fits))
    return folder / PROFILE


def _recorders(workers: Workers) -> AbstractContextManager[Pool]:
    """Always other processes: this one may have several threads, from which small matrices gain nothing."""
    if isinstance(workers, Pool):
        return opened(workers)
    return closing(Processes(size_of(workers), one_thread=True))


class Bench:
    """Carries out the jobs of a unit's folder, which it must be able to see: recordings of a kind and their
    fit, and unrelated work."""

    def __init__(self, folder: str) -> None:
        self._folder = Path(folder)

    def carry_out(self, job: str | Work, tell: Tell) -> None:
        """Make the missing recordings of a part or of a kind, and report progress; fit a kind, and send the
        calibration."""
        if not isinstance(job, str):
            job()
            return
        names = [name for name in parts_of(self._folder) if job in (name, kind_of(name))]
        for name in names:
            if not is_recorded(self._folder, name):
                record_part(self._folder, name, lambda *said: tell(said))
        if job == kind_of(job):
            tell(fitted(self._folder, names))

    def close(self) -> None:
        """It holds nothing."""


def record_part(folder: Path, name: str, report: Progress) -> None:
    """Record one part of all plans into `folder/recordings/name`, complete or not at all."""
    from realitygap.calibration.recorder.plans import CYLINDER
    from realitygap.calibration.recorder.record import Wanted, record

    known = settings_of(folder)
    base = load_profile(known["base"]) if "base" in known else None
    address = Address.parse(known["robot"] if "robot" in known else f"twin:{known['unit']}")
    finished = recordings_of(folder) / name
    unfinished = finished.with_name(name + UNFINISHED)
    shutil.rmtree(unfinished, ignore_errors=True)  # left by an interrupted call
    plan, _, shape = name.partition("-")
    thing = {"": None, "wall": "wall", "cylinder": CYLINDER}[shape]
    distances = tuple(known["distances_cm"]) if "distances_cm" in known else None
    wanted = Wanted(
        plan=plan, object=thing, seed=known["seed"], base=base, bearings=known.get("bearings"),
        distances_cm=distances,
    )  # fmt: skip
    with written_together(unfinished), closing(address.open(noise=known.get("twin_noise", 1.0))) as body:
        record(wanted, unfinished, body, on_progress=report)
    move_whole(unfinished, finished)


def fitted(folder: Path, names: Sequence[str], **how: Any) -> Calibration:
    """The calibration by some of the folder's parts; `how` is for `calibrate`."""
    from realitygap.calibration.calibrate import calibrate
    from realitygap.calibration.recordings.files import load_recording
    from realitygap.calibration.share import calibrate_share

    known = settings_of(folder)
    recordings = [load_recording(recordings_of(folder) / name) for name in sorted(names)]
    base = _base(folder, recordings)
    how |= {"form": form_of(folder)}
    if "share" in known:  # a wall is more informative than a cylinder
        share, seed = known["share"], known["seed"]
        return calibrate_share(recordings[::-1], base, share=share, seed=seed, **how)
    return calibrate(recordings, base, beside=False, **how)


def _profile(folder: Path, fits: Sequence[Calibration]) -> str:
    """The profile of all fits together, as TOML."""
    from realitygap.calibration.calibrate import joined

    known = settings_of(folder)
    name = f"twin-{known['unit']}" if "unit" in known else Address.parse(known["robot"]).folder()
    fits = sorted(
        (fit for fit in fits if fit.recordings), key=lambda one: Path(one.recordings[0].source).name
    )
    recordings = [one for fit in fits for one in fit.recordings]
    # The date is in the recordings: the same settings make the same file on any day.
    return joined(fits, _base(folder, recordings)).named(name, date="").profile.to_toml()


def _base(folder: Path, recordings: Sequence[Recording]) -> Profile:
    """The profile that the fits start from."""
    from realitygap.calibration.calibrate import base_of

    return load_profile(settings_of(folder).get("base", base_of(recordings)))
