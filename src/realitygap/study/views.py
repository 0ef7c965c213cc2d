"""What is asked of a study most, as SQL views over its tables: `runs`, `evaluations`, `tests`.

A new database holds them, for whoever opens it with other tools; `Study.query` lays them over one of any
format, for as long as it reads. docs/tables-and-logs.md says what each column is.
"""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Mapping
from typing import Any

from realitygap.study.settings import flat

__all__ = ["NAMES", "views"]

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
