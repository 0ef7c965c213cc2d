"""`simulate`: a whole trial, step by step, in the units that people read."""

import math
from pathlib import Path

import pytest

EXAMPLE = Path(__file__).parents[2] / "examples" / "follow_the_wall.py"
KEYS = {
    "t_s", "x_cm", "y_cm", "heading_deg", "proximity", "ambient", "inputs", "commands", "wheels", "contact",
}  # fmt: skip
FORWARD = ("simulate", "avoidance", "--controller", "constant:2,2", "--pose", 25, 25, 0)


def test_every_key_has_an_entry_a_step(json_of):
    """Twenty seconds are 200 entries under every key, each of the stated width."""
    made = json_of(*FORWARD)
    assert {*made} >= {*KEYS, "score", "task", "profile", "noise", "seed"}
    assert all(len(made[key]) == 200 for key in KEYS)
    for key, width in {"proximity": 8, "ambient": 8, "inputs": 8, "commands": 2, "wheels": 2}.items():
        assert {len(row) for row in made[key]} == {width}
    assert made["t_s"][:3] == [0.0, 0.1, 0.2]
    assert {type(flag) for flag in made["contact"]} == {bool}
    assert isinstance(made["score"], float)


def test_it_begins_at_the_pose(json_of):
    """The first entry is where the robot was put, negative headings included."""
    made = json_of(*FORWARD[:-1], -90, "--noise", "zero", "--seconds", 1)
    assert (made["x_cm"][0], made["y_cm"][0]) == (25, 25)
    assert made["heading_deg"][0] == pytest.approx(-90)
    assert made["y_cm"][-1] < 25
    assert len(made["t_s"]) == 10


def test_negative_commands_are_words_too(json_of):
    """`constant:-3,5` is a controller, not an option, and turns the robot to the left."""
    words = ("simulate", "light", "--controller", "constant:-3,5", "--pose", 15, 35, 0)
    made = json_of(*words, "--noise", "zero")
    assert made["commands"] == [[-3, 5]] * 200
    assert made["heading_deg"][-1] > 90


def test_without_noise_a_wheel_settles_on_its_command(json_of):
    """Two units asked for are two units achieved, and 1.6 cm driven in each second."""
    made = json_of(*FORWARD, "--noise", "zero", "--seconds", 5)
    assert made["wheels"][-1] == pytest.approx([2, 2], abs=0.02)
    assert made["x_cm"][-1] - made["x_cm"][-11] == pytest.approx(1.6, abs=0.02)
    assert made["y_cm"][-1] == pytest.approx(25)


def test_the_same_seed_is_the_same_trial(json_of):
    """A seed names a trial; another seed is another one."""
    assert json_of(*FORWARD, "--seed", 4) == json_of(*FORWARD, "--seed", 4)
    assert json_of(*FORWARD, "--seed", 4)["x_cm"] != json_of(*FORWARD, "--seed", 5)["x_cm"]


def test_a_trial_lasts_as_long_as_the_task(json_of, tmp_path):
    """Unless another length is given."""
    text = EXAMPLE.read_text("utf-8").replace("two_rooms.toml", "light-seeking")
    task = tmp_path / "short.py"
    task.write_text(text.replace("seconds=20", "seconds=1.5"))
    words = ("simulate", task, "--controller", "constant:1,1", "--pose", 15, 35, 0)
    assert len(json_of(*words)["t_s"]) == 15
    assert len(json_of(*words, "--seconds", 0.5)["t_s"]) == 5


def test_braitenberg_reaches_the_lamp(json_of):
    """The hand-made light seeker ends nearer to the lamp than it began."""
    made = json_of("simulate", "light", "--controller", "braitenberg", "--pose", 15, 35, 60)
    begin, end = (math.hypot(110 - made["x_cm"][k], 35 - made["y_cm"][k]) for k in (0, -1))
    assert end < begin / 2


def test_a_genotype_can_be_saved_and_driven(json_of, tmp_path):
    """A genotype's file does what the controller it was made of does."""
    import realitygap

    file = tmp_path / "mine.txt"
    realitygap.Genotype.constant(2, 2).save(file)
    assert json_of(*FORWARD[:3], file, *FORWARD[4:])["x_cm"] == json_of(*FORWARD)["x_cm"]


def test_a_robot_and_an_arena_of_ones_own(call, json_of, tmp_path):
    """What `profile show` and `arena show` print can be changed and given back."""
    robot, room = tmp_path / "mine.toml", tmp_path / "room.toml"
    robot.write_text(call("profile", "show", "paper").stdout.replace('name = "paper"', 'name = "mine"', 1))
    room.write_text(call("arena", "show", "light-seeking").stdout)
    made = json_of(*FORWARD, "--profile", robot, "--arena", room, "--seconds", 1)
    assert (made["profile"], made["arena"]) == ("mine", "light-seeking")
    for text in (robot.read_text(), room.read_text()):
        assert text.count("#") > 5  # the shipped file's own comments
    bare = call("profile", "show", robot).stdout
    assert "#" not in bare and 'name = "mine"' in bare


def test_a_small_room_of_ones_own(json_of, tmp_path):
    """A room in which the task's own start would not be free serves all the same."""
    room = tmp_path / "box.toml"
    room.write_text('name = "box"\nsize_cm = [12, 12]\n')
    made = json_of(*FORWARD[:-3], 6, 6, 0, "--arena", room, "--seconds", 5)
    assert max(made["x_cm"]) < 12 - 2.9 + 1e-6
    assert any(made["contact"])


def test_the_text_says_where_it_went(call):
    """Without --json there is a table and the score."""
    result = call(*FORWARD)
    assert result.exit_code == 0
    assert "x cm" in result.stdout
    assert "score" in result.stdout.splitlines()[-1]


@pytest.mark.parametrize("kind", ["png", "svg"])
def test_the_path_can_be_drawn(call, tmp_path, kind):
    """--picture leaves a file of its kind."""
    file = tmp_path / f"path.{kind}"
    assert call(*FORWARD, "--seconds", 2, "--picture", file).exit_code == 0
    assert file.read_bytes()[:5] in (b"\x89PNG\r", b"<?xml")


def test_profile_show_tells_every_sensor(json_of):
    """The profile's JSON holds eight proximity and eight ambient sensors with their places."""
    told = json_of("profile", "show", "paper")
    assert len(told["infrared"]["sensors"]) == len(told["ambient"]["sensors"]) == 8
    assert told["body"]["radius_cm"] == 2.9
