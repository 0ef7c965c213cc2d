"""A study keeps copies of all that it is made of."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from realitygap.errors import ConfigError
from realitygap.study.config import StudyConfig
from realitygap.study.folder import gather, own
from realitygap.study.plan import plans, run_stream, trial_streams
from realitygap.world.arena import load_arena

TASK = """
from realitygap import Start, Task

def score(path, room):
    return path.contact.mean()

task = Task(name="touch", arena="room.toml", feeds="proximity", start=Start(x_cm=25, y_cm=25), score=score)
"""


@pytest.fixture
def mine(tmp_path) -> Path:
    """A user's task file with its arena beside it."""
    folder = tmp_path / "mine"
    folder.mkdir()
    (folder / "room.toml").write_text(load_arena("obstacle-avoidance").to_toml())
    (folder / "touch.py").write_text(TASK)
    return folder / "touch.py"


def put(files: dict[str, bytes], folder: Path) -> None:
    for name, content in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(content)


def test_copies_load_to_the_same(mine, tmp_path):
    """What a study keeps loads to equal tasks and robot when the user's own files are gone."""
    config = StudyConfig.single(mine, profile="paper").with_settings(["task.seconds=3"])
    first = gather(config)
    local, files = first.copies()
    put(files, tmp_path / "study")
    mine.unlink()
    (mine.parent / "room.toml").unlink()
    again = gather(own(local, tmp_path / "study"))
    assert again.tasks[0].to_dict() == first.tasks[0].to_dict() and again.tasks[0].seconds == 3
    assert again.profile == first.profile
    assert again.copies() == (local, files)


def test_another_arena_takes_the_tasks_place(tmp_path):
    """`arenas` gives a task another arena, by the task's name; an unknown name is refused."""
    (tmp_path / "wide.toml").write_text(replace(load_arena("obstacle-avoidance"), sliding=0.5).to_toml())
    config = StudyConfig.single("avoidance", arenas={"obstacle-avoidance": str(tmp_path / "wide.toml")})
    assert gather(config).tasks[0].arena.sliding == 0.5
    with pytest.raises(ConfigError, match=r"arenas.avoid: no such task .* Did you mean 'obstacle-avoidance'"):
        gather(StudyConfig.single("avoidance", arenas={"avoid": "light-seeking"}))


def test_runs_are_numbered_condition_by_condition():
    """Ids count from 1; names tell task, noise and index."""
    made = plans(gather(StudyConfig.reproduction(runs=2)))
    assert [plan.id for plan in made] == list(range(1, 13))
    assert [made[i].name for i in (0, 3, 11)] == [
        "obstacle-avoidance/zero/1",
        "obstacle-avoidance/observed/2",
        "light-seeking/double/2",
    ]
    assert len({int(plan.stream) for plan in made}) == 12


def test_a_runs_stream_depends_on_seed_task_noise_and_index_only():
    """The same run in another study, or as one of more runs, has the same randomness."""
    whole = {plan.name: plan.stream for plan in plans(gather(StudyConfig.reproduction(runs=3)))}
    alone = plans(gather(StudyConfig.single("light", "double", runs=2)))
    assert all(whole[plan.name] == plan.stream for plan in alone)
    streams = {int(run_stream(*names)) for names in [
        (1, "a", 1.0, 1), (2, "a", 1.0, 1), (1, "b", 1.0, 1), (1, "a", 2.0, 1), (1, "a", 1.0, 2)
    ]}  # fmt: skip
    assert len(streams) == 5


def test_trial_streams_do_not_depend_on_where_a_chunk_begins():
    """Evaluation e, trial t have one stream, however a run is cut into pieces."""
    stream = alone = plans(gather(StudyConfig.single("light")))[0].stream
    whole = trial_streams(stream, 0, 10, 3)
    assert (trial_streams(alone, 4, 6, 3) == whole[4:]).all()
    assert len(set(whole.ravel().tolist())) == 30
