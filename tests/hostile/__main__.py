"""Fuzz every kind of file: `python -m tests.hostile [--cases 2000] [--seed 0] [--kind K] [--keep FOLDER]`.

Each case is one file, changed by chance (named by seed, kind and number), read as a command reads it. It
must end with exit code 0, 1 or 2, and on failure with one line that is not "unexpected". Prints what fell.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import random
import resource
import signal
import sys
import tempfile
from pathlib import Path

from tests.hostile.inputs import KINDS
from tests.hostile.mutate import mutated

LONGEST_S, MEMORY = 60, 12 * 2**30


def tried(name: str, data: bytes) -> tuple[int, str]:
    """The exit code and what stands on stderr of reading these bytes as this kind of file."""
    from realitygap.cli import realitygap
    from realitygap.cli.console import guarded

    kind = KINDS[name]
    out, error = io.StringIO(), io.StringIO()
    with (
        tempfile.TemporaryDirectory() as folder,
        contextlib.redirect_stderr(error),
        contextlib.redirect_stdout(out),
    ):
        kind.write(Path(folder), data)
        if kind.call is not None:
            call = kind.call
            code = guarded(lambda: bool(call(Path(folder))) and None)
        else:
            try:
                realitygap.main([word.replace("{}", folder) for word in kind.command], prog_name="realitygap")
            except SystemExit as end:
                code = int(end.code or 0)
        said = error.getvalue().replace(folder, "…")
    return code, said


def fault(code: int, said: str) -> str:
    """What is wrong with an end; "" if nothing."""
    lines = [line for line in said.splitlines() if line and not line.startswith(("warning: ", "note: "))]
    if "unexpected" in said or "Traceback" in said or code not in (0, 1, 2):
        return f"exit {code}: {said[-400:]}"
    if "not enough memory" in said:
        return said[-400:]
    if code and (len(lines) != 1 or not lines[0].startswith("error: ") or len(lines[0]) > 1500):
        return f"exit {code}, {len(lines)} lines: {said[-400:]}"
    return f"exit 0 with {lines}" if not code and any("Warning" in line for line in lines) else ""


def case(name: str, seed: int, number: int) -> bytes:
    """The bytes of a case."""
    return mutated(KINDS[name].data, random.Random(f"{seed}/{name}/{number}"))


def main() -> int:
    """Try as many cases as asked for of each kind; 1 if any fell."""
    parser = argparse.ArgumentParser(prog="python -m tests.hostile", description=__doc__.splitlines()[0])
    parser.add_argument("--cases", type=int, default=2000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--kind", action="append", choices=KINDS)
    parser.add_argument("--keep", type=Path, help="write files that fell there")
    asked = parser.parse_args()
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    signal.signal(signal.SIGALRM, _late)
    fell = 0
    for name in asked.kind or KINDS:
        ends = dict.fromkeys((0, 1, 2), 0)
        for number in range(asked.cases):
            data = case(name, asked.seed, number)
            signal.alarm(LONGEST_S)
            try:
                code, said = tried(name, data)
            except BaseException as error:
                code, said = -1, f"Traceback: {error!r}"
            signal.alarm(0)
            ends[code] = ends.get(code, 0) + 1
            wrong = fault(code, said)
            if wrong:
                fell += 1
                print(f"{name} {asked.seed} {number}: {' '.join(wrong.split())}", flush=True)
                if asked.keep:
                    asked.keep.mkdir(parents=True, exist_ok=True)
                    (asked.keep / f"{name}-{asked.seed}-{number}").write_bytes(data)
        print(f"{name}: {asked.cases} cases, by exit code {ends}", flush=True)
    print(f"{fell} fell")
    return 1 if fell else 0


def _late(number: int, frame: object) -> None:
    raise TimeoutError(f"longer than {LONGEST_S} s")


if __name__ == "__main__":
    sys.exit(main())
