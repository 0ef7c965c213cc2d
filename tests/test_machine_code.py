"""Compiled functions on file: believed only as they were written."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import ClassVar

import numba
import pytest

from realitygap.errors import UsageError
from realitygap.kernels.jit import SHELF, entry_for, kernel
from realitygap.machine_code import Shelf
from realitygap.plugins import run_file
from tests.hostile.damage import KINDS, command, damage

SMALL = """
from realitygap.machine_code import Shelf

shelf = Shelf(b"a test")
def add(a, b): return a + b
def subtract(a, b): return a - b
add, subtract = shelf.compiled(add), shelf.compiled(subtract)

def told():
    sums = add(5, 3), subtract(5, 3)
    return *sums, sum(add.stats.cache_hits.values()), sum(subtract.stats.cache_hits.values())
"""

NURSERY = """
import gc, json, os, sys
import numba

@numba.njit
def first(a): return a + 1
first(1)
gc.freeze()

for line in sys.stdin:
    order = json.loads(line)
    child = os.fork()
    if child == 0:
        break
    print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), flush=True)
else:
    sys.exit()
os.environ.clear()
os.environ.update(order["environment"])
os.chdir(order["folder"])
sys.path.insert(1, order["folder"])
for number, name in enumerate((os.devnull, "out", "err")):
    os.dup2(os.open(name, os.O_RDONLY if number == 0 else os.O_WRONLY | os.O_CREAT | os.O_TRUNC), number)
exec(order["program"], {"__name__": "__main__"})
"""
"""A process that has imported Numba and compiled one function, and no more, forks one for each program: what
comes before a first compilation, and freeing all that at the end, would be most of what they do."""

compiler = pytest.mark.skipif(bool(os.environ.get("NUMBA_DISABLE_JIT")), reason="the compiler is off")
pytestmark = compiler


def program(more: str) -> str:
    return f"from small import told; print(*told(), flush=True)\n{more}"


class Place:
    """A program, its cache and its temporary folder."""

    nursery: ClassVar[subprocess.Popen[str]]

    def __init__(self, folder: Path) -> None:
        self.folder, self.cache, self.temporary = folder, folder / "cache", folder / "tmp"
        self.temporary.mkdir()
        (folder / "small.py").write_text(SMALL)

    def start(self, more: str = "", cache: str = "") -> subprocess.Popen[str]:
        """The program begun: it prints two sums and how many of the two functions were on file."""
        return subprocess.Popen(
            [sys.executable, "-c", program(more)], text=True, env=self.environment(cache), cwd=self.folder,
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, stdin=subprocess.PIPE,
        )  # fmt: skip

    def run(self, more: str = "", cache: str = "") -> tuple[str, str]:
        """What the program said on stdout and stderr, once it ended well."""
        order = {"program": program(more), "folder": str(self.folder), "environment": self.environment(cache)}
        nursery = self.nursery
        assert nursery.stdin is not None and nursery.stdout is not None
        print(json.dumps(order), file=nursery.stdin, flush=True)
        code = nursery.stdout.readline()
        out, err = ((self.folder / name).read_text().strip() for name in ("out", "err"))
        assert code == "0\n", err
        return out, err

    def environment(self, cache: str) -> dict[str, str]:
        """What the program finds."""
        names = {"XDG_CACHE_HOME": cache or str(self.cache), "TMPDIR": str(self.temporary)}
        names["PYTHONDONTWRITEBYTECODE"] = "1"  # a file edited within a second would be taken for the old one
        dropped = ("REALITYGAP_SPARE_CACHE", "NUMBA_CACHE_DIR")
        environment = {key: value for key, value in os.environ.items() if key not in dropped} | names
        return environment | {"PYTHONPATH": str(self.folder)}

    def entries(self) -> list[Path]:
        """The files of the cache, by name."""
        return sorted(self.cache.rglob("*.code"))

    def left(self) -> list[str]:
        """What is in the temporary folder."""
        return os.listdir(self.temporary)


@pytest.fixture(scope="module", autouse=True)
def nursery() -> Iterator[None]:
    """From which all programs come that are run to their end."""
    with subprocess.Popen(
        [sys.executable, "-B", "-c", NURSERY], text=True, stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as Place.nursery:
        yield


@pytest.fixture(scope="module")
def kept(tmp_path_factory: pytest.TempPathFactory) -> Place:
    """A place whose two functions are on file."""
    place = Place(tmp_path_factory.mktemp("place"))
    assert place.run() == ("8 2 0 0", "") and len(place.entries()) == 2
    return place


@pytest.fixture
def place(kept: Place) -> Iterator[Place]:
    """The same, put right again afterwards."""
    whole = {entry: entry.read_bytes() for entry in kept.entries()}
    yield kept
    for entry, data in whole.items():
        entry.write_bytes(data)


def test_what_is_on_file_is_loaded_and_nobody_else_can_write_it(place: Place) -> None:
    """A second process compiles nothing, nor loads what only that needs; the folder is the user's alone."""
    process = place.start("import sys; print('numba.np.arraymath' in sys.modules)")
    assert process.communicate(timeout=60) == ("8 2 1 1\nFalse\n", "") and process.returncode == 0
    assert place.entries()[0].parent.stat().st_mode & 0o777 == 0o700


@pytest.mark.parametrize("kind", KINDS)
def test_a_damaged_entry_is_compiled_again(place: Place, kind: str) -> None:
    """Whatever happened to an entry: the right result, one line that says so, and a whole entry again."""
    entry, other = place.entries()
    before = entry.read_bytes()
    damage(entry, kind, other, seed=1)
    out, err = place.run()
    assert out in ("8 2 0 1", "8 2 1 0")
    assert len(err.splitlines()) == 1 and "was damaged" in err and entry.name in err
    assert len(entry.read_bytes()) == len(before)


def test_an_edited_function_is_compiled_again(tmp_path: Path) -> None:
    """Compiled code of a file's earlier text is never taken."""
    place = Place(tmp_path)
    place.run()
    (tmp_path / "small.py").write_text(SMALL.replace("a - b", "a * b"))
    assert place.run()[0] == "8 15 0 0"


PART = """
from realitygap.machine_code import Shelf

shelf = Shelf(b"a test")
def half(a): return a / 2
half = shelf.compiled(half, form="PART")
def whole(a): return half(a) + half(a)
whole = shelf.compiled(whole)

def told():
    before = sorted(name for name in ("half", "whole", "other") if shelf.holds(name))
    return *before, whole(3.0), half(3.0), half(5), whole(5.0)
"""


def test_a_part_is_called_by_compiled_code_and_by_python(tmp_path: Path) -> None:
    """Freshly compiled or from a file, a part that has no way in for Python serves both callers."""
    place = Place(tmp_path)
    (tmp_path / "small.py").write_text(PART)
    assert place.run() == ("3.0 1.5 2.5 5.0", "")
    assert place.run() == ("half whole 3.0 1.5 2.5 5.0", "")


HALF, TWICE = (
    """
from realitygap.machine_code import Shelf

shelf = Shelf(b"a test")
def half(a): return a / 2
half = shelf.compiled(half, form="PART", fastmath={"nnan"}, _nrt=False)
""",
    """
from halves import half, shelf
def whole(a): return half(a) + half(a)
whole = shelf.compiled(whole)

def told():
    return whole(3.0), sum(half.stats.cache_hits.values())
""",
)


def test_a_part_on_file_is_linked_into_what_is_compiled_later(tmp_path: Path) -> None:
    """It is no machine code of its own: what calls it is, whether or not both were compiled at once."""
    place = Place(tmp_path)
    (tmp_path / "halves.py").write_text(HALF)
    (tmp_path / "small.py").write_text(TWICE)
    assert place.run() == ("3.0 0", "")
    (tmp_path / "small.py").write_text(TWICE.replace("half(a) + half(a)", "half(a) + half(half(a))"))
    assert place.run() == ("2.25 1", "")


def test_a_folder_that_others_can_write_is_not_used(place: Place) -> None:
    """Code that somebody else may have put there is not loaded, and that is said."""
    folder = place.entries()[0].parent
    folder.chmod(0o777)
    try:
        out, err = place.run()
    finally:
        folder.chmod(0o700)
    assert out == "8 2 0 0" and "others can write" in err and str(folder) in err


CHILDREN = """
import subprocess, sys
for _ in range(2):
    code = "from small import told; print(*told())"
    print(subprocess.run([sys.executable, "-c", code], capture_output=True, text=True).stdout.strip())
"""


def test_without_a_place_all_processes_share_one_temporary_folder(place: Place) -> None:
    """Where nothing can be kept: one folder, one line that names the place, and nothing left behind."""
    out, err = place.run(CHILDREN, cache="/dev/null")
    assert out.splitlines() == ["8 2 0 0", "8 2 1 1", "8 2 1 1"]
    assert len(err.splitlines()) == 1 and "/dev/null" in err and "Not a directory" in err
    assert place.left() == []


def test_what_a_kill_left_is_swept(place: Place) -> None:
    """A folder of a killed process goes at the next start; that of a living one, and a stranger's, stay."""
    first, second = (place.start("import sys; sys.stdin.read()", cache="/dev/null") for _ in range(2))
    for process in (first, second):
        assert process.stdout is not None and process.stdout.readline() == "8 2 0 0\n"
    stranger = place.temporary / "realitygap-of-mine"
    stranger.mkdir()
    assert len(place.left()) == 3
    first.send_signal(signal.SIGKILL)
    first.communicate(timeout=60)
    place.run()
    assert len(place.left()) == 2 and stranger.is_dir()
    second.communicate(timeout=60)
    assert place.left() == [stranger.name]
    stranger.rmdir()


def test_a_command_survives_a_damaged_entry_of_its_own(tmp_path: Path) -> None:
    """`simulate` with its score's compiled code cut short ends as without."""
    right, _ = command(None)
    cache, there = tmp_path / "cache", SHELF.place
    copy = shutil.copytree(there, cache / "realitygap" / there.name)
    copy.chmod(0o700)
    for entry in cache.rglob("avoidance-*.code"):
        damage(entry, "cut", entry, seed=1)
    out, err = command(cache)
    assert out == right and "was damaged" in err


def test_a_number_outside_a_users_function_is_compiled_in(tmp_path: Path) -> None:
    """A program that changes it gets the function with the new one, not what is on file for its text."""
    file = tmp_path / "user.py"
    file.write_text("GAIN = 0.0\n\n\ndef scaled(x):\n    return GAIN * x\n")
    module, shelf = run_file(file, UsageError), Shelf(b"a test")
    for module.GAIN in (2.0, 3.0, 2.0):
        assert shelf.compiled(module.scaled)(1.0) == module.GAIN


def test_a_number_outside_a_function_that_a_users_function_calls_is_compiled_in(tmp_path: Path) -> None:
    """It too may change while the text stays; here in a file of its own."""
    file = tmp_path / "user.py"
    file.write_text(
        "import numba\n\nGAIN = 0.0\n\n\n@numba.njit\ndef inner(x):\n    return GAIN * x\n\n\n"
        "def outer(x):\n    return inner(x) + 1.0\n"
    )
    module, shelf = run_file(file, UsageError), Shelf(b"a test")
    for module.GAIN in (2.0, 3.0, 2.0):
        module.inner = numba.njit(module.inner.py_func)
        assert shelf.compiled(module.outer)(1.0) == module.GAIN + 1.0


@pytest.mark.parametrize(("words", "call"), [("import helpers", "helpers."), ("from helpers import *", "")])
def test_what_a_users_function_takes_from_another_file_is_compiled_in(
    tmp_path: Path, words: str, call: str
) -> None:
    """A number there, or a compiled function, may change while the function's own file does not."""
    place = Place(tmp_path)
    user = f"{words}\n\n\ndef score(x):\n    return {call}GAIN * {call}inner(x)\n"
    (tmp_path / "small.py").write_text(
        f"from realitygap.machine_code import Shelf\n{user}\n\n"
        "def told():\n    return (Shelf(b'a test').compiled(score)(1.0),)\n"
    )
    for gain, factor in ((2.0, 3.0), (5.0, 3.0), (5.0, 7.0), (2.0, 3.0)):
        (tmp_path / "helpers.py").write_text(
            f"import numba\n\nGAIN = {gain}\n\n\n@numba.njit\ndef inner(x):\n    return {factor} * x\n"
        )
        assert place.run() == (str(gain * factor), "")


def test_numbers_that_a_caller_writes_down_are_compiled_once(tmp_path: Path) -> None:
    """A part called with 0 and with 1 is one function of a whole number; with 0.5 it is another."""
    file = tmp_path / "user.py"
    plus, calls = "def plus(x, y):\n    return x + y\n", "def calls(x):\n    return plus(x, 0) + plus(x, 1)\n"
    file.write_text(f"{plus}\n\n{calls}")
    module, shelf = run_file(file, UsageError), Shelf(b"a test")
    module.plus = part = shelf.compiled(module.plus, form="PART")
    assert shelf.compiled(module.calls)(5) == 11 and len(part.overloads) == 1
    assert part.get_call_template((numba.int64, numba.types.literal(0)), {})[2] == (numba.int64, numba.int64)
    assert shelf.compiled(lambda x: part(x, 0.5))(5) == 5.5 and len(part.overloads) == 2


APART = """
from realitygap.machine_code import Shelf

shelf = Shelf(b"a test")
def half(x): return 0.5 * x
half = shelf.compiled(half, form="APART")
def quarter(x): return half(half(x))
quarter = shelf.compiled(quarter)

def told():
    return quarter(8.0), sum(quarter.stats.cache_hits.values()), sum(half.stats.cache_hits.values())
"""


def test_code_that_lies_apart_is_there_before_what_calls_it(tmp_path: Path) -> None:
    """A second process loads both; where it is gone or damaged, both are compiled again."""
    place = Place(tmp_path)
    (tmp_path / "small.py").write_text(APART)
    assert place.run() == ("2.0 0 0", "") and place.run() == ("2.0 1 0", "")
    (apart,) = tmp_path.rglob("half-*.code")
    older = apart.read_bytes()
    apart.unlink()
    assert place.run() == ("2.0 0 0", "") and place.run() == ("2.0 1 0", "")
    assert place.run("from small import half; print(half(1.0))")[0].endswith("0.5")
    apart.write_bytes(older)
    damage(apart, "cut", apart, seed=1)
    out, err = place.run()
    assert out == "2.0 0 0" and "was damaged" in err and place.run() == ("2.0 1 0", "")


def test_an_entry_is_found_for_each_kind_of_arguments() -> None:
    """Whole numbers after fractions, and fractions after whole numbers, are not taken for each other."""
    total = kernel(lambda one, other: one + other)
    for _ in range(2):
        assert entry_for(total, 1, 2)((3, 4)) == 7 and entry_for(total, 0.5, 1)((1.5, 1)) == 2.5
