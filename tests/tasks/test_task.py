"""Tasks as values: the paper's two, what the kernels get, names, and every refusal."""

from dataclasses import replace

import pytest

from realitygap.errors import TaskError
from realitygap.tasks import TASKS, Start, Task, load_task
from realitygap.world.robot import load_profile
from realitygap.world.sensors import UNLIT


@pytest.fixture(scope="module")
def avoidance() -> Task:
    """The paper's obstacle avoidance."""
    return load_task("obstacle-avoidance")


def test_the_papers_tasks():
    """Two trials of twenty seconds; proximity for avoidance, ambient light for light seeking (§6)."""
    tasks = [load_task(name) for name in TASKS]
    assert [task.feeds for task in tasks] == ["proximity", "ambient"]
    assert {(task.seconds, task.steps, task.trials) for task in tasks} == {(20.0, 200, 2)}
    assert all(task.of(load_profile("paper")).sensors == tuple(range(8)) for task in tasks)
    assert all(task.source is None for task in tasks)


@pytest.mark.parametrize("word", ["light-seeking", "Light Seeking", "light_seeking", "light", "SEEKING"])
def test_tasks_answer_to_their_words(word):
    """A task is found by its name in any case, with spaces or underscores, or by one of its words."""
    assert load_task(word).name == "light-seeking"


def test_unknown_task():
    """An unknown name is refused with the nearest name and the list."""
    with pytest.raises(
        TaskError, match=r"unknown task 'obstacles'.*Known: obstacle-avoidance, light-seeking"
    ):
        load_task("obstacles")


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"name": "My task"}, "name: expected lower-case letters"),
        ({"seconds": 0.25}, r"seconds: expected a multiple of 0\.1 from 0\.1 to 100000, got 0\.25"),
        ({"trials": 0}, "trials: expected a whole number, 1 or more, got 0"),
        ({"feeds": "sound"}, "feeds: expected 'proximity' or 'ambient' or 'proximity.ambient', got 'sound'"),
        ({"sensors": range(17)}, "sensors: expected at most 16 sensors"),
        ({"sensors": 8}, "sensors: expected a tuple of numbers, got 8"),
        ({"arena": "moon"}, "unknown arena 'moon'"),
        (
            {"start": Start(x_cm=15, y_cm=15)},
            r"start: expected a free place .* overlaps the cylinder at \(15, 15\)",
        ),
    ],
)
def test_wrong_values_are_refused_by_name(avoidance, change, told):
    """A wrong value is refused by its name, with what was expected, what came and the task."""
    with pytest.raises(TaskError, match=told):
        replace(avoidance, **change)


@pytest.mark.parametrize("seconds", [0.1, 0.3, 0.7, 10, 19.9, 3600.1])
def test_tenths_of_a_second_are_exact(avoidance, seconds):
    """Every multiple of 0.1 s is accepted, whatever its binary rounding."""
    assert replace(avoidance, seconds=seconds).steps == round(seconds * 10)


def test_a_robot_must_suit_the_task(avoidance):
    """A robot without the sensors that a task feeds, or too large for its start, is refused."""
    paper = load_profile("paper")
    few = replace(paper, infrared=replace(paper.infrared, sensors=paper.infrared.sensors[:6]))
    with pytest.raises(TaskError, match=r"sensors: expected proximity sensors .* which has 6, got number 6"):
        replace(avoidance, sensors=range(8)).to_kernel(few)
    assert avoidance.to_kernel(few).channels.tolist() == list(range(6))
    none = replace(paper, ambient=UNLIT)
    with pytest.raises(TaskError, match=r"feeds: profile 'paper' has no ambient sensors"):
        load_task("light-seeking").to_kernel(none)
    large = replace(paper, body=replace(paper.body, radius_cm=8))
    with pytest.raises(TaskError, match=r"start: a robot of radius 8 cm .* may overlap the cylinder"):
        avoidance.to_kernel(large)
