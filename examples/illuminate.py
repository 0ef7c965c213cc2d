"""Fill an archive of behaviours with pyribs' MAP-Elites: how fast and how curved robots drive.

pip install ribs
python examples/illuminate.py [GENERATIONS [PICTURE]]
"""

import sys

import matplotlib.pyplot as plt
import numpy as np
from ribs.archives import GridArchive
from ribs.emitters import EvolutionStrategyEmitter
from ribs.schedulers import Scheduler

from realitygap import Problem


def main(generations, picture=None):
    """Fill the archive, print how many behaviours it has, and draw it."""
    problem = Problem("obstacle-avoidance", controller="feed-forward:4")
    ranges = list(zip(*problem.measure_bounds, strict=True))
    archive = GridArchive(solution_dim=problem.dim, dims=(20, 20), ranges=ranges, seed=1)
    emitters = [
        EvolutionStrategyEmitter(archive, x0=problem.x0(), sigma0=0.5, batch_size=32, seed=k) for k in (1, 2)
    ]
    scheduler = Scheduler(archive, emitters)
    for generation in range(generations):
        batch = problem.evaluate(scheduler.ask(), seed=generation)
        scheduler.tell(batch.fitness, batch.measures)
    _, best = problem.champion(archive.data("solution"))  # a stored fitness was lucky
    print(f"{archive.stats.num_elites} behaviours; the best on 100 fresh trials: {best.fitness[0]:.3f}")
    if picture:
        draw(archive, problem, picture)
    return archive


def draw(archive, problem, picture):
    """The best fitness of each cell."""
    cells, elites = np.full(archive.dims, np.nan), archive.data()
    cells[tuple(archive.int_to_grid_index(elites["index"]).T)] = elites["objective"]
    figure, axes = plt.subplots(figsize=(4.4, 3.6), layout="constrained")
    (left, right), (bottom, top) = problem.measure_bounds.T
    shown = axes.imshow(cells.T, origin="lower", extent=(left, right, bottom, top), cmap="viridis")
    axes.set(xlabel=f"{problem.measures[0]} / top speed", ylabel=f"{problem.measures[1]} / top speed")
    figure.colorbar(shown, label="fitness")
    figure.savefig(picture, dpi=150)


if __name__ == "__main__":
    given = sys.argv[1:]
    main(int(given[0]) if given else 100, *given[1:2])
