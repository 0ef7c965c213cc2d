"""Steps a second of the vector environments, as Gymnasium measures them, and how an example learns.

    python benchmarks/gymnasium.py                    # a table
    python benchmarks/gymnasium.py --draw docs/gymnasium.png

`gymnasium.utils.performance.benchmark_vector_step` samples an action for every robot and steps; beside it
stands Gymnasium's own vector of as many single environments.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

# This file has the library's name: its own folder is no place to look for that.
sys.path = [place for place in sys.path if Path(place or ".").resolve() != Path(__file__).resolve().parent]

import gymnasium  # noqa: E402
import numpy as np  # noqa: E402
from gymnasium.utils.performance import benchmark_vector_step  # noqa: E402

import realitygap.environment  # noqa: E402

gymnasium.register_envs(realitygap.environment)
NAMES = {
    "obstacle avoidance": "realitygap/ObstacleAvoidance-v0",
    "light seeking": "realitygap/LightSeeking-v0",
}
WAYS = {"ours": "vector_entry_point", "SyncVectorEnv": "sync"}
MOST_SINGLE = 64
"""A thousand single environments take a minute to make."""


def table(robots: list[int], seconds: int, spread: float) -> None:
    """Thousands of robots' steps a second."""
    print("| thousand steps a second | " + " | ".join(f"{count} robots" for count in robots) + " |")
    print("|---|" + "---|" * len(robots))
    for task, name in NAMES.items():
        for title, way in WAYS.items():
            cells = []
            for count in robots:
                if way == "sync" and count > MOST_SINGLE:
                    cells.append("")
                    continue
                env = gymnasium.make_vec(name, num_envs=count, vectorization_mode=way, spread=spread)
                cells.append(f"{benchmark_vector_step(env, seconds, seed=1) / 1000:.4g}")
            print(f"| {task}, {title} | {' | '.join(cells)} |", flush=True)


def draw(file: Path, runs: int) -> None:
    """How the mean score of examples/learn.py rises: each run, and their median."""
    import matplotlib.pyplot as plt

    sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "examples"))
    import learn

    curves = np.array([learn.main(20, seed=seed) for seed in range(runs)])
    steps = (1 + np.arange(curves.shape[1])) * learn.ROBOTS * 2 * 200 / 1000
    figure, axes = plt.subplots(figsize=(4.8, 3.0), layout="constrained")
    axes.plot(steps, curves.T, color="#0072b2", alpha=0.35, lw=1)
    axes.plot(steps, np.median(curves, 0), "o-", color="black", ms=3, lw=1.5, label=f"median of {runs} runs")
    axes.set(xlabel="thousand steps of all robots", ylabel="mean score of the 64 robots", ylim=(0, None))
    axes.legend(loc="lower right", fontsize=8)
    figure.savefig(file, dpi=150)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--robots", type=int, nargs="+", default=[1, 64, 1024])
    parser.add_argument("--seconds", type=int, default=3, help="of each measurement")
    parser.add_argument("--spread", type=float, default=0.0, help="constants drawn anew for each trial")
    parser.add_argument("--runs", type=int, default=10, help="of the figure")
    parser.add_argument("--draw", type=Path, help="draw the figure instead")
    options = parser.parse_args()
    if options.draw:
        draw(options.draw, options.runs)
    else:
        table(options.robots, options.seconds, options.spread)


if __name__ == "__main__":
    main()
