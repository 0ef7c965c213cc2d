"""A study as tables, for pandas, R, DuckDB or a spreadsheet: Parquet, CSV or data frames.

The page How to look at results says what each column is.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from realitygap.errors import UsageError
from realitygap.files import as_path, atomic_path, atomic_write, to_csv
from realitygap.lazy import needed
from realitygap.study.load import Study, as_study
from realitygap.study.store import Table
from realitygap.transfer.record import load_transfers
from realitygap.transfer.scores import ScoreRow, kind_of, marks_of

__all__ = ["TABLES", "frame", "table", "write_tables"]

ORDER = {"runs": "run", "evaluations": "run, number", "tests": "run, who, tested_noise, number, trial"}
"""What `study.query` selects from, and the order of the rows."""
TABLES = (*ORDER, "trials", "scores")
OF_TRIAL = (
    "run", "name", "task", "noise", "individual", "robot", "unit", "twin_noise", "start", "seconds",
    "situated_from", "filmed", "late_steps", "missed_steps", "lost_steps", "timing",
)  # fmt: skip
OF_SCORES = ("type", "situated_type", "behaviour", "correspondence", "low", "high", "differences")
TEXTS = {
    "name", "task", "individual", "robot", "situated_from", "folder", "kind", "why", "type", "situated_type",
    "differences", "timing",
}  # fmt: skip
"""Columns that stay texts even when empty."""


def table(study: Study, name: str) -> Table:
    """One of TABLES: NumPy columns of equal length, NaN or None where there is nothing.

    Raises:
        UsageError: no such table.
        StudyError: the study, or a trial of it, cannot be read.
    """
    if name not in TABLES:
        raise UsageError(f"table: expected {', '.join(TABLES)}, got {name!r}.")
    study = as_study(study)
    if name in ORDER:
        return study.query(f"SELECT * FROM {name} ORDER BY {ORDER[name]}")
    marks = marks_of(study)
    return _trials(study, marks) if name == "trials" else _columns(list(ScoreRow.__dataclass_fields__), marks)


def frame(study: Study, name: str) -> Any:
    """One of TABLES as pandas' DataFrame.

    Raises:
        UsageError: no such table, or no pandas.
    """
    return needed("pandas", "tables").DataFrame(table(study, name))


def write_tables(study: Study, kind: str, folder: str | Path) -> dict[Path, int]:
    """Write all tables of a study, a file each; how many rows each has.

    Args:
        study: with its transfers, as far as there are any.
        kind: "parquet" or "csv".
        folder: where to; made if needed. Files of the same names are replaced.

    Raises:
        UsageError: no pyarrow for Parquet.
        OSError: a file cannot be written.
    """
    if kind not in ("parquet", "csv"):
        raise UsageError(f"kind: expected 'parquet' or 'csv', got {kind!r}.")
    arrow = needed("pyarrow.parquet", "tables") if kind == "parquet" else None
    folder = as_path(folder, "folder")
    folder.mkdir(parents=True, exist_ok=True)
    made = {}
    for name in TABLES:
        path, columns = folder / f"{name}.{kind}", table(study, name)
        if arrow is None:
            atomic_write(path, _csv(columns))
        else:
            with atomic_path(path) as new:
                arrow.write_table(_arrow(columns), new)
        made[path] = len(next(iter(columns.values())))
    return made


def _trials(study: Study, marks: Sequence[ScoreRow]) -> Table:
    """A row for each trial on a robot, with the scores of its individual on that kind of robot."""
    scores = {(one.run, one.individual, one.kind): one for one in marks}
    rows = []
    for one in load_transfers(study.folder):
        found = scores.get((one.run, one.individual, kind_of(one)))
        rows.append({
            **{key: getattr(one, key) for key in OF_TRIAL},
            **one.pose.to_dict(),
            "score_simulated": one.fitness_simulated, "score_situated": one.fitness_situated,
            **{key: getattr(found, key, None) for key in OF_SCORES},
            "folder": one.folder.relative_to(study.folder).as_posix(),
        })  # fmt: skip
    places = ("x_cm", "y_cm", "heading_deg", "score_simulated", "score_situated")
    return _columns([*OF_TRIAL, *places, *OF_SCORES, "folder"], rows)


def _columns(names: Sequence[str], rows: Sequence[Any]) -> Table:
    """Rows (dictionaries, or values with such attributes) as columns: texts, whole numbers or numbers."""
    plain = [row if isinstance(row, dict) else row.to_dict() for row in rows]
    columns: Table = {}
    for name in names:
        values = [row[name] for row in plain]
        if name in TEXTS or any(isinstance(value, str) for value in values):
            columns[name] = np.array([*(value or None for value in values), None], object)[:-1]
        elif all(isinstance(value, int) for value in values):
            columns[name] = np.array(values, bool if name == "filmed" else np.int64)
        else:
            columns[name] = np.array(values, np.float64)
    return columns


def _arrow(columns: Table) -> Any:
    arrow = needed("pyarrow", "tables")
    return arrow.table({
        name: arrow.array(values, arrow.string() if values.dtype == object else None, from_pandas=True)
        for name, values in columns.items()
    })  # fmt: skip


def _csv(columns: Table) -> str:
    """Comma-separated, a line of names first; nothing where there is no number or no text."""
    rows = zip(*(values.tolist() for values in columns.values()), strict=True)
    return to_csv([columns, *(["" if v is None or v != v else v for v in row] for row in rows)])
