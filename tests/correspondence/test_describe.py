"""Batches told in tracks and descriptors: each trial's own, as it is told alone."""

import numpy as np
import pytest

from realitygap import Genotype, Simulation, describe, load_profile, load_task
from realitygap.correspondence.descriptors import chosen, describe_all
from realitygap.correspondence.trials import Trial
from realitygap.errors import UsageError


@pytest.mark.parametrize("name", ["avoidance", "light"])
def test_each_trial_of_a_batch_is_told_as_alone(name):
    """Tracks are the trajectories', descriptors those of their trials; an array [networks, trials] each."""
    simulation = Simulation(load_task(name), load_profile("paper"))
    genes = [Genotype.braitenberg(simulation.task.feeds).genes, Genotype.constant(3, 2).genes]
    networks, streams = Genotype.decode(np.stack(genes), 8), np.arange(6, dtype=np.uint64).reshape(2, 3)
    path = simulation.tracks(networks, streams)
    told = describe(path, name, "paper")
    assert {d.name for d in chosen(simulation.task.arena)} <= set(told)
    for n in range(2):
        alone, _ = simulation.trajectory(Genotype.decode(genes[n], 8), stream=int(streams[n, 1]))
        track = alone.track
        assert (path.x[n, 1] == track.x[1:]).all() and (
            path.contact[n, 1] > 0
        ).tolist() == alone.contact.tolist()
        trial = Trial(x=track.x[1:], y=track.y[1:], heading=np.unwrap(alone.track.heading)[1:])
        for key, values in describe_all([trial], simulation.task.arena).items():
            assert told[key].shape == (2, 3)
            assert told[key][n, 1] == pytest.approx(values[0], rel=1e-6, abs=1e-6, nan_ok=True), key


def test_a_path_of_another_place_is_refused():
    """Outside the task's arena nothing around the robot is what it was."""
    light = Simulation("light", "paper")
    path = light.tracks(Genotype.braitenberg("ambient").networks(), np.array([[1, 2]], np.uint64))
    with pytest.raises(UsageError, match=r"inside the arena of task 'obstacle-avoidance'.*simulation\.task"):
        describe(path, "avoidance", "paper")
