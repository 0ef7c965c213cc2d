"""The examples work as their page says: a task, an arena and a robot of one's own."""

import json
from pathlib import Path

from click.testing import CliRunner

from realitygap import load_study
from realitygap.cli import realitygap

EXAMPLES = Path(__file__).resolve().parents[1] / "examples"


def run(*words: str) -> str:
    """The output of a command that must succeed."""
    result = CliRunner().invoke(realitygap, [str(word) for word in words])
    assert result.exit_code == 0, result.output
    return result.stdout


def test_a_task_of_ones_own_evolves(tmp_path):
    """The third task, in one Python file with an arena of its own, evolves compiled."""
    words = ("--evaluations", "80", "--set", "task.seconds=4.0", "--workers", "1", "--out", tmp_path / "wall")
    run("evolve", EXAMPLES / "follow_the_wall.py", *words)
    study = load_study(tmp_path / "wall")
    assert study.runs[0].finished and study.runs[0].best_fitness > 0
    assert (tmp_path / "wall" / "report" / "index.html").is_file()


def test_a_robot_and_an_arena_of_ones_own():
    """Another robot in another arena reads what is there, all of its sensors."""
    robot, arena = EXAMPLES / "hexagon.toml", EXAMPLES / "two_rooms.toml"
    pose = ("--pose", "20", "20", "-90", "--noise", "zero", "--json")
    read = json.loads(run("probe", "avoidance", "--profile", robot, "--arena", arena, *pose))
    assert len(read["proximity"][0]) == 6 and len(read["ambient"][0]) == 2
