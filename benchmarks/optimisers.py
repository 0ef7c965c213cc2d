"""Three optimisers on both tasks at the same budget, their finds retested: a table and a figure.

    python benchmarks/optimisers.py --out optimisers --write docs/benchmarks.md

CMA-ES (pycma) and MAP-Elites (pyribs) look for the weights of a feed-forward network, the paper's
algorithm for its own genotypes, with its own evaluations (`run_study`). What a run found is kept in --out:
a run that is there is not made again.
"""

from __future__ import annotations

import argparse
from functools import cache
from pathlib import Path
from typing import NamedTuple

import cma
import matplotlib.pyplot as plt
import numpy as np
from ribs.archives import GridArchive
from ribs.emitters import IsoLineEmitter
from ribs.schedulers import Scheduler
from scipy import stats

from realitygap.problem import Problem
from realitygap.study.config import Condition, StudyConfig
from realitygap.study.runner import run_study

CONTROLLER, NOISE, SEED = "feed-forward:4", 1.0, 1995
LAST, CHOOSING, FRESH, BATCH = 100, 20, 100, 50
"""Who may become champion, trials that choose it, trials that measure it; MAP-Elites' children at a time."""
TASKS = {
    "obstacle-avoidance": ("Obstacle avoidance", 1.0),
    "light-seeking": ("Light seeking, 10⁻⁶ cm⁻²", 1e6),
}
NAMES = {"cma": "CMA-ES", "map": "MAP-Elites", "paper": "the paper's algorithm"}
COLOURS, MARKS = ("#0072b2", "#d55e00", "#009e73"), "osD"
BEGIN, END = "<!-- made by benchmarks/optimisers.py: begin -->", "<!-- end -->"


class Found(NamedTuple):
    """What a run believed of its fittest, and whom it ended with, the fittest first: [n, dim]."""

    stored: float
    last: np.ndarray


def by_cma(problem: Problem, evaluations: int, seed: int) -> Found:
    """The last generation; the fittest is the mean of the distribution, as pycma recommends for noise."""
    options = {"seed": seed + 1, "verbose": -9, "bounds": [list(bound) for bound in problem.bounds]}
    search = cma.CMAEvolutionStrategy(problem.x0(), 0.5, options)
    best = -np.inf
    for number in range(0, evaluations - search.popsize + 1, search.popsize):
        solutions = search.ask()
        fitness = problem.evaluate(solutions, seed=_seed(seed, number)).fitness
        search.tell(solutions, -fitness)
        best = max(best, fitness.max())
    return Found(best, np.stack([search.result.xfavorite, *solutions]))


def by_map(problem: Problem, evaluations: int, seed: int) -> Found:
    """The best elites of an archive of 20 × 20 speeds and turnings."""
    ranges = list(zip(*problem.measure_bounds, strict=True))
    archive = GridArchive(solution_dim=problem.dim, dims=(20, 20), ranges=ranges, seed=seed)
    emitter = IsoLineEmitter(
        archive, x0=problem.x0(), iso_sigma=0.5, line_sigma=0.2, batch_size=BATCH, seed=seed
    )
    scheduler = Scheduler(archive, [emitter])
    for number in range(0, evaluations, BATCH):
        batch = problem.evaluate(scheduler.ask(), seed=_seed(seed, number))
        scheduler.tell(batch.fitness, batch.measures)
    elites = archive.data()
    order = np.argsort(-elites["objective"])[:LAST]
    return Found(elites["objective"][order[0]], elites["solution"][order])


def by_paper(options: argparse.Namespace, evaluations: int) -> dict[str, list[Found]]:
    """Runs as `realitygap evolve` makes them: the fittest, and the last population."""
    conditions = tuple(Condition(task=task, noise=NOISE) for task in TASKS)
    config = StudyConfig(seed=SEED, runs=options.runs, evaluations=evaluations, conditions=conditions)
    study = run_study(options.out / f"paper-{evaluations}", config, workers=options.workers, resume=True)
    found: dict[str, list[Found]] = {task: [] for task in TASKS}
    for run in study.runs:
        genes = np.concatenate([run.fittest[np.newaxis], study.state(run.id).genes])
        found[run.task].append(Found(run.best_fitness, genes.reshape(len(genes), -1).astype(float)))
    return found


def _seed(run: int, number: int) -> int:
    """Every batch of every run has trials of its own."""
    return (SEED + run) * 10**6 + number


def judged(problem: Problem, found: Found) -> np.ndarray:
    """Stored fitness, the fittest retested, and the champion: chosen by some trials, measured by others."""
    fittest = problem.retest(found.last[0], FRESH, seed=1).fitness[0]
    chosen = np.argmax(problem.retest(found.last, CHOOSING, seed=2).fitness)
    champion = problem.retest(found.last[chosen], FRESH, seed=1).fitness[0]
    return np.array([found.stored, fittest, champion])


def measured(options: argparse.Namespace, evaluations: int) -> dict[str, dict[str, np.ndarray]]:
    """[runs, 3] of each task and optimiser; what is on file is read."""
    paper = cache(lambda: by_paper(options, evaluations))
    made: dict[str, dict[str, np.ndarray]] = {}
    for task, (_, scale) in TASKS.items():
        real = Problem(task, CONTROLLER, noise=NOISE, workers=options.workers)
        genes = Problem(task, "delay-network", noise=NOISE, workers=options.workers)
        makers = {
            "cma": lambda run, real=real: judged(real, by_cma(real, evaluations, run)),
            "map": lambda run, real=real: judged(real, by_map(real, evaluations, run)),
            "paper": lambda run, task=task, genes=genes: judged(genes, paper()[task][run]),
        }
        made[task] = {}
        for name, make in makers.items():
            rows = [kept(options.out / f"{name}-{task}-{evaluations}-{run}.npy", make, run)
                    for run in range(options.runs)]  # fmt: skip
            made[task][name] = scale * np.array(rows)
    return made


def kept(file: Path, make, run: int) -> np.ndarray:
    """A run's row, made unless it is there."""
    if not file.is_file():
        np.save(file, make(run))
    return np.load(file)


def table(evaluations: int, task: str, made: dict[str, np.ndarray]) -> list[str]:
    """Mean and standard deviation over the runs; the champion's difference from the paper's, 95 % (Welch)."""
    runs = len(made["paper"])
    lines = [
        f"**{TASKS[task][0]}, {evaluations} evaluations** ({runs} runs each)", "",
        "| | best during evolution | the same, retested | champion | champion, less the paper's |",
        "|---|---|---|---|---|",
    ]  # fmt: skip
    for name, rows in made.items():
        cells = [f"{column.mean():.3f} ± {column.std(ddof=1):.3f}" for column in rows.T]
        low, high = stats.ttest_ind(rows[:, 2], made["paper"][:, 2], equal_var=False).confidence_interval()
        cells.append("" if name == "paper" else f"{low:+.3f} … {high:+.3f}")
        lines.append(f"| {NAMES[name]} | {' | '.join(cells)} |")
    return [*lines, ""]


def draw(made: dict[int, dict[str, dict[str, np.ndarray]]], file: Path) -> None:
    """Every run's champion on its fresh trials; a bar at the median."""
    figure, axes = plt.subplots(1, len(TASKS), figsize=(7.0, 2.8), layout="constrained")
    for one, (task, (title, _)) in zip(axes, TASKS.items(), strict=True):
        for k, tasks in enumerate(made.values()):
            for i, (name, rows) in enumerate(tasks[task].items()):
                at, champions = k + 0.27 * (i - 1), rows[:, 2]
                spread = np.linspace(-0.09, 0.09, len(champions))
                one.scatter(at + spread, champions, s=11, marker=MARKS[i], c=COLOURS[i], alpha=0.75, lw=0,
                            label=NAMES[name] if k == 0 else None)  # fmt: skip
                one.hlines(np.median(champions), at - 0.11, at + 0.11, "black", lw=1.5)
        one.set_xticks(range(len(made)), [f"{count}" for count in made])
        name, _, unit = title.partition(", ")
        one.set(
            xlabel="evaluations", ylabel=", ".join(["champion's score", *filter(None, [unit])]), title=name
        )
        one.set_ylim(0, 1.05 * one.get_ylim()[1])
    axes[0].legend(fontsize=7, loc="lower right")
    figure.savefig(file, dpi=150)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("optimisers"), help="folder for what was found")
    parser.add_argument("--runs", type=int, default=20)
    parser.add_argument("--budgets", type=int, nargs="+", default=[1000])
    parser.add_argument("--workers", type=int)
    parser.add_argument(
        "--write", type=Path, help="page that the table is written into, the figure beside it"
    )
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    made = {evaluations: measured(options, evaluations) for evaluations in options.budgets}
    text = "\n".join(line for count, tasks in made.items() for task in tasks
                     for line in table(count, task, tasks[task]))  # fmt: skip
    print(text)
    if options.write:
        page = options.write.read_text("utf-8")
        before, rest = page.split(BEGIN)
        options.write.write_text(f"{before}{BEGIN}\n{text}\n{END}{rest.split(END)[1]}", "utf-8")
    folder = options.write.parent if options.write else options.out
    draw(made, folder / "optimisers-compared.png")


if __name__ == "__main__":
    main()
