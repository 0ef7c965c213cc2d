"""The twin through its serial line, its camera and the tracker: how many times real time.

    python benchmarks/twin.py

Braitenberg's controllers drive unit 1 at 38400 baud: what a watched trial of 20 s costs, part by part, on a
rig that serves many. Real time: the loop's lateness.
"""

from __future__ import annotations

import json
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from realitygap.control.genotype import Genotype
from realitygap.robots.address import Address
from realitygap.robots.drive import drive
from realitygap.tasks import load_task
from realitygap.track import read_track
from realitygap.transfer.rig import Rig
from realitygap.twin.camera import OverheadCamera
from realitygap.values import Pose, Readings
from realitygap.world.arena import load_arena
from realitygap.world.robot import load_profile

TASKS = {
    "obstacle-avoidance": ("proximity", Pose(x=25.0, y=25.0, heading=0.5)),
    "light-seeking": ("ambient", Pose(x=15.0, y=35.0, heading=0.5)),
}
ENDS = {"proximity": (0.0, 1023.0), "ambient": (484.0, 55.0)}


def inputs(kind: str, readings: Readings) -> list[int]:
    """Counts to −10..10, as the paper's profile does."""
    low, high = ENDS[kind]
    counts = getattr(readings, kind)
    return [round(min(max((c - low) / (high - low) * 20 - 10, -10), 10)) for c in counts]


def spent() -> float:
    """Processor time of this process, s."""
    usage = resource.getrusage(resource.RUSAGE_SELF)
    return usage.ru_utime + usage.ru_stime


def parts(task: str, pose: Pose, folder: Path) -> None:
    """Processor time of a watched trial's parts."""
    with Rig(load_task(task), load_profile("paper"), robot="twin:1", folder_for_camera=folder) as rig:
        driver = Genotype.braitenberg(rig.task.feeds).controller()
        rig.drive(driver, 1, pose, 2.0)
        least = [float("inf")] * 2
        for stream in range(2, 7):
            sealed = folder / f"{task}.csv"
            before = spent()
            rig.trial(driver, stream, pose, 20.0, sealed=sealed)
            driven = spent()
            rig.tracker.track(rig.truth(sealed, 20.0), stream)
            least = [min(pair) for pair in zip(least, (driven - before, spent() - driven), strict=True)]
    print(
        f"{task}: a watched trial of 20 s: {sum(least):.2f} s of processor time (driver and twin "
        f"{least[0]:.2f}, camera and tracker {least[1]:.2f}; least of five)"
    )


def real_time(pose: Pose) -> None:
    """The loop's lateness on a twin that is served in real time."""
    words = ["-m", "realitygap", "robot", "serve", "--arena", "obstacle-avoidance", "--json"]
    with subprocess.Popen([sys.executable, *words], stdout=subprocess.PIPE) as served:
        assert served.stdout is not None
        device = json.loads(served.stdout.readline())["device"]
        body = Address.parse(f"khepera:{device}").open(kinds=("proximity", "ambient"))
        driver = Genotype.braitenberg("proximity").controller()
        made = drive(body, driver, seconds=10.0, inputs=lambda r: inputs("proximity", r))
        body.close()
        served.terminate()
    print(
        f"real time, both kinds of sensors at 38400 baud: {len(made.t)} steps, {made.late_steps} late, "
        f"lateness {1000 * made.late.mean():.2f} ms on average, {1000 * made.late.max():.2f} ms at worst"
    )


def main() -> None:
    with tempfile.TemporaryDirectory() as folder:
        for task, (_, pose) in TASKS.items():
            parts(task, pose, Path(folder))
            truth = read_track(Path(folder) / f"{task}.csv")
            for view in ("drawn", "mujoco"):
                try:
                    with OverheadCamera(load_arena(task).plain(), unit=1, view=view) as camera:
                        start = time.perf_counter()
                        count = sum(1 for _ in zip(range(200), camera.frames(truth, fps=10), strict=False))
                        print(f"  camera, {view}: {count / (time.perf_counter() - start):.0f} frames/s")
                except Exception as error:  # no EGL or OSMesa here
                    print(f"  camera, {view}: {error}")
    real_time(TASKS["obstacle-avoidance"][1])


if __name__ == "__main__":
    main()
