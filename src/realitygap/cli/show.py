"""`realitygap show`: what a study holds."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from realitygap.cli import option
from realitygap.cli.kinds import PICTURE
from realitygap.cli.output import print_json, shown, table

if TYPE_CHECKING:
    from realitygap.evolution.algorithm import Genes
    from realitygap.study.load import Run, Study

__all__ = ["describe", "print_runs", "show"]


@click.command()
@click.argument("study", type=click.Path())
@click.argument("run", required=False)
@click.option("--picture", type=PICTURE, help="Draw the network of RUN's champion to FILE.")
@option.trust
@option.as_json
def show(study: str, run: str | None, picture: Path | None, trust: bool, json_output: bool) -> None:
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

    loaded = load_study(study, trust=trust)  # to run an encoding of the user's own
    runs = loaded.runs if run is None else [loaded.run(run)]
    if picture is not None:
        if run is None:
            raise click.BadParameter("draws the network of one RUN: name it.", param_hint="'--picture'")
        _draw(loaded, runs[0], picture)
    if json_output:
        print_json({"study": study, "runs": [describe(loaded, one) for one in runs]})
    elif run is None:
        print_runs(runs)
    else:
        _print_run(loaded, runs[0])


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
    """One line per run."""
    rows = [
        [
            run.id, run.name, run.evaluations, shown(run.best_fitness), shown(run.champion_fitness),
            "finished" if run.finished else "unfinished",
        ]
        for run in runs
    ]  # fmt: skip
    click.echo(table(("run", "name", "evaluations", "best fitness", "champion retested", ""), rows))


def _print_run(study: Study, run: Run) -> None:
    """One run: its figures as comments, then its champion's genotype, so that it can be saved."""
    lines = [
        f"run {run.id}, {run.name}, seed {run.seed}",
        f"{run.evaluations} evaluations, {'finished' if run.finished else 'unfinished'}",
        f"best fitness {shown(run.best_fitness)}, champion retested {shown(run.champion_fitness)}",
    ]
    for (who, noise), scores in run.tests.items():
        mean, sd = shown(scores.mean()), shown(scores.std())
        lines.append(f"{who} at noise {noise}: {mean}, sd {sd}, {scores.size} trials")
    for line in lines:
        click.echo(f"# {line}")
    genes = run.champion if run.champion is not None else run.fittest
    click.echo((_text(study, run, genes) or "# no genotype yet").rstrip())


def _draw(study: Study, run: Run, picture: Path) -> None:
    """The network of a run's champion (of the fittest while there is none), as a picture."""
    from realitygap.files import atomic_path
    from realitygap.report.network import network_figure
    from realitygap.report.style import styled

    genes = run.champion if run.champion is not None else run.fittest
    if genes is None:
        raise click.BadParameter(f"run {run.id} has no individual yet to draw.", param_hint="'--picture'")
    facts, slots = study.facts(run.task), study.slots(run.task, genes)
    sensing = {"feeds": facts["feeds"], "sensors": facts["sensors"]}
    with styled():
        figure = network_figure(slots, study.profile, title=run.name, **sensing)
        with atomic_path(picture) as spare:
            figure.savefig(spare, dpi=200)


def _text(study: Study, run: Run, genes: Genes | None) -> str | None:
    """A genotype's text form; None where there is none yet."""
    return None if genes is None else str(study.slots(run.task, genes))
