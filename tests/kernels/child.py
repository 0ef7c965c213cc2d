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
from numba.core import event

from realitygap.compiled import SHELF
from realitygap.control.genotype import Layout, braitenberg
from realitygap.control.network import decode
from realitygap.control.operators import Variation
from realitygap.kernels.rng import substream
from realitygap.simulation.simulation import Simulation
from realitygap.study.ahead import STAGES, Ahead
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


def compiled_into(folder: Path) -> tuple[list[str], list[str]]:
    """What is compiled, by its names in order, into a folder, and the fingerprints of that code; as they
    were, where that was done before."""
    kept = folder / "fingerprints"
    if not kept.exists():
        kept.write_text("\n".join(in_a_child(5.0, 20, "afresh", NUMBA_CACHE_DIR=str(folder))))
    names, *lines = kept.read_text().split("\n")
    return names.split(), lines


class Names(event.Listener):
    """Of the functions that are compiled, as they begin."""

    def __init__(self) -> None:
        self.seen: list[str] = []

    def on_start(self, event: event.Event) -> None:
        self.seen.append(event.data["dispatcher"].py_func.__name__)

    def on_end(self, event: event.Event) -> None:
        """Nothing."""


def compile_ahead() -> list[str]:
    """Compile what trials need as a study does, its parts first; the names of what was compiled."""
    with event.install_listener("numba:compile", Names()) as names:
        ahead = Ahead()
        for job in (*STAGES[0][:2], STAGES[1][0]):
            ahead.carry_out(job, print)
    return names.seen


def fingerprints(seconds: float, count: int, *, whole: bool = True) -> list[str]:
    """A line a task and noise level: the hash of every bit of `count` trials' scores (and courses)."""
    layout, profile = Layout(), load_profile("paper")
    variation = Variation(start_neurons=0.3)
    lines = []
    for name in ("obstacle-avoidance", "light-seeking"):
        task = replace(load_task(name), seconds=seconds)
        genes = [braitenberg(task.feeds, layout)]
        genes += [variation.random(substream(np.uint64(33), i)) for i in range(count - 1)]
        nets = decode(np.stack(genes), layout)
        for level in (0.0, 1.0):
            simulation = Simulation(task, profile, level)
            scores = simulation.scores(nets, np.arange(2 * count, dtype=np.uint64).reshape(count, 2))
            digest = hashlib.sha256(scores.tobytes())
            if whole:
                course, _ = simulation.trajectory(decode(genes[0], layout), stream=7)
                for column in ("x", "y", "heading", "proximity", "ambient", "commands", "wheels"):
                    digest.update(np.ascontiguousarray(getattr(course, column)).tobytes())
            lines.append(f"{name} {level:g} {digest.hexdigest()}")
    return lines


if __name__ == "__main__":
    if len(sys.argv) == 2:
        compiled_into(Path(sys.argv[1]))
        for path in Path(sys.argv[1]).rglob("*.code"):
            if SHELF.folder is not None:
                shutil.copy(path, SHELF.folder)
        one = Simulation("obstacle-avoidance", "paper")
        course, _ = one.trajectory(
            decode(braitenberg(one.task.feeds, Layout()), Layout()), stream=0, seconds=0.1
        )
        one.probe(course.end)
        twin = TwinBody({"size_cm": [50, 50]}, unit=1)
        twin.advance(1), twin.proximity(), twin.ambient()
    else:
        if sys.argv[3] == "afresh":
            print(*compile_ahead())
        print("\n".join(fingerprints(float(sys.argv[1]), int(sys.argv[2]), whole=sys.argv[3] == "whole")))
