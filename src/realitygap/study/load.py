"""Reads a study, finished or not, even while another process works on it.

Tables are dictionaries of NumPy columns: `pandas.DataFrame(study.evaluations())` needs no more.
"""

from __future__ import annotations

import json
import math
import sqlite3
from collections.abc import Hashable, Iterator, Mapping, Sequence
from contextlib import closing, suppress
from dataclasses import dataclass, field, fields
from functools import cached_property
from hashlib import blake2b
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from realitygap import lazy
from realitygap.control.encoding import Encoding, genotype_of
from realitygap.control.genotype import Genotype, NetworkController
from realitygap.control.origin import Origin, remember
from realitygap.errors import ConfigError, NoSuchNameError, StudyError
from realitygap.evolution.algorithm import Genes, State
from realitygap.evolution.ga import Population
from realitygap.files import as_path, must_be
from realitygap.kernels.types import Networks
from realitygap.study.config import StudyConfig
from realitygap.study.folder import Materials, read_config, read_materials, read_profile, trust_programs
from realitygap.study.plan import Plan
from realitygap.study.store import DATABASE, WHO, Reader, Table
from realitygap.tasks.task import Task
from realitygap.values import Pose, as_count
from realitygap.work.folder import flat
from realitygap.world.robot import Profile, noise_level, noise_name

__all__ = ["Run", "Study", "Tests", "as_study", "load_study"]


def load_study(path: str | PathLike[str], *, trust: bool = False) -> Study:
    """Load a study from its folder as it is now; evaluations are read when needed.

    Reading runs no user's code. A simulation in a user's own task runs that task's file, unless this user has
    neither evolved with it nor agreed to it.

    Args:
        path: the study's folder, its study.db, or a Study, which is read again.
        trust: agree to run the task files that it brings, from now on.

    Raises:
        StudyError: no study there, a database that is broken or of another format, or a study.toml
            that is broken or has been edited since.
    """
    folder = as_path(path, "study")
    folder = folder.parent if folder.name == DATABASE else folder
    must_be(trust, bool, "trust", "True agrees to run its files.")
    if trust:
        trust_programs(folder)
    return Study(folder)


def as_study(study: object) -> Study:
    """A Study unchanged, or the study of a folder's path."""
    return study if isinstance(study, Study) else load_study(as_path(study, "study"))


class Study:
    """A study: its configuration, its runs as of loading, its tables.

    A run is given by number or name, as a Run, or as "best": `best:light-seeking/observed` is the best of a
    task and a noise level, of which either may be left out.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder.absolute()  # the same study wherever the process goes
        self.config: StudyConfig = read_config(folder)
        self._reader = Reader(self.folder / DATABASE)
        self._rows = self._reader.runs()
        self.runs = [
            Run(
                id=row["id"], name=row["name"], task=row["task"], noise=row["noise"], index=row["position"],
                condition=(row["id"] - 1) // self.config.runs, seed=self.config.seed,
                evaluations=row["evaluations"], best_fitness=row["best_fitness"],
                fittest_number=row["fittest"], champion_number=row["champion"],
                champion_fitness=row["champion_fitness"], finished=bool(row["finished"]), study=self,
            )
            for row in self._rows
        ]  # fmt: skip
        self._encodings: dict[str, Encoding] = {}
        self._genes: tuple[int, Genes] = 0, np.zeros(0)
        """Of the run that an individual was read from last: its number, and all individuals then."""

    def __fspath__(self) -> str:
        """Its folder: a Study works wherever a path to one is expected."""
        return str(self.folder)

    def __repr__(self) -> str:
        done = sum(run.finished for run in self.runs)
        return f"<Study {str(self.folder)!r}: {done} of {len(self.runs)} runs finished>"

    @property
    def best(self) -> Run:
        """The run with the highest test score; while none is finished, with the best fitness so far.

        Raises:
            StudyError: several tasks, whose scores cannot be compared, or no run has begun.
        """
        return self.run("best")

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

    @cached_property
    def _facts(self) -> dict[str, dict[str, Any]]:
        found: dict[str, dict[str, Any]] = self._reader.meta("tasks")
        return found

    def facts(self, task: str | Task) -> dict[str, Any]:
        """A task without its score, as by `Task.to_dict`: no user's file is run.

        Raises:
            StudyError: the study has no such task.
        """
        task = str(getattr(task, "name", task))
        found = self._facts
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
        facts = self.facts(task)
        return remember(self.encoding(task).decode(genes[np.newaxis]), Origin(facts["name"], facts["feeds"]))

    def controller(self, task: str | Task, genes: Genes) -> NetworkController:
        """A controller that drives a body with a genotype's network."""
        return self.slots(task, genes).controller()

    def slots(self, task: str | Task, genes: Genes) -> Genotype:
        """A genotype as one of slots with the same network."""
        return genotype_of(self.encoding(task), genes)

    def evaluations(self, run: AnyRun | None = None) -> Table:
        """Every evaluation of a run, or of all: run, number, fitness, score_1 …, parents, cell.

        Scores of tasks with fewer trials than others of the study end with NaN.
        """
        trials = max(int(facts["trials"]) for facts in self._facts.values())
        parts: list[Table] = [_evaluations(0, {}, trials)]
        for one in self._some(run):
            found = self._reader.evaluated(one, "fitness", "scores", "parents", "cell")
            parts.append(_evaluations(one, found, trials))
        return _stacked(parts)

    def genotypes(self, run: AnyRun) -> Genes:
        """[n, ...]: all individuals of a run, in the order of evaluation; of slots [n, slots, fields]."""
        run = self._id(run)
        genes: Genes | None = self._reader.evaluated(run, "genes").get("genes")
        if genes is not None:
            return genes
        facts = json.loads(self._rows[run - 1]["encoding"])
        return np.zeros((0, *facts["shape"]), facts["dtype"])

    def genotype(self, run: AnyRun, number: int) -> Genes:
        """The individual of one evaluation, of its run's type and shape.

        Raises:
            StudyError: no such evaluation.
        """
        of, (whose, genes), number = self._id(run), self._genes, as_count(number, "number", 0)
        if whose != of or number >= len(genes):  # a run's next one is likely among them
            genes = self.genotypes(of)
            self._genes = of, genes
        if number >= len(genes):
            raise StudyError(f"{self.folder}: run {of} has no evaluation {number}.")
        one: Genes = genes[number].copy()
        return one

    def tests(self, run: AnyRun | None = None) -> Table:
        """Fresh trials: run, who (fittest or champion), noise, trial, score.

        `noise` is the one tested under, which `query` and `to_pandas` call tested_noise.
        """
        parts = [_trials({"run": [0], "who": ["champion"], "noise": [0.0]}, np.zeros((1, 0)))]
        for one in self._some(run):
            found = self._reader.tested(one)
            if found:
                order = np.lexsort((found["noise"], found["who"] != "fittest"))
                who, noise, scores = (found[key][order] for key in ("who", "noise", "fresh"))
                parts.append(_trials({"run": [one] * len(who), "who": who, "noise": noise}, scores))
        return _stacked(parts)

    def retests(self, run: AnyRun | None = None) -> Table:
        """The last populations' retest: run, cell, number, trial, score."""
        parts = [_trials({"run": [0], "cell": [0], "number": [0]}, np.zeros((1, 0)))]
        for one in self._some(run):
            found = self._reader.tested(one)
            if found:
                whose = {
                    "run": [one] * len(found["cells"]),
                    "cell": found["cells"],
                    "number": found["numbers"],
                }
                parts.append(_trials(whose, found["retest"]))
        return _stacked(parts)

    def query(self, sql: str) -> Table:
        """Columns that SQL selects from the tables `runs`, `evaluations` and `tests`.

            study.query("SELECT task, noise, avg(champion_fresh) AS mean FROM runs GROUP BY task, noise")

        Raises:
            StudyError: the statement is invalid, or writes.
        """
        must_be(sql, str, "sql", "SELECT * FROM runs is one.")
        tables = {
            "runs": self._runs_table,
            "evaluations": lambda: self._with_runs(self.evaluations()),
            "tests": self._tests_table,
        }
        with closing(sqlite3.connect(":memory:", isolation_level=None)) as database:
            for name, made in tables.items():
                if name in sql.lower():
                    _fill(database, name, made())
            database.execute("PRAGMA query_only = ON")
            database.setlimit(sqlite3.SQLITE_LIMIT_ATTACHED, 0)  # or ATTACH would make a file
            try:
                rows = database.execute(sql)
                names = [column[0] for column in rows.description or ()]
                found = rows.fetchall()
            except sqlite3.Error as error:
                why = str(error).rstrip(".")
                raise StudyError(f"sql: {why}. Expected a SELECT from {', '.join(tables)}.") from None
        if not names:
            raise StudyError(f"sql: expected a SELECT from {', '.join(tables)}, got {sql!r}.")
        if len(set(names)) != len(names):
            raise StudyError(f"sql: two columns have one name: {', '.join(names)}. Rename one (AS).")
        columns = zip(*found, strict=True) if found else [()] * len(names)
        return {name: _column(values) for name, values in zip(names, columns, strict=True)}

    def _runs_table(self) -> Mapping[str, Sequence[Any]]:
        """A row a run, with the mean of its fresh trials at its own noise, and every setting as `set_…`."""
        config = self.config.to_dict()
        shown = {key: value for key, value in config.items() if key not in ("title", "conditions")}
        settings = {f"set_{key.replace('.', '_')}": _plain(value) for key, value in flat(shown)}
        rows = []
        for run in self.runs:
            fresh = {}
            for who in WHO:
                scores = run.tests.get((who, run.noise), np.zeros(0)).tolist()
                fresh[who] = math.fsum(scores) / len(scores) if scores else None
            rows.append({
                "run": run.id, "name": run.name, "task": run.task, "noise": run.noise, "index": run.index,
                "finished": run.finished, "evaluations": run.evaluations, "best_fitness": run.best_fitness,
                "fittest": run.fittest_number, "fittest_fresh": fresh["fittest"],
                "champion": run.champion_number, "champion_fitness": run.champion_fitness,
                "champion_fresh": fresh["champion"], **settings,
            })  # fmt: skip
        return {key: [row[key] for row in rows] for key in rows[0]}

    def _tests_table(self) -> Mapping[str, Sequence[Any]]:
        """Fresh trials, and the retest of the last population as who = "population", at the run's noise."""
        tests, retests = self.tests(), self.retests()
        numbers = {row["id"]: {"fittest": row["fittest"], "champion": row["champion"]} for row in self._rows}
        pairs = zip(tests["run"].tolist(), tests["who"].tolist(), strict=True)
        number = [numbers[run][who] for run, who in pairs] + retests["number"].tolist()
        own = [self._rows[run - 1]["noise"] for run in retests["run"].tolist()]
        return self._with_runs({
            "run": np.append(tests["run"], retests["run"]),
            "who": np.append(tests["who"], np.full(len(own), "population")),
            "number": np.array(number, np.int64),
            "tested_noise": np.append(tests["noise"], own),
            "trial": np.append(tests["trial"], retests["trial"]),
            "score": np.append(tests["score"], retests["score"]),
        })  # fmt: skip

    def _with_runs(self, table: Table) -> Mapping[str, Sequence[Any]]:
        """A table with what each row's run is called, as lists; None where there is no number."""
        columns = {"run": table["run"].tolist()}
        for name in ("name", "task", "noise", "position"):
            column = [self._rows[run - 1][name] for run in columns["run"]]
            columns["index" if name == "position" else name] = column
        rest = {name: column.tolist() for name, column in table.items() if name != "run"}
        return columns | {name: [None if v != v else v for v in column] for name, column in rest.items()}

    def to_pandas(self, table: str = "runs") -> Any:
        """A table as pandas' DataFrame: runs, evaluations, tests, trials (on robots), or scores.

        In tests, `noise` is the run's and `tested_noise` the one tested under; the retest of the last
        population is among them, as who = "population".

        Raises:
            UsageError: no such table, or no pandas.
        """
        return lazy.tables().frame(self, table)

    def digest(self) -> str:
        """A digest of every run's results: equal for studies with the same runs, however they were made.
        Checkpoints are not included."""
        names = [one.name for one in fields(Run) if one.name not in ("condition", "seed", "study")]
        facts = [{name: getattr(run, name) for name in names} for run in self.runs]
        found = blake2b(repr(facts).encode(), digest_size=16)
        for run in range(1, len(self.runs) + 1):
            for table in (self.evaluations(run), self.tests(run), self.retests(run)):
                found.update(b"".join(column.tobytes() for column in table.values()))
            found.update(blake2b(self.genotypes(run).tobytes()).digest())
        return found.hexdigest()

    def versions(self) -> dict[str, list[str]]:
        """Versions of what has worked on the study, by name, each once: see `provenance.versions`."""
        found: dict[str, list[str]] = {}
        for session in self._reader.meta("sessions"):
            for name, version in session["versions"].items():
                if version not in found.setdefault(name, []):
                    found[name].append(version)
        return found

    def _some(self, run: AnyRun | None) -> Sequence[int]:
        """The number of a run, or all."""
        return range(1, len(self._rows) + 1) if run is None else [self._id(run)]

    def _id(self, run: AnyRun) -> int:
        if isinstance(run, Run):
            run = run.id
        if isinstance(run, str) and (run == "best" or run.startswith("best:")):
            return self._best(run.removeprefix("best").removeprefix(":")).id
        could = isinstance(run, Hashable) and not isinstance(run, bool)
        for row in self._rows:
            if could and run in (row["id"], row["name"], str(row["id"])):
                return int(row["id"])
        raise StudyError(
            f"{self.folder}: expected a run, 1 to {len(self._rows)}, best, or a name such as "
            f"{self._rows[0]['name']!r}, got {run!r}."
        )

    def _best(self, of: str) -> Run:
        """The best run of "TASK", "LEVEL", "TASK/LEVEL" or ""."""
        words = [word for word in of.split("/") if word]
        found = [run for run in self.runs if run.best_fitness is not None and all(map(run.is_of, words))]
        tasks = dict.fromkeys(run.task for run in found)
        if not found:
            known = dict.fromkeys(name for run in self.runs for name in (run.task, run.noise_name))
            raise StudyError(
                f"{self.folder}: best: expected a task or a noise level of runs that have begun "
                f"({', '.join(known)}), got {of!r}."
            )
        if len(tasks) > 1:
            named = " or ".join(f"best:{'/'.join([task, *words])}" for task in tasks)
            raise StudyError(f"{self.folder}: best: scores of different tasks do not compare. Name {named}.")
        worth = [(-math.inf if run.fitness is None else run.fitness, run.best_fitness) for run in found]
        return found[worth.index(max(worth))]

    def run(self, id_or_name: AnyRun) -> Run:
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

    def state(self, run: AnyRun) -> State | None:
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
class Run(Plan):
    """One evolutionary run so far, with what was planned; values that do not exist yet are None.

    Attributes:
        best_fitness, fittest_number: the highest fitness stored, and its evaluation number.
        champion_number, champion_fitness: the best of the retest, and its mean score there.
        study: where its evaluations are.
    """

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
    def fitness(self) -> float | None:
        """The test score: mean of the champion's new trials at the noise it evolved under."""
        scores = self.tests.get(("champion", self.noise))
        return None if scores is None else math.fsum(scores.tolist()) / len(scores)

    def is_of(self, word: str) -> bool:
        """Whether a task (or a word of its name) or a noise level is this run's."""
        return word in (self.task, *self.task.split("-"), self.noise_name, f"{self.noise:g}")

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

    def drive_live(self, who: str | int = "champion", *, height: int = 1150) -> Any:
        """The page's player, in which the robot can be dragged and its noise changed, in a notebook; `save`
        writes it. Where the notebook forbids WebAssembly it shows a recorded trial.

        Args:
            who: "champion", "fittest" or the number of an evaluation.
            height: of its frame, in pixels.

        Raises:
            UsageError: there is no such individual.
        """
        return lazy.notebook().replayed(self, who, live=True, height=height)

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
    def tests(self) -> Tests:
        """Scores of new trials by (who, noise level or its name); empty before the run is finished."""
        table = self.study.tests(self.id)
        pairs = dict.fromkeys(zip(table["who"].tolist(), table["noise"].tolist(), strict=True))
        return Tests({(w, n): table["score"][(table["who"] == w) & (table["noise"] == n)] for w, n in pairs})


class Tests(Mapping[tuple[str, float], NDArray[np.float64]]):
    """Scores of new trials: `run.tests["champion", "double"]` is `run.tests["champion", 2.0]`."""

    def __init__(self, scores: Mapping[tuple[str, float], NDArray[np.float64]]) -> None:
        self._scores = scores

    def __getitem__(self, key: tuple[str, str | float]) -> NDArray[np.float64]:
        with suppress(ConfigError, TypeError, ValueError, KeyError):
            who, noise = key
            return self._scores[who, noise_level(noise)]
        raise NoSuchNameError("tests", key, self._scores)

    def __iter__(self) -> Iterator[tuple[str, float]]:
        return iter(self._scores)

    def __len__(self) -> int:
        return len(self._scores)


AnyRun = int | str | Run


def _evaluations(run: int, found: Mapping[str, NDArray[Any]], trials: int) -> Table:
    """Columns of a run's evaluations; of none for their types."""
    scores = found.get("scores", np.zeros((0, 1)))
    scores = np.pad(scores, ((0, 0), (0, trials - scores.shape[1])), constant_values=np.nan)
    nobody = np.zeros((0, 2), np.int64)
    places = zip(("parent_a", "parent_b"), found.get("parents", nobody).T, strict=True)
    return {
        "run": np.full(len(scores), run, np.int64),
        "number": np.arange(len(scores)),
        "fitness": found.get("fitness", np.zeros(0)),
        **{f"score_{k + 1}": column for k, column in enumerate(scores.T)},
        **dict(places),
        "cell": found.get("cell", np.zeros(0, np.int64)),
    }


def _trials(whose: Mapping[str, Any], scores: NDArray[np.float64]) -> Table:
    """A row for each of the trials [n, trials] of n individuals, whose columns are repeated."""
    kinds = {"who": np.dtype("U8"), "noise": np.dtype(float)}
    n, trials = scores.shape
    repeated = {
        name: np.repeat(np.array(column, kinds.get(name, np.int64)), trials) for name, column in whose.items()
    }
    return {**repeated, "trial": np.tile(np.arange(trials), n), "score": scores.ravel()}


def _stacked(parts: Sequence[Table]) -> Table:
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def _plain(value: object) -> object:
    """A setting as SQLite takes it."""
    return value if value is None or isinstance(value, str | int | float) else json.dumps(value)


def _fill(database: sqlite3.Connection, name: str, columns: Mapping[str, Sequence[Any]]) -> None:
    """Make a table of columns."""
    names = ", ".join(f'"{column}"' for column in columns)
    database.execute(f"CREATE TABLE {name} ({names})")
    places = ", ".join("?" * len(columns))
    database.executemany(f"INSERT INTO {name} VALUES ({places})", zip(*columns.values(), strict=True))


def _column(values: Sequence[Any]) -> NDArray[Any]:
    """Integers, or numbers with NaN for NULL, or whatever they are."""
    if all(type(value) is int for value in values):
        return np.array(values, np.int64)
    if all(isinstance(value, int | float | None) for value in values):
        return np.array([np.nan if value is None else value for value in values], np.float64)
    return np.array([*values, None], object)[:-1]
