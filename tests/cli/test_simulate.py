"""`simulate`, `probe`, `profile` and `arena`: from words to figures in the units that people read."""

import numpy as np
import pytest

import realitygap

KEYS = {
    "t_s", "x_cm", "y_cm", "heading_deg", "proximity", "ambient", "inputs", "commands", "wheels", "contact",
}  # fmt: skip
FORWARD = ("simulate", "avoidance", "--controller", "constant:2,2", "--pose", "25,25,0")


def test_every_key_has_an_entry_a_step(json_of):
    """Twenty seconds are 200 entries under every key, each of the stated width."""
    made = json_of(*FORWARD)
    assert {*made} >= {*KEYS, "score", "task", "profile", "noise", "seed"}
    assert all(len(made[key]) == 200 for key in KEYS)
    for key, width in {"proximity": 8, "ambient": 8, "inputs": 8, "commands": 2, "wheels": 2}.items():
        assert {len(row) for row in made[key]} == {width}
    assert made["t_s"][:3] == [0.0, 0.1, 0.2]
    assert {type(flag) for flag in made["contact"]} == {bool} and isinstance(made["score"], float)


def test_it_begins_at_the_pose_and_settles_on_its_command(json_of):
    """The first entry is where the robot was put, negative headings included; without noise two units are 1.6
    cm a second."""
    made = json_of(*FORWARD[:-1], "25,25,-90", "--noise", "zero", "--seconds", 5)
    assert (made["x_cm"][0], made["y_cm"][0]) == (25, 25)
    assert made["heading_deg"][0] == pytest.approx(-90)
    assert made["wheels"][-1] == pytest.approx([2, 2], abs=0.02)
    assert made["y_cm"][-11] - made["y_cm"][-1] == pytest.approx(1.6, abs=0.02)


def test_the_same_seed_is_the_same_trial(json_of):
    """A seed names a trial; another seed is another one. `constant:-3,5` is a controller, not an option."""
    words = (*FORWARD[:3], "constant:-3,5", *FORWARD[4:], "--seed")
    assert json_of(*words, 4) == json_of(*words, 4) and json_of(*words, 4)["commands"] == [[-3, 5]] * 200
    assert json_of(*words, 4)["x_cm"] != json_of(*words, 5)["x_cm"]


def test_what_is_listed_and_shown_can_be_changed_and_given_back(call, json_of, tmp_path):
    """`profile` and `arena` list what they print, with the shipped comments; a genotype's file
    does what the controller does that it was made of; a room may be too small for the task's own start."""
    assert "paper\n" in call("profile").stdout and "light-seeking\n" in call("arena").stdout
    robot, room, genes = (tmp_path / name for name in ("mine.toml", "room.toml", "mine.txt"))
    robot.write_text(call("profile", "paper").stdout.replace('name = "paper"', 'name = "mine"', 1))
    room.write_text(call("arena", "light-seeking").stdout)
    assert all(file.read_text().count("#") > 5 for file in (robot, room))
    made = json_of(*FORWARD, "--profile", robot, "--arena", room, "--seconds", 1)
    assert (made["profile"], made["arena"]) == ("mine", "light-seeking")
    assert "#" not in call("profile", robot).stdout
    realitygap.Genotype.constant(2, 2).save(genes)
    assert json_of(*FORWARD[:3], genes, *FORWARD[4:])["x_cm"] == json_of(*FORWARD)["x_cm"]
    room.write_text('name = "box"\nsize_cm = [12, 12]\n')
    made = json_of(*FORWARD[:-1], "6,6,0", "--arena", room, "--seconds", 5)
    assert max(made["x_cm"]) < 12 - 2.9 + 1e-6 and any(made["contact"])


def test_the_text_and_the_picture(call, tmp_path):
    """Without --json the score in its unit, and with --verbose a table with headings within a turn;
    --picture leaves a file of its kind. Without a pose it is a start of the task's."""
    result = call(*FORWARD, "--seconds", 2, "--picture", tmp_path / "path.svg")
    assert result.exit_code == 0 and "x cm" not in result.stdout and "score 0.19" in result.stdout
    assert (tmp_path / "path.svg").read_bytes()[:5] == b"<?xml"
    turning = ("--controller", "constant:5,-5", "--verbose")
    table = call("simulate", "light", *turning).stdout
    assert "× 10⁻⁶ cm⁻²\nfrom (15.0, 35.0) cm" in table
    rows = [line.split() for line in table.partition("contact\n")[2].splitlines()]
    assert len(rows) == 20 and all(abs(float(row[3])) <= 180 for row in rows)
    for words in (("arena", "light-seeking"), ("profile", "thymio")):
        assert call(*words, "--picture", tmp_path / f"{words[0]}.pdf").exit_code == 0
        assert b"/FontFile2" in (tmp_path / f"{words[0]}.pdf").read_bytes()  # TrueType, embedded


def test_probe_reads_as_often_as_it_is_asked(json_of, call):
    """Whole counts that vary; without noise the model's own, unrounded, felt in front of a wall."""
    made = json_of("probe", "light", "--pose", "60,35,0", "--repeat", 50)
    ambient = np.array(made["ambient"])
    assert np.shape(made["proximity"]) == ambient.shape == (50, 8)
    assert (ambient == np.round(ambient)).all() and (ambient.std(axis=0) > 0).any()
    exact = np.array(
        json_of("probe", "avoidance", "--pose", "25,6,-90", "--noise", 0, "--repeat", 3)["proximity"]
    )
    assert (exact == exact[0]).all() and (exact[:, 2:4] != np.round(exact[:, 2:4])).all()
    assert exact[0, 2:4].min() > exact[0, 6:8].max() and exact[0, 2] == pytest.approx(exact[0, 3])
    five = call("probe", "avoidance", "--pose", "25,7,-90", "--profile", "examples/five_eyes.toml").stdout
    assert "s4" in five and "s5" not in five and "ambient" not in five


def test_a_room_without_a_lamp_is_noted(call):
    """Light seeking where no lamp is goes on, with a note; with one there is none."""
    dark = call("probe", "light", "--arena", "obstacle-avoidance", "--pose", "25,25,0")
    assert dark.exit_code == 0 and "note: arena 'obstacle-avoidance' has no lamp" in dark.stderr
    assert call("probe", "light", "--pose", "25,25,0").stderr == ""
