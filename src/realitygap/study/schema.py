"""The tables of a study's database, as SQL, and the errors of SQLite in a person's words."""

import errno
import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from realitygap.errors import StudyError

__all__ = ["APPLICATION", "BLOCKS", "FORMAT", "SEALED", "check_format", "schema", "told"]

APPLICATION = 0x52474150
"""`PRAGMA application_id` of a study's database: "RGAP"."""
FORMAT = 4
"""`PRAGMA user_version`: raised when the tables change."""
SEALED = 2
"""From this format on a database keeps its study's sources, and a digest of all that it holds."""
BLOCKS = 4
"""From this format on genotypes stand compressed in a table of their own, many to a row."""

_FIXED = """
CREATE TABLE run (            -- one evolutionary run; its numbers are those of its checkpoint
    id INTEGER PRIMARY KEY,   -- from 1, condition by condition
    name TEXT NOT NULL UNIQUE,
    task TEXT NOT NULL,
    noise REAL NOT NULL,      -- level: 0 zero, 1 observed, 2 double
    position INTEGER NOT NULL, -- from 1 within its condition
    encoding TEXT NOT NULL,   -- JSON: dtype and shape of its genotypes, the encoding's name and settings
    evaluations INTEGER NOT NULL DEFAULT 0,
    best_fitness REAL,        -- highest fitness stored so far, of evaluation `fittest`
    fittest INTEGER,
    champion INTEGER,         -- evaluation number of the best in the retest, once finished
    champion_fitness REAL,    -- its mean score in the retest
    finished INTEGER NOT NULL DEFAULT 0
);
CREATE TABLE checkpoint (     -- what a run goes on from; written with the evaluations before it
    run INTEGER PRIMARY KEY REFERENCES run(id),
    evaluations INTEGER NOT NULL,
    state BLOB NOT NULL
);
CREATE TABLE retest (         -- the last population on fresh trials at the run's own noise
    run INTEGER NOT NULL REFERENCES run(id),
    cell INTEGER NOT NULL,
    number INTEGER NOT NULL,
    trial INTEGER NOT NULL,
    score REAL NOT NULL,
    PRIMARY KEY (run, cell, trial)
) WITHOUT ROWID;
CREATE TABLE test (           -- `who`: fittest or champion; on fresh trials at three noise levels
    run INTEGER NOT NULL REFERENCES run(id),
    who TEXT NOT NULL,
    noise REAL NOT NULL,
    trial INTEGER NOT NULL,
    score REAL NOT NULL,
    PRIMARY KEY (run, who, noise, trial)
) WITHOUT ROWID;
CREATE TABLE session (        -- who has worked on this study, and with which versions
    id INTEGER PRIMARY KEY,
    began TEXT NOT NULL,      -- UTC
    pid INTEGER NOT NULL,
    versions TEXT NOT NULL    -- JSON
);
CREATE TABLE source (         -- all that the study follows from, as it was when it was made
    name TEXT PRIMARY KEY,    -- a file's, from the study's folder
    content BLOB NOT NULL
);
CREATE TABLE task (           -- what a task is, beside its score: nobody has to run its file for that
    name TEXT PRIMARY KEY,
    facts TEXT NOT NULL       -- JSON
);
CREATE TABLE digest (         -- of the rows of a table that belong to a run; run 0: of the whole table
    run INTEGER NOT NULL,
    part TEXT NOT NULL,
    value BLOB NOT NULL,
    PRIMARY KEY (run, part)
) WITHOUT ROWID;
"""


def schema(trials: int) -> str:
    """SQL of all tables, for up to `trials` trials in an evaluation."""
    scores = "\n".join(f"    score_{t} REAL," for t in range(1, trials + 1))
    return f"""{_FIXED}
CREATE TABLE evaluation (     -- every individual that was ever evaluated
    run INTEGER NOT NULL REFERENCES run(id),
    number INTEGER NOT NULL,  -- from 0 within its run
    fitness REAL NOT NULL,    -- mean of its trials' scores
{scores}
    parent_a INTEGER NOT NULL, -- evaluation numbers; -1: none
    parent_b INTEGER NOT NULL,
    cell INTEGER NOT NULL,    -- the place in the population that it took, or was offered
    PRIMARY KEY (run, number)
) WITHOUT ROWID;
CREATE TABLE genotypes (      -- of all evaluations, as many to a row as were kept at once
    run INTEGER NOT NULL REFERENCES run(id),
    number INTEGER NOT NULL,  -- of the first of them
    content BLOB NOT NULL,    -- zlib: one after the other, of the dtype and shape in run.encoding
    PRIMARY KEY (run, number)
);
PRAGMA application_id = {APPLICATION};
PRAGMA user_version = {FORMAT};
"""


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
