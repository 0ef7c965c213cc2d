"""Shards of a transfer, made apart and put into the study's folder, are the transfer in one piece."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path
from shutil import ignore_patterns
from zipfile import ZIP_DEFLATED, ZipFile

import pytest

from realitygap.errors import StudyError
from realitygap.files import to_toml
from realitygap.robots.address import Address
from realitygap.study.load import load_study
from realitygap.transfer.options import Transfer
from realitygap.transfer.record import archive, load_transfers, merge_trials
from realitygap.transfer.replay import Replays
from realitygap.transfer.run import WORK, run_transfer
from realitygap.transfer.scores import jobs_of
from realitygap.values import Pose
from realitygap.work.archive import read_file, unpacked
from realitygap.work.shard import Mark, Shard, all_shards


def drive(study: Path, *, shard: Shard | str | None = None, starts: int = 2) -> list[Path]:
    """Both champions by their counters; the folders of the trials."""
    options = Transfer(robots=("twin:1",), starts=starts, seconds=0.5, path_from="wheels")
    return [one.folder for one in run_transfer(study, options, workers=1, shard=shard)]


@pytest.fixture(scope="module")
def whole(finished, tmp_path_factory) -> Path:
    """The study with its trials, made in one piece."""
    study = Path(shutil.copytree(finished.folder, tmp_path_factory.mktemp("made") / "whole"))
    drive(study)
    return study


def test_shards_of_a_transfer_are_the_whole(finished, whole, tmp_path):
    """Every trial, file by file; twice is as good as once, and nothing is overwritten. Shards that were moved
    away from their study ask for it."""
    parts = Path(shutil.copytree(finished.folder, tmp_path / "parts"))
    trials = [one.folder for one in load_transfers(whole)]
    shards = [Shard(number, 2) for number in (1, 2)]
    assert [len(drive(parts, shard=shard)) for shard in (shards[0], "2/2")] == [2, 2]
    assert not (parts / "transfer").exists()
    folders = [tmp_path / f"parts-transfer-shard-{number}-of-2" for number in (1, 2)]
    with pytest.raises(StudyError, match=r"moved is not the study .* Give that study \(--out\)"):
        merge_trials(all_shards(folders), tmp_path / "moved")
    for _ in range(2):
        made = merge_trials(all_shards(folders), parts)
    assert sorted(one.folder.relative_to(parts) for one in made) == sorted(
        one.relative_to(whole) for one in trials
    )
    for trial in trials:
        for name in ("simulated.csv", "situated.csv"):
            assert read_file(trial, name) == read_file(parts / trial.relative_to(whole), name)
    made[0].folder.mkdir(parents=True)
    (made[0].folder / "situated.csv").write_text("another")  # a kill may leave part of what is archived
    assert len(load_transfers(parts)) == len(merge_trials(all_shards(folders), parts)) == 4
    text = read_file(made[0].folder, "transfer.toml")
    (made[0].folder / "transfer.toml").write_bytes(text)
    with pytest.raises(StudyError, match=r": a trial other than .* is there, and is not overwritten"):
        merge_trials(all_shards(folders), parts)
    drive(parts, shard=shards[1], starts=1)
    with pytest.raises(StudyError, match=r"the trials were made with starts = 2, not 1\. .*one transfer"):
        merge_trials(all_shards(folders), parts)


def test_a_shard_without_all_of_its_trials_is_not_merged(finished, tmp_path):
    """As of a copy that was made while it was worked on: a trial or one of its tracks is missing, and nothing
    is taken. Trials of an earlier number of starts are no substitute, and do no harm."""
    study = Path(shutil.copytree(finished.folder, tmp_path / "study"))
    shards = [Shard(number, 2) for number in (1, 2)]
    for shard in shards:
        drive(study, shard=shard, starts=1)
        trials = drive(study, shard=shard)
    folders = [tmp_path / f"study-transfer-shard-{number}-of-2" for number in (1, 2)]
    with unpacked(folders[1]) as loose:
        shutil.copytree(loose / "transfer", tmp_path / "loose")
    shutil.rmtree(folders[1] / "transfer")
    (tmp_path / "loose").rename(folders[1] / "transfer")
    for gone in (trials[0] / "situated.csv", trials[0], folders[1] / "transfer"):
        gone.rename(tmp_path / "gone")
        with pytest.raises(
            StudyError, match=r"shard-2-of-2: a trial of run \d from start 2 is missing .* Copy it"
        ):
            merge_trials(all_shards(folders), study)
        assert not (study / "transfer").exists()
        (tmp_path / "gone").rename(gone)
    assert len(merge_trials(all_shards(folders), study)) == 4


def trial(place: Path, robot: str) -> Path:
    """A finished trial as its folder has it, its first start."""
    folder = place / "transfer" / robot.replace(":", "-").replace("/dev/", "") / "run" / "start-1"
    folder.mkdir(parents=True)
    facts = {"run": 1, "name": "run", "task": "light-seeking", "noise": 1.0, "individual": "champion"}
    facts |= {"start": 1, "seconds": 1.0, "situated_from": "counters", "late_steps": 0, "film": False}
    facts |= {"robot": robot, "unit": Address.parse(robot).unit, "fitness": {"simulated": 1, "situated": 1}}
    text = to_toml({**facts, "pose": Pose(x=1.0, y=1.0, heading=0.0).to_dict()})
    for name, content in (("transfer.toml", text), ("simulated.csv", "s"), ("situated.csv", robot)):
        (folder / name).write_text(content)
    return folder


def test_a_trial_of_two_shards_is_taken_once(finished, tmp_path):
    """As they have one after other numbers of starts; if they differ nothing is taken. What a robot recorded
    before it was stopped is kept."""
    study = Path(shutil.copytree(finished.folder, tmp_path / "study"))
    shards = [Shard(number, 2) for number in (1, 2)]
    folders = [shard.folder(tmp_path / "study-transfer") for shard in shards]
    for shard, folder in zip(shards, folders, strict=True):
        Mark(shard=shard, work=WORK, facts={"study": finished.digest()}).write(folder, finished=True)
    _, again, other = trial(folders[0], "twin:1"), trial(folders[1], "twin:1"), "serial:/dev/ttyUSB0"
    real = trial(folders[1], other).relative_to(folders[1])
    (again / "situated.csv").write_text("another")
    with pytest.raises(StudyError, match=r"shard-1-of-2/.*: a trial other than .*shard-2-of-2/.* is there"):
        merge_trials(all_shards(folders), study)
    assert not (study / "transfer").exists()
    (again / "situated.csv").write_text("twin:1")
    half = study / real.with_name("start-1.half")
    half.mkdir(parents=True)
    (half / "steps.csv").write_text("recorded")
    made = merge_trials(all_shards(folders), study)
    assert [one.folder for one in made] == [study / again.relative_to(folders[1]), study / real]
    assert (study / real / "situated.csv").read_text() == other
    assert (half.with_name("start-1.stopped-1") / "steps.csv").read_text() == "recorded"


@pytest.mark.parametrize("name", ["../../evil/transfer.toml", "/etc/evil", "start-1/../evil", "x.toml"])
def test_an_archive_of_others_writes_nowhere_else(tmp_path, name):
    """A name that leads out of its place is refused, whoever would unpack it; so is what no trial holds."""
    packed = tmp_path / "transfer" / "twin-1" / "run.zip"
    packed.parent.mkdir(parents=True)
    bomb = {"start-1/transfer.toml": bytes(2**24)}
    for content, says in (
        ({name: b"evil"}, "is not a trial's file"),
        (bomb, "is more than a trial can hold"),
    ):
        with ZipFile(packed, "w", ZIP_DEFLATED) as made:
            made.writestr(*content.popitem())
            made.writestr("start-2/transfer.toml", "")
        with pytest.raises(StudyError, match=rf"run\.zip: .* {says}"), unpacked(tmp_path):
            pass
        with pytest.raises(StudyError, match=says):
            load_transfers(tmp_path)


def test_other_archives_are_left_alone(whole, tmp_path):
    """Somebody's own .zip, and an archive that a kill left half written, are no trials."""
    study = Path(shutil.copytree(whole, tmp_path / "study"))
    packed = next((study / "transfer").glob("*/*.zip"))
    shutil.copy(packed, packed.with_name(f".part-999999999-{packed.name}"))
    with ZipFile(packed.parent.parent / "photos.zip", "w") as photos:
        photos.writestr("x.jpg", "a picture")
    assert len(load_transfers(study)) == len(load_transfers(whole))
    with unpacked(study) as there:
        assert not list(there.rglob("x.jpg")) and not list(there.rglob(".part*"))


def test_archived_trials_are_those_of_folders(whole, tmp_path):
    """Tracks, recordings, replays and score rows; a filmed trial and a real robot's keep their folders."""
    packed, home = load_study(whole), tmp_path / "loose" / "transfer"
    with unpacked(whole) as there:
        loose = load_study(shutil.copytree(whole, tmp_path / "loose", ignore=ignore_patterns("transfer")))
        shutil.copytree(there / "transfer", home)
    one, other = load_transfers(loose.folder), load_transfers(whole)
    assert len(one) == len(other) == 4
    for here, there in zip(one, other, strict=True):
        assert replace(here, folder=there.folder) == there and here.folder.is_dir() != there.folder.is_dir()
        for key in ("t", "x", "y"):
            assert (getattr(here.situated, key) == getattr(there.situated, key)).all()
        replays = [Replays(study).of(trial.folder) for study, trial in ((loose, here), (packed, there))]
        assert replays[0].situated.ended == replays[1].situated.ended == "finished"
        assert (replays[0].simulated.track.x == replays[1].simulated.track.x).all()
    keys = [[job.key for job in jobs_of(study)] for study in (loose, packed)]
    assert keys[0] == keys[1]
    filmed = one[0].folder
    text = (filmed / "transfer.toml").read_text()
    (filmed / "transfer.toml").write_text(text.replace("film = false", "film = true"))
    archive(filmed.parent)
    assert [path.name for path in filmed.parent.iterdir()] == [filmed.name] and len(
        load_transfers(loose.folder)
    ) == 4
