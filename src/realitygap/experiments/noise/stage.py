"""What the trials of a study of noise need, loaded once in a process: robots, tasks, genes, starts."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np

from realitygap.calibration.unit_folder import PROFILE
from realitygap.controller.encoding import Encoding, controller_of
from realitygap.controller.network import NetworkController
from realitygap.evolution.algorithm import Genes
from realitygap.evolution.population import Population
from realitygap.experiments.noise import plan
from realitygap.experiments.noise.config import NoiseConfig
from realitygap.experiments.noise.plan import Controller, Evolved
from realitygap.kernels.params import Networks
from realitygap.simulation.simulation import Simulation
from realitygap.study.load import load_study
from realitygap.values import Pose
from realitygap.world.profile import load_profile

__all__ = ["Stage"]


class Stage:
    """The calibrated units and evolved controllers of the study in a folder.

    Attributes:
        champions: known genes, for workers that cannot see evolution's studies.
    """

    def __init__(self, folder: Path, config: NoiseConfig) -> None:
        self.folder, self.config = folder, config
        self.champions: dict[Controller, Genes] = {}
        self.profile = cache(lambda unit: load_profile(plan.calibration_folder(folder, unit) / PROFILE))
        self.task = cache(config.task)
        self.starts = cache(self._starts)
        self._study = cache(lambda made: load_study(plan.evolved_folder(folder, config, made)))
        self._encoding = cache(self._made)

    def networks(self, one: Controller) -> Networks:
        """A controller's network."""
        return self._encoding(one.task, one.home).decode(self.genes(one)[np.newaxis])

    def driver(self, one: Controller) -> NetworkController:
        """The same as a controller of a robot."""
        return controller_of(self._encoding(one.task, one.home), self.genes(one))

    def genes(self, one: Controller) -> Genes:
        """Its run's champion, or the highest stored fitness of the last population (the first of equals)."""
        genes = self.champions.get(one)
        if genes is None:
            study = self._study(plan.evolved(self.config, one))
            run = study.run(one.run_name)
            if one.individual == "champion":
                genes = run.champion
            else:
                last = study.state(run.id)
                assert isinstance(last, Population)
                genes = last.genes[np.argmax(last.fitness)]
            assert genes is not None
        return genes

    def simulation(self, task: str, unit: int, home: int, level: float) -> Simulation:
        """The simulation calibrated to a unit, for controllers with any calibration unit.

        The input range (§7.2, "bands") belongs to the controller, which keeps that of its calibration unit
        (`home`) on every robot, twin or simulated.

        Args:
            task: its name.
            unit: of the simulation's calibration.
            home: the controllers' calibration unit.
            level: of noise.
        """
        robot, own = self.profile(unit), self.profile(home)
        worn = replace(
            robot,
            infrared=replace(robot.infrared, bands=own.infrared.bands),
            ambient=replace(robot.ambient, bands=own.ambient.bands),
        )
        return Simulation(self.task(task), worn, level)

    def _made(self, task: str, home: int) -> Encoding:
        any_of = Evolved(1, home, 1, self.config.levels)
        made = plan.evolution(self.config, any_of, plan.calibration_folder(self.folder, home) / PROFILE)
        return made.encoding_for(self.task(task).of(self.profile(home)))

    def _starts(self, task: str, seed_set: int, unit: int) -> tuple[Pose, ...]:
        """Starts of the trials on a unit: the same for all controllers and levels."""
        config, numbers = self.config, range(1, self.config.starts + 1)
        own = config.starts_by_unit
        simulation = Simulation(self.task(task), self.profile(unit if own else 1))
        names = (task, "unit", unit) if own else (task, seed_set)
        return tuple(simulation.start(plan.stream(config, "start", *names, k)) for k in numbers)
