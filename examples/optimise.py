"""Use somebody else's optimiser on a task: pycma's CMA-ES, and SciPy's differential evolution.

pip install cma
python examples/optimise.py [GENERATIONS]
"""

import sys

import cma
from scipy.optimize import differential_evolution

from realitygap import Problem


def by_pycma(problem, generations, seed=1):
    """Ask and tell; every generation has trials of its own."""
    options = {"seed": seed, "verbose": -9, "bounds": [list(bound) for bound in problem.bounds]}
    search = cma.CMAEvolutionStrategy(problem.x0(), 0.5, options)
    for generation in range(generations):
        solutions = search.ask()
        search.tell(solutions, -problem.evaluate(solutions, seed=generation).fitness)
    return search.result.xfavorite


def by_scipy(problem, generations, seed=1):
    """Whole generations at once: SciPy hands them over as columns."""
    calls = iter(range(10**9))
    found = differential_evolution(
        lambda columns: -problem.evaluate(columns.T, seed=next(calls)).fitness,
        problem.bounds.T, vectorized=True, updating="deferred", maxiter=generations, popsize=1, rng=seed,
        polish=False,
    )  # fmt: skip
    return found.x


def main(generations):
    """Print what each found, retested on fresh trials; return it."""
    problem = Problem("obstacle-avoidance", controller="feed-forward:4")
    found = {}
    for search in (by_pycma, by_scipy):
        again = problem.retest(search(problem, generations), trials=100)
        found[search.__name__] = again.fitness[0]
        print(
            f"{search.__name__}: {again.fitness[0]:.3f}, sd {again.info['sd'][0]:.3f} over 100 fresh trials"
        )
    return found


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 60)
