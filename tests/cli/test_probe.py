"""`probe`: what the sensors read at one place."""

from dataclasses import replace

import numpy as np
import pytest

from realitygap.world.robot import load_profile


def test_it_reads_as_often_as_it_is_asked(json_of):
    """`--repeat 5` is five readings of eight proximity and eight ambient sensors."""
    made = json_of("probe", "avoidance", "--pose", 25, 25, 0, "--repeat", 5)
    assert np.shape(made["proximity"]) == np.shape(made["ambient"]) == (5, 8)


def test_without_noise_readings_are_not_rounded(json_of):
    """At noise zero the model's own values are shown, the same each time."""
    made = json_of("probe", "avoidance", "--pose", 25, 6, -90, "--noise", "zero", "--repeat", 3)
    front = np.array(made["proximity"])[:, 2:4]
    assert (front == front[0]).all()
    assert (front != np.round(front)).all()


def test_with_noise_readings_are_whole_counts(json_of):
    """At any other level the converter's whole counts are shown, and they vary."""
    made = json_of("probe", "light", "--pose", 60, 35, 0, "--repeat", 50)
    ambient = np.array(made["ambient"])
    assert (ambient == np.round(ambient)).all()
    assert (ambient.std(axis=0) > 0).any()


def test_facing_a_wall_is_felt_in_front(json_of):
    """Near a wall the front sensors read more than the back ones."""
    made = json_of("probe", "avoidance", "--pose", 25, 4, -90, "--noise", 0)
    (proximity,) = made["proximity"]
    assert min(proximity[2:4]) > max(proximity[6:8])
    assert proximity[2] == pytest.approx(proximity[3])


def test_more_sensors_than_a_network_takes(call, json_of, tmp_path):
    """Twenty are all probed, and a study takes those that it names."""
    paper, mine = load_profile("paper"), tmp_path / "mine.toml"
    eyes = replace(paper.infrared, sensors=(3 * paper.infrared.sensors)[:20])
    mine.write_text(replace(paper, infrared=eyes).to_toml(), "utf-8")
    (read,) = json_of("probe", "avoidance", "--pose", 25, 6, -90, "--profile", mine)["proximity"]
    assert len(read) == 20
    few = ("task.sensors=[0,19]", "task.seconds=1", "evolution.rows=3", "evolution.columns=3")
    words = [word for one in few for word in ("--set", one)]
    made = call("evolve", "avoidance", "--profile", mine, "--evaluations", 9, "--runs", 1, *words,
                "--out", tmp_path / "out")  # fmt: skip
    assert made.exit_code == 0, made.output


def test_the_text_has_a_column_a_sensor(call):
    """Without --json the readings are a table of eight columns; kinds that a robot lacks have none."""
    result = call("probe", "light", "--pose", 60, 35, 0)
    assert result.exit_code == 0
    assert "s7" in result.stdout
    five = call("probe", "avoidance", "--pose", 25, 7, -90, "--profile", "examples/five_eyes.toml").stdout
    assert "s4" in five and "s5" not in five and "ambient" not in five
