"""One call from a twin's unit to its profile: record all plans, fit, write robot.toml.

from realitygap.calibration.unit import calibrated_unit

profile = calibrated_unit("units/7", unit=7, noise=1.0, seed=0, workers=2)
"""

from __future__ import annotations

import shutil
from collections.abc import Callable
from contextlib import AbstractContextManager, closing
from pathlib import Path
from typing import Any

from realitygap import whole
from realitygap.calibration.recordings.files import FACTS
from realitygap.errors import CalibrationError
from realitygap.text import as_path, must_be, refuse_unknown
from realitygap.toml import read_toml, to_toml
from realitygap.work.pool import Pool, Setup, Tell
from realitygap.work.processes import Processes
from realitygap.work.workers import Workers, cores, opened

__all__ = ["PARTS", "PROFILE", "SETTINGS", "calibrated_unit"]

PROFILE, SETTINGS, RECORDINGS, UNFINISHED = "robot.toml", "unit.toml", "recordings", ".part"
PARTS = ("ambient", "wheels", "infrared-wall", "infrared-cylinder")
"""The recordings, the longest first: so that two workers end at about the same time."""
FIT = "fit"
CURE = "Choose another folder, or remove this one."
BASE = "paper"
"""What the recordings do not tell stays as in this profile."""
RECIPE = 3
"""Changes whenever the same settings would make another profile."""

Progress = Callable[[str, int, int], None]
"""Is told the recording's name (or "fit"), the places done, and all."""


def calibrated_unit(
    folder: str | Path,
    *,
    unit: int,
    noise: float,
    seed: int,
    workers: Workers = 1,
    on_progress: Progress | None = None,
) -> Path:
    """The profile of a twin's unit, recorded through its serial line and fitted.

    Recordings are kept in `folder/recordings`, each as a whole or not at all: an interrupted call
    begun again, with any number of workers, ends at the same bits. What is there already is not
    made again.

    Args:
        folder: the unit's own; made if need be.
        unit: which robot of the population.
        noise: the twin's noise scale.
        seed: of its noise, and of what is random in the plans.
        workers: processes that record at the same time, one a core if None; or a pool.
        on_progress: is told how far it is; whoever raises there stops the work.

    Returns:
        The path of `folder/robot.toml`.

    Raises:
        CalibrationError: the folder belongs to another unit or other settings.
        StudyError: its process died again and again.
    """
    folder = as_path(folder, "folder").resolve()
    for key, value, kind in (("unit", unit, int), ("seed", seed, int), ("noise", noise, int | float)):
        must_be(value, kind, key, "See `realitygap record --help`.")
    _claim(folder, {"recipe": RECIPE, "unit": unit, "twin_noise": float(noise), "seed": seed})
    if not (folder / PROFILE).is_file():
        _carry_out(folder, workers, on_progress or (lambda name, done, total: None))
    return folder / PROFILE


def _carry_out(folder: Path, workers: Workers, report: Progress) -> None:
    """Record what is not there yet, then fit."""
    setup = Setup(Bench, (str(folder),))
    parts = [name for name in PARTS if not (folder / RECORDINGS / name / FACTS).is_file()]
    with _recorders(workers, len(parts)) as pool:
        pool.work(setup, parts, lambda told: report(*told))
    report(FIT, 0, 1)
    with closing(Processes(1, one_thread=True)) as pool:
        pool.work(setup, [FIT], lambda text: whole.write(folder / PROFILE, text))
    report(FIT, 1, 1)


def _recorders(workers: Workers, parts: int) -> AbstractContextManager[Pool]:
    """Never this process: small matrices gain nothing from more threads than one, which it may have."""
    if isinstance(workers, Pool):
        return opened(workers)
    size = cores() if workers is None else max(1, workers)
    return closing(Processes(min(size, max(1, parts)), one_thread=True))


class Bench:
    """Carries out the jobs of a unit's folder, which it has to see: a recording of PARTS, or the fit."""

    def __init__(self, folder: str) -> None:
        self._folder = Path(folder)

    def carry_out(self, job: str, tell: Tell) -> None:
        """Record, and say how far it is; or fit, and say what the profile is."""
        if job == FIT:
            tell(fitted(self._folder))
        else:
            record_part(self._folder, job, lambda *said: tell(said))

    def close(self) -> None:
        """It holds nothing."""


def record_part(folder: Path, name: str, report: Progress) -> None:
    """Record one part of all plans into `folder/recordings/name`, there as a whole or not at all."""
    from realitygap.calibration.recorder.plans import CYLINDER
    from realitygap.calibration.recorder.record import Wanted, record
    from realitygap.robots.address import Address

    unit, noise, seed = (_settings(folder)[key] for key in ("unit", "twin_noise", "seed"))
    finished = folder / RECORDINGS / name
    unfinished = finished.with_name(name + UNFINISHED)
    shutil.rmtree(unfinished, ignore_errors=True)  # left by one that was stopped
    plan, _, shape = name.partition("-")
    wanted = Wanted(plan=plan, object={"": None, "wall": "wall", "cylinder": CYLINDER}[shape], seed=seed)
    with whole.together(unfinished), closing(Address.parse(f"twin:{unit}").open(noise=noise)) as body:
        record(wanted, unfinished, body, on_progress=report)
    whole.move(unfinished, finished)


def fitted(folder: Path) -> str:
    """The profile that all parts are fitted to, as its file."""
    from realitygap.calibration.calibrate import calibrate
    from realitygap.calibration.recordings.files import load_recording
    from realitygap.world.profile import load_profile

    recordings = [load_recording(folder / RECORDINGS / name) for name in sorted(PARTS)]
    unit = _settings(folder)["unit"]
    # The day stands in the recordings: the same settings make the same file on any day.
    made = calibrate(recordings, load_profile(BASE), beside=False).named(f"twin-{unit}", date="")
    return made.profile.to_toml()


def _settings(folder: Path) -> dict[str, Any]:
    return read_toml(folder / SETTINGS, CalibrationError, CURE)


def _claim(folder: Path, settings: dict[str, Any]) -> None:
    """Make the folder this unit's, or see that it is."""
    path = folder / SETTINGS
    if not path.is_file():
        if (folder / PROFILE).exists() or (folder / RECORDINGS).exists():
            raise CalibrationError(
                f"{folder}: expected a new folder, or one with {SETTINGS}; it holds something else. "
                "Choose another folder."
            )
        folder.mkdir(parents=True, exist_ok=True)
        whole.write(path, to_toml(settings))
        return
    there = read_toml(path, CalibrationError, CURE, broken=CURE)
    refuse_unknown(there, settings, CalibrationError, where=str(path))
    for key, value in settings.items():
        if there.get(key) != value:
            raise CalibrationError(
                f"{path}: {key}: expected {value!r}, got {there.get(key)!r}: another calibration is there. "
                f"{CURE}"
            )
