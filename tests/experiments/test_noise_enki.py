"""Enki's robots in the noise experiment: one model, its units, its words. `test_enki.py` drives them."""

from __future__ import annotations

from dataclasses import replace

import pytest

from realitygap.errors import ConfigError
from realitygap.experiments.noise.config import NoiseConfig
from realitygap.experiments.noise.folder import command_of
from realitygap.report.noise.words import limits, robot_words

TASKS = ("obstacle-avoidance",)


def test_its_units_are_those_of_a_model():
    """By their numbers, as the twin's; the noise scale is Enki's, and the command says all of it."""
    config = NoiseConfig(robot="enki:epuck", units=3, twin_noise=2.0, tasks=TASKS)
    assert [config.address(unit) for unit in (1, 3)] == ["enki:epuck:1", "enki:epuck:3"]
    assert NoiseConfig(robot="enki", tasks=TASKS).robot == "enki:khepera"
    assert NoiseConfig().address(2) == "twin:2"
    assert NoiseConfig.from_dict(config.to_dict()) == config
    assert "--robot enki:epuck" in command_of(replace(config, units=2)) and "--units 2" in command_of(
        replace(config, units=2)
    )


@pytest.mark.parametrize(
    ("key", "wrong", "says"),
    [
        ("robot", "enki:epuck:2", "expected enki:epuck, got 'enki:epuck:2'. Its units are those from 1"),
        ("robot", "khepera:/dev/null", "expected twin, .*enki:MODEL, or a robot of your own"),
        ("base", "paper", "expected none for enki:"),
    ],
)
def test_what_is_none_of_its_is_refused(key, wrong, says):
    """A unit in the address, a line, a base."""
    with pytest.raises(ConfigError, match=says):
        NoiseConfig(**{"robot": "enki:epuck", "tasks": TASKS, key: wrong})


def test_its_page_calls_it_what_it_is():
    """Pseudo-reality that others made: no twin, and no robot of the user's own."""
    settings = {"robot": "enki:epuck"}
    assert robot_words(settings) == "enki:epuck, a robot of EPFL's simulator Enki"
    assert "simulated by Enki, EPFL's simulator: pseudo-reality" in limits(settings)[0]
    assert "twin" not in " ".join(limits(settings))
    assert robot_words({}) == "" and "The robot is a twin" in limits({})[0]
