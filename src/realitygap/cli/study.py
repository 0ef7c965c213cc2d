"""`realitygap show`, `replay` and `export`: what is in a study."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from realitygap.cli import options
from realitygap.cli.console import load_trusted, shown, table, tell
from realitygap.cli.simulate import path_table, save_path, simulation_facts
from realitygap.errors import StudyError

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from realitygap.evolution.algorithm import Genes
    from realitygap.report.scores import ScoreTable
    from realitygap.study.load import Run, Study

__all__ = ["export", "replay", "show", "show_shard", "show_study"]

SCORES = ("behaviour", "correspondence")


@click.command()
@click.argument("study", type=click.Path())
@click.argument("run", required=False)
@click.option(
    "--picture",
    type=options.OutFile(".png", ".svg", ".pdf"),
    help="Draw the network of RUN's champion to FILE.",
)
@options.trust
@options.as_json
def show(study: str, run: str | None, picture: Path | None, trust: bool) -> None:
    """Show the runs of STUDY, or one of them.

    STUDY is a folder. RUN is a number or a name such as obstacle-avoidance/observed/1; its
    champion's genotype is shown too. "champion" is the best of the final population on fresh
    trials, "fittest" has the highest fitness ever stored, as in the paper.

    \b
    Example: save a champion and drive it
        realitygap show out/reproduce 1 > champion.txt
        realitygap simulate avoidance --controller champion.txt --pose 25,25,0
    """
    from realitygap.study.load import load_study

    loaded = load_study(study, trust=trust)  # to run an encoding of the user's own
    runs = loaded.runs if run is None else [loaded.run(run)]
    if picture is not None:
        if run is None:
            raise click.BadParameter("draws the network of one RUN: name it.", param_hint="'--picture'")
        _draw(loaded, runs[0], picture)
    text = _run_table(runs) if run is None else _run_text(loaded, runs[0])
    tell({"study": study, "runs": [_run_facts(loaded, one) for one in runs]}, text)


def _run_facts(study: Study, run: Run) -> dict[str, Any]:
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


def _run_table(runs: list[Run]) -> str:
    """One line per run."""
    rows = []
    for run in runs:
        fitness, state = map(shown, (run.best_fitness, run.champion_fitness)), _state(run)
        rows.append([run.id, run.name, run.evaluations, *fitness, state])
    return table(("run", "name", "evaluations", "best fitness", "champion retested", ""), rows)


def _state(run: Run) -> str:
    return "finished" if run.finished else "unfinished"


def _run_text(study: Study, run: Run) -> str:
    """One run: its figures as comments, then its champion's genotype, so that it can be saved."""
    lines = [
        f"# run {run.id}, {run.name}, seed {run.seed}",
        f"# {run.evaluations} evaluations, {_state(run)}",
        f"# best fitness {shown(run.best_fitness)}, champion retested {shown(run.champion_fitness)}",
    ]
    for (who, noise), scores in run.tests.items():
        mean, sd = shown(scores.mean()), shown(scores.std())
        lines.append(f"# {who} at noise {noise}: {mean}, sd {sd}, {scores.size} trials")
    genes = run.champion if run.champion is not None else run.fittest
    return "\n".join([*lines, (_text(study, run, genes) or "# no genotype yet").rstrip()])


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


def show_study(folder: Path, study: Study, page: Path | None, more: Mapping[str, Any] | None = None) -> None:
    """Print a study's runs and scores, and where it and its page are; for a shard, which has none, the
    finished runs, and how to merge all shards. `more` are further parts of the JSON."""
    from realitygap.report.scores import study_tables

    runs = study.runs if page is not None else [run for run in study.runs if run.finished]
    facts = [_run_facts(study, run) for run in runs]
    if page is None:
        show_shard(folder, {"runs": facts}, _run_table(runs))
        return
    scores = study_tables(study)
    rows = [table.to_dict() for table in scores]
    found = {"study": str(folder), "report": str(page), "runs": facts, "tables": rows, **(more or {})}
    tell(found, _run_table(runs), *_score_lines(scores), f"\nstudy  {folder}\nreport {page}")


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
    head = ("scores, 0 to 10", "noise", "on", *SCORES, *(f"paper's {name}" for name in SCORES))
    rows = []
    for one in tables:
        for level in one.classes:
            paper = [shown(value, "g") for value in level.paper_average or (None, None)]
            if level.marks:
                means = ("–" if mean is None else f"{mean.value:.1f}" for mean in map(level.mean, SCORES))
                rows.append([one.task, level.name, one.kind or "–", *means, *paper])
    return ["", table(head, rows)] if rows else []


@click.command()
@click.argument("study", type=click.Path(path_type=Path))
@click.argument("run")
@options.individual
@options.profile(None, " [default: the study's own]")
@options.noise(None, " [default: the run's own]")
@options.seed()
@options.pose()
@options.seconds
@options.picture
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
) -> None:
    """Replay an evolved individual.

    Simulates the individual in the run's own task and prints its trajectory.

    RUN is a number or a name, as `realitygap show STUDY` lists them. Without --pose the robot
    starts as the task says, drawn with --seed.

    \b
    Example:
        realitygap replay out/reproduce 1 --noise double --picture champion.gif
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
    saved = [] if picture is None else [f"saved {picture}"]
    tell(found, path_table(trajectory), f"\n{one.name}, {who}: score {score:.6g}", *saved)


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
@click.argument("study", type=click.Path(path_type=Path))
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
@click.argument("study", type=click.Path(path_type=Path))
@click.argument("run")
@click.option("--format", "kind", type=click.Choice(["rerun", "mcap"]), default="rerun", help="Of the file.")
@into
@options.individual
@click.option("--robot", metavar="ROBOT", help="The trial's robot: its folder in transfer/, such as twin-1.")
@click.option("--start", type=click.IntRange(1), metavar="N", help="Which trial [default: the first].")
def log(
    study: Path, run: str, kind: str, out: Path, individual: str, robot: str | None, start: int | None
) -> None:
    """Write a trial on a robot as a log for Rerun or Foxglove.

    The simulated robot stands beside the one that was driven, on one time line: arena, rays, readings,
    network, film. The trial is one of RUN, a number or a name, as `realitygap show STUDY` lists them.

    \b
    Example:
        realitygap export log out/reproduce 1 --format mcap --out logs
    """
    from realitygap.export.logs import trial_log, write_log

    trial = trial_log(load_trusted(study).run(run), individual, robot, start)
    path = write_log(trial, kind, out)
    click.echo(f"wrote {path}: {path.stat().st_size:,} bytes")


@export.command()
@click.argument("study", type=click.Path(path_type=Path))
@click.argument("run")
@click.option(
    "--language",
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
    wheel commands in the robot's units come out. Test vectors are written beside it. RUN is a number or a
    name, as `realitygap show STUDY` lists them.

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
