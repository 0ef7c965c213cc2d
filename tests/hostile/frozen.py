"""Freeze, suspend, hang and kill drivers, and freeze their guards, at random moments: the robot is told to stand.

    python -m tests.hostile.frozen [--drives 24] [--seed 1]

On a line that is listened in to. Ends with 1 if a robot was told to stand later than half a second
after its driver's last word, or its guard's freezing, or drives on. For a quiet machine: a busy one is late
by itself.
"""  # noqa: E501

from __future__ import annotations

import argparse
import math
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from contextlib import closing
from pathlib import Path

from realitygap.robots.drive import Recorder, Recording, drive
from realitygap.robots.khepera import KheperaBody
from tests.robots.conftest import ARENA, BODY, ROOT, STALL_S
from tests.robots.controllers import Constant, bands
from tests.robots.pump import Faults, Pump
from tests.robots.test_faults import comes_to_stand
from tests.served import Served

HANG, GUARD = "a controller that hangs", "a guard that freezes"
WAYS = (
    HANG, GUARD, signal.SIGSTOP, signal.SIGTSTP, signal.SIGKILL, signal.SIGINT, signal.SIGTERM, signal.SIGHUP
)  # fmt: skip
IN_TIME_S = 0.55
"""Half a second, and a moment for the line and the machine."""


class Tap(Pump):
    """Notes when the driver's words, and a command to stand, pass."""

    def __init__(self, robot: str) -> None:
        super().__init__(robot, Faults())
        self.words: list[tuple[float, bytes]] = []

    def _hand_on(self, fd: int, data: bytes) -> None:
        if fd == self._robot:
            self.words.append((time.monotonic(), data))
        super()._hand_on(fd, data)

    def last_word(self, moment: float) -> float:
        """When the last word before a moment passed."""
        return max((at for at, _ in self.words if at <= moment), default=moment)

    def stopped_after_s(self, moment: float) -> float:
        """From a moment until the robot was told to stand."""
        return next((at - moment for at, data in self.words if at > moment and b"D,0,0" in data), math.inf)


def child(device: str, folder: str, hangs_at: int) -> None:
    """Drive for a minute."""

    class Driving(Constant):
        def decide(self, inputs: object) -> object:
            if self.steps == 5:
                print("driving", flush=True)
            if self.steps == hangs_at:
                print("hangs", flush=True)
                while True:
                    time.sleep(1)
            return super().decide([])

    with closing(KheperaBody.connect(device, give_up_s=STALL_S)) as khepera:
        drive(khepera, Driving(), seconds=60, inputs=bands, recorder=Recorder(folder))


def one_drive(way: object, draw: random.Random, folder: Path) -> tuple[float, bool, str]:
    """Seconds until the robot was told to stand, whether it stands, how the recording says it ended."""
    hangs_at = 5 + draw.randrange(8) if way == HANG else -1
    with Served(ARENA, body=BODY) as twin, Tap(twin.device) as tap:
        words = [sys.executable, "-m", "tests.hostile.frozen", "--child", tap.device, str(folder / "r")]
        with subprocess.Popen(
            [*words, str(hangs_at)],
            cwd=ROOT,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
            process_group=0,
        ) as driver:
            try:
                assert driver.stdout is not None and driver.stdout.readline() == "driving\n"
                if way == HANG:
                    assert driver.stdout.readline() == "hangs\n"
                else:
                    time.sleep(draw.uniform(0, 1))
                moment = time.monotonic()
                if isinstance(way, signal.Signals):
                    driver.send_signal(way)
                elif way == GUARD:
                    children = Path(f"/proc/{driver.pid}/task/{driver.pid}/children").read_text()
                    os.kill(guard := int(children), signal.SIGSTOP)
                since = moment if way == GUARD else tap.last_word(moment)
                time.sleep(1.0)
                took, stands = tap.stopped_after_s(since), comes_to_stand(twin, folder)
                if way == GUARD:
                    os.kill(guard, signal.SIGCONT)
                driver.send_signal(signal.SIGCONT)
                if way == HANG:
                    driver.send_signal(signal.SIGINT)
                driver.wait(60)
                stands &= comes_to_stand(twin, folder)
            finally:
                driver.send_signal(signal.SIGCONT)
                driver.kill()
    return took, stands, Recording.from_folder(folder / "r").ended


def main() -> int:
    """Drive, end, look."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--drives", type=int, default=24)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--child", nargs=3, metavar=("DEVICE", "FOLDER", "HANGS_AT"))
    told = parser.parse_args()
    if told.child:
        device, folder, hangs_at = told.child
        child(device, folder, int(hangs_at))
        return 0
    os.environ["PYTHONPATH"] = os.pathsep.join([str(ROOT), str(ROOT / "src")])
    draw, bad = random.Random(told.seed), 0
    for k in range(told.drives):
        way = WAYS[k % len(WAYS)]
        with tempfile.TemporaryDirectory() as place:
            took, stands, ended = one_drive(way, draw, Path(place))
        wrong = took > IN_TIME_S or not stands
        bad += wrong
        name = way.name if isinstance(way, signal.Signals) else way
        print(f"{name}: told to stand after {took:.2f} s{'' if stands else ', DRIVES ON'}; {ended[:60]}")
    print(f"seed {told.seed}: {told.drives} drives, {bad} too late or driving on")
    return int(bad > 0)


if __name__ == "__main__":
    sys.exit(main())
