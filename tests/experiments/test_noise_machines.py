"""A study of the level of noise by shards, and by workers that see none of its files."""

from __future__ import annotations

from pathlib import Path

import pytest

from realitygap.calibration.unit_folder import PROFILE
from realitygap.errors import StudyError
from realitygap.experiments.noise.folder import merge_noise, open_folder
from realitygap.experiments.noise.plan import calibration_folder, controllers, share
from realitygap.experiments.noise.run import WORK, noise_study
from realitygap.study.merge import all_shards
from realitygap.work.pool import Here
from realitygap.work.shard import Mark, Shard, read_mark
from tests.experiments.noise_parts import quick_units, tables, tiny


class Far(Here):
    """A pool whose workers do not see the study's folder."""

    far = True


@pytest.fixture(scope="module")
def made(tmp_path_factory) -> tuple[dict[str, str], list[Path]]:
    """Tables of a study in one piece, and the folders of its two shards, one by a pool that sees no files."""
    place = tmp_path_factory.mktemp("noise")
    design = tiny(tasks=("obstacle-avoidance",), units=1)
    shards = [Shard(number, 2) for number in (1, 2)]
    with quick_units():
        one = tables(noise_study(place / "one", design, workers=1))
        for shard, workers in zip(shards, (1, Far()), strict=True):
            noise_study(shard.folder(place / "study"), design, workers=workers, shard=shard)
    return one, [shard.folder(place / "study") for shard in shards]


def test_shards_share_the_controllers():
    """Each controller once, and every shard about as many of each task and level."""
    design = tiny()
    for of in (1, 2, 5):
        parts = [share(design, Shard(number, of)) for number in range(1, of + 1)]
        assert sorted(one.name for part in parts for one in part) == sorted(
            c.name for c in controllers(design)
        )


def test_shards_merged_are_the_study_in_one_piece(made, tmp_path):
    """Its tables, byte by byte."""
    one, folders = made
    assert not any((folder / "results").exists() for folder in folders)
    merge_noise(all_shards(folders), tmp_path / "whole")
    assert tables(noise_study(tmp_path / "whole", workers=1, resume=True)) == one


def test_what_does_not_belong_together_is_not_merged(made, tmp_path):
    """Units that were measured otherwise; a shard that lost a file. Nothing is left."""
    _, folders = made
    profile = calibration_folder(folders[1], 1) / PROFILE
    text = profile.read_text()
    profile.write_text(f"{text}\n# by another machine\n")
    with pytest.raises(StudyError, match="differ: the twin was recorded on different kinds of machine"):
        merge_noise(all_shards(folders), tmp_path / "whole")
    profile.write_text(text)
    for files in ("simulated/*.json", "situated/*.npz"):
        file = next(folders[0].glob(files))
        kept = file.read_bytes()
        file.unlink()
        with pytest.raises(StudyError, match=f"no shard has the controller {file.stem}"):
            merge_noise(all_shards(folders), tmp_path / "whole")
        file.write_bytes(kept[: len(kept) // 2])
        with pytest.raises(StudyError, match=rf"{file}: expected .* Delete it and resume"):
            merge_noise(all_shards(folders), tmp_path / "whole")
        file.write_bytes(kept)
    assert not [*tmp_path.iterdir()]


def test_a_shard_that_is_refused_is_left_as_it_is(tmp_path):
    """Among other files no mark is left; begun once more without `resume`, a finished one stays finished."""
    design, shard = tiny(tasks=("obstacle-avoidance",), units=1), Shard(1, 2)
    (tmp_path / "thesis.txt").touch()
    with pytest.raises(StudyError, match=r"other files \(thesis\.txt\)"):
        noise_study(tmp_path, design, workers=1, shard=shard)
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.txt"]
    folder = tmp_path / "finished"
    folder.mkdir()
    open_folder(folder, design, resume=False)
    Mark(shard=shard, work=WORK).write(folder, finished=True)
    with pytest.raises(StudyError, match=r"Resume it \(--resume\)"):
        noise_study(folder, design, workers=1, shard=shard)
    mark = read_mark(folder)
    assert mark is not None and mark.finished
