"""Break the code in one place at a time, and see whether its tests notice.

    python tests/mutate.py [--only WORD] [--jobs N] [--list]

Each mutation of `tests/mutations.py` is made in a copy of the tree, and the tests named beside it are run
there: a mutation that they pass has *survived*, and wants a test. The copy has a compile cache of its own
(a mutated kernel is compiled anew: half a minute). First the tests are run unmutated. Ends with 1 if a
mutation survived, breaks more than a test (a module that cannot be loaded shows nothing), or is stale:
the text that it replaces does not stand exactly once in its file any more.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from queue import SimpleQueue

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from tests.mutations import MUTATIONS, Mutation  # noqa: E402

PACKAGE = Path("src") / "realitygap"
KEPT = ("src", "tests", "examples", "docs", "benchmarks", "pyproject.toml", "README.md", "CHANGELOG.md")
WORDS = {0: "SURVIVED", 1: "killed"}
"""By pytest's exit code; any other is a mutation that says nothing."""
LONGEST_S = 1200


def is_stale(one: Mutation, tree: Path) -> bool:
    """Whether its text does not stand exactly once in its file."""
    file = tree / PACKAGE / one.file
    return not file.is_file() or file.read_text("utf-8").count(one.old) != 1


def copy_tree(to: Path) -> Path:
    """The tree without what is not tried; returns its folder."""
    tree = to / "tree"
    tree.mkdir()
    for name in KEPT:
        source = ROOT / name
        if source.is_dir():
            shutil.copytree(source, tree / name, ignore=shutil.ignore_patterns("__pycache__"))
        elif source.is_file():
            shutil.copy(source, tree / name)
    return tree


def tried(tree: Path, tests: Sequence[str]) -> tuple[int, str]:
    """pytest's exit code on these tests of the tree, and a line that says why; 1 if they never end."""
    environment = dict(os.environ)
    environment |= {"PYTHONPATH": f"{tree / 'src'}{os.pathsep}{tree}", "PYTHONDONTWRITEBYTECODE": "1"}
    environment |= {"XDG_CACHE_HOME": str(tree.parent / "cache")}
    command = [sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider", *tests]
    try:
        done = subprocess.run(
            command, cwd=tree, env=environment, capture_output=True, text=True, timeout=LONGEST_S, check=False
        )
    except subprocess.TimeoutExpired:
        return 1, f"no end within {LONGEST_S} s"
    lines = done.stdout.strip().splitlines() or [done.stderr.strip()[-200:]]
    return done.returncode, next((line for line in lines if line.startswith(("FAILED", "ERROR"))), lines[-1])


def mutated(one: Mutation, tree: Path) -> bool:
    """Whether a mutation is killed; says what became of it, and pytest's line."""
    begun, file = time.monotonic(), tree / PACKAGE / one.file
    text = file.read_text("utf-8")
    file.write_text(text.replace(one.old, one.new), "utf-8")
    try:
        code, line = tried(tree, one.tests)
    finally:
        file.write_text(text, "utf-8")
    word = WORDS.get(code, "BROKEN")
    print(f"{word:9} {one.file}: {one.title}, {time.monotonic() - begun:.0f} s  ({line})", flush=True)
    return word == "killed"


def all_mutated(chosen: Sequence[Mutation], place: Path, jobs: int) -> list[bool]:
    """Whether each is killed: every job has a tree and a compile cache of its own."""
    trees: SimpleQueue[Path] = SimpleQueue()
    for number in range(jobs):
        (place / str(number)).mkdir()
        trees.put(copy_tree(place / str(number)))

    def one_of(one: Mutation) -> bool:
        tree = trees.get()
        try:
            return mutated(one, tree)
        finally:
            trees.put(tree)

    with ThreadPoolExecutor(jobs) as pool:
        return list(pool.map(one_of, chosen))


def main() -> int:
    """Mutate, test, tell."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--only", default="", metavar="WORD", help="mutations whose file or title has it")
    parser.add_argument("--list", action="store_true", help="name them, look for stale ones, run nothing")
    parser.add_argument("--jobs", type=int, default=1, metavar="N", help="so many at once (default 1)")
    told = parser.parse_args()
    chosen = [one for one in MUTATIONS if told.only in f"{one.file} {one.title}"]
    stale = [one for one in chosen if is_stale(one, ROOT)]
    for one in stale if not told.list else chosen:
        print(f"{'STALE     ' if one in stale else ''}{one.file}: {one.title}")
    if stale or told.list:
        return int(bool(stale))
    with tempfile.TemporaryDirectory(prefix="realitygap-mutate-") as place:
        tree = copy_tree(Path(place))
        files = dict.fromkeys(test for one in chosen for test in one.tests)
        code, line = tried(tree, [*files])
        if code:
            print(f"the tests do not pass before anything is mutated: {line}")
            return 1
        killed = sum(all_mutated(chosen, Path(place), max(1, told.jobs)))
    print(f"{killed} killed, {len(chosen) - killed} not, of {len(chosen)}")
    return int(killed < len(chosen))


if __name__ == "__main__":
    sys.exit(main())
