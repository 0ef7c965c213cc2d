"""`realitygap merge`: put together what shards did apart."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING

import click

from realitygap.cli import option
from realitygap.cli.experiment import show_noise
from realitygap.cli.failure import resumable
from realitygap.cli.notes import ask_trust, note_versions
from realitygap.cli.output import tell, warn
from realitygap.cli.studies import show_study
from realitygap.cli.transfer import told_transfers
from realitygap.work.progress import ProgressLine

if TYPE_CHECKING:
    from collections.abc import Mapping

    from realitygap.work.pool import Workers
    from realitygap.work.shard import Shard

__all__ = ["merge"]


@click.command()
@click.argument("shards", nargs=-1, required=True, type=click.Path(path_type=Path))
@option.out(says="Folder for the merged study [default: the shards' name without -shard-I-of-N].")
@option.workers
@option.trust
@option.as_json
def merge(
    shards: tuple[Path, ...], out: Path | None, workers: Workers, trust: bool, json_output: bool
) -> None:
    """Put SHARDS together: the folders that --shard 1/N to N/N made of one study.

    The result is the same as from one process, to the bit. Every shard must be there, finished, and have the
    same settings. Nothing is overwritten, and the shards do not change. Trials of `transfer` go into the
    folder of the study that drove.

    \b
    Example:
        realitygap evolve avoidance --runs 9 --out out/nine --shard 1/3   # and 2/3, 3/3, anywhere
        realitygap merge out/nine-shard-*-of-3
    """
    from realitygap import api
    from realitygap.experiments.noise import CONFIG, NoiseConfig
    from realitygap.experiments.noise_run import merge_noise, noise_experiment
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
        _merge_transfer(found, target, json_output=json_output)
        return
    told = {"shards": list(map(str, found.values()))}
    if mark is not None and mark.work == "experiment noise":
        with resumable(target, NoiseConfig.from_folder(shards[0]).resuming(target), CONFIG):
            merge_noise(found, target)
            note_versions(load_study(place).versions() for place in sorted((target / "evolved").iterdir()))
            with ProgressLine() as progress:
                results = noise_experiment(target, workers=workers, resume=True, on_progress=progress.show)
            show_noise(target, results, told, json_output=json_output)
        return
    for folder in found.values():
        ask_trust(str(folder), trust)
    driven = [folder for folder in found.values() if (folder / TRANSFERS).is_dir()]
    warn(f"{folder}: its transfers stay there; drive the merged study anew." for folder in driven)
    with resumable(target, f"realitygap report {shlex.quote(str(target))}", DATABASE):
        study = merge_runs(found, target)
        note_versions([study.versions()])
        page = api.report(target, study, workers=workers)
    show_study(target, study, page, told, json_output=json_output)


def _merge_transfer(shards: Mapping[Shard, Path], study: Path, *, json_output: bool) -> None:
    """Put the trials of shards into the folder of the study that drove, and print them."""
    from realitygap.transfer.record import merge_trials, read_trial

    made = merge_trials(shards, study)
    tables = (read_trial(one.folder).get("versions", {}) for one in made)
    note_versions({name: [value] for name, value in table.items()} for table in tables)
    facts = {"study": str(study), "transfers": [one.to_dict() for one in made]}
    tell(json_output, facts, *told_transfers(made), f"\ntransfers {study / 'transfer'}")
