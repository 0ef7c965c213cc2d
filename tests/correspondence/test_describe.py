"""Batches told in tracks and descriptors: each trial's own, as it is told alone."""

import numpy as np
import pytest

from realitygap import Genotype, Simulation, describe, load_profile, load_task
from realitygap.correspondence.catalogue import chosen
from realitygap.correspondence.descriptors import describe_all
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


@pytest.fixture(scope="module")
def path():
    """Two trials at light seeking."""
    light = Simulation("light", "paper")
    return light.tracks(Genotype.braitenberg("ambient").networks(), np.array([[1, 2]], np.uint64))


@pytest.mark.parametrize(
    ("change", "task", "says"),
    [
        (lambda p: p, "avoidance", "inside the arena of task 'obstacle-avoidance'.*simulation.task"),
        (lambda p: p._replace(y=p.y[0]), "light", "of one shape, got float64"),
        (lambda p: p._replace(heading=p.heading[..., :100]), "light", "of one shape"),
        (lambda p: p._replace(x=0.0, y=0.0, heading=0.0), "light", "of one shape, got float, float, float"),
    ],
)
def test_a_path_of_another_place_or_shape_is_refused(path, change, task, says):
    """It is told what was expected; lists of one shape are told as arrays are."""
    with pytest.raises(UsageError, match=says):
        describe(change(path), task, "paper")
    listed = type(path)(*(column.tolist() for column in path))
    assert (describe(listed, "light", "paper")["speed"] == describe(path, "light", "paper")["speed"]).all()
