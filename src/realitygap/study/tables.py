"""The tables of a study's database as NumPy columns: evaluations, genotypes, tests."""

from collections.abc import Hashable
from hashlib import blake2b
from pathlib import Path
from typing import Any

import numpy as np

from realitygap import lazy
from realitygap.errors import StudyError
from realitygap.evolution.algorithm import Genes
from realitygap.files import must_be
from realitygap.study.config import StudyConfig
from realitygap.study.folder import read_config
from realitygap.study.reader import DATABASE, Reader, Table
from realitygap.values import as_count

__all__ = ["Tables"]


class Tables:
    """The contents of a study's database; runs are given by number or name."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder.absolute()  # the same study wherever the process goes
        self.config: StudyConfig = read_config(folder)
        self._reader = Reader(self.folder / DATABASE)
        self._rows = self._reader.runs()
        self._block: tuple[int, int, Genes] = 0, 0, np.zeros(0)
        """Of the run that an individual was read from last: its number, that of the first, and they."""

    def evaluations(self, run: int | None = None) -> Table:
        """Every evaluation of a run, or of all: run, number, fitness, score_1 …, parents, cell."""
        return self._reader.evaluations(None if run is None else self._id(run))

    def genotypes(self, run: int) -> Genes:
        """[n, ...]: all individuals of a run, in the order of evaluation; of slots [n, slots, fields]."""
        kind, shape = self._form(run)
        return np.frombuffer(self._reader.genotypes(self._id(run))[1], kind).reshape(-1, *shape)

    def genotype(self, run: int, number: int) -> Genes:
        """The individual of one evaluation, of its run's type and shape.

        Raises:
            StudyError: no such evaluation.
        """
        of, (whose, first, genes), number = self._id(run), self._block, as_count(number, "number", 0)
        if whose != of or not 0 <= number - first < len(genes):  # a run's next one is likely from there
            kind, shape = self._form(of)
            first, found = self._reader.genotypes(of, number)
            genes = np.frombuffer(found, kind).reshape(-1, *shape)
            self._block = of, first, genes
        if not 0 <= number - first < len(genes):
            raise StudyError(f"{self.folder}: run {run} has no evaluation {number}.")
        one: Genes = genes[number - first].copy()
        return one

    def tests(self, run: int | None = None) -> Table:
        """Fresh trials: run, who (fittest or champion), noise, trial, score.

        `noise` is the one tested under, which `query` and `to_pandas` call tested_noise.
        """
        return self._reader.tests(None if run is None else self._id(run))

    def retests(self, run: int | None = None) -> Table:
        """The last populations' retest: run, cell, number, trial, score."""
        return self._reader.retests(None if run is None else self._id(run))

    def query(self, sql: str) -> Table:
        """Columns that SQL selects from `runs`, `evaluations` and `tests`, or from the study's tables.

            study.query("SELECT task, noise, avg(champion_fresh) AS mean FROM runs GROUP BY task, noise")

        Raises:
            StudyError: the statement is invalid, or writes.
        """
        must_be(sql, str, "sql", "SELECT * FROM runs is one.")
        return self._reader.query(sql, self.config.to_dict())

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
        found = blake2b(repr(self._reader.runs()).encode(), digest_size=16)
        for row in self._rows:
            run = int(row["id"])
            for table in (self.evaluations(run), self.tests(run), self.retests(run)):
                found.update(b"".join(column.tobytes() for column in table.values()))
            found.update(blake2b(self._reader.genotypes(run)[1]).digest())
        return found.hexdigest()

    def versions(self) -> dict[str, list[str]]:
        """Versions of what has worked on the study, by name, each once: see `folder.versions`."""
        return self._reader.versions()

    def _form(self, run: int) -> tuple[str, tuple[int, ...]]:
        """Type and shape of a run's genotypes, without its task or encoding."""
        facts = self._reader.encoding(self._id(run))
        return facts["dtype"], tuple(facts["shape"])

    def _id(self, run: int | str) -> int:
        could = isinstance(run, Hashable) and not isinstance(run, bool)
        for row in self._rows:
            if could and run in (row["id"], row["name"], str(row["id"])):
                return int(row["id"])
        raise StudyError(
            f"{self.folder}: expected a run, 1 to {len(self._rows)} or a name such as "
            f"{self._rows[0]['name']!r}, got {run!r}."
        )
