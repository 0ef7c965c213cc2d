"""Replays finished transfers: readings and decisions of the simulated and the situated robot."""

from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

from realitygap.control.genotype import Genotype
from realitygap.errors import UsageError
from realitygap.evolution.algorithm import Genes
from realitygap.robots.drive import Recording
from realitygap.simulation.simulation import Simulation
from realitygap.study.load import Study
from realitygap.track import Trajectory
from realitygap.transfer.record import load_transfer, read_trial
from realitygap.transfer.spec import transfer_stream
from realitygap.work.archive import unpacked

__all__ = ["Replay", "Replays"]

SAME_CM = 0.001
"""A path farther than this from the stored one is not that trial's."""


class Replay(NamedTuple):
    """The driving network, and what is known of both drives besides their paths; None if unknown."""

    genotype: Genotype | None
    simulated: Trajectory | None
    situated: Recording | None


class Replays:
    """Replays a study's transfers; simulations are made once for each task and noise level."""

    def __init__(self, study: Study) -> None:
        self._study = study
        self._simulation = cache(lambda task, noise: Simulation(study.task(task), study.profile, noise))
        self.quiet = cache(lambda task: Simulation(study.task(task), study.profile, 0.0))

    def of(self, folder: Path) -> Replay:
        """The transfer of a trial's folder.

        A trial of another version whose path would differ today is not presented as the stored one: its
            readings are None.
        """
        table = read_trial(folder)
        situated = _recording(folder)
        if not {"evaluation", "seed"} <= table.keys():
            return Replay(None, None, situated)
        try:
            genes = self._study.genotype(table["run"], table["evaluation"])
        except UsageError:  # the study was created again since
            return Replay(None, None, situated)
        simulated = self._simulated(folder, genes, int(table["seed"]))
        return Replay(self._study.slots(self._study.run(table["run"]).task, genes), simulated, situated)

    def _simulated(self, folder: Path, genes: Genes, seed: int) -> Trajectory | None:
        one, study = load_transfer(folder), self._study
        simulation = self._simulation(one.task, one.noise)
        stream = transfer_stream(seed, study.run(one.run), one.start)
        drawn = simulation.start(stream)
        apart = np.hypot(drawn.x - one.pose.x, drawn.y - one.pose.y)
        # A file's degrees do not give the last bit of the radians: the drawn pose is used where it agrees.
        pose = drawn if apart < SAME_CM and abs(drawn.heading_deg - one.pose.heading_deg) < 1e-6 else one.pose
        networks = study.networks(one.task, genes)
        try:
            trajectory, _ = simulation.trajectory(networks, stream=stream, pose=pose, seconds=one.seconds)
        except UsageError:  # the arena's file was changed since, and the pose is invalid
            return None
        track, path = trajectory.track, one.simulated
        if len(track) != len(path):
            return None
        apart = np.hypot(track.x - path.x, track.y - path.y)
        return trajectory if float(apart.max()) < SAME_CM else None


def _recording(folder: Path) -> Recording | None:
    try:
        with unpacked(folder) as here:
            return Recording.from_folder(here)
    except UsageError:
        return None
