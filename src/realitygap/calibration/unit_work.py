"""One job of a unit's calibration, in a process of its own: `python -m realitygap.calibration.unit_work
FOLDER JOB` records one part or fits, and tells on stdout, a line of JSON each time, how far it is.
"""

from __future__ import annotations

import json
import os
import signal
import sys
import threading
from pathlib import Path
from typing import Any

from realitygap import whole
from realitygap.calibration.unit import CURE, FIT, PARTS, PROFILE, RECORDINGS, SETTINGS, UNFINISHED
from realitygap.errors import CalibrationError, UsageError
from realitygap.toml import read_toml

__all__ = ["fit_unit", "record_part"]

BASE = "paper"
"""What the recordings do not tell stays as in this profile."""


def record_part(folder: Path, name: str) -> None:
    """Record one part of all plans into `folder/recordings/name`, there as a whole or not at all."""
    from contextlib import closing

    from realitygap.calibration.recorder.plans import CYLINDER
    from realitygap.calibration.recorder.record import Wanted, record
    from realitygap.robots.address import Address

    unit, noise, seed = (_settings(folder)[key] for key in ("unit", "twin_noise", "seed"))
    finished = folder / RECORDINGS / name
    unfinished = finished.with_name(name + UNFINISHED)
    plan, _, shape = name.partition("-")
    wanted = Wanted(plan=plan, object={"": None, "wall": "wall", "cylinder": CYLINDER}[shape], seed=seed)
    with closing(Address.parse(f"twin:{unit}").open(noise=noise)) as body:
        record(wanted, unfinished, body, on_progress=_tell)
    whole.move(unfinished, finished)


def fit_unit(folder: Path) -> None:
    """Fit all parts, and write the profile."""
    from realitygap.calibration.calibrate import calibrate
    from realitygap.calibration.recordings.files import load_recording
    from realitygap.world.profile import load_profile

    _tell(FIT, 0, 1)
    recordings = [load_recording(folder / RECORDINGS / name) for name in sorted(PARTS)]
    unit = _settings(folder)["unit"]
    # The day stands in the recordings: the same settings make the same file on any day.
    made = calibrate(recordings, load_profile(BASE), beside=False).named(f"twin-{unit}", date="")
    whole.write(folder / PROFILE, made.profile.to_toml())
    _tell(FIT, 1, 1)


def _settings(folder: Path) -> dict[str, Any]:
    return read_toml(folder / SETTINGS, CalibrationError, CURE)


def _tell(name: str, done: int, total: int) -> None:
    _say({"name": name, "done": done, "total": total})


def _say(what: dict[str, Any]) -> None:
    sys.stdout.write(json.dumps(what) + "\n")
    sys.stdout.flush()


def _leave_with_parent() -> None:
    """End when the parent is gone: its end of stdin closes then."""

    def wait() -> None:
        sys.stdin.read()
        os.kill(os.getpid(), signal.SIGKILL)

    threading.Thread(target=wait, daemon=True).start()


def main() -> int:
    """Do the job that the command line names."""
    folder, job = Path(sys.argv[1]), sys.argv[2]
    _leave_with_parent()
    try:
        if job == FIT:
            fit_unit(folder)
        else:
            record_part(folder, job)
    except UsageError as error:
        _say({"error": str(error)})
    return 0


if __name__ == "__main__":
    os._exit(main())
