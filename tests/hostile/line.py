"""Spoil a robot's line at random while it drives: no drive hangs, believes nonsense, or leaves the robot moving.

    python -m tests.hostile.line [--drives 60] [--seed 1]

Bytes are lost, doubled, garbled and late, the line falls silent, the plug is pulled. A drive keeps every
step, or ends with one of the project's errors; then the robot stands, or the error says that it may not.
"""  # noqa: E501

from __future__ import annotations

import argparse
import contextlib
import random
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

from realitygap.errors import RealityGapError
from realitygap.robots.drive import Recorder, Recording, drive
from realitygap.robots.khepera import KheperaBody
from tests.robots.conftest import ARENA, BODY
from tests.robots.controllers import Constant, bands
from tests.robots.pump import Faults, Pump
from tests.robots.test_faults import comes_to_stand
from tests.served import Served

SECONDS = 1.5
TOO_LONG_S = 30.0
WARNING = "may still be moving"


def random_faults(draw: random.Random) -> Faults:
    """From a byte in ten thousand to one in thirty, each way."""

    def share() -> float:
        return 10 ** draw.uniform(-4, -1.5) if draw.random() < 0.6 else 0.0

    late = draw.choice([0.0, 0.0, 0.05, 0.3])
    return Faults(
        lost=share(), doubled=share(), garbled=share(),
        late=late, late_s=draw.uniform(0.02, 0.4), seed=draw.randrange(2**32),
    )  # fmt: skip


@contextlib.contextmanager
def breaking(pump: Pump, draw: random.Random) -> Iterator[str]:
    """Somewhere in the drive the line may fall silent, for a while or for good, or be pulled."""
    what = draw.choice(["", "", "silent", "silent a while", "pulled"])
    timers = []
    if what:
        at = draw.uniform(0.1, SECONDS)
        breaks = pump.pull if what == "pulled" else lambda: setattr(pump, "silent", True)
        timers.append(threading.Timer(at, breaks))
        if what == "silent a while":
            heals = at + draw.uniform(0.1, 0.9)
            timers.append(threading.Timer(heals, lambda: setattr(pump, "silent", False)))
    for timer in timers:
        timer.start()
    try:
        yield what
    finally:
        for timer in timers:
            timer.cancel()
            timer.join()


def complaint(folder: Path, draw: random.Random) -> tuple[str, str]:
    """What came of a drive, and what is wrong about it ("": nothing)."""
    baud = draw.choice([19200, 38400, 115200])
    with Served(ARENA, body=BODY, baud=baud) as twin, Pump(twin.device, Faults()) as pump:
        khepera = KheperaBody.connect(pump.device, baud=baud)
        recorder = Recorder(folder / "r")
        pump.faults, error, begun = random_faults(draw), "", time.monotonic()
        with breaking(pump, draw) as what:
            try:
                controller = Constant(4, 5)
                settings = {"clock": khepera.clock, "inputs": bands, "recorder": recorder}
                drive(khepera, controller, seconds=SECONDS, **settings)  # type: ignore[arg-type]
            except RealityGapError as failure:
                error = str(failure)
        took = time.monotonic() - begun
        pump.faults, pump.silent = Faults(), False
        khepera.abandon()
        kept = Recording.from_folder(folder / "r")
        result = f"{what or 'not broken'}, {'an error' if error else 'driven'}"
        if took > TOO_LONG_S:
            return result, f"took {took:.0f} s"
        if not error and len(kept.t) != round(SECONDS / 0.1):
            return result, f"finished with {len(kept.t)} steps"
        if not ((kept.proximity >= 0) & (kept.proximity <= 1023)).all():
            return result, "believes readings that no robot gives"
        if WARNING not in error and not comes_to_stand(twin, folder):
            return result, f"drives on after {error!r}"
    return result, ""


def main() -> int:
    """Drive, spoil, look."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--drives", type=int, default=60)
    parser.add_argument("--seed", type=int, default=1)
    told = parser.parse_args()
    came, bad = Counter[str](), 0
    for k in range(told.drives):
        with tempfile.TemporaryDirectory() as place:
            result, wrong = complaint(Path(place), random.Random(f"{told.seed}/{k}"))
        came[result] += 1
        bad += bool(wrong)
        if wrong:
            print(f"drive {k} ({result}): {wrong}")
    for result, count in sorted(came.items()):
        print(f"{count:4d}  {result}")
    print(f"seed {told.seed}: {told.drives} drives, {bad} wrong")
    return int(bad > 0)


if __name__ == "__main__":
    sys.exit(main())
