"""A driver in a process of its own, to be stopped and killed: child.py ADDRESS|DEVICE FOLDER."""

from __future__ import annotations

import sys
from contextlib import closing
from functools import partial

from realitygap.robots import guard
from realitygap.robots.address import Address
from realitygap.robots.drive import Recorder, drive
from realitygap.robots.khepera import KheperaBody
from tests.robots.conftest import STALL_S
from tests.robots.controllers import Constant, bands


def main(device: str, folder: str) -> None:
    """Drive for a minute; say so after the first steps."""
    guard.UNGUARDED_S = 5.0  # as in conftest.py

    class Talking(Constant):
        def decide(self, inputs: object) -> object:
            if self.steps == 5:
                print("driving", flush=True)
            return super().decide([])

    connect = Address.parse(device).open if ":" in device else partial(KheperaBody.connect, device)
    with closing(connect(give_up_s=STALL_S)) as body:
        drive(body, Talking(3, 4), seconds=60, inputs=bands, recorder=Recorder(folder))


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2])
