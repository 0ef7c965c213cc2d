"""`realitygap evolve`: evolve controllers for one task at one level of noise."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from realitygap.cli import option
from realitygap.cli.notes import note_few, note_new
from realitygap.cli.scene import note_dark
from realitygap.cli.studies import carry_out, show_study

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from realitygap.study.config import Condition, StudyConfig
    from realitygap.work.shard import Shard
    from realitygap.work.workers import Workers

__all__ = ["begun_config", "changed_config", "evolve", "folder_of"]


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
    noise: tuple[float, ...],
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
    from realitygap.study.reader import DATABASE

    folder = folder_of(task) if out is None else out
    folder = folder if shard is None else shard.folder(folder)
    begun = begun_config(folder, task, config, resume)
    fields = {**options, "arena": arena, "spreads": spreads}
    chosen = changed_config(begun, task, noise, settings, option.given(fields))
    if not resume:
        _notes(chosen, task)
    else:
        note_new(folder, DATABASE)
    words = f"evolve {shlex.quote(task)}{option.unusual(engine)}"
    carried = carry_out(
        folder, chosen, words=words, workers=workers, engine=engine, resume=resume, shard=shard, watch=watch
    )
    show_study(carried, json_output=json_output)


def folder_of(task: str) -> Path:
    """Where a task is evolved by default."""
    from realitygap.tasks import load_task

    return Path("out", load_task(task).name)


def begun_config(folder: Path, task: str, config: Path | None, resume: bool) -> StudyConfig:
    """What a study starts from: --config's file, the study in its folder if it is resumed, or one condition
    of the task as typed."""
    from realitygap.study.config import StudyConfig
    from realitygap.study.folder import exists, own_config

    if config is not None:
        return StudyConfig.from_toml(config, task=task)
    return own_config(folder) if resume and exists(folder) else StudyConfig.single(task)


def changed_config(
    begun: StudyConfig, task: str, noise: tuple[float, ...], settings: Iterable[str], given: Mapping[str, Any]
) -> StudyConfig:
    """A configuration changed to the task alone, as typed, at these levels of noise, with settings as in
    --set, KEY=VALUE each, and what else was given: `spreads`, `arena`, fields of a configuration by name."""
    from dataclasses import replace

    from realitygap.tasks import load_task

    name, fields = load_task(task).name, dict(given)
    arenas = {key: arena for key, arena in begun.arenas.items() if key == name}
    conditions = _conditions(begun, task, noise, fields.pop("spreads", ()))
    begun = replace(begun, conditions=conditions, arenas=arenas).with_settings(settings)
    if "arena" in fields:
        fields["arenas"] = {name: fields.pop("arena")}
    return replace(begun, **fields)


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


def _conditions(
    config: StudyConfig, task: str, noise: tuple[float, ...], spreads: tuple[float, ...]
) -> tuple[Condition, ...]:
    """The task at each of `noise` within each of `spreads`; without one of them at those that a configuration
    has for it, or at observed noise with constants as they are."""
    from realitygap.study.config import Condition
    from realitygap.tasks import load_task

    def same(other: str) -> bool:
        """By what it is called: a configuration's task files are not run to find that out."""
        if task.endswith(".py") or other.endswith(".py"):
            return Path(other).name == Path(task).name
        return load_task(other) is load_task(task)

    if noise and spreads:
        pairs = [(level, spread) for spread in spreads for level in noise]
    else:
        there = [(c.noise, c.spread) for c in config.conditions if same(c.task)] or [(1.0, 0.0)]
        levels, shares = (dict.fromkeys(one) for one in zip(*there, strict=True))
        pairs = [(level, spread) for spread in spreads or shares for level in noise or levels]
        pairs = pairs if noise or spreads else there
    return tuple(Condition(task=task, noise=level, spread=spread) for level, spread in pairs)
