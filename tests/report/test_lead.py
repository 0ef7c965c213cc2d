"""What a page says of itself: whose experiment it is, of which robot, and how to make it again."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest
from markupsafe import escape

from realitygap.experiments.reproduction import ASKED, Reproduction, again
from realitygap.report import build_report
from realitygap.report.gather import parts_of
from realitygap.report.lead import departures, is_paper, lead, made_of
from realitygap.study.config import StudyConfig
from realitygap.study.load import Study
from realitygap.study.provenance import versions
from realitygap.study.runner import run_study
from realitygap.tasks import load_task
from realitygap.world.arena import load_arena
from realitygap.world.robot import FittedChannel, Profile, Provenance, load_profile
from tests.conftest import draw_nothing
from tests.report.situations import write_transfer

HEXAGON = Path(__file__).parents[2] / "examples" / "hexagon.toml"
SHORT = ["task.seconds=0.5", "fresh_trials=2", "retest_trials=2"]


@pytest.fixture(scope="module")
def reproduced(tmp_path_factory) -> Study:
    """What `realitygap reproduce --runs 1 --evaluations 64 --seed 3 --profile paper` evolves."""
    config = StudyConfig.reproduction(runs=1, evaluations=64, seed=3)
    return run_study(tmp_path_factory.mktemp("again") / "study", config, workers=1)


@pytest.fixture(scope="module")
def page(reproduced: Study) -> str:
    """Its page, without figures."""
    return _page(reproduced)


def _page(study: Study) -> str:
    with pytest.MonkeyPatch.context() as patch:
        draw_nothing(patch)
        patch.setattr("realitygap.report.build.marks_of", lambda study: [])  # other tests look at them
        return " ".join(build_report(study.folder).read_text("utf-8").split())


def _like(study: Study, folder: Path, **changes: object) -> SimpleNamespace:
    """A study in another folder that differs so from the one that is there."""
    same = {key: getattr(study, key) for key in ("config", "profile", "task", "runs")}
    return SimpleNamespace(**{**same, "folder": folder, **changes})


def _calibrated(name: str, base: str = "paper") -> Profile:
    """A profile that was fitted to recordings, a Khepera's if its base is."""
    fits = (FittedChannel(channel="infrared", form="paper", rmse=20.0),)
    return replace(load_profile("paper"), name=name, provenance=Provenance(base=base, fits=fits))


def test_the_page_prints_the_command_that_makes_the_study_again(page):
    """Its profile, which is not calibrated first, and no transfer where there was none."""
    command = "realitygap reproduce --runs 1 --evaluations 64 --seed 3 --profile paper --no-transfer"
    assert f"<code>{command}</code>" in page
    assert "the same two tasks, robot, networks and genetic algorithm" in page


def test_the_page_names_the_processor_and_the_versions(page):
    """Those of every session, as bits may depend on them."""
    for name, version in versions().items():
        assert f"<dt>{name}</dt><dd>{escape(version)}</dd>" in page


def test_the_command_tells_what_is_not_usual(reproduced, tmp_path):
    """A calibrated study needs no profile; another robot needs its file; other starts are named."""
    usual = "--runs 1 --evaluations 64 --seed 3"
    mine = _like(reproduced, tmp_path, profile=load_profile(HEXAGON))
    assert again(mine) == f"{usual} --profile profile.toml --no-transfer"
    (tmp_path / ASKED).write_text(Reproduction(runs=1, evaluations=64, seed=3, starts=3).to_toml())
    study = _like(reproduced, tmp_path, profile=_calibrated("twin-1"))
    assert again(study) == f"{usual} --no-transfer"
    write_transfer(study, reproduced.runs[0])
    assert again(study) == f"{usual} --starts 3"
    write_transfer(study, reproduced.runs[1], start=8)
    assert again(study) == usual
    (tmp_path / ASKED).write_text(Reproduction(profile="khepera").to_toml())
    assert again(_like(study, tmp_path, profile=load_profile("khepera"))) == f"{usual} --profile khepera"


@pytest.mark.parametrize(
    "setting",
    ["task.seconds=2", "evolution.algorithm=random", "variation.mutation=0.1", "fresh_trials=3"],
)
def test_a_study_that_reproduce_does_not_make_has_no_such_command(reproduced, tmp_path, setting):
    """Any other setting is another study."""
    config = reproduced.config.with_settings([setting])
    assert again(_like(reproduced, tmp_path, config=config)) == ""


def test_another_arena_is_another_study(reproduced, tmp_path):
    """It is neither the paper's nor made by `reproduce`."""
    wide = load_arena("light-seeking")
    study = _like(reproduced, tmp_path, task=lambda name: replace(load_task(name), arena=wide))
    assert again(study) == "" and not is_paper(study, parts_of(study))


@pytest.mark.parametrize(
    ("settings", "profile", "says"),
    [
        (["evolution.algorithm=random"], None, "found by random search in a simulation of a Khepera"),
        (["evolution.algorithm=panmictic"], None, "one well-mixed population"),
        (["variation.mutation=0.1"], None, "genetic algorithm (operators at other rates) in"),
        (
            [],
            load_profile(HEXAGON),
            "genetic algorithm in a simulation of the robot of profile “hexagon”, at",
        ),
        ([], replace(load_profile("paper"), source="mine"), "the robot of a changed profile “paper”"),
        ([], load_profile("enki-thymio2"), "the robot of profile “enki-thymio2”, at"),
        (
            [],
            _calibrated("mine", base="e-puck"),
            "the robot of profile “mine”, calibrated to recordings of it",
        ),
    ],
)
def test_a_study_that_is_not_the_papers_is_not_called_so(reproduced, tmp_path, settings, profile, says):
    """Another algorithm, other rates or another robot are named."""
    config = reproduced.config.with_settings(settings)
    study = _like(reproduced, tmp_path, config=config, profile=profile or reproduced.profile)
    parts = parts_of(study)
    assert not is_paper(study, parts) and says in lead(study, parts)


def test_a_calibrated_khepera_is_the_papers_robot(reproduced, tmp_path):
    """Unit 1 of the twin, as `reproduce` measures it; a robot that a person measured."""
    study = _like(reproduced, tmp_path, profile=_calibrated("twin-1"))
    assert is_paper(study, parts_of(study))
    assert "a Khepera robot, calibrated to unit 1 of its twin, at zero, observed and" in lead(
        study, parts_of(study)
    )
    study = _like(reproduced, tmp_path, profile=_calibrated("mine"))
    assert "the robot of profile “mine”, calibrated to recordings of it" in lead(study, parts_of(study))


def test_a_calibrated_simulation_is_not_passed_off_as_the_printed_one(page, tmp_path):
    """The page says what of the printed equations is no more, and nothing where all of them are there."""
    assert departures(load_profile("paper")) == ""
    both = "none of the printed sensor equations is used as it stands"
    assert departures(load_profile("khepera")) == both  # its wheels are the paper's
    assert departures(load_profile("thymio")) == ""  # the paper printed no Thymio's
    paper = load_profile("paper")
    infrared = FittedChannel(channel="infrared", form="extended", rmse=1.0)
    near = replace(paper, provenance=Provenance(base="paper", fits=(infrared,)))
    assert departures(near) == "the infrared sensors have an equation other than the printed one"
    driven = FittedChannel(channel="wheels", form="refitted", rmse=1.0)
    wheels = replace(paper.wheels, ki=1e-9, friction_cm_s2=0.0)
    made = replace(paper, wheels=wheels, provenance=Provenance(base="paper", fits=(driven,)))
    assert departures(made) == "the wheels have no integral term and no static friction"
    assert "calibrated, not the paper’s as printed" not in page
    config = StudyConfig.reproduction(runs=1, evaluations=64, seed=3)
    config = config.with_settings(["profile=khepera", *SHORT])
    text = _page(run_study(tmp_path / "measured", config, workers=1))
    assert f"The simulation is calibrated, not the paper’s as printed: {both}." in text


def test_the_robot_has_the_sensors_that_it_has():
    """Infrared that also measures light, infrared alone, light alone, and both apart."""
    paper, hexagon = load_profile("paper"), load_profile(HEXAGON)
    also = "infrared sensors, which can also measure the light that falls on them"
    assert made_of(paper) == f"disc on two wheels with {also}"
    assert made_of(load_profile("thymio")) == "body on two wheels with infrared sensors"
    assert made_of(hexagon) == "disc on two wheels with infrared and light sensors"
    blind = replace(hexagon, infrared=replace(hexagon.infrared, sensors=()))
    assert made_of(blind) == "disc on two wheels with light sensors"


def test_the_lead_says_noise_and_length(tmp_path):
    """Without noise it claims none; trials of another length are not the paper's tasks unsaid."""
    config = StudyConfig.single("avoidance", 0.0, evaluations=64, seed=3)
    text = _page(run_study(tmp_path / "still", config.with_settings(SHORT), workers=1))
    assert "in a simulation of a Khepera robot (the paper’s constants), without noise; after Jakobi" in text
    assert "noisy" not in re.sub(r"<script.*", "", text) and "realitygap reproduce" not in text
    changed = StudyConfig.reproduction(runs=1, evaluations=64, seed=3)
    text = _page(run_study(tmp_path / "short", changed.with_settings(SHORT), workers=1))
    assert "the same two tasks (with seconds = 0.5), robot, networks" in text
