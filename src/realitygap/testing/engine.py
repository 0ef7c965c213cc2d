"""What every engine does, whatever carries its trials out."""

from typing import Any
from unittest import TestCase

import numpy as np

from realitygap.control.operators import Variation
from realitygap.errors import UsageError
from realitygap.kernels.params import Networks, Path
from realitygap.kernels.rng import substream
from realitygap.simulation.simulation import Engine, Simulation, Streams
from realitygap.tasks.load import load_task
from realitygap.tasks.task import Task
from realitygap.world.robot import Profile, load_profile

__all__ = ["EngineContract"]

NETWORKS, TRIALS = 5, 3


class EngineContract:
    """Tests of an engine: override `made`, and set `exact` unless its bits are those of the kernels.

    Example:
        class TestMyEngine(EngineContract):
            exact = False

            def made(self, task, profile, noise):
                return MyEngine(task, profile, noise)
    """

    exact = True
    tasks = ("obstacle-avoidance", "light-seeking")

    def made(self, task: Task, profile: Profile, noise: float) -> Engine:
        """The engine."""
        raise NotImplementedError("override made()")

    def test_scores_have_the_shape_of_their_streams(self) -> None:
        """A finite score for each trial, the same for the same streams."""
        for engine, networks, streams in self._engines():
            engine.compile()
            scores = engine.scores(networks, streams)
            assert scores.shape == streams.shape and scores.dtype == np.float64
            assert np.isfinite(scores).all() and np.array_equal(scores, engine.scores(networks, streams))

    def test_a_trial_is_a_function_of_its_network_and_stream(self) -> None:
        """Neither its place in a batch nor what else is in it changes a bit."""
        for engine, networks, streams in self._engines():
            together = engine.scores(networks, streams)
            turned = _some(networks, slice(None, None, -1))
            assert np.array_equal(engine.scores(turned, streams[::-1])[::-1], together)
            for k in range(NETWORKS):
                alone = _some(networks, slice(k, k + 1))
                assert np.array_equal(engine.scores(alone, streams[k : k + 1, :1])[0], together[k, :1])

    def test_scores_are_of_the_tracks(self) -> None:
        """The task's score, as plain Python, of each track."""
        for name, (engine, networks, streams) in zip(self.tasks, self._engines(), strict=True):
            task, robot = load_task(name), load_profile("paper")
            scores, tracks = engine.scores(networks, streams), engine.tracks(networks, streams)
            assert tracks.x.shape == (*streams.shape, task.steps)
            for k in np.ndindex(*streams.shape):
                path = Path(*(np.ascontiguousarray(rows[k]) for rows in tracks))
                assert np.isclose(task.score(path, task.room(robot)), scores[k], rtol=1e-12, atol=0.0)

    def test_robots_stay_in_their_arena(self) -> None:
        """No robot is ever in a wall."""
        for name, (engine, networks, streams) in zip(self.tasks, self._engines(), strict=True):
            size, radius = load_task(name).arena.size_cm, load_profile("paper").body.radius_cm
            tracks = engine.tracks(networks, streams)
            for places, length in ((tracks.x, size[0]), (tracks.y, size[1])):
                assert (places > radius - 1e-9).all() and (places < length - radius + 1e-9).all()

    def test_wrong_batches_are_refused(self) -> None:
        """Streams that are not a row for each network end in a message, not in a result."""
        for engine, networks, streams in self._engines():
            mistakes: list[Any] = [streams[1:], streams.astype(np.int64), streams[0]]
            for wrong in mistakes:
                accepted = f"streams {wrong.dtype}{list(wrong.shape)} were accepted"
                with TestCase().assertRaises(UsageError, msg=accepted):
                    engine.scores(networks, wrong)

    def test_it_agrees_with_the_kernels(self) -> None:
        """The scores are those of the processor's cores, to the bit if the engine is `exact`."""
        for name, (engine, networks, streams) in zip(self.tasks, self._engines(), strict=True):
            cores = Simulation(name, "paper", 1.0).scores(networks, streams)
            scores = engine.scores(networks, streams)
            same = np.array_equal(scores, cores)
            assert same if self.exact else np.isclose(scores.mean(), cores.mean(), rtol=0.25)

    def _networks(self) -> Networks:
        variation = Variation(start_neurons=0.3)
        return variation.decode(np.stack([variation.random(np.uint64(k)) for k in range(NETWORKS)]))

    def _engines(self) -> list[tuple[Engine, Networks, Streams]]:
        """The engine at each task, with the same networks and streams."""
        networks = self._networks()
        names = [[substream(np.uint64(k), t) for t in range(TRIALS)] for k in range(NETWORKS)]
        streams = np.array(names, np.uint64)
        robot = load_profile("paper")
        return [(self.made(load_task(name), robot, 1.0), networks, streams) for name in self.tasks]


def _some(networks: Networks, which: slice) -> Networks:
    """Rows of a batch of networks."""
    arrays: Any = [np.ascontiguousarray(array[which]) for array in networks]
    return Networks(*arrays)
