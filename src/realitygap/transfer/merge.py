"""Merges the trials of a transfer's shards into the folder of the study."""

from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from itertools import product
from pathlib import Path

from realitygap.errors import StudyError
from realitygap.robots.address import Address
from realitygap.study.folder import exists
from realitygap.study.load import load_study
from realitygap.transfer.folder import files_in, keep, keep_camera
from realitygap.transfer.load import Transferred, load_transfer, load_transfers, read_trial
from realitygap.transfer.packed import Packed, content, placed
from realitygap.transfer.plan import FOLDER
from realitygap.transfer.trial import SIMULATED, SITUATED, TRIAL
from realitygap.work.folder import file_errors, lock, refuse_difference, refuse_links
from realitygap.work.shard import Shard, read_mark

__all__ = ["merge_trials"]


def merge_trials(shards: Mapping[Shard, Path], folder: Path) -> list[Transferred]:
    """Copy every trial to the study's folder; existing ones are kept.

    Args:
        shards: their folders, as from `study.merge.all_shards`.
        folder: the study's.

    Returns:
        The shards' trials in the study's folder.

    Raises:
        StudyError: shards of different transfers or of another study, one that lacks trials, or a different
            trial is in the folder or another shard.
    """
    _refuse_other(shards, folder)
    with lock(folder), ExitStack() as opened:
        todo: dict[Path, Path] = {}
        for shard in shards.values():
            refuse_links(shard)
            found = load_transfers(shard)  # packed ones included
            _refuse_incomplete(shard, found)
            for trial in (one.folder for one in found):
                place = folder / trial.relative_to(shard)
                for there in {place, todo.setdefault(place, trial)} - {trial}:
                    _refuse_overwriting(trial, there)
        left = [(trial, place) for place, trial in todo.items() if content(place / TRIAL) is None]
        home = folder / FOLDER
        with file_errors(home):
            home.mkdir(exist_ok=True)
        packed = any(not trial.is_dir() for trial, _ in left)
        archive = opened.enter_context(Packed(home)) if packed else None
        for trial, place in left:
            with file_errors(place):
                _copy_cameras(trial.parent.parent, place.parent.parent)
                with placed(trial) as here:
                    files = files_in(here)
                if archive is not None and not trial.is_dir():
                    archive.keep(place.relative_to(home).as_posix(), files)
                else:
                    keep(place, Address.parse(read_trial(trial / TRIAL)["robot"]), files, finished=True)
    return [load_transfer(place) for place in todo]


def _copy_cameras(there: Path, here: Path) -> None:
    for camera in there.glob("camera-*.json"):
        keep_camera(here / camera.name, camera.read_bytes())


def _refuse_other(shards: Mapping[Shard, Path], folder: Path) -> None:
    """Refuse shards of different transfers, or of another study than this one."""
    first, *others = shards.values()
    facts = {place: dict(mark.facts) for place in (first, *others) if (mark := read_mark(place)) is not None}
    for other in others:
        cure = f"{other} has that. Only shards of one transfer are merged."
        refuse_difference(f"{first}: the trials were made", facts[first], facts[other], cure)
    if not exists(folder) or load_study(folder).digest() != facts[first].get("study"):
        raise StudyError(
            f"{folder} is not the study whose individuals drove in {first}. Give that study (--out)."
        )


def _refuse_incomplete(folder: Path, found: Sequence[Transferred]) -> None:
    """Refuse a shard without all of its trials, as of a copy that was made while it was worked on."""
    mark = read_mark(folder)
    assert mark is not None
    facts = mark.facts
    every = product(facts.get("robots", ()), facts.get("runs", ()), range(1, facts.get("starts", 0) + 1))
    left = Counter((run, start) for _, run, start in mark.shard.own(every))
    for one in found:
        whole = all(content(one.folder / name) is not None for name in (SIMULATED, SITUATED))
        left[one.run, one.start] -= whole and one.individual == facts.get("individual")
    for (run, start), lacking in left.items():
        if lacking > 0:
            raise StudyError(
                f"{folder}: a trial of run {run} from start {start} is missing or incomplete, though the "
                "shard is marked as finished: it was copied while it was worked on. Copy it once more."
            )


def _refuse_overwriting(trial: Path, place: Path) -> None:
    there = place.exists() or content(place / TRIAL) is not None
    if there and any(content(place / name) != content(trial / name) for name in (SIMULATED, SITUATED)):
        raise StudyError(
            f"{place}: a trial other than {trial} is there, and is not overwritten. Move it away."
        )
