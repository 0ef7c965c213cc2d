"""`realitygap evolve`: evolve controllers for one task at one level of noise."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from realitygap.cli import option
from realitygap.cli.failure import resumable
from realitygap.cli.notes import note_few, note_new
from realitygap.cli.scene import note_dark
from realitygap.cli.studies import show_study

if TYPE_CHECKING:
    from realitygap.study.config import StudyConfig
    from realitygap.work.pool import Workers
    from realitygap.work.shard import Shard

__all__ = ["evolve"]


@click.command()
@click.argument("task")
@option.noise(None, " May be repeated, for several conditions. [default: observed]", several=True)
@option.spread
@option.profile(None, " [default: paper]")
@option.arena
@option.seed(None, " [default: 1995]")
@option.runs("Runs [default: 1].")
@option.evaluations
@option.out(says="The study's folder [default: out/TASK].")
@click.option("--config", type=click.Path(path_type=Path), metavar="FILE", help="Start from a study's TOML.")
@click.option(
    "--set",
    "settings",
    multiple=True,
    metavar="KEY=VALUE",
    help="Change one setting, such as evolution.rows=10, variation.mutation=0.1 or task.seconds=10.",
)
@option.workers
@option.engine
@option.shard
@option.watch
@option.resume
@option.as_json
def evolve(
    task: str,
    spreads: tuple[float, ...],
    out: Path | None,
    workers: Workers,
    engine: str,
    shard: Shard | None,
    watch: bool,
    resume: bool,
    json_output: bool,
    **options: Any,
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
    chosen = api.study_config(folder, task, spread=spreads, resume=resume, **options)
    if not resume:
        _notes(chosen, task)
    else:
        note_new(folder, DATABASE)
    again = f"evolve {shlex.quote(task)}{option.unusual(engine)}"
    with resumable(folder, f"realitygap {again} --out {shlex.quote(str(folder))} --resume", DATABASE):
        study, page = api.carry_out(
            folder, chosen, workers=workers, engine=engine, resume=resume, shard=shard, watch=watch
        )
    show_study(folder, study, page, json_output=json_output)


def _notes(config: StudyConfig, task: str) -> None:
    """What is taken as it was said, though it may be a slip."""
    from dataclasses import replace

    from realitygap.tasks import load_task
    from realitygap.world.arena import load_arena
    from realitygap.world.robot import load_profile

    loaded, profile, changes = load_task(task), load_profile(config.profile), config.task.changes()
    if loaded.name in config.arenas:
        changes["arena"] = load_arena(config.arenas[loaded.name])
    loaded = replace(loaded, **changes).of(profile)
    loaded.to_kernel(profile)  # or what the robot lacks would be told as a fault of the encoding
    note_dark(loaded, loaded.arena)
    population = config.evolution.make(config.encoding_for(loaded)).cells
    note_few(config.evaluations, population)
