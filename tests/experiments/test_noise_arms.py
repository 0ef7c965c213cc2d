"""The arms of the second study: their plan, and how they are carried out, on a plan of the same form."""

from __future__ import annotations

import csv
import re
import shutil
import tomllib
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from realitygap.errors import ConfigError, StudyError, StudyInterruptedError
from realitygap.experiments.noise.config import NoiseConfig
from realitygap.experiments.noise.folder import merge_noise
from realitygap.experiments.noise.plan import controllers, evolution, evolved, evolved_folder
from realitygap.experiments.noise.run import noise_study
from realitygap.experiments.noise.second import arms
from realitygap.experiments.noise.situated import read_situated
from realitygap.experiments.noise.stage import Stage
from realitygap.study.load import load_study
from realitygap.study.merge import all_shards
from realitygap.work.shard import Shard
from tests.experiments.noise_parts import quick_units, tables

DOCS = Path(__file__).resolve().parents[2] / "docs" / "noise-level-2.md"
REALITIES = {
    "Enki's Khepera": {"robot": "enki:khepera"}, "stranger": {"robot": "stranger"}, "twin, noise scale 1": {},
    "twin, noise scale 2": {"twin_noise": 2.0},
}  # fmt: skip
TASKS = {"both": ("obstacle-avoidance", "light-seeking"), "obstacle avoidance": ("obstacle-avoidance",)}
WHO = ["task", "seed_set", "run", "evolved_level", "individual"]

SMALL = """
[design]
seeds = [31, 41]
first_unit = 2
units = 3
foreign = 1
starts = 2
starts_by_unit = true
fittest = true

[arm.T]
tasks = ["obstacle-avoidance"]
evaluations = 70
seconds = 3.0
levels = [0.0, 1.0]
runs = [2, 4]
"""


@pytest.fixture(scope="module")
def plan(tmp_path_factory) -> Iterator[Path]:
    """A plan of the same form with one small arm, and units that are quick."""
    folder = tmp_path_factory.mktemp("plan")
    (folder / "arms.toml").write_text(SMALL)
    (folder / "claims.toml").write_text("bound = 0.5\n")
    with quick_units() as patch:
        patch.setattr(arms, "STATED", folder)
        yield folder


@pytest.fixture(scope="module")
def done(plan, tmp_path_factory) -> Path:
    """The folder of the finished small arm; tests leave it as it is."""
    folder = tmp_path_factory.mktemp("arm") / "T"
    noise_study(folder, arms.arm("T"), workers=1)
    return folder


@pytest.fixture
def real(monkeypatch) -> None:
    """The second study's own plan."""
    monkeypatch.setattr(arms, "STATED", Path(arms.__file__).parent)


def rows(folder: Path, name: str) -> list[dict[str, str]]:
    with (folder / "results" / name).open(newline="") as file:
        return list(csv.DictReader(file))


def test_the_arms_are_those_of_the_plan(real):
    """The plan's table, its order, its units, trials and seeds are what the command carries out."""
    text = DOCS.read_text("utf-8")
    table = re.findall(r"^\| (\w+) \| (.+?) \| (.+?) \| (\d+) \| ([\d, –]+) \|", text, re.M)
    assert [name for name, *_ in table] == list(arms.arm_names())
    assert f"in the order {', '.join(arms.arm_names())} " in text
    for name, reality, tasks, evaluations, runs in table:
        by_level = {
            level: int(count)
            for level, count in zip((0.0, 0.5, 1.0, 2.0, 4.0), runs.split(", "), strict=True)
            if count != "–"
        }
        assert arms.arm(name) == NoiseConfig(
            arm=name, levels=tuple(by_level), runs=tuple(by_level.values()), evaluations=int(evaluations),
            tasks=TASKS[tasks], seed_sets=2, seed=20261, seeds=(20261, 20262), first_unit=101, units=16,
            foreign=3, starts=4, starts_by_unit=True, fittest=True, **REALITIES[reality],
        )  # fmt: skip
    for stated in ("numbers 101 to 116", "three foreign units", "four starts each: 16 trials",
                   "master seeds 20261 and 20262", "drawn once for each unit"):  # fmt: skip
        assert stated in text
    trials = {name: arms.arm(name).twin_trials for name in arms.arm_names()}
    assert trials["T"] + trials["T5"] + trials["T2"] == 48_000
    assert trials["E"] + trials["E5"] == 22_400


def test_units_take_turns_and_drive_those_that_follow(real):
    """Runs of all levels spread over the sixteen units; foreign ones are the next three, in a circle."""
    config = arms.arm("E")
    every = controllers(config)
    assert len(every) == len({one.name for one in every}) == 2 * config.controllers == 1280
    for level, most in ((1.0, 5), (0.5, 3)):
        runs = [one for one in every if (one.seed_set, one.level, one.individual) == (2, level, "fittest")]
        shares = [sum(one.home == unit for one in runs) for unit in config.every_unit]
        assert max(shares) == most and max(shares) - min(shares) <= 1
    assert config.driven(101) == (101, 102, 103, 104) and config.driven(115) == (115, 116, 101, 102)
    assert config.driven(115, "fittest") == (115,)


def test_the_tables_of_an_arm(done):
    """Both individuals of each run at each level; a row's home and foreign figures are of those units."""
    made, cells = rows(done, "controllers.csv"), rows(done, "cells.csv")
    assert list(made[0]) == [
        *WHO, "home_unit", "name", "fitness_simulated", "fitness_situated", "drop", "fitness_situated_home",
        "fitness_situated_foreign", "trials",
    ]  # fmt: skip
    assert list(cells[0]) == [
        *WHO, "comparison_level", "score", "behaviour", "layout", "noisiness", "responsiveness",
        "fitness_simulated", "score_home", "score_foreign", "layout_home", "without_jitter",
        "without_jitter_home",
    ]  # fmt: skip
    assert len(made) == 12 and len(cells) == 24
    assert [[row[k] for k in WHO] for row in made for _ in (0, 1)] == [[row[k] for k in WHO] for row in cells]
    for row in made:
        foreign, home = row["fitness_situated_foreign"], float(row["fitness_situated_home"])
        both = [home] if row["individual"] == "fittest" else [home, float(foreign)]
        assert (foreign == "") == (row["individual"] == "fittest") == (row["trials"] == "2")
        assert float(row["fitness_situated"]) == pytest.approx(sum(both) / len(both), rel=1e-4)
    for row in cells:
        alone = row["individual"] == "fittest"
        scores = [row[key] for key in ("score", "layout", "without_jitter")]
        at_home = [row[key] for key in ("score_home", "layout_home", "without_jitter_home")]
        assert all(0 <= float(value) <= 10 for value in (*scores, *at_home))
        assert (row["score_foreign"] == "") == alone and (not alone or scores == at_home)
    assert any(row["without_jitter"] != row["score"] for row in cells)
    assert {row["unit"] for row in rows(done, "calibration.csv")} == {"2", "3", "4"}
    lived = rows(done, "without-camera.csv")
    champions = [row for row in made if row["individual"] == "champion"]
    assert len(lived) == sum(int(row["trials"]) // 2 for row in champions)
    assert all(float(row[key]) > 0 for row in lived for key in ("readings", "distance", "replay_cm"))
    assert {float(row["correspondence"]) for row in lived} >= {
        float(row["score_home"])
        for row in cells
        if (row["individual"], row["comparison_level"]) == ("champion", "1.0")
    }


def test_an_arm_records_how_it_was_made(done, plan):
    """study.toml has the arm, its command, commit and plan; all profiles lie beside it."""
    told = tomllib.loads((done / "results" / "study.toml").read_text())
    assert told["arm"] == "T" and told["command"] == "realitygap experiment noise --arm T"
    assert told["plan"] == arms.plan_digests() and len(told["versions_at_start"]["commit"]) >= 7
    assert told["controllers"] == 6 and told["twin_trials"] == 36 and told["runs"] == [2, 4]
    for unit in (2, 3, 4):
        profile = done / "calibration" / f"unit-{unit}" / "robot.toml"
        kept = done / "results" / "profiles" / f"unit-{unit}.toml"
        assert kept.read_bytes() == profile.read_bytes()


def test_starts_are_drawn_once_for_each_unit(done):
    """Whoever drives a unit, of whichever seed set, starts where all do; other units have other starts."""
    config = NoiseConfig.from_folder(done)
    stage, found, streams = Stage(done, config), {}, []
    for one in controllers(config):
        kept = read_situated(stage, one)
        assert kept.units == config.driven(one.home, one.individual)
        streams += kept.streams.ravel().tolist()
        for unit, poses in zip(kept.units, kept.poses, strict=True):
            found.setdefault(unit, set()).add(poses[:, 0, :2].round(9).tobytes())
    assert [len(starts) for starts in found.values()] == [1, 1, 1]
    assert len(set.union(*found.values())) == 3 and len(set(streams)) == len(streams) == 36


def test_the_fittest_is_the_last_populations(done):
    """Highest stored fitness of all who live at the end; the champion is the run's own."""
    config = NoiseConfig.from_folder(done)
    stage = Stage(done, config)
    for one in controllers(config):
        study = load_study(evolved_folder(done, config, evolved(config, one)))
        run = study.run(one.run_name)
        if one.individual == "champion":
            assert np.array_equal(stage.genes(one), run.champion)
            continue
        last = {int(number) for number in study.state(run.id).numbers}
        fitness = dict(enumerate(study.evaluations(run.id)["fitness"].tolist()))
        best = max(last, key=fitness.__getitem__)
        assert fitness[best] == max(fitness[number] for number in last)
        equals = [number for number in last if fitness[number] == fitness[best]]
        assert any(np.array_equal(stage.genes(one), study.genotype(run.id, number)) for number in equals)


def test_seed_sets_have_their_own_seeds(done):
    """What evolves and is drawn in a set follows from that set's master seed."""
    config = NoiseConfig.from_folder(done)
    made = [load_study(evolved_folder(done, config, evolved(config, one))) for one in controllers(config)]
    assert len({study.config.seed for study in made}) == 4
    other = replace(config, seeds=(31, 42))
    for study in {evolved(config, one) for one in controllers(config)}:
        seeds = [evolution(c, study, Path("robot.toml")).seed for c in (config, other)]
        assert (seeds[0] == seeds[1]) == (study.seed_set == 1)


def test_an_arm_that_is_stopped_comes_to_the_same_bits(done, plan, tmp_path):
    """Stopped in every phase and gone on with by --resume, its tables are those of one piece."""
    folder = tmp_path / "T"
    for phase, least in (("evolving", 2), ("on the twin", 3), ("comparing with the simulations", 4)):

        def stop(event, phase=phase, least=least):
            if event.phase == phase and event.done >= least:
                raise KeyboardInterrupt

        with pytest.MonkeyPatch.context() as patch:
            patch.setattr("realitygap.work.progress.EVERY_S", 0.0)
            with pytest.raises(StudyInterruptedError, match="kept"):
                noise_study(
                    folder, arms.arm("T"), workers=1, resume=(folder / "noise-study.toml").is_file(),
                    on_progress=stop,
                )  # fmt: skip
    assert 0 < len(list(folder.glob("simulated/*.json"))) < 12 == len(list(folder.glob("situated/*.npz")))
    assert tables(noise_study(folder, None, workers=1, resume=True)) == tables(done / "results")


def test_shards_of_an_arm_come_to_the_same_bits(done, plan, tmp_path):
    """A run's two individuals stay together; merged, the tables are those of one piece."""
    shards = [Shard(number, 2) for number in (1, 2)]
    folders = [shard.folder(tmp_path / "T") for shard in shards]
    for shard, folder in zip(shards, folders, strict=True):
        noise_study(folder, arms.arm("T"), workers=1, shard=shard)
        assert 0 < len(list(folder.glob("situated/*.npz"))) < 12
    merge_noise(all_shards(folders), tmp_path / "whole")
    assert tables(noise_study(tmp_path / "whole", workers=1, resume=True)) == tables(done / "results")


def test_another_design_or_plan_is_refused(done, plan, tmp_path):
    """Neither another design under an arm's name, nor claims or arms that changed once there are data."""
    other = replace(arms.arm("T"), evaluations=80)
    with pytest.raises(StudyError, match="arm T is planned with evaluations = 70, not 80"):
        noise_study(tmp_path / "new", other, workers=1)
    assert not list((tmp_path / "new").glob("*.toml"))
    for file, old, new in (("claims.toml", "0.5", "0.6"), ("arms.toml", "[design]", "more = 1\n[design]")):
        text = (plan / file).read_text()
        (plan / file).write_text(text.replace(old, new))
        try:
            with pytest.raises(StudyError, match=f"started under another plan: {file} has changed"):
                noise_study(done, None, workers=1, resume=True)
        finally:
            (plan / file).write_text(f"# a comment may change\n{text}")
    folder = Path(shutil.copytree(done, tmp_path / "edited"))
    for name in ("noise-study.toml", ".noise-study.toml"):
        (folder / name).write_text((folder / name).read_text().replace("foreign = 1", "foreign = 2"))
    with pytest.raises(StudyError, match="arm T is planned with foreign = 1, not 2"):
        noise_study(folder, None, workers=1, resume=True)
    assert noise_study(done, arms.arm("T"), workers=1, resume=True) == done / "results"


def test_what_is_an_arms_is_an_arms_alone(real):
    """Settings that only arms have are refused without one; an arm that is none, or lacks a seed, too."""
    with pytest.raises(ConfigError, match="foreign: expected None except in an arm of the plan, got 3"):
        NoiseConfig(foreign=3)
    with pytest.raises(ConfigError, match=r"arm: expected one of .*, got 'X'"):
        arms.arm("X")
    for change, says in (({"seeds": (1,)}, "seeds: expected one for each of 2"),
                         ({"foreign": 16}, "foreign: expected a whole number from 0 to 15"),
                         ({"runs": (2, 2)}, "runs: expected one for each of 3 levels")):  # fmt: skip
        with pytest.raises(ConfigError, match=says):
            replace(arms.arm("S"), **change)
    assert "seeds" not in NoiseConfig().to_dict()
    config = NoiseConfig(levels=(2, 0), runs=(4, 8))
    assert config.runs == (8, 4) and [config.runs_in_set(level) for level in (0, 2)] == [4, 2]
