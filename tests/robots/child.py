"""A driver in a process of its own, to be stopped and killed: child.py DEVICE FOLDER."""

from __future__ import annotations

import sys

from realitygap.robots.clock import RealClock
from realitygap.robots.khepera.body import Khepera, KheperaBody
from realitygap.robots.loop import drive
from realitygap.robots.recording import Recorder
from tests.robots.conftest import STALL_S
from tests.robots.controllers import Constant, bands


def main(device: str, folder: str) -> None:
    """Drive for a minute; say so after the first steps."""

    class Talking(Constant):
        def decide(self, inputs: object) -> object:
            if self.steps == 5:
                print("driving", flush=True)
            return super().decide([])

    clock = RealClock()
    with Khepera.connect(device, clock=clock, give_up_s=STALL_S) as khepera:
        body = KheperaBody(khepera)
        drive(body, Talking(3, 4), seconds=60, clock=clock, inputs=bands, recorder=Recorder(folder))


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2])
