"""A study's configuration: read, written, changed and refused."""

from __future__ import annotations

import re
import tomllib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from realitygap.control.encoding import Variation
from realitygap.errors import ConfigError
from realitygap.study.config import Condition, Evolution, StudyConfig

TASKS = ("obstacle-avoidance", "light-seeking")
PAPER = StudyConfig.reproduction()

configs = st.builds(
    StudyConfig,
    title=st.text(max_size=20),
    seed=st.integers(0, 2**63 - 1),
    runs=st.integers(1, 100),
    evaluations=st.integers(1, 10**6),
    conditions=st.lists(
        st.builds(Condition, task=st.sampled_from(TASKS), noise=st.floats(0, 10)),
        min_size=1,
        max_size=5,
        unique_by=lambda c: (c.task, c.noise),
    ).map(tuple),
    evolution=st.builds(Evolution, rows=st.integers(3, 20))
    | st.builds(Evolution, algorithm=st.sampled_from(["panmictic", "random"]), size=st.integers(2, 99)),
    variation=st.builds(Variation, mutation=st.floats(0, 1), sources=st.sampled_from(["expressed", "all"])),
    arenas=st.dictionaries(st.sampled_from(TASKS), st.sampled_from(["light-seeking", "my arena.toml"])),
)


@given(configs)
def test_a_file_reads_back_to_the_same(config):
    """A configuration that is written to TOML reads back equal, whatever it holds."""
    assert StudyConfig.from_dict(tomllib.loads(config.to_toml())) == config


def test_the_papers_study():
    """Two tasks at three noise levels, condition by condition, five runs of 1000 evaluations."""
    pairs = [(c.task, c.noise) for c in PAPER.conditions]
    assert pairs == [(task, noise) for task in TASKS for noise in (0.0, 1.0, 2.0)]
    assert (PAPER.runs, PAPER.evaluations, PAPER.seed, PAPER.evolution.rows) == (5, 1000, 1995, 8)


def test_settings_change_what_they_name():
    """--set reaches every part, reads TOML values and plain texts, and leaves the rest alone."""
    changed = PAPER.with_settings(
        ["seed=3", "variation.mutation=0.1", "task.seconds = 10", "title=two words", "profile=mine.toml"]
    )
    assert (changed.seed, changed.variation.mutation, changed.task.seconds) == (3, 0.1, 10.0)
    assert (changed.title, changed.profile) == ("two words", "mine.toml")
    assert changed.variation.crossover == 0.8 and PAPER.seed == 1995
    assert PAPER.with_settings(["evolution.algorithm=random"]).evolution == Evolution(
        algorithm="random", size=64
    )


@pytest.mark.parametrize(
    ("setting", "words"),
    [
        ("runns=3", "runns: unknown key. Did you mean 'runs'?"),
        ("seed.deep=1", "seed.deep: unknown key"),
        ("runs=0", "runs: expected a whole number from 1 to 1000000, got 0"),
        ("evolution.algorithm=tours", "evolution.algorithm 'tours'"),
        ("conditions=[{task='light', noise='loud'}]", "conditions[0].noise: expected zero, observed, double"),
        ("runs", "expected a setting key=value"),
    ],
)
def test_wrong_settings_are_refused_by_key(setting, words):
    """A wrong setting names its key, what was expected and what came."""
    with pytest.raises(ConfigError, match=re.escape(words)):
        PAPER.with_settings([setting])


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("seed = \nruns = 1", "not a TOML file: .*line 1"),
        ("seed = 3", "conditions: expected one or more"),
        ('[[conditions]]\nnoise = "zero"', r"conditions\[0\].task: missing"),
    ],
)
def test_a_broken_file_is_named(tmp_path, text, words):
    """A broken file is refused by its name and the key or line."""
    path = tmp_path / "mine.toml"
    path.write_text(text)
    with pytest.raises(ConfigError, match=f"mine.toml: {words}"):
        StudyConfig.from_toml(path)
    with pytest.raises(ConfigError, match=r"none.toml: no such file"):
        StudyConfig.from_toml(tmp_path / "none.toml")


def test_files_are_found_beside_the_file_that_names_them(tmp_path):
    """A profile beside the study's TOML is found from any working folder; shipped names stay names."""
    (tmp_path / "robot.toml").write_text("")
    path = tmp_path / "mine.toml"
    path.write_text('profile = "robot.toml"\n[[conditions]]\ntask = "light"\n')
    config = StudyConfig.from_toml(path)
    assert config.profile == str((tmp_path / "robot.toml").resolve()) and config.conditions[0].task == "light"
