"""One call from a twin's unit to its profile: record all plans, fit, write robot.toml.

from realitygap.calibration.unit import calibrated_unit

profile = calibrated_unit("units/7", unit=7, noise=1.0, seed=0, workers=2)
"""

from __future__ import annotations

import contextlib
import json
import os
import shutil
import subprocess
import sys
from collections import deque
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from realitygap import whole
from realitygap.calibration.recordings.files import FACTS
from realitygap.errors import CalibrationError, RobotError
from realitygap.text import as_path, must_be, refuse_unknown
from realitygap.toml import read_toml, to_toml

__all__ = ["PARTS", "PROFILE", "SETTINGS", "calibrated_unit"]

PROFILE, SETTINGS, RECORDINGS, UNFINISHED = "robot.toml", "unit.toml", "recordings", ".part"
PARTS = ("ambient", "wheels", "infrared-wall", "infrared-cylinder")
"""The recordings, the longest first: so that two workers end at about the same time."""
FIT = "fit"
CURE = "Choose another folder, or remove this one."
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
    workers: int = 1,
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
        workers: recordings made at the same time, each in a process of its own.
        on_progress: is told how far it is; whoever raises there stops the work.

    Returns:
        The path of `folder/robot.toml`.

    Raises:
        CalibrationError: the folder belongs to another unit or other settings.
        RobotError: a recording's process died.
    """
    folder = as_path(folder, "folder").resolve()
    for key, value, kind in (("unit", unit, int), ("seed", seed, int), ("noise", noise, int | float)):
        must_be(value, kind, key, "See `realitygap record --help`.")
    settings = {"recipe": RECIPE, "unit": unit, "twin_noise": float(noise), "seed": seed}
    _claim(folder, settings)
    profile = folder / PROFILE
    if profile.is_file():
        return profile
    left = []
    for name in PARTS:
        if not (folder / RECORDINGS / name / FACTS).is_file():
            shutil.rmtree(folder / RECORDINGS / (name + UNFINISHED), ignore_errors=True)
            left.append(name)
    report = on_progress or (lambda name, done, total: None)
    _carry_out(folder, left, max(1, workers), report)
    _carry_out(folder, [FIT], 1, report)
    return profile


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


def _carry_out(folder: Path, jobs: Sequence[str], workers: int, report: Progress) -> None:
    """Do the jobs, `workers` at a time, each in a process of its own; pass on how far they are."""
    import selectors

    waiting, running = deque(jobs), dict[Any, tuple[str, subprocess.Popen[str]]]()
    watch = selectors.DefaultSelector()
    try:
        while waiting or running:
            while waiting and len(running) < workers:
                job = waiting.popleft()
                process = _start(folder, job)
                running[process.stdout] = job, process
                watch.register(process.stdout, selectors.EVENT_READ)  # type: ignore[arg-type]
            for key, _ in watch.select():
                line = key.fileobj.readline()  # type: ignore[union-attr]
                if line:
                    _heed(json.loads(line), report)
                    continue
                watch.unregister(key.fileobj)
                _end(*running.pop(key.fileobj))
    finally:
        watch.close()
        for _, process in running.values():
            process.kill()
            process.communicate()


def _start(folder: Path, job: str) -> subprocess.Popen[str]:
    """A process of calibration/unit_work.py; small matrices gain nothing from more threads than one."""
    return subprocess.Popen(
        [sys.executable, "-m", "realitygap.calibration.unit_work", str(folder), job],
        stdout=subprocess.PIPE,
        stdin=subprocess.PIPE,
        text=True,
        start_new_session=True,
        env={**os.environ, "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"},
    )


def _heed(said: dict[str, Any], report: Progress) -> None:
    if "error" in said:
        raise CalibrationError(said["error"])
    report(said["name"], said["done"], said["total"])


def _end(job: str, process: subprocess.Popen[str]) -> None:
    for pipe in (process.stdin, process.stdout):
        if pipe is not None:
            with contextlib.suppress(OSError):
                pipe.close()
    if process.wait() != 0:
        raise RobotError(
            f"{job}: its process ended with exit code {process.returncode}; its own message is above. "
            "What is finished is kept: the same call goes on."
        )
