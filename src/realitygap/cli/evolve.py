"""`realitygap reproduce`, `evolve`, `merge` and `report`: what makes studies and their pages."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Unpack

import click

from realitygap.cli import options
from realitygap.cli.console import (
    ask_trust,
    link,
    load_trusted,
    note,
    note_few,
    note_new,
    resumable,
    tell,
    warn,
)
from realitygap.cli.experiment import show_noise, show_robots
from realitygap.cli.simulate import note_dark
from realitygap.cli.study import show_study
from realitygap.cli.transfer import transfer_lines
from realitygap.work.progress import ProgressLine

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from realitygap.api import ReproductionFields, StudyFields
    from realitygap.study.config import StudyConfig
    from realitygap.study.load import Study
    from realitygap.work.pool import Workers
    from realitygap.work.shard import Shard

__all__ = ["evolve", "made_page", "merge", "report", "reproduce"]


@click.command()
@options.out(default=Path("out/reproduce"), help="The study's folder.")
@options.profile(None, "  [default: a profile calibrated first, to unit 1 of the twin]")
@options.runs(help="Runs for each task and noise level [default: 5].")
@options.evaluations
@options.seed(None, " [default: 1995]")
@options.starts(type=options.Whole(1), help="Trials of each champion on the twin [default: 8].")
@options.workers
@options.engine
@click.option(
    "--no-transfer",
    is_flag=True,
    help="Stop before the transfer: no trials on the twin. Resuming without it makes them.",
)
@options.watch
@options.resume
@options.as_json
def reproduce(
    out: Path,
    workers: Workers,
    engine: str,
    no_transfer: bool,
    watch: bool,
    resume: bool,
    **fields: Unpack[ReproductionFields],
) -> None:
    """Repeat the paper's experiment and write a page about it.

    First, as in the paper, it records the readings of unit 1 of the twin (a physics model of the robot behind
    its own serial protocol) and fits the simulation to them. It evolves both tasks in that
    simulation at all three noise levels, has every champion drive the unit, and films one of each kind.
    It scores the runs and writes a page about them. --profile paper uses the printed constants and records
    nothing. With --resume, omitted options keep their saved values.

    \b
    Example:
        realitygap reproduce --out out/reproduce
    """
    from realitygap import api
    from realitygap.experiments.reproduction import ASKED
    from realitygap.study.store import DATABASE
    from realitygap.transfer.record import load_transfers

    requested = api.reproduction(out, resume, **fields)
    if not resume:
        note_few(requested.evaluations)
    else:
        note_new(out, DATABASE, ASKED)
    again = (
        f"reproduce{' --no-transfer' * no_transfer}{options.unusual(engine)} --out {shlex.quote(str(out))}"
    )
    with resumable(out, f"realitygap {again} --resume", DATABASE, ASKED), ProgressLine() as progress:
        study, page = api.carry_out(
            out,
            requested,
            workers=workers,
            engine=engine,
            resume=resume,
            watch=watch,
            transfer=not no_transfer,
            on_progress=progress.show,
        )
        took = progress.took()
    made = {} if no_transfer else {"transfers": [one.to_dict() for one in load_transfers(out)]}
    show_study(out, study, page, made)
    click.echo(took, err=True)


@click.command()
@click.argument("task")
@options.noise(None, " May be repeated, for several conditions. [default: observed]", several=True)
@options.noise_between
@options.spread
@options.profile(None, " [default: paper]")
@options.arena
@options.seed(None, " [default: 1995]")
@options.runs(help="Runs [default: 1].")
@options.evaluations
@options.out(help="The study's folder [default: out/TASK].")
@click.option("--config", type=click.Path(path_type=Path), metavar="FILE", help="Start from a study's TOML.")
@click.option(
    "--set",
    "settings",
    multiple=True,
    metavar="KEY=VALUE",
    help="Change one setting, such as evolution.rows=10, variation.mutation=0.1 or task.seconds=10.",
)
@options.workers
@options.engine
@options.shard
@options.watch
@options.resume
@options.trust
@options.as_json
def evolve(
    task: str,
    noise: tuple[float, ...],
    noise_between: bool,
    spreads: tuple[float, ...],
    arena: str | None,
    out: Path | None,
    config: Path | None,
    settings: tuple[str, ...],
    workers: Workers,
    engine: str,
    shard: Shard | None,
    watch: bool,
    resume: bool,
    trust: bool,
    **fields: Unpack[StudyFields],
) -> None:
    """Evolve controllers for TASK and make the report.

    TASK is obstacle-avoidance, light-seeking or a Python file of your own. Options override --set, which
    overrides --config. With --resume, omitted options keep their saved values.

    \b
    Example:
        realitygap evolve light-seeking --noise double --runs 3 --set evolution.rows=10
    """
    from realitygap import api
    from realitygap.study.store import DATABASE

    folder = api.folder_of(task, out, shard)
    chosen = api.study_config(
        folder,
        task,
        config=config,
        resume=resume,
        trust=trust,
        noise=noise,
        spread=spreads,
        settings=settings,
        arena=arena,
        noise_between=noise_between or None,
        **fields,
    )
    if not resume:
        _notes(chosen)
    else:
        note_new(folder, DATABASE)
    again = f"evolve {shlex.quote(task)}{options.unusual(engine)}"
    with resumable(folder, f"realitygap {again} --out {shlex.quote(str(folder))} --resume", DATABASE):
        study, page = api.carry_out(
            folder, chosen, workers=workers, engine=engine, resume=resume, shard=shard, watch=watch
        )
    show_study(folder, study, page)


def _notes(config: StudyConfig) -> None:
    """What is taken as it was said, though it may be a slip."""
    from realitygap.study.folder import gather

    task = gather(config).tasks[0]
    note_dark(task, task.arena)
    note_few(config.evaluations, config.evolution.make(config.encoding_for(task)).cells)


@click.command()
@click.argument("shards", nargs=-1, required=True, type=click.Path(path_type=Path))
@options.out(help="Folder for the merged study [default: the shards' name without -shard-I-of-N].")
@options.workers
@options.as_json
def merge(shards: tuple[Path, ...], out: Path | None, workers: Workers) -> None:
    """Merge the shards of a study into one folder.

    SHARDS are the folders that --shard 1/N to N/N made. The result is the same as from one process, to the
    bit. Every shard must be there, finished, and have the same settings. Nothing is overwritten, and the
    shards do not change. Trials of `transfer` go into the folder of the study that drove.

    \b
    Example:
        realitygap evolve avoidance --runs 9 --out out/nine --shard 1/3   # and 2/3, 3/3, anywhere
        realitygap merge out/nine-shard-*-of-3
    """
    from realitygap import api
    from realitygap.experiments.noise import NoiseConfig, merge_noise, noise_experiment
    from realitygap.study.load import load_study
    from realitygap.study.runner import merge_runs
    from realitygap.study.store import DATABASE
    from realitygap.transfer.spec import FOLDER as TRANSFERS
    from realitygap.work.shard import all_shards, read_mark, whole_of

    found = all_shards(shards)
    target = whole_of(shards[0]) if out is None else out
    mark = read_mark(shards[0])
    if mark is not None and mark.work == "transfer":
        target = target if out is not None else target.with_name(target.name.removesuffix(f"-{mark.work}"))
        _merge_transfer(found, target)
        return
    more = {"shards": list(map(str, found.values()))}
    if mark is not None and mark.work == "experiment noise":
        with resumable(target, NoiseConfig.from_folder(shards[0]).resuming(target), NoiseConfig.FILE):
            merge_noise(found, target)
            _note_versions(load_study(place).versions() for place in sorted((target / "evolved").iterdir()))
            with ProgressLine() as progress:
                results = noise_experiment(target, workers=workers, resume=True, on_progress=progress.show)
            show_noise(target, results, more)
        return
    for folder in found.values():
        ask_trust(folder)
    driven = [folder for folder in found.values() if (folder / TRANSFERS).is_dir()]
    warn(f"{folder}: its transfers stay there; drive the merged study anew." for folder in driven)
    with resumable(target, f"realitygap report {shlex.quote(str(target))}", DATABASE):
        study = merge_runs(found, target)
        _note_versions([study.versions()])
        page = api.report(target, study, workers=workers)
    show_study(target, study, page, more)


def _merge_transfer(shards: Mapping[Shard, Path], study: Path) -> None:
    """Put the trials of shards into the folder of the study that drove, and print them."""
    from realitygap.transfer.record import merge_trials, read_trial

    made = merge_trials(shards, study)
    tables = (read_trial(one.folder).get("versions", {}) for one in made)
    _note_versions({name: [value] for name, value in table.items()} for table in tables)
    facts = {"study": str(study), "transfers": [one.to_dict() for one in made]}
    tell(facts, *transfer_lines(study, made), f"\ntransfers {study / 'transfer'}")


def _note_versions(found: Iterable[Mapping[str, Iterable[str]]]) -> None:
    """Note what differed between the machines that made shards: bits may differ too."""
    from realitygap.api import different_versions

    for difference in different_versions(found):
        note(difference)


@click.command()
@options.study
@options.as_json
def report(study: Path) -> None:
    """Rebuild the report of STUDY.

    STUDY is a folder; its page, figures and tables are made from its database. The folder of an experiment on
    noise or on several robots will do too.

    \b
    Example:
        realitygap report out/reproduce
    """
    from realitygap.experiments.experiment import RESULTS
    from realitygap.experiments.noise import NoiseConfig
    from realitygap.experiments.robots import RobotsConfig, finished
    from realitygap.report.scores import study_tables

    if (study / NoiseConfig.FILE).is_file():
        show_noise(study, study / RESULTS)
        return
    if (study / RobotsConfig.FILE).is_file():
        show_robots(study, finished(study))
        return
    loaded = load_trusted(study)
    page = made_page(study, loaded)
    tables = [table.to_dict() for table in study_tables(loaded)]
    tell({"report": str(page), "tables": tables}, f"report {link(page)}")


def made_page(folder: Path, study: Study) -> Path:
    """A study's report, made anew."""
    from realitygap import api
    from realitygap.work.pool import opened

    with opened(None, one_thread=True) as pool:
        return api.report(folder, study, workers=pool)
