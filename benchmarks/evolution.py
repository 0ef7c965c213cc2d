"""Is evolution better than chance? The distributed algorithm beside three others, same budget.

    python benchmarks/evolution.py --out evolution-studies --write docs/benchmarks.md

Makes one study for each algorithm and budget (both tasks, observed noise), resumes whatever is
already in the folder, and writes the table between the two marks in the page.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from scipy import stats

from realitygap.study.config import Condition, StudyConfig
from realitygap.study.load import Study
from realitygap.study.runner import run_study

ALGORITHMS = {
    "torus": ("distributed, as in the paper", []),
    "no-crossover": ("the same without crossover", ["variation.crossover=0.0"]),
    "panmictic": ("one well-mixed population", ["evolution.algorithm=panmictic"]),
    "random": ("random search", ["evolution.algorithm=random"]),
}
MEASURES = ("stored", "fittest", "champion")
TASKS = {
    "obstacle-avoidance": ("Obstacle avoidance", 1.0),
    "light-seeking": ("Light seeking, 10⁻⁶ cm⁻²", 1e6),
}
BEGIN, END = "<!-- made by benchmarks/evolution.py: begin -->", "<!-- end -->"


def study_of(name: str, evaluations: int, options: argparse.Namespace) -> Study:
    """The study of one algorithm at one budget, carried out or read back."""
    conditions = tuple(Condition(task=task, noise=1.0) for task in TASKS)
    config = StudyConfig(
        title=f"{name}, {evaluations} evaluations", seed=options.seed, runs=options.runs,
        evaluations=evaluations, conditions=conditions,
    ).with_settings(ALGORITHMS[name][1])  # fmt: skip
    folder = Path(options.out) / f"{name}-{evaluations}"
    return run_study(folder, config, workers=options.workers, resume=True)


def measured(study: Study, task: str) -> dict[str, np.ndarray]:
    """One number a run for each measure, in the table's unit."""
    runs = [run for run in study.runs if run.task == task]
    scale = TASKS[task][1]
    fresh = {who: [run.tests[who, 1.0].mean() for run in runs] for who in ("fittest", "champion")}
    stored = [run.best_fitness for run in runs]
    return {key: scale * np.array(v) for key, v in {"stored": stored, **fresh}.items()}


def table(evaluations: int, task: str, results: dict[str, dict[str, np.ndarray]]) -> list[str]:
    """Mean of each algorithm; below it the paper's algorithm less this one, 95 % interval (Welch)."""
    runs = len(results["torus"]["stored"])
    lines = [
        f"**{TASKS[task][0]}, {evaluations} evaluations** ({runs} runs each)", "",
        "| algorithm | best during evolution | the same, retested | champion |",
        "|---|---|---|---|",
    ]  # fmt: skip
    for name, (title, _) in ALGORITHMS.items():
        cells = []
        for measure in MEASURES:
            ours, theirs = results["torus"][measure], results[name][measure]
            cell = f"{theirs.mean():.3f} ± {1.96 * theirs.std(ddof=1) / np.sqrt(runs):.3f}"
            if name != "torus":
                low, high = stats.ttest_ind(ours, theirs, equal_var=False).confidence_interval()
                cell += f" <br> paper's less this: {low:+.3f} … {high:+.3f}"
            cells.append(cell)
        lines.append(f"| {title} | {' | '.join(cells)} |")
    return [*lines, ""]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", default="evolution-studies", help="folder for the studies")
    parser.add_argument("--runs", type=int, default=20)
    parser.add_argument("--budgets", type=int, nargs="+", default=[1000, 5000])
    parser.add_argument("--seed", type=int, default=1995)
    parser.add_argument("--workers", type=int)
    parser.add_argument("--write", type=Path, help="page that the table is written into")
    options = parser.parse_args()
    lines: list[str] = []
    for evaluations in options.budgets:
        studies = {name: study_of(name, evaluations, options) for name in ALGORITHMS}
        for task in TASKS:
            results = {name: measured(study, task) for name, study in studies.items()}
            lines += table(evaluations, task, results)
    text = "\n".join(lines)
    print(text)
    if options.write:
        page = options.write.read_text("utf-8")
        before, rest = page.split(BEGIN)
        options.write.write_text(f"{before}{BEGIN}\n{text}\n{END}{rest.split(END)[1]}", "utf-8")


if __name__ == "__main__":
    main()
