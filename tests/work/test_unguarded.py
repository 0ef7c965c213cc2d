"""Workers need nothing of the script that starts them, and know what a user's files define."""

from __future__ import annotations

import pickle
import subprocess
import sys
from pathlib import Path

import pytest

from realitygap.errors import UsageError
from realitygap.plugins import named_object, packed

BENCH = """
import os
class Bench:
    def __init__(self, more):
        self.more = more
    def carry_out(self, job, tell):
        tell((job + self.more.n, os.getpid()))
    def close(self):
        pass
class More:
    n = 10
"""
USE = """
import os, sys
from realitygap.errors import UsageError
from realitygap.plugins import named_object
from realitygap.work.pool import Setup
from realitygap.work.pool import opened
def work():
    heard = []
    with opened(2) as pool:
        pool.work(Setup(Bench, (More(),)), range(4), heard.append)
    print(sorted(number for number, _ in heard), os.getpid() in [pid for _, pid in heard], flush=True)
"""
NAMED = "Bench, More = (named_object(f'mine.py:{name}', UsageError, name) for name in ('Bench', 'More'))\n"
ELSEWHERE, HERE = "[10, 11, 12, 13] False\n", "[10, 11, 12, 13] True\n"
DAEMON = (
    "import multiprocessing\n"
    "child = multiprocessing.get_context('fork').Process(target=work, daemon=True)\n"
    "child.start()\nchild.join()\n"
)


def ran(folder: Path, text: str, how: str = "file") -> tuple[str, str]:
    """What a script says on its two streams, with the user's file beside it."""
    (folder / "mine.py").write_text(BENCH)
    (folder / "script.py").write_text(text)
    words, given = {"file": (["script.py"], ""), "-c": (["-c", text], ""), "stdin": (["-"], text)}[how]
    done = subprocess.run(
        [sys.executable, *words], cwd=folder, input=given, capture_output=True, text=True, timeout=120
    )
    return done.stdout, done.stderr


@pytest.mark.parametrize("how", ["file", "-c", "stdin"])
def test_a_script_needs_no_guard(tmp_path: Path, how: str) -> None:
    """It is run once, wherever it stands, and its workers carry out what the user's file defines."""
    assert ran(tmp_path, USE + NAMED + "work()\n", how) == (ELSEWHERE, "")


def test_a_daemonic_process_works_alone(tmp_path: Path) -> None:
    """Python lets it start no others: it does the work itself, and says so."""
    out, error = ran(tmp_path, USE + NAMED + DAEMON)
    assert out == HERE and "one worker, this process, does all of the work" in error


def test_what_a_guarded_script_defines_is_known_to_its_workers(tmp_path: Path) -> None:
    """They run it as Python's own would; without a guard the message says what it lacks."""
    guarded = USE + BENCH + "print('run\\n', end='')\nif __name__ == '__main__':\n    work()\n"
    *runs, said = ran(tmp_path, guarded)[0].splitlines()
    assert set(runs) == {"run"} and 2 <= len(runs) <= 3 and f"{said}\n" == ELSEWHERE
    _, error = ran(tmp_path, USE + BENCH + "work()\n")
    assert "a worker process died (exit code 1)" in error and "must begin under `if __name__" in error


def test_a_file_named_twice_is_one_module(tmp_path: Path) -> None:
    """What it defines is the same object, which can be pickled; edited, it is run again."""
    file = tmp_path / "mine.py"
    file.write_text(BENCH)

    def more() -> type:
        return named_object(f"{file}:More", UsageError, "one")  # type: ignore[return-value]

    first = more()
    assert more() is first and pickle.loads(pickle.dumps(first())).n == 10
    assert packed(first())[0] == [str(file)] and packed("no object of it")[0] == []
    file.write_text(BENCH.replace("10", "20"))
    assert more().n == 20
