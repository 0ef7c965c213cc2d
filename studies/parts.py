"""What the studies' programs share: a run's two individuals, and calibrations by a share of a recording."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from realitygap.calibration.calibrate import Calibration, calibrate
from realitygap.calibration.load import load_recording
from realitygap.calibration.recordings import Recording, SensorRecording
from realitygap.calibration.unit import PROFILE, Unit
from realitygap.errors import CalibrationError
from realitygap.experiments.noise import Controller
from realitygap.files import atomic_write
from realitygap.study.load import Study
from realitygap.work.pool import Workers
from realitygap.world.robot import Profile


@dataclass(frozen=True, kw_only=True)
class Individual(Controller):
    """A run's champion, or its fittest of the last population."""

    individual: str = "champion"

    @property
    def key(self) -> tuple[object, ...]:
        """The names of the streams of its trials."""
        return (*super().key, *(() if self.individual == "champion" else (self.individual,)))

    @property
    def name(self) -> str:
        """Its name in files and messages."""
        who = "" if self.individual == "champion" else f"-{self.individual}"
        return f"{self.task}-set-{self.seed_set}-level-{self.level!r}-run-{self.run}{who}"


def genes_of(one: Individual, study: Study) -> Any:
    """Its run's champion, or the highest stored fitness of the last population (the first of equals)."""
    run = study.run(one.run_name)
    if one.individual == "champion":
        return run.champion
    last = study.state(run.id)
    return last.genes[np.argmax(last.fitness)]


def thinned(recording: SensorRecording, share: float, seed: int) -> SensorRecording:
    """The recording with a share of its places, at least one; a larger share contains a smaller one."""
    place = recording.place()
    drawn = np.random.default_rng(seed).permutation(place.max() + 1)
    rows = np.isin(place, drawn[: max(1, round(share * len(drawn)))])
    names = ("distance_cm", "bearing_deg", "repeat", "counts", "pose", "speed_cm_s")
    there = {name: column for name in names if (column := getattr(recording, name)) is not None}
    return replace(recording, lines=(), **{name: column[rows] for name, column in there.items()})


def calibrate_share(
    recordings: Sequence[Recording], base: Profile, *, share: float, seed: int, **how: Any
) -> Calibration | None:
    """A calibration by a share of the places of recordings of one kind, the most informative first; wheels
    are used whole. Recordings with too few readings left are dropped, the last first; None without any."""
    kept = [thinned(one, share, seed) if isinstance(one, SensorRecording) else one for one in recordings]
    for few in range(len(kept), 0, -1):
        try:
            return calibrate(kept[:few], base, beside=False, **how)
        except CalibrationError:
            continue
    return None


def calibrated_again(
    folder: Path, *, of: Path, share: float = 1.0, form: str | None = None, workers: Workers = 1
) -> Path:
    """Another profile of the unit in folder `of` from a share of its recordings' places, or in another form
    than its own; one that is there is kept."""
    if (made := folder / PROFILE).is_file():
        return made
    unit, fits = Unit(of), []
    for kind in dict.fromkeys(part.partition("-")[0] for part in unit.parts):
        # A wall is more informative than a cylinder.
        names = sorted((part for part in unit.parts if part.partition("-")[0] == kind), reverse=share < 1)
        recordings = [load_recording(unit.recordings / name) for name in names]
        base, how = unit.base(recordings), {"form": form or unit.form, "workers": workers}
        if share < 1:
            fits.append(calibrate_share(recordings, base, share=share, seed=unit.settings["seed"], **how))
        else:
            fits.append(calibrate(recordings, base, beside=False, **how))
    folder.mkdir(parents=True, exist_ok=True)
    atomic_write(made, unit.profile([fit for fit in fits if fit is not None]))
    return made
