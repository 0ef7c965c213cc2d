"""Reads a study, finished or not, even while another process works on it.

Tables are dictionaries of NumPy columns: `pandas.DataFrame(study.evaluations())` needs no more.
"""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from realitygap import lazy
from realitygap.control.encoding import Encoding, genotype_of
from realitygap.control.genotype import Genotype, NetworkController
from realitygap.errors import StudyError
from realitygap.evolution.algorithm import Genes, State
from realitygap.evolution.ga import Population
from realitygap.files import as_path, must_be
from realitygap.kernels.types import Networks
from realitygap.study.folder import agree, read_materials, read_profile
from realitygap.study.materials import Materials
from realitygap.study.plan import Plan
from realitygap.study.tables import Tables
from realitygap.tasks.task import Task
from realitygap.values import Pose
from realitygap.world.robot import Profile, noise_name

__all__ = ["Run", "Study", "as_study", "load_study"]


def load_study(path: str | PathLike[str], *, trust: bool = False) -> Study:
    """Load a study from its folder as it is now; evaluations are read when needed.

    Reading runs no user's code. A simulation in a user's own task runs that task's file, unless this user has
    neither evolved with it nor agreed to it.

    Args:
        path: the study's folder, or a Study, which is read again.
        trust: agree to run the task files that it brings, from now on.

    Raises:
        StudyError: no study there, a database that is broken or of another format, or a study.toml
            that has been edited since.
        ConfigError: a broken study.toml.
    """
    folder = as_path(path, "study")
    must_be(trust, bool, "trust", "True agrees to run its files.")
    if trust:
        agree(folder)
    return Study(folder)


def as_study(study: object) -> Study:
    """A Study unchanged, or the study of a folder's path."""
    return study if isinstance(study, Study) else load_study(as_path(study, "study"))


class Study(Tables):
    """A study: its configuration, its runs as of loading, its tables."""

    def __init__(self, folder: Path) -> None:
        super().__init__(folder)
        self.runs = [Run(**row, seed=self.config.seed, study=self) for row in self._rows]
        self._encodings: dict[str, Encoding] = {}

    def __fspath__(self) -> str:
        """Its folder: a Study works wherever a path to one is expected."""
        return str(self.folder)

    def __repr__(self) -> str:
        done = sum(run.finished for run in self.runs)
        return f"<Study {str(self.folder)!r}: {done} of {len(self.runs)} runs finished>"

    @cached_property
    def _materials(self) -> Materials:
        return read_materials(self.folder)

    @cached_property
    def profile(self) -> Profile:
        """The robot."""
        return read_profile(self.folder)

    def task(self, name: str | Task) -> Task:
        """A task of the study, with the study's settings and arena; this runs a user's file.

        Raises:
            StudyError: a file that this user has not agreed to run, or that has been edited since.
        """
        return self._materials.task(str(getattr(name, "name", name)))

    def facts(self, task: str | Task) -> dict[str, Any]:
        """A task without its score, as by `Task.to_dict`: no user's file is run.

        Raises:
            StudyError: the study has no such task.
        """
        task = str(getattr(task, "name", task))
        found = self._reader.tasks()
        if task not in found:
            known = ", ".join(found)
            raise StudyError(f"{self.folder}: expected a task of the study ({known}), got {task!r}.")
        return found[task]

    def encoding(self, task: str | Task) -> Encoding:
        """The encoding of a task's genotypes; this runs a user's file.

        Raises:
            StudyError: a file that this user has not agreed to run, or that has been edited since.
        """
        name = str(getattr(task, "name", task))
        if name not in self._encodings:
            own = "encoding" in self.config.own_files()
            config = self._materials.config if own else self.config
            sensors = self.facts(name)["sensors"]
            self._encodings[name] = config.encoding.make(len(sensors), config.variation)
        return self._encodings[name]

    def networks(self, task: str | Task, genes: Genes) -> Networks:
        """The network of one genotype, for the kernels."""
        must_be(genes, np.ndarray, "genotype", "run.champion is one.")
        return self.encoding(task).decode(genes[np.newaxis])

    def controller(self, task: str | Task, genes: Genes) -> NetworkController:
        """A controller that drives a body with a genotype's network."""
        return self.slots(task, genes).controller()

    def slots(self, task: str | Task, genes: Genes) -> Genotype:
        """A genotype as one of slots with the same network."""
        return genotype_of(self.encoding(task), genes)

    def run(self, id_or_name: int | str) -> Run:
        """One run.

        Raises:
            StudyError: no such run.
        """
        number = self._id(id_or_name)
        return next(run for run in self.runs if run.id == number)

    def show(self, height: int = 1150) -> Any:
        """The page's player in a notebook: every run's champion, simulated and situated; `save` writes it.

        Args:
            height: of its frame, in pixels.

        Raises:
            StudyError: no run has started.
        """
        return lazy.notebook().shown_study(self, height)

    def figures(self) -> Mapping[str, Any]:
        """The page's figures by name, each drawn by Matplotlib when first needed."""
        figures: Mapping[str, Any] = lazy.notebook().of_study(self)
        return figures

    def _repr_html_(self) -> str:
        return str(lazy.notebook().study_html(self))

    def state(self, run: int) -> State | None:
        """The state in a run's last checkpoint; None before the first. This may run a user's file."""
        kept = self._reader.checkpoint(self._id(run))
        if kept is None:
            return None
        with suppress(StudyError):  # what a Population wrote is read without a user's file
            return Population.from_bytes(kept)
        task, config = self.task(self.run(run).task), self._materials.config
        state: State = config.evolution.make(config.encoding_for(task)).from_bytes(kept)
        return state


@dataclass(frozen=True, kw_only=True)
class Run:
    """One evolutionary run so far; values that do not exist yet are None.

    Attributes:
        id: from 1; name: task/noise/index.
        noise: level (0 zero, 1 observed, 2 double); index: from 1 among the runs of its condition.
        seed: the study's; with task, noise and index it makes the run's own stream.
        best_fitness, fittest_number: the highest fitness stored, and its evaluation number.
        champion_number, champion_fitness: the best of the retest, and its mean score there.
        study: where its evaluations are.
    """

    id: int
    name: str
    task: str
    noise: float
    index: int
    seed: int
    evaluations: int
    best_fitness: float | None
    fittest_number: int | None
    champion_number: int | None
    champion_fitness: float | None
    finished: bool
    study: Study = field(repr=False, compare=False)

    @property
    def noise_name(self) -> str:
        """The noise level in words."""
        return noise_name(self.noise)

    @property
    def plan(self) -> Plan:
        """The run's plan; its `stream` is the source of its randomness."""
        return Plan(
            id=self.id, name=self.name, condition=(self.id - 1) // self.study.config.runs, task=self.task,
            noise=self.noise, index=self.index, seed=self.seed,
        )  # fmt: skip

    @property
    def fittest(self) -> Genes | None:
        """Genotype of the highest fitness stored: the paper's choice."""
        return None if self.fittest_number is None else self.study.genotype(self.id, self.fittest_number)

    @property
    def champion(self) -> Genes | None:
        """Genotype of the best of the last population on fresh trials."""
        return None if self.champion_number is None else self.study.genotype(self.id, self.champion_number)

    def individual(self, who: str | int) -> tuple[str, Genes]:
        """An individual ("champion", "fittest" or an evaluation's number) in words, and its genotype.

        Raises:
            StudyError: no such individual, or not yet.
        """
        if who in ("champion", "fittest"):
            genes = self.champion if who == "champion" else self.fittest
            if genes is None:
                cure = "name an evaluation, or finish the study (`realitygap … --resume`)"
                raise StudyError(f"run {self.id} has no {who} yet; {cure}.")
            return str(who), genes
        if not str(who).isdecimal() or int(who) >= self.evaluations:
            raise StudyError(
                f"expected champion, fittest or an evaluation, 0 to {self.evaluations - 1}, got {who!r}."
            )
        return f"evaluation {int(who)}", self.study.genotype(self.id, int(who))

    def replay(
        self,
        who: str | int = "champion",
        *,
        noise: str | float | None = None,
        pose: Pose | None = None,
        seed: int = 0,
        seconds: float | None = None,
        profile: Profile | str | None = None,
    ) -> Any:
        """The page's player with one simulated trial, in a notebook; `save` writes it.

        Args:
            who: "champion", "fittest" or the number of an evaluation.
            noise: level; the run's own if None.
            pose: where it starts; None: drawn by the task with the seed.
            seed: of the trial.
            seconds: duration, s; the task's own if None.
            profile: another robot.

        Raises:
            UsageError: there is no such individual, or it cannot start there.
        """
        options = {"noise": noise, "pose": pose, "seed": seed, "seconds": seconds, "profile": profile}
        return lazy.notebook().replayed(self, who, **options)

    def _repr_html_(self) -> str:
        return str(lazy.notebook().run_html(self))

    @property
    def population(self) -> Genes | None:
        """[cells, ...]: the population at the last checkpoint, cell by cell."""
        state = self.study.state(self.id)
        return None if state is None else state.genes

    @cached_property
    def tests(self) -> dict[tuple[str, float], NDArray[np.float64]]:
        """Scores on fresh trials by (who, noise level); empty before the run is finished."""
        table = self.study.tests(self.id)
        pairs = dict.fromkeys(zip(table["who"].tolist(), table["noise"].tolist(), strict=True))
        return {(w, n): table["score"][(table["who"] == w) & (table["noise"] == n)] for w, n in pairs}
