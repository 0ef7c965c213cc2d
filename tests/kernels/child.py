"""Run as a program: prints the hashes of a few short trials, for comparison between processes.

With a folder alone: compiles into it, and keeps the code for the tests that follow, too; and what many of
them begin with, who would else compile it at the same time.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

from realitygap.compiled import folder
from realitygap.control.encoding import Variation
from realitygap.control.genotype import Genotype
from realitygap.kernels.rng import substream
from realitygap.report.drive import Driven, drive_json
from realitygap.simulation.simulation import Simulation
from realitygap.tasks import load_task
from realitygap.twin.body import TwinBody
from realitygap.world.robot import load_profile

PROJECT = Path(__file__).parents[2]


def in_a_child(seconds: float, count: int, part: str, **environment: str) -> list[str]:
    """The fingerprints as another process prints them."""
    words = [sys.executable, "-m", "tests.kernels.child", str(seconds), str(count), part]
    done = subprocess.run(
        words, cwd=PROJECT, env={**os.environ, **environment}, capture_output=True, text=True, timeout=3000
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.split("\n")[:-1]


def compiled_into(folder: Path) -> list[str]:
    """The fingerprints of code that is compiled into a folder; as they were, where that was done before."""
    kept = folder / "fingerprints"
    if not kept.exists():
        kept.write_text("\n".join(in_a_child(5.0, 20, "scores", NUMBA_CACHE_DIR=str(folder))))
    return kept.read_text().split("\n")


def fingerprints(seconds: float, count: int, *, whole: bool = True) -> list[str]:
    """A line a task and noise level: the hash of every bit of `count` trials' scores (and courses)."""
    profile = load_profile("paper")
    variation = Variation(start_neurons=0.3)
    lines = []
    for name in ("obstacle-avoidance", "light-seeking"):
        task = replace(load_task(name), seconds=seconds)
        genes = [Genotype.braitenberg(task.feeds).genes]
        genes += [variation.random(substream(np.uint64(33), i)) for i in range(count - 1)]
        nets = Genotype.decode(np.stack(genes), 8)
        for level in (0.0, 1.0):
            simulation = Simulation(task, profile, level)
            scores = simulation.scores(nets, np.arange(2 * count, dtype=np.uint64).reshape(count, 2))
            digest = hashlib.sha256(scores.tobytes())
            if whole:
                course, _ = simulation.trajectory(Genotype.decode(genes[0], 8), stream=7)
                for column in ("x", "y", "heading", "proximity", "ambient", "commands", "wheels"):
                    digest.update(np.ascontiguousarray(getattr(course, column)).tobytes())
            lines.append(f"{name} {level:g} {digest.hexdigest()}")
    return lines


if __name__ == "__main__":
    if len(sys.argv) == 2:
        compiled_into(Path(sys.argv[1]))
        folder().mkdir(parents=True, exist_ok=True)
        for path in Path(sys.argv[1]).rglob("*.nb[ci]"):
            shutil.copy(path, folder())
        one = Simulation("obstacle-avoidance", "paper")
        course, _ = one.trajectory(Genotype.braitenberg(one.task.feeds).networks(), stream=0, seconds=0.1)
        one.probe(course.end)
        avoider = Genotype.braitenberg(one.task.feeds)
        drive_json([Driven(task=one.task, profile=one.profile, runs={"avoider": avoider})])
        twin = TwinBody({"size_cm": [50, 50]}, unit=1)
        twin.advance(1), twin.proximity(), twin.ambient()
    else:
        print("\n".join(fingerprints(float(sys.argv[1]), int(sys.argv[2]), whole=sys.argv[3] == "whole")))
