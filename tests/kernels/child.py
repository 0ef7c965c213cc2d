"""Run as a program: prints the hashes of a few short trials, for comparison between processes."""

from __future__ import annotations

import hashlib
import sys
from dataclasses import replace

import numpy as np

from realitygap.controller.handmade import braitenberg
from realitygap.controller.layout import Layout
from realitygap.controller.network import decode
from realitygap.controller.operators import Variation
from realitygap.kernels.rng import substream
from realitygap.simulation.simulation import Simulation
from realitygap.tasks import load_task
from realitygap.world.profile import load_profile


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
    print("\n".join(fingerprints(float(sys.argv[1]), int(sys.argv[2]), whole=sys.argv[3] == "whole")))
