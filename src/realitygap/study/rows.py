"""Writes a database of an earlier format: a row for each evaluation and each fresh trial."""

import sqlite3
import zlib
from collections.abc import Iterator

from realitygap.evolution.algorithm import Genes
from realitygap.study.run import Records, Results

__all__ = ["advance_rows", "finish_rows", "plain"]


def plain(genes: Genes) -> Genes:
    """Little-endian genes, as in files."""
    return genes.astype(genes.dtype.newbyteorder("<"), copy=False)


def advance_rows(database: sqlite3.Connection, run: int, records: Records) -> None:
    """Store evaluations; genotypes in a separate row, or in formats before that one in each row."""
    columns = [row[1] for row in database.execute("PRAGMA table_info(evaluation)")]
    genes = plain(records.genes)
    rows = _rows(run, records, sum(name.startswith("score_") for name in columns))
    if "genotype" not in columns:
        block = (run, int(records.number[0]), zlib.compress(genes.tobytes()))
        database.execute("INSERT INTO genotypes VALUES (?, ?, ?)", block)
    else:
        rows = ((*row, one.tobytes()) for row, one in zip(rows, genes, strict=True))
    database.executemany(f"INSERT INTO evaluation VALUES ({', '.join('?' * len(columns))})", rows)


def finish_rows(database: sqlite3.Connection, run: int, results: Results) -> None:
    """Store a run's tests."""
    retest = [
        (run, cell, number, trial, score)
        for cell, number, row in zip(
            results.cells.tolist(), results.numbers.tolist(), results.retest.tolist(), strict=True
        )
        for trial, score in enumerate(row)
    ]
    test = [
        (run, who, noise, trial, score)
        for (who, noise), row in results.fresh.items()
        for trial, score in enumerate(row.tolist())
    ]
    database.executemany("INSERT INTO retest VALUES (?, ?, ?, ?, ?)", retest)
    database.executemany("INSERT INTO test VALUES (?, ?, ?, ?, ?)", test)


def _rows(run: int, records: Records, trials: int) -> Iterator[tuple[object, ...]]:
    """Rows of the table `evaluation`; tasks with fewer trials than others leave scores empty."""
    empty = (None,) * (trials - records.scores.shape[1])
    columns = zip(
        records.number.tolist(),
        records.fitness.tolist(),
        records.scores.tolist(),
        records.parents.tolist(),
        records.cell.tolist(),
        strict=True,
    )
    for number, fitness, scores, (first, second), cell in columns:
        yield (run, number, fitness, *scores, *empty, first, second, cell)
