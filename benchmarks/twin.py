"""The twin through its serial line, its camera and the tracker: how many times real time.

    python benchmarks/twin.py

Virtual time: Braitenberg's controllers drive unit 1 at 38400 baud; what a watched trial of 20 s costs, part
by part, on a rig that serves many. Real time: the loop's lateness.
"""

from __future__ import annotations

import os
import resource
import tempfile
import time
from pathlib import Path

from realitygap.control.genotype import Genotype
from realitygap.robots.clock import Clock, RealClock, VirtualClock
from realitygap.robots.khepera.body import Khepera, KheperaBody
from realitygap.robots.khepera.twin import TwinBody
from realitygap.robots.loop import drive
from realitygap.robots.recording import Recording
from realitygap.tasks import load_task
from realitygap.transfer.rig import Rig
from realitygap.twin.camera import OverheadCamera
from realitygap.twin.drawing import WHOLE
from realitygap.twin.process import TwinProcess, start_twin
from realitygap.twin.states import States
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


def trial(twin: TwinProcess, clock: Clock, kinds: tuple[str, ...], pose: Pose, seconds: float) -> Recording:
    """One trial through the line."""
    with Khepera.connect(twin.device, clock=clock) as khepera:
        body = KheperaBody(khepera, kinds=kinds, carry=twin.place)
        body.reset(pose)
        controller = Genotype.braitenberg(kinds[0]).controller()
        return drive(body, controller, seconds=seconds, clock=clock, inputs=lambda r: inputs(kinds[0], r))


def spent(pid: int | None = None) -> float:
    """Processor time of this process, or of another one, s."""
    if pid is None:
        usage = resource.getrusage(resource.RUSAGE_SELF)
        return usage.ru_utime + usage.ru_stime
    with open(f"/proc/{pid}/stat", encoding="ascii") as file:
        ticks = file.read().rsplit(")", 1)[1].split()[11:13]
    return sum(map(int, ticks)) / os.sysconf("SC_CLK_TCK")


def parts(task: str, pose: Pose, folder: Path) -> None:
    """Processor time of a watched trial's parts."""
    with Rig(load_task(task), load_profile("paper"), robot="twin:1", folder_for_camera=folder) as rig:
        driver = Genotype.braitenberg(rig.task.feeds).controller()
        rig.drive(driver, 1, pose, 2.0)
        assert isinstance(rig.body, TwinBody) and rig.body.twin is not None
        pid = rig.body.twin.pid
        least = [float("inf")] * 3
        for stream in range(2, 7):
            sealed = folder / "sealed.csv"
            before, twin = spent(), spent(pid)
            rig.trial(driver, stream, pose, 20.0, sealed=sealed)
            driven = spent()
            rig.watcher.track(rig.states(sealed, 20.0), stream)
            costs = (driven - before, spent(pid) - twin, spent() - driven)
            least = [min(pair) for pair in zip(least, costs, strict=True)]
    print(
        f"  a watched trial of 20 s: {sum(least):.2f} s of processor time (driver {least[0]:.2f}, twin "
        f"{least[1]:.2f}, camera and tracker {least[2]:.2f}; least of five)"
    )


def main() -> None:
    with tempfile.TemporaryDirectory() as folder:
        for task, (kind, pose) in TASKS.items():
            sealed = Path(folder) / f"{task}.csv"
            with start_twin(load_arena(task).plain(), unit=1, pose=pose) as twin:
                twin.film(sealed)
                speeds = []
                for seconds in (5.0, 60.0, 60.0, 60.0):
                    start = time.perf_counter()
                    trial(twin, VirtualClock(twin.channel), (kind,), pose, seconds)
                    speeds.append(seconds / (time.perf_counter() - start))
            print(f"{task}: {min(speeds[1:]):.0f} to {max(speeds[1:]):.0f} times real time")
            parts(task, pose, Path(folder))
            states = States.from_file(sealed)
            for view in ("drawn", "mujoco"):
                try:
                    with OverheadCamera(load_arena(task).plain(), unit=1, view=view) as camera:
                        start = time.perf_counter()
                        count = sum(
                            1
                            for _, (_t, show) in zip(range(200), camera.looks(states), strict=False)
                            if show(WHOLE).size
                        )
                        print(f"  camera, {view}: {count / (time.perf_counter() - start):.0f} frames/s")
                except Exception as error:  # no EGL or OSMesa here
                    print(f"  camera, {view}: {error}")
        kind, pose = TASKS["obstacle-avoidance"]
        with start_twin(load_arena("obstacle-avoidance").plain(), unit=1, pose=pose, clock="real") as twin:
            recording = trial(twin, RealClock(), ("proximity", "ambient"), pose, 10.0)
        print(
            f"real clock, both kinds of sensors at 38400 baud: {len(recording.t)} steps, "
            f"{recording.late_steps} late, lateness {1000 * recording.late.mean():.2f} ms on average, "
            f"{1000 * recording.late.max():.2f} ms at worst"
        )


if __name__ == "__main__":
    main()
