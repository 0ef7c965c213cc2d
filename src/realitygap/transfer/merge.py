"""Put the trials of a transfer's shards into the folder of the study that drove."""

from __future__ import annotations

import shutil
from collections.abc import Iterator, Mapping
from pathlib import Path

from realitygap.errors import StudyError
from realitygap.study.load import load_study
from realitygap.study.lock import lock
from realitygap.study.schema import told
from realitygap.study.settings import refuse_difference
from realitygap.study.sources import refuse_links
from realitygap.transfer.folder import half_folder
from realitygap.transfer.load import Transferred, load_transfer
from realitygap.transfer.plan import FOLDER
from realitygap.transfer.trial import SIMULATED, SITUATED, TRIAL
from realitygap.whole import move
from realitygap.work.shard import Shard, read_mark

__all__ = ["merge_trials"]


def merge_trials(shards: Mapping[Shard, Path], folder: Path) -> list[Transferred]:
    """Copy every trial to the study's folder; those that are there are kept.

    Args:
        shards: their folders, as `study.merge.all_shards` has them.
        folder: the study's.

    Returns:
        The shards' trials, where they are now.

    Raises:
        StudyError: shards of different transfers or of another study, or other trials are there.
    """
    _refuse_other(shards, folder)
    made: list[Path] = []
    with lock(folder):
        todo = [
            (trial, folder / trial.relative_to(shard))
            for shard in shards.values()
            for trial in _trials(shard)
        ]
        for trial, place in todo:
            _refuse_overwriting(trial, place)
        for trial, place in todo:
            with told(place):
                for camera in trial.parent.parent.glob("camera-*.json"):
                    if not (place.parent.parent / camera.name).exists():
                        place.parent.mkdir(parents=True, exist_ok=True)
                        shutil.copyfile(camera, place.parent.parent / camera.name)
                if not place.exists():
                    half = half_folder(place)
                    shutil.rmtree(half, ignore_errors=True)
                    shutil.copytree(trial, half)
                    move(half, place)
            made.append(place)
    return [load_transfer(place) for place in made]


def _trials(shard: Path) -> Iterator[Path]:
    """The finished trials of a shard."""
    refuse_links(shard)
    for file in sorted((shard / FOLDER).glob(f"*/*/start-*/{TRIAL}")):
        if file.parent.name[6:].isdecimal():
            yield file.parent


def _refuse_other(shards: Mapping[Shard, Path], folder: Path) -> None:
    """Refuse shards of different transfers, or of another study than this one."""
    first, *others = shards.values()
    facts = {place: dict(mark.facts) for place in (first, *others) if (mark := read_mark(place)) is not None}
    for other in others:
        cure = f"{other} has that. Only shards of one transfer are merged."
        refuse_difference(f"{first}: the trials were made", facts[first], facts[other], cure)
    if load_study(folder).digest() != facts[first].get("study"):
        raise StudyError(f"{folder} is not the study whose individuals drove in {first}. Give that (--out).")


def _refuse_overwriting(trial: Path, place: Path) -> None:
    """Refuse to put a trial where another is."""
    for name in (SIMULATED, SITUATED) if place.exists() else ():
        if not (place / name).is_file() or (place / name).read_bytes() != (trial / name).read_bytes():
            raise StudyError(
                f"{place}: another trial is there than {trial}, and is not overwritten. Move it away."
            )
