"""Engines: the contract, the cores' engine, and a slow one that a user might have written."""

from __future__ import annotations

import numpy as np
import pytest

from realitygap.errors import TaskError, UsageError
from realitygap.kernels.types import Networks, Path
from realitygap.simulation.simulation import Simulation
from realitygap.tasks import load_task
from realitygap.testing import EngineContract


class OneByOne:
    """Lives each trial by itself and takes its score in plain Python."""

    def __init__(self, task, profile, noise):
        self.simulation = Simulation(task, profile, noise)
        self.task, self.room = task, task.room(profile)

    def scores(self, networks, streams):
        tracks = self.tracks(networks, streams)
        found = np.zeros(streams.shape)
        for k in np.ndindex(*streams.shape):
            path = Path(*(np.ascontiguousarray(rows[k]) for rows in tracks))
            found[k] = self.task.score(path, self.room)
        return found

    def tracks(self, networks, streams):
        self.simulation.checked(networks, streams)
        found = np.zeros((len(Path._fields), *streams.shape, self.task.steps))
        for k, t in np.ndindex(*streams.shape):
            one = Networks(*(array[k : k + 1] for array in networks))
            found[:, k, t] = np.array(self.simulation.tracks(one, streams[k : k + 1, t : t + 1]))[:, 0, 0]
        return Path(*found)

    def compile(self):
        self.simulation.compile()


class TestSimulation(EngineContract):
    def made(self, task, profile, noise):
        return Simulation(task, profile, noise)


class TestOneByOne(EngineContract):
    def made(self, task, profile, noise):
        return OneByOne(task, profile, noise)


def test_a_simulation_takes_another_engine():
    """Batches go to the engine that a simulation is given, with its task, robot and noise."""
    made = []

    def engine(task, profile, noise):
        made.append((task.name, profile.name, noise))
        return OneByOne(task, profile, noise)

    simulation = Simulation("light", "paper", "double", engine=engine)
    assert made == [("light-seeking", "paper", 2.0)] and isinstance(simulation.engine, OneByOne)


@pytest.mark.parametrize("spoiled", [lambda scores: scores[:, 0], lambda scores: scores * np.nan])
def test_scores_of_another_form_are_refused(spoiled):
    """Evolution would select by them."""

    def scores(self, networks, streams):
        return spoiled(OneByOne.scores(self, networks, streams))

    simulation = Simulation("light", "paper", engine=type("Mine", (OneByOne,), {"scores": scores}))
    networks, streams = EngineContract()._networks(), np.arange(10, dtype=np.uint64).reshape(5, 2)
    with pytest.raises(UsageError, match=r"^engine Mine: expected finite scores float64\[5, 2\]"):
        simulation.scores(networks, streams)


def test_a_score_that_stops_in_a_batch_is_told_by_its_line(tmp_path):
    """The first path on which a user's score fails is found again, and its line named."""
    file = tmp_path / "touchy.py"
    file.write_text(
        "from realitygap import Start, Task\n\n\ndef score(path, room):\n"
        "    total = 0.0\n    for i in range(path.x.size):\n        total += path.x[i]\n"
        "    if total > 0.0 and path.left[0] != 0.0:\n"
        "        return path.x[path.x.size + 3]\n    return total\n\n\n"
        'task = Task(name="touchy", arena="obstacle-avoidance", feeds="proximity", seconds=1.0,\n'
        "            start=Start(x_cm=25, y_cm=25), score=score)\n"
    )
    task = load_task(file)
    simulation = Simulation(task, "paper")
    networks = EngineContract()._networks()
    with pytest.raises(TaskError, match=r"touchy.py, line 9: the score fails with IndexError"):
        simulation.scores(networks, np.arange(10, dtype=np.uint64).reshape(5, 2))
