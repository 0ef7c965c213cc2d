"""The how-to's list of what `path` and `room` hold is the code's."""

import re
from pathlib import Path as File

import numpy as np

from realitygap import Genotype, Simulation, Task, load_task
from realitygap.kernels.types import Path, Room
from realitygap.study.config import StudyConfig

HOW_TO = File(__file__).resolve().parents[2] / "docs" / "how-to-own-parts.md"


def listed(what: str) -> dict[str, str]:
    """Shape by name, as the how-to's table has it."""
    text = HOW_TO.read_text("utf-8")
    return dict(re.findall(rf"^\| `{what}\.(\w+)` \| ([^|]*?) \|", text, re.M))


def test_every_array_is_listed_with_its_shape():
    """In the code's order; a field that is added or renamed has to be told."""
    simulation = Simulation("light", "paper")
    path = simulation.tracks(Genotype.constant(3, 3).networks(), np.zeros((1, 1), np.uint64))
    room, sizes = simulation.task.room(simulation.profile), {"steps": 200, "lamps": 1, "cylinders": 0}
    for what, kind, values in (("path", Path, [one[0, 0] for one in path]), ("room", Room, list(room))):
        shapes = listed(what)
        assert list(shapes) == list(kind._fields)
        for name, value in zip(kind._fields, values, strict=True):
            told = shapes[name]
            expected = () if told == "a number" else tuple(
                sizes[word] if word in sizes else int(word) for word in told.strip("[]").split(", ")
            )  # fmt: skip
            assert np.shape(value) == expected, name


def test_a_task_goes_wherever_its_name_goes():
    """Simulation, studies' settings, tracks' arenas: a Task does what its name does."""
    from realitygap import drive, drive_simulated, setting_of
    from realitygap.correspondence.trials import trial_of
    from realitygap.simulation.body import SimulatedBody

    task = load_task("avoidance")
    assert isinstance(task, Task) and StudyConfig.single(task) == StudyConfig.single("obstacle-avoidance")
    trials, scores = [], []
    for named in (task, "avoidance"):
        simulation = Simulation(named, "paper")
        lived, _ = drive_simulated(simulation, _steady(), stream=2)
        trials.append(trial_of(lived))
        scores.append(drive(SimulatedBody(simulation), _steady(), task=named).score)
    assert scores[0] == scores[1] and (trials[0].x == trials[1].x).all()
    assert setting_of(trials[:1], task) == setting_of(trials[:1], "avoidance")


def _steady():
    from realitygap.control.controllers import own_controller

    return own_controller(lambda inputs: (3, 2))
