"""`realitygap show`, `replay` and `export`: what is in a study."""

from __future__ import annotations

import shlex
import textwrap
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from realitygap.cli import options
from realitygap.cli.console import link, load_trusted, table, tell
from realitygap.cli.fitness import Fitness, test_facts, test_score
from realitygap.cli.simulate import path_lines, save_path, simulation_facts
from realitygap.errors import StudyError

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from realitygap.evolution.algorithm import Genes
    from realitygap.report.scores import ScoreTable
    from realitygap.study.load import Run, Study

__all__ = ["export", "replay", "run_facts", "run_lines", "show", "show_shard", "show_study"]

SCORES = ("behaviour", "correspondence")


@click.command()
@options.study
@click.argument("run", required=False)
@click.option(
    "--picture",
    type=options.OutFile(".png", ".svg", ".pdf"),
    help="Draw the network of RUN's champion to FILE.",
)
@options.trust
@options.verbose
@options.as_json
def show(study: Path, run: str | None, picture: Path | None, trust: bool, verbose: bool) -> None:
    """Show the runs of STUDY, or one of them.

    STUDY is a folder. RUN is a number, a name such as obstacle-avoidance/observed/1, or best
    (best:TASK, best:TASK/LEVEL); its champion's genotype is shown too. The champion is the best of
    the last population in further trials; its test score is its mean in new ones. --verbose adds each
    run's evaluations, and the test scores at every noise level.

    \b
    Example: save a champion and drive it
        realitygap show out/reproduce 1 > champion.txt
        realitygap simulate avoidance --controller champion.txt
    """
    from realitygap.study.load import load_study

    loaded = load_study(study, trust=trust)  # to run an encoding of the user's own
    runs = loaded.runs if run is None else [loaded.run(run)]
    if picture is not None:
        if run is None:
            raise click.BadParameter("draws the network of one RUN: name it.", param_hint="'--picture'")
        _draw(loaded, runs[0], picture)
    lines = run_lines(loaded, runs, verbose) if run is None else [_run_text(loaded, runs[0], verbose)]
    tell({"study": str(study), "runs": [run_facts(loaded, one) for one in runs]}, *lines)


def run_facts(study: Study, run: Run) -> dict[str, Any]:
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
        "test_score": test_facts(run),
        "fittest": _text(study, run, run.fittest),
        "fittest_evaluation": run.fittest_number,
        "tests": [
            {"who": who, "noise": noise, "mean": scores.mean(), "sd": scores.std(), "trials": scores.size}
            for (who, noise), scores in run.tests.items()
        ],
    }


def run_lines(study: Study, runs: Sequence[Run], verbose: bool = False) -> list[str]:
    """A line for each run, with its two figures, and what they are."""
    fitness, rows = Fitness(study), []
    whole = all(run.finished for run in runs)
    head = ["run", "name", *["evaluations"] * verbose, "best during evolution", "test score"]
    for run in runs:
        more = [] if whole else ["" if run.finished else "unfinished"]
        rows.append([run.id, run.name, *[run.evaluations] * verbose, *fitness.both(run), *more])
    legend = "test score: mean of the champion's new trials at its own noise ± 95 % interval"
    return [table(head if whole else [*head, ""], rows), "", legend, *fitness.units(r.task for r in runs)]


def _run_text(study: Study, run: Run, verbose: bool) -> str:
    """One run: its figures as comments, then its champion's genotype, so that it can be saved."""
    fitness, scores = Fitness(study), test_score(run)
    best, test = fitness.both(run)
    unit, feeds = fitness.unit(run.task), study.facts(run.task)["feeds"]
    told = "" if scores is None else f" (mean of {scores.count} new trials at noise {run.noise:g} ± 95 %)"
    lines = [
        f"# run {run.id}, {run.name}, seed {run.seed}, fed {feeds}",
        f"# {run.evaluations} evaluations{'' if run.finished else ', unfinished'}",
        f"# best during evolution {best}{unit}",
        f"# test score {test}{unit * (scores is not None)}{told}",
    ]
    for (who, noise), found in run.tests.items() if verbose else ():
        mean, sd = (fitness.text(run.task, float(value)) for value in (found.mean(), found.std()))
        whose = "champion" if who == "champion" else "best during evolution"
        lines.append(f"# {whose}, new trials at noise {noise:g}: {mean}, sd {sd}, {found.size} trials")
    genes = run.champion if run.champion is not None else run.fittest
    return "\n".join([*lines, (_text(study, run, genes) or "# no genotype yet").rstrip()])


def _draw(study: Study, run: Run, picture: Path) -> None:
    """The network of a run's champion (of the fittest while there is none), as a picture."""
    from realitygap.report.network import network_figure
    from realitygap.report.style import write_figure

    genes = run.champion if run.champion is not None else run.fittest
    if genes is None:
        raise click.BadParameter(f"run {run.id} has no individual yet to draw.", param_hint="'--picture'")
    facts, slots = study.facts(run.task), study.slots(run.task, genes)
    sensing = {"feeds": facts["feeds"], "sensors": facts["sensors"]}
    write_figure(partial(network_figure, slots, study.profile, title=run.name, **sensing), picture)


def _text(study: Study, run: Run, genes: Genes | None) -> str | None:
    """A genotype's text form; None where there is none yet."""
    return None if genes is None else str(study.slots(run.task, genes))


def show_study(folder: Path, study: Study, page: Path | None, more: Mapping[str, Any] | None = None) -> None:
    """Print a study's runs and scores, and where it and its page are; for a shard, which has none, the
    finished runs, and how to merge all shards. `more` are further parts of the JSON."""
    from realitygap.report.scores import study_tables

    runs = study.runs if page is not None else [run for run in study.runs if run.finished]
    facts, lines = [run_facts(study, run) for run in runs], run_lines(study, runs)
    if page is None:
        show_shard(folder, {"runs": facts}, *lines)
        return
    scores = study_tables(study)
    rows = [table.to_dict() for table in scores]
    found = {"study": str(folder), "report": str(page), "runs": facts, "tables": rows, **(more or {})}
    where = f"\nstudy  {folder}", f"report {link(page)}"
    tell(found, *lines, *_score_lines(scores), "", *_answer_lines(study, scores), *where)


def _answer_lines(study: Study, scores: Sequence[ScoreTable]) -> Iterator[str]:
    """Each task's answer, as its report begins."""
    from realitygap.report.answer import answer_of
    from realitygap.report.evolution import parts_of

    for part in parts_of(study):
        answer = answer_of(part, [one for one in scores if one.task == part.task.name])
        between = " " if len(answer.means) == 1 else ": "
        yield textwrap.fill(f"{part.task.name}: {answer.found}{between}{answer.detail}", 80)


def show_shard(folder: Path, more: Mapping[str, Any], *lines: str) -> None:
    """Print what a shard did, where it is, and how all of them are put together."""
    from realitygap.work.shard import read_mark, whole_of

    mark = read_mark(folder)
    assert mark is not None
    facts = {"study": str(folder), "shard": str(mark.shard), **more}
    whole = shlex.quote(str(folder.with_name(whole_of(folder).name)))
    merging = f"realitygap merge {whole}-shard-*-of-{mark.shard.of}"
    tell(facts, *lines, f"\nshard {mark.shard} in {folder}\nwhen all are done: {merging}")


def _score_lines(tables: Sequence[ScoreTable]) -> list[str]:
    """Tables 1 and 2 by their averages."""
    quoted = any(level.paper for one in tables for level in one.classes)
    head = ("scores, 0 to 10" + " (paper's)" * quoted, "noise", "on", *SCORES)
    rows = []
    for one in tables:
        for level in one.classes:
            if any(map(level.values, SCORES)):
                means = ["–" if mean is None else f"{mean.value:.1f}" for mean in map(level.mean, SCORES)]
                paper = [f" ({value:g})" for value in level.paper_average or ()] or ["", ""]
                cells = (f"{ours}{theirs}" for ours, theirs in zip(means, paper, strict=True))
                rows.append([one.task, level.name, one.kind or "–", *cells])
    return ["", table(head, rows)] if rows else []


@click.command()
@options.study
@click.argument("run")
@options.individual
@options.profile(None, " [default: the study's own]")
@options.noise(None, " [default: the run's own]")
@options.seed()
@options.pose()
@options.seconds
@options.picture
@options.verbose
@options.as_json
def replay(
    study: Path,
    run: str,
    individual: str,
    profile: str | None,
    noise: float | None,
    seed: int,
    pose: options.Numbers | None,
    seconds: float | None,
    picture: Path | None,
    verbose: bool,
) -> None:
    """Replay an evolved individual.

    Simulates the individual in the run's own task and prints its trajectory.

    RUN is a number or a name, as `realitygap show STUDY` lists them, or best (best:TASK,
    best:TASK/LEVEL). Without --pose the robot starts as the task says, drawn with --seed. --verbose
    prints where it was each second.

    \b
    Example:
        realitygap replay out/reproduce best:light --noise double --picture champion.gif
    """
    from realitygap.simulation.simulation import Simulation
    from realitygap.world.robot import load_profile

    loaded = load_trusted(study)
    one = loaded.run(run)
    who, genes = _individual(one, individual)
    task, level = loaded.task(one.task), one.noise if noise is None else noise
    robot = loaded.profile if profile is None else load_profile(profile)
    place = None if pose is None else options.checked_pose(pose, task.arena, robot)
    simulation, networks = Simulation(task, robot, level), loaded.networks(one.task, genes)
    trajectory, score = simulation.trajectory(networks, stream=seed, pose=place, seconds=seconds)
    if picture is not None:
        save_path(picture, task, robot, trajectory)
    whose = {"study": str(study), "run": one.id, "name": one.name, "individual": who}
    found = {**whose, **simulation_facts(simulation, seed), **trajectory.to_dict(), "score": score}
    whose_score = f"{one.name}, {who}: "
    tell(
        found,
        *path_lines(task.to_dict(), trajectory, score, picture, verbose=verbose, whose=whose_score),
    )


def _individual(run: Run, who: str) -> tuple[str, Genes]:
    """An individual of a run in words, and its genotype."""
    try:
        return run.individual(who)
    except StudyError as error:
        raise click.BadParameter(str(error), param_hint="'--individual'") from None


@click.group()
def export() -> None:
    """Export tables, a trial's log, or a controller's source.

    Examples: all tables; a trial's log; a controller for any chip with a C compiler

    \b
        realitygap export tables out/reproduce --out tables
        realitygap export log out/reproduce 1 --out logs
        realitygap export source out/reproduce 1 --out avoider
    """


into = click.option(
    "--out", type=click.Path(path_type=Path), required=True, metavar="DIR", help="Folder to write into."
)


@export.command()
@options.study
@click.option(
    "--format", "kind", type=click.Choice(["parquet", "csv"]), default="parquet", help="Of the files."
)
@into
def tables(study: Path, kind: str, out: Path) -> None:
    """Write STUDY as tables for pandas, R, DuckDB or a spreadsheet.

    A file each: runs, evaluations, tests, trials, scores. The documentation's page How to look at results
    describes each column.

    \b
    Example:
        realitygap export tables out/reproduce --format csv --out tables
    """
    from realitygap.export.tables import write_tables

    for path, count in write_tables(load_trusted(study), kind, out).items():
        click.echo(f"wrote {path}: {count} rows")


@export.command()
@options.study
@click.argument("run")
@click.option("--format", "kind", type=click.Choice(["rerun", "mcap"]), default="rerun", help="Of the file.")
@into
@options.individual
@click.option("--robot", metavar="ROBOT", help="The trial's robot: its folder in transfer/, such as twin-1.")
@click.option("--start", type=options.Whole(1), metavar="N", help="Which trial [default: the first].")
def log(
    study: Path, run: str, kind: str, out: Path, individual: str, robot: str | None, start: int | None
) -> None:
    """Write a trial on a robot as a log for Rerun or Foxglove.

    The simulated robot stands beside the one that was driven, on one time line: arena, rays, readings,
    network, film. The trial is one of RUN, a number, a name or best, as of `realitygap show`.

    \b
    Example:
        realitygap export log out/reproduce 1 --format mcap --out logs
    """
    from realitygap.export.logs import trial_log, write_log

    trial = trial_log(load_trusted(study).run(run), individual, robot, start)
    path = write_log(trial, kind, out)
    click.echo(f"wrote {path}: {path.stat().st_size:,} bytes")


@export.command()
@options.study
@click.argument("run")
@click.option(
    "--language",
    "--format",
    type=click.Choice(["c99", "micropython", "arduino", "e-puck2"]),
    default="c99",
    help="c99: a header and a source file; micropython: a module; arduino: a sketch's folder; e-puck2: a "
    "project on its maker's library.",
)
@into
@options.individual
@click.option("--name", default="controller", metavar="NAME", help="Prefix of files and functions.")
def source(study: Path, run: str, language: str, out: Path, individual: str, name: str) -> None:
    """Write an evolved controller for a robot's processor.

    It uses whole numbers only, and is the same to the bit as in the simulation: readings in counts go in,
    wheel commands in the robot's units come out. Test vectors are written beside it. RUN is a number, a
    name or best, as of `realitygap show`.

    \b
    Examples: for any chip with a C compiler; a sketch for Arduino's IDE
        realitygap export source out/reproduce 1 --out avoider
        realitygap export source out/reproduce 1 --language arduino --name avoider --out .
    """
    from realitygap.export.onboard import on_board, sizes, write_source

    one = load_trusted(study).run(run)
    board = on_board(one, *_individual(one, individual), name=name)
    made = write_source(board, language, out)
    for path in made:
        click.echo(f"wrote {path}")
    neurons, links = len(board.thresholds), len(board.sources)
    click.echo(f"{neurons} neurons, {links} links; {board.state_bytes} bytes of state")
    compiled = next((path for path in made if path.suffix == ".c"), None)
    for chip, size in (sizes(compiled) if compiled is not None else {}).items():
        click.echo(f"{chip}: {size} bytes of code and tables")
