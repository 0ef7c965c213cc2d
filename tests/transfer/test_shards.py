"""Shards of a transfer, made apart and put into the study's folder, are the transfer in one piece."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import pytest

from realitygap.errors import StudyError
from realitygap.study.load import load_study
from realitygap.study.merge import all_shards
from realitygap.transfer.load import load_transfers
from realitygap.transfer.merge import merge_trials
from realitygap.transfer.options import Transfer
from realitygap.transfer.packed import PACKED
from realitygap.transfer.replay import Replays
from realitygap.transfer.run import run_transfer
from realitygap.transfer.score_rows import jobs_of
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
    with pytest.raises(StudyError, match=r": a trial other than .* is there, and is not overwritten"):
        merge_trials(all_shards(folders), parts)
    drive(parts, shard=shards[1], starts=1)
    with pytest.raises(StudyError, match=r"the trials were made with starts = 2, not 1\. .*one transfer"):
        merge_trials(all_shards(folders), parts)


def test_packed_trials_are_the_same(finished, tmp_path):
    """In one file: tracks, recordings, replays and score rows as of folders; resumed, merged, damaged."""
    loose, packed = (
        load_study(shutil.copytree(finished.folder, tmp_path / name)) for name in ("loose", "packed")
    )
    options = Transfer(robots=("twin:1",), starts=2, seconds=0.5, watch=False)
    one = run_transfer(loose, options, workers=1)
    shards = [Shard(number, 2) for number in (1, 2)]
    for shard in shards:
        run_transfer(packed, replace(options, pack=True), workers=1, shard=shard)
    folders = [tmp_path / f"packed-transfer-shard-{number}-of-2" for number in (1, 2)]
    assert len([*folders[0].rglob("*.*")]) == 3  # its mark, its lock and its archive
    merge_trials(all_shards(folders), packed.folder)
    other = run_transfer(packed, replace(options, pack=True), workers=1)
    files = [path.name for path in (packed.folder / "transfer").rglob("*") if path.is_file()]
    assert files == [PACKED] and len(one) == len(other) == len(load_transfers(packed.folder)) == 4
    for here, there in zip(one, other, strict=True):
        assert replace(here, folder=there.folder) == there and not there.folder.exists()
        assert all(
            (getattr(here.situated, key) == getattr(there.situated, key)).all() for key in ("t", "x", "y")
        )
        replays = [Replays(study).of(trial.folder) for study, trial in ((loose, here), (packed, there))]
        assert replays[0].situated.ended == replays[1].situated.ended == "finished"
        assert (replays[0].simulated.track.x == replays[1].simulated.track.x).all()
    keys = [[job.key for job in jobs_of(study, one[0].task)] for study in (loose, packed)]
    assert keys[0] == keys[1]
    data = bytearray((packed.folder / "transfer" / PACKED).read_bytes())
    data[4096:] = bytes(len(data) - 4096)
    (packed.folder / "transfer" / PACKED).write_bytes(data)
    with pytest.raises(StudyError, match=PACKED):
        load_transfers(packed.folder)
