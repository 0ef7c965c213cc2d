"""Shards of a transfer, made apart and put into the study's folder, are the transfer in one piece."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from realitygap.errors import StudyError
from realitygap.study.merge import all_shards
from realitygap.transfer.merge import merge_trials
from realitygap.transfer.options import Transfer
from realitygap.transfer.run import run_transfer
from realitygap.work.shard import Shard


def drive(study: Path, *, shard: Shard | None = None, starts: int = 2) -> list[Path]:
    """Both champions by their counters; the folders of the trials."""
    options = Transfer(robots=("twin:1",), starts=starts, seconds=0.5, watch=False)
    return [one.folder for one in run_transfer(study, options, workers=1, shard=shard)]


def test_shards_of_a_transfer_are_the_whole(finished, tmp_path):
    """Every trial, file by file; twice is as good as once, and nothing is overwritten."""
    whole, parts = (Path(shutil.copytree(finished.folder, tmp_path / name)) for name in ("whole", "parts"))
    trials = drive(whole)
    shards = [Shard(number, 2) for number in (1, 2)]
    assert [len(drive(parts, shard=shard)) for shard in shards] == [2, 2]
    assert not (parts / "transfer").exists()
    folders = [tmp_path / f"parts-transfer-shard-{number}-of-2" for number in (1, 2)]
    for _ in range(2):
        made = merge_trials(all_shards(folders), parts)
    assert sorted(one.folder.relative_to(parts) for one in made) == sorted(
        one.relative_to(whole) for one in trials
    )
    for trial in trials:
        for name in ("simulated.csv", "situated.csv"):
            assert (trial / name).read_bytes() == (parts / trial.relative_to(whole) / name).read_bytes()
    (made[0].folder / "situated.csv").write_text("another")
    with pytest.raises(StudyError, match=r"start-1: another trial is there than .* not overwritten"):
        merge_trials(all_shards(folders), parts)
    drive(parts, shard=shards[1], starts=1)
    with pytest.raises(StudyError, match=r"the trials were made with starts = 2, not 1\. .*one transfer"):
        merge_trials(all_shards(folders), parts)
