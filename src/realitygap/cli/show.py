"""`realitygap show`: what a study holds."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from realitygap.cli.options import as_json
from realitygap.cli.output import print_json, print_table

if TYPE_CHECKING:
    from realitygap.controller.layout import Genes
    from realitygap.study.load import Run, Study

__all__ = ["describe", "find_run", "print_runs", "show"]


@click.command()
@click.argument("study", type=click.Path())
@click.argument("run", required=False)
@as_json
def show(study: str, run: str | None, json_output: bool) -> None:
    """Show the runs of STUDY, or one of them.

    STUDY is a folder. RUN is a number or a name such as obstacle-avoidance/observed/1; its
    champion's genotype is shown too. "champion" is the best of the final population on fresh
    trials, "fittest" has the highest fitness ever stored, as in the paper.

    \b
    Example: save a champion and drive it
        realitygap show out/reproduce 1 > champion.txt
        realitygap simulate avoidance --controller champion.txt --pose 25 25 0
    """
    from realitygap.study.load import load_study

    loaded = load_study(study)
    runs = loaded.runs if run is None else [find_run(loaded, run)]
    if json_output:
        print_json({"study": study, "runs": [describe(loaded, one) for one in runs]})
    elif run is None:
        print_runs(runs)
    else:
        _print_run(loaded, runs[0])


def find_run(study: Study, name: str) -> Run:
    """The run with that number or name, or a clear refusal."""
    for run in study.runs:
        if name == run.name or name.lstrip("#") == str(run.id):
            return run
    last = study.runs[-1].id if study.runs else 0
    example = f", or a name such as {study.runs[0].name}" if study.runs else ""
    raise click.BadParameter(
        f"expected a run's number, 1 to {last}{example}, got {name!r}.", param_hint="'RUN'"
    )


def describe(study: Study, run: Run) -> dict[str, Any]:
    """One run as JSON tells it."""
    return {
        "run": run.id,
        "name": run.name,
        "task": run.task,
        "noise": run.noise,
        "seed": run.seed,
        "evaluations": run.evaluations,
        "finished": run.finished,
        "best_fitness": run.best_fitness,
        "champion": _text(study, run, run.champion),
        "champion_fitness": run.champion_fitness,
        "fittest": _text(study, run, run.fittest),
        "fittest_evaluation": run.fittest_number,
        "tests": [
            {"who": who, "noise": noise, "mean": scores.mean(), "sd": scores.std(), "trials": scores.size}
            for (who, noise), scores in run.tests.items()
        ],
    }


def print_runs(runs: list[Run]) -> None:
    """A line a run."""
    rows = [
        [
            run.id,
            run.name,
            run.evaluations,
            _figure(run.best_fitness),
            _figure(run.champion_fitness),
            "finished" if run.finished else "unfinished",
        ]
        for run in runs
    ]
    print_table(("run", "name", "evaluations", "best fitness", "champion retested", ""), rows)


def _print_run(study: Study, run: Run) -> None:
    """One run: its figures as comments, then its champion's genotype, so that it can be saved."""
    lines = [
        f"run {run.id}, {run.name}, seed {run.seed}",
        f"{run.evaluations} evaluations, {'finished' if run.finished else 'unfinished'}",
        f"best fitness {_figure(run.best_fitness)}, champion retested {_figure(run.champion_fitness)}",
    ]
    for (who, noise), scores in run.tests.items():
        mean, sd = _figure(scores.mean()), _figure(scores.std())
        lines.append(f"{who} at noise {noise}: {mean}, sd {sd}, {scores.size} trials")
    for line in lines:
        click.echo(f"# {line}")
    genes = run.champion if run.champion is not None else run.fittest
    click.echo((_text(study, run, genes) or "# no genotype yet").rstrip())


def _text(study: Study, run: Run, genes: Genes | None) -> str | None:
    """A genotype's text form; None where there is none yet."""
    from realitygap.controller.genotype import to_text
    from realitygap.controller.layout import Layout

    if genes is None:
        return None
    return to_text(genes, Layout.of(genes, inputs=len(study.task(run.task).sensors)))


def _figure(value: float | None) -> str:
    """Three significant digits, or a dash."""
    return "–" if value is None or value != value else f"{value:.3g}"
