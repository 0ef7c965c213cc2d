"""The tables of a study's database, as SQL, and the errors of SQLite in a person's words.

What is asked of a study most are views over them: `runs`, `evaluations`, `tests`. A new database holds those,
for whoever opens it with other tools; `Study.query` lays them over one of any format, for as long as it
reads. docs/tables-and-logs.md says what each column is.
"""

import errno
import json
import sqlite3
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from realitygap.errors import StudyError
from realitygap.study.settings import flat

__all__ = ["APPLICATION", "BLOCKS", "FORMAT", "NAMES", "SEALED", "check_format", "schema", "told", "views"]

APPLICATION = 0x52474150
"""`PRAGMA application_id` of a study's database: "RGAP"."""
FORMAT = 4
"""`PRAGMA user_version`: raised when the tables change."""
SEALED = 2
"""From this format on a database keeps its study's sources, and a digest of all that it holds."""
BLOCKS = 4
"""From this format on genotypes stand compressed in a table of their own, many to a row."""


def schema(trials: int) -> str:
    """SQL of all tables, for up to `trials` trials in an evaluation."""
    scores = "\n".join(f"    score_{t} REAL," for t in range(1, trials + 1))
    fixed = Path(__file__).with_name("schema.sql").read_text("utf-8").replace("    -- SCORES", scores)
    return f"\n{fixed}PRAGMA application_id = {APPLICATION};\nPRAGMA user_version = {FORMAT};\n"


def check_format(database: sqlite3.Connection, path: Path) -> int:
    """The database's format; one that is no study's, or of a newer realitygap, is refused.

    Raises:
        StudyError: names the file and the cure.
    """
    if database.execute("PRAGMA application_id").fetchone()[0] != APPLICATION:
        raise StudyError(f"{path}: not a study's database. Give the folder of a study, or a new one.")
    version: int = database.execute("PRAGMA user_version").fetchone()[0]
    if not 1 <= version <= FORMAT:
        raise StudyError(
            f"{path}: written in format {version}, this realitygap reads formats 1 to {FORMAT}. "
            f"{'Upgrade realitygap' if version > FORMAT else 'Restore it from a copy'}."
        )
    return version


@contextmanager
def told(path: Path) -> Iterator[None]:
    """Errors of SQLite and of files as one StudyError that names the file and the cure."""
    try:
        yield
    except sqlite3.Error as error:
        raise StudyError(f"{path}: {_words(error)}") from error
    except OSError as error:
        kept = "What was saved is kept. " if error.errno == errno.ENOSPC else ""
        cure = "Free some space and resume" if kept else "Check the path and its rights, or take another"
        raise StudyError(f"{error.filename or path}: {error.strerror or error}. {kept}{cure}.") from error


def _words(error: sqlite3.Error) -> str:
    code = getattr(error, "sqlite_errorcode", 0) & 0xFF
    if code == sqlite3.SQLITE_FULL:
        return "the disk is full. What was saved is kept: free some space and resume."
    if code == sqlite3.SQLITE_IOERR:
        return f"{error}: is the disk full or gone? What was saved is kept: see to it and resume."
    if code in (sqlite3.SQLITE_READONLY, sqlite3.SQLITE_PERM, sqlite3.SQLITE_CANTOPEN):
        return f"{error}. Check the folder's rights, or copy the study elsewhere."
    if code in (sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED):
        return f"another program holds the database ({error}). Close it and resume."
    return f"the database is broken ({error}). Restore it from a copy, or begin again in another folder."


NAMES = ("runs", "evaluations", "tests")

_OF_RUN = 'r.id AS run, r.name, r.task, r.noise, r.position AS "index"'


def views(database: sqlite3.Connection, config: Mapping[str, Any], *, temporary: bool = False) -> list[str]:
    """SQL that creates the views, a statement each.

    Args:
        database: the study's, of any format.
        config: its configuration (`StudyConfig.to_dict()`): each setting is a column of `runs`, named as
            --set names it, `set_` before it and underscores for dots.
        temporary: for this connection alone; nothing is written.
    """
    columns = [row[1] for row in database.execute("PRAGMA table_info(evaluation)")]
    found = ", ".join(f"e.{name}" for name in columns if name not in ("run", "genotype"))
    shown = {key: value for key, value in config.items() if key not in ("title", "conditions")}
    settings = "".join(
        f", {_literal(value)} AS {_quoted('set_' + key.replace('.', '_'))}" for key, value in flat(shown)
    )
    queries = {
        "runs": f"""SELECT {_OF_RUN}, r.finished, r.evaluations, r.best_fitness, r.fittest,
            {_fresh("fittest")}, r.champion, r.champion_fitness, {_fresh("champion")}{settings} FROM run r""",
        "evaluations": f"SELECT {_OF_RUN}, {found} FROM evaluation e JOIN run r ON r.id = e.run",
        "tests": f"""SELECT {_OF_RUN}, t.who, CASE t.who WHEN 'champion' THEN r.champion ELSE r.fittest END
            AS number, t.noise AS tested_noise, t.trial, t.score FROM test t JOIN run r ON r.id = t.run
            UNION ALL SELECT {_OF_RUN}, 'population', t.number, r.noise, t.trial, t.score
            FROM retest t JOIN run r ON r.id = t.run""",
    }
    kind = "TEMP VIEW" if temporary else "VIEW"
    return [f"CREATE {kind} {name} AS {query}" for name, query in queries.items()]


def _fresh(who: str) -> str:
    """The mean of an individual's fresh trials at the noise it evolved under."""
    mean = f"SELECT avg(score) FROM test WHERE run = r.id AND who = '{who}' AND noise = r.noise"
    return f"({mean}) AS {who}_fresh"


def _literal(value: object) -> str:
    if value is None:
        return "NULL"
    if isinstance(value, int | float):
        return repr(int(value) if isinstance(value, bool) else value)
    return "'" + (value if isinstance(value, str) else json.dumps(value)).replace("'", "''") + "'"


def _quoted(name: str) -> str:
    return '"' + name.replace('"', '""') + '"'
