"""The most common questions about a study, as views over its tables: `runs`, `evaluations`, `tests`.

A database contains them, for other tools; `Study.query` creates them for its own connection.
Arrays are unpacked in plain SQL, or, five times as fast, by two functions that a connection may define.
"""

import json
import sqlite3
import struct
from collections.abc import Mapping
from typing import Any

from realitygap.study.schema import most_trials
from realitygap.study.settings import flat

__all__ = ["NAMES", "lay_views", "views"]

NAMES = ("runs", "evaluations", "tests")

_OF_RUN = 'r.id AS run, r.name, r.task, r.noise, r.position AS "index"'


def lay_views(database: sqlite3.Connection, config: Mapping[str, Any]) -> None:
    """Create the views over a database for this connection alone; nothing is written."""
    database.create_function("whole", 1, lambda some: int.from_bytes(some, "little"), deterministic=True)
    database.create_function("real", 1, lambda some: struct.unpack("<d", some)[0], deterministic=True)
    for view in views(database, config, short=True):
        database.execute(view.replace("VIEW", "TEMP VIEW", 1))


def views(database: sqlite3.Connection, config: Mapping[str, Any], *, short: bool = False) -> list[str]:
    """SQL statements that create the views.

    Args:
        database: the study's.
        config: its configuration (`StudyConfig.to_dict()`): each setting is a column of `runs`, named as for
            --set with the prefix `set_` and underscores for dots.
        short: for a connection with functions that unpack arrays.
    """
    shown = {key: value for key, value in config.items() if key not in ("title", "conditions")}
    settings = "".join(
        f", {_literal(value)} AS {_quoted('set_' + key.replace('.', '_'))}" for key, value in flat(shown)
    )
    runs = f"""SELECT {_OF_RUN}, r.finished, r.evaluations, r.best_fitness, r.fittest, {_fresh("fittest")},
        r.champion, r.champion_fitness, {_fresh("champion")}{settings} FROM run r"""
    queries = {"runs": runs, **_of_arrays(database, short=short)}
    return [f"CREATE VIEW {name} AS {query}" for name, query in queries.items()]


def _fresh(who: str) -> str:
    """The mean of an individual's fresh trials at the noise that it evolved under."""
    mean = f"SELECT avg(score) FROM tests WHERE run = r.id AND who = '{who}' AND tested_noise = r.noise"
    return f"({mean}) AS {who}_fresh"


def _of_arrays(database: sqlite3.Connection, *, short: bool) -> dict[str, str]:
    trials = most_trials(database)
    scores, places = [f"score_{k + 1}" for k in range(trials)], ("parent_a", "parent_b", "cell")
    found = [f"CASE WHEN length(e.fitness) THEN {_real('e.fitness', 'k', short=short)} END AS mean"]
    for k, name in enumerate(scores):
        score = _real("e.scores", f"trials * k + {k}", short=short)
        found.append(f"CASE WHEN {k} < trials THEN {score} END AS {name}")
    for k, name in enumerate(places):
        place = _whole("e.places", f"3 * k + {k}", "(length(e.places) / 3 / e.count)", 4, short=short)
        found.append(f"{place} - 1 AS {name}")
    mean = " + ".join(f"ifnull({name}, 0)" for name in scores[:2])
    fitness = f"ifnull(mean, ({mean}) / trials) AS fitness"
    columns = ", ".join(["run, name, task, noise", '"index"', "number", fitness, *scores, *places])
    return {
        "evaluations": f"""{_counted("count", "evolved")} SELECT {columns} FROM (
            SELECT {_OF_RUN}, e.number + k AS number, trials, {", ".join(found)}
            FROM (SELECT *, length(scores) / 8 / count AS trials FROM evolved) e
            JOIN run r ON r.id = e.run CROSS JOIN i ON k < e.count)""",
        "tests": f"""{_counted("length(scores) / 8", "tested")} SELECT {_OF_RUN}, t.who, t.number,
            t.noise AS tested_noise, k AS trial, {_real("t.scores", "k", short=short)} AS score
            FROM tested t JOIN run r ON r.id = t.run CROSS JOIN i ON k < length(t.scores) / 8""",
    }


def _counted(count: str, part: str) -> str:
    """`i`: k from 0 up to the number that a row of a table needs, and all bytes; `two`: n and 2 to the −n."""
    more = f"SELECT k + 1, bytes FROM i WHERE k + 1 < (SELECT max({count}) FROM {part})"
    every = f"i(k, bytes) AS (SELECT 0, X'{bytes(range(256)).hex()}' UNION ALL {more})"
    next_one = "SELECT n + step, power * by, step, by FROM two WHERE n BETWEEN -970 AND 1073"
    powers = f"two(n, power, step, by) AS (VALUES (0, 1.0, 1, 0.5), (-1, 2.0, -1, 2.0) UNION ALL {next_one})"
    return f"WITH RECURSIVE {every}, {powers}"


def _whole(blob: str, at: str, width: str, most: int, *, short: bool = False) -> str:
    """The whole number of at most `most` bytes, little-endian, at position `at` of `blob`.

    A byte's value is its position in `bytes`. DISTINCT keeps SQLite from extracting the number again for each
    of its bytes.
    """
    some = f"substr({blob}, 1 + {width} * ({at}), {width})"
    if short:
        return f"whole({some})"
    worth = (f"instr(bytes, substr(b, {k + 1}, 1)) - 1 << {8 * k}" for k in range(most))
    return f"(SELECT ({') | ('.join(worth)}) FROM (SELECT DISTINCT {some} AS b))"


def _real(blob: str, at: str, *, short: bool) -> str:
    """The float64 at position `at` of `blob`, exactly: its digits times a power of two, by SQL's shifts."""
    if short:
        return f"real(substr({blob}, 1 + 8 * ({at}), 8))"
    parts = f"(w & {2**52 - 1}) | ((w >> 52 & 2047 > 0) << 52) AS m, 1075 - max(w >> 52 & 2047, 1) AS n"
    bits = f"SELECT DISTINCT {_whole(blob, at, '8', 8)} AS w"
    digits = f"SELECT DISTINCT 1 - 2 * (w < 0) AS sign, {parts} FROM ({bits})"
    near = "m = 0 OR n BETWEEN 0 AND 124 THEN m * 1.0 / (1 << min(n, 62)) / (1 << max(min(n, 124) - 62, 0))"
    size = f"CASE WHEN {near} ELSE (SELECT m * power FROM two WHERE two.n = d.n) END"
    return f"(SELECT sign * ({size}) FROM ({digits}) d)"


def _literal(value: object) -> str:
    if value is None:
        return "NULL"
    if isinstance(value, int | float):
        return repr(int(value) if isinstance(value, bool) else value)
    return "'" + (value if isinstance(value, str) else json.dumps(value)).replace("'", "''") + "'"


def _quoted(name: str) -> str:
    return '"' + name.replace('"', '""') + '"'
