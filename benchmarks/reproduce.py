"""The reproduction as a whole and by phase, time first and once compiled, memory, the serial share.

    python benchmarks/reproduce.py
    python benchmarks/reproduce.py --runs 1 --evaluations 64 --starts 1     # see that it works

Runs `realitygap reproduce` in fresh processes with a compilation cache of its own, then times the
parts of one evaluation in this process, and memory against the number of runs and cost against trials.
A phase lasts from its first line of progress to the next phase's.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import threading
import time
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from steps import random_networks

from realitygap.simulation.simulation import Simulation, batch_streams
from realitygap.study.config import StudyConfig
from realitygap.study.folder import gather
from realitygap.study.plan import plans
from realitygap.study.run import ConditionRunner, advance, begin
from realitygap.tasks import load_task
from realitygap.world.robot import load_profile

PHASES = {
    "recording": "recording and fitting unit 1", "fitting": "recording and fitting unit 1",
    "compiling": "runs", "evolving": "runs", "testing": "runs", "finished": "runs",
    "transferring": "transfers, films, scores", "scoring": "transfers, films, scores",
    "making": "report",
}  # fmt: skip
"""The phase that a line of progress belongs to, by its first word."""


class Cost(NamedTuple):
    """What a command took: seconds, peak memory (MB, all processes added up), seconds of each phase."""

    seconds: float
    peak_mb: float
    phases: dict[str, float]


def whole(folder: Path, *words: str) -> Cost:
    """One command's cost."""
    environment = os.environ | {"XDG_CACHE_HOME": str(folder / "cache")}
    command = [sys.executable, "-m", "realitygap", *words]
    start, peak, began = time.perf_counter(), 0.0, {}
    process = subprocess.Popen(
        command, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
    )

    def listen() -> None:
        for line in process.stderr:
            phase = PHASES.get(line.split(maxsplit=1)[0].rstrip(":")) if line.strip() else None
            if phase is not None:
                began.setdefault(phase, time.perf_counter())

    listener = threading.Thread(target=listen)
    listener.start()
    while process.poll() is None:
        peak = max(peak, sum(map(proportional_mb, family(process.pid))))
        time.sleep(0.1)
    end = time.perf_counter()
    listener.join()
    assert process.returncode == 0, command
    ends = [*list(began.values())[1:], end]
    phases = {phase: to - since for (phase, since), to in zip(began.items(), ends, strict=True)}
    return Cost(end - start, peak, phases)


def family(pid: int) -> list[int]:
    """A process and its descendants (Linux)."""
    found = [pid]
    for parent in found:
        for task in Path(f"/proc/{parent}/task").glob("*/children"):
            found += map(int, task.read_text().split())
    return found


def proportional_mb(pid: int) -> float:
    """Memory of a process, what it shares counted in proportion (Linux)."""
    try:
        lines = Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines()
    except OSError:
        return 0.0
    return sum(float(line.split()[1]) for line in lines if line.startswith("Pss:")) / 1024


def serial_share(task: str) -> tuple[float, float]:
    """Microseconds of an evaluation in all, and of its trials with their scores alone."""
    materials = gather(StudyConfig.single(task))
    runner, plan = ConditionRunner(materials, 0), plans(materials)[0]
    simulation, state, pairs = runner.simulation(runner.noise), begin(runner, plan), []
    for _ in range(8):  # the first compiles, and fills the cells
        start, trials, told, run = time.thread_time(), 0.0, None, advance(runner, plan, state, 300)
        try:
            while True:
                asked = run.send(told)
                networks = runner.encoding.decode(asked.genes.copy())
                before = time.thread_time()
                told = simulation.scores(networks, asked.streams)
                trials += time.thread_time() - before
        except StopIteration as ended:
            state, _ = ended.value
        pairs.append(((time.thread_time() - start) / 300e-6, trials / 300e-6))
    return tuple(np.median(pairs[1:], axis=0))


def seconds_for_trials(trials: int) -> float:
    """CPU seconds of so many trials of obstacle avoidance."""
    task = replace(load_task("obstacle-avoidance"), seconds=20.0)
    simulation = Simulation(task, load_profile("paper"), 1.0)
    networks = random_networks(simulation, stream=3, count=64)
    streams = batch_streams(5, trials).reshape(64, -1)
    simulation.scores(networks, streams[:, :2])
    start = time.thread_time()
    simulation.scores(networks, streams)
    return time.thread_time() - start


def sized() -> list[str]:
    """The options of `reproduce` that make it smaller, as they were given."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    for name in ("runs", "evaluations", "starts"):
        parser.add_argument(f"--{name}", help="as of `realitygap reproduce`")
    given = vars(parser.parse_args()).items()
    return [word for key, value in given if value is not None for word in (f"--{key}", value)]


def reproductions(folder: Path, size: list[str]) -> None:
    """The simulated half twice, the transfers after it, and all of it at once."""
    half = ("reproduce", "--no-transfer", "--profile", "paper", *size, "--out")
    first = whole(folder, *half, str(folder / "first"))
    again = whole(folder, *half, str(folder / "again"))
    print(
        f"the simulated half, first time: {first.seconds:.1f} s; compiled: {again.seconds:.1f} s; "
        f"memory {again.peak_mb:.0f} MB"
    )
    rest = whole(folder, "reproduce", "--resume", "--out", str(folder / "again"))
    print(f"transfers, films, scores and report after it: {rest.seconds:.1f} s; memory {rest.peak_mb:.0f} MB")
    full = whole(folder, "reproduce", *size, "--out", str(folder / "whole"))
    print(f"the whole of it, once compiled: {full.seconds:.1f} s; memory {full.peak_mb:.0f} MB; of it:")
    for phase, seconds in full.phases.items():
        print(f"  {phase}: {seconds:.1f} s")


def main() -> None:
    size = sized()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        reproductions(folder, size)
        short = ("--evaluations", "200", "--set", "task.seconds=2.0", "--json")
        for runs in (30, 300) if not size else (3,):
            out = str(folder / f"runs{runs}")
            cost = whole(folder, "evolve", "avoidance", "--runs", str(runs), "--out", out, *short)
            print(f"a study of {runs} short runs: {cost.seconds:.1f} s, memory {cost.peak_mb:.0f} MB")
    for task in ("obstacle-avoidance", "light-seeking"):
        total, compiled = serial_share(task)
        print(f"{task}: {total:.0f} µs an evaluation, serial share {100 * (1 - compiled / total):.0f} %")
    a, b = seconds_for_trials(1280), seconds_for_trials(5120)
    print(f"four times the trials: {b / a:.2f} times the time")


if __name__ == "__main__":
    main()
