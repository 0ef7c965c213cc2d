"""Compiled functions: kept on file for as long as their text stays, and believed only whole."""

from __future__ import annotations

import os
import random
import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

import numba
import numpy as np
import pytest

from realitygap import compiled as module
from realitygap.compiled import compiled, helper, kernel, naming, step
from realitygap.errors import UsageError
from realitygap.plugins import run_file

pytestmark = pytest.mark.skipif(bool(os.environ.get("NUMBA_DISABLE_JIT")), reason="the compiler is off")

KINDS = ("cut", "empty", "flipped", "pickle", "another")


def damage(entry: Path, kind: str, other: Path) -> None:
    """Make a file wrong: cut short, empty, a bit flipped, a pickle that runs a program, or another's."""
    data, chance = bytearray(entry.read_bytes()), random.Random(1)
    if kind == "cut":
        data = data[: chance.randrange(max(1, len(data)))]
    elif kind == "empty":
        data.clear()
    elif kind == "flipped":
        data[chance.randrange(len(data))] ^= 1 << chance.randrange(8)
    elif kind == "pickle":
        data = bytearray(b"cos\n_exit\n(I7\ntR.")
    else:
        data = bytearray(other.read_bytes()) if other != entry else data[::-1]
    entry.write_bytes(data)


def simulated(cache: Path | None) -> tuple[str, str]:
    """What `realitygap simulate` says on stdout and stderr with a cache of its own."""
    words = ["simulate", "avoidance", "--controller", "constant:5,-3", "--pose", "25,25,90"]
    environment = dict(os.environ)
    if cache is not None:
        environment.pop("NUMBA_CACHE_DIR", None)
        environment["XDG_CACHE_HOME"] = str(cache)
    done = subprocess.run(
        [sys.executable, "-m", "realitygap", *words], env=environment, capture_output=True, text=True,
        timeout=600, check=False,
    )  # fmt: skip
    assert done.returncode == 0, (done.returncode, done.stderr)
    return done.stdout, done.stderr


SMALL = """
from realitygap.compiled import compiled

@compiled
def add(a, b): return a + b
@compiled
def subtract(a, b): return a - b

def told():
    sums = add(5, 3), subtract(5, 3)
    return *sums, sum(add.stats.cache_hits.values()), sum(subtract.stats.cache_hits.values())
"""


class Place:
    """A program `small.py`, and its cache."""

    def __init__(self, folder: Path, text: str = SMALL) -> None:
        self.folder, self.cache = folder, folder / "cache"
        (folder / "small.py").write_text(text)

    def run(self, *, before: str = "", cache: str = "") -> str:
        """What the program's `told` gives."""
        names = {"XDG_CACHE_HOME": cache or str(self.cache), "PYTHONDONTWRITEBYTECODE": "1"}
        kept = {name: value for name, value in os.environ.items() if name != "NUMBA_CACHE_DIR"}
        path = os.pathsep.join((str(self.folder), kept.get("PYTHONPATH", "")))
        done = subprocess.run(
            [sys.executable, "-c", f"{before}\nfrom small import told; print(*told())"], cwd=self.folder,
            env=kept | names | {"PYTHONPATH": path}, capture_output=True, text=True, timeout=300,
        )  # fmt: skip
        assert done.returncode == 0 and not done.stderr, done.stderr
        return done.stdout.strip()

    def entries(self, ending: str = "*.nb[ci]") -> list[Path]:
        """The files of the cache, by name."""
        return sorted(self.cache.rglob(ending))


@pytest.fixture(scope="module")
def kept(tmp_path_factory: pytest.TempPathFactory) -> Place:
    """A place whose two functions are on file."""
    place = Place(tmp_path_factory.mktemp("place"))
    assert place.run() == "8 2 0 0" and place.run() == "8 2 1 1"
    return place


@pytest.fixture
def place(kept: Place) -> Iterator[Place]:
    """The same, put right again afterwards."""
    whole = {entry: entry.read_bytes() for entry in kept.entries()}
    yield kept
    for entry, data in whole.items():
        entry.write_bytes(data)


@pytest.mark.parametrize("ending", ["*.nbc", "*.nbi"])
@pytest.mark.parametrize("kind", KINDS)
def test_a_damaged_entry_is_compiled_again(place: Place, kind: str, ending: str) -> None:
    """Whatever happened to a file: the right result, and a whole file again."""
    entry, other = place.entries(ending)
    damage(entry, kind, other)
    assert place.run() in ("8 2 0 1", "8 2 1 0")
    assert len(place.entries()) == 4 and all(map(module._is_whole, place.entries()))


def test_an_edited_function_is_compiled_again(tmp_path: Path) -> None:
    """Compiled code of a file's earlier text is never taken, and does not stay."""
    place = Place(tmp_path)
    place.run()
    files = len(place.entries())
    (tmp_path / "small.py").write_text(SMALL.replace("a - b", "a * b"))
    assert place.run() == "8 15 0 0" and len(place.entries()) == files


def test_where_nothing_can_be_kept_each_process_compiles(place: Place) -> None:
    """A folder that cannot be made, as in a container with a home that cannot be written."""
    assert place.run(cache="/dev/null") == place.run(cache="/dev/null") == "8 2 0 0"


HALF, WHOLE, WORDS = (
    "from realitygap.compiled import step\n\n@step\ndef half(a): return a / 2\n",
    """
from realitygap.compiled import kernel
from realitygap.halves import half
import realitygap.words

@kernel
def whole(a): return half(a) + half(a)

def told(): return whole(3.0), sum(whole.stats.cache_hits.values())
""",
    "WORD = 'nothing is compiled here'\n",
)


def test_an_edited_file_that_is_called_is_noticed_another_is_not(tmp_path: Path) -> None:
    """In the package itself: a kernel's file stays as it is, that of a step which it calls does not."""
    inside = tmp_path / "realitygap"
    inside.mkdir()
    for name, text in (("__init__", ""), ("halves", HALF), ("small", WHOLE), ("words", WORDS)):
        (inside / f"{name}.py").write_text(text)
    (inside / "compiled.py").write_text(Path(module.__file__).read_text("utf-8"))
    place = Place(tmp_path, "from realitygap.small import told\n")
    assert place.run() == "3.0 0" and place.run() == "3.0 1"
    (inside / "words.py").write_text(f"# a remark\n{WORDS}")
    assert place.run() == "3.0 1"
    (inside / "halves.py").write_text(HALF.replace("a / 2", "a / 4"))
    assert place.run() == "1.5 0" and place.run() == "1.5 1"


FAR = """
import math
from realitygap.compiled import compiled, kernel, step

@compiled
def far(a):
    for k in range(40):
        a = math.sqrt(a * a + k) if a < 1e3 else math.log(a) + math.sin(a) * math.cos(a * k) + math.tan(a)
        a = math.exp(-a) + math.atan2(a, 2.0 + k) + math.hypot(a, k) + math.erf(a)
    return a

@step
def both(a): return far(a) + far(-a)

@kernel
def whole(a): return both(a) + both(a + 1.0) + both(a + 2.0)

def told(): return whole(3.0), sum(whole.stats.cache_hits.values())
"""


def test_a_step_may_call_what_is_too_large_to_be_inlined(tmp_path: Path) -> None:
    """A kernel on file has all that it needs, though its process compiles nothing else."""
    place = Place(tmp_path, FAR)
    (fresh, none), (kept, one) = (place.run().split() for _ in range(2))
    assert fresh == kept and (none, one) == ("0", "1")


class Inner(NamedTuple):
    """Seven numbers."""

    a: float
    b: float
    c: float
    d: float
    e: float
    f: float
    g: np.ndarray


class Outer(NamedTuple):
    """A few fields, one of which is large."""

    inner: Inner
    factor: float


@step
def third(inner, k):
    """A number of an array in a large tuple."""
    return inner.g[k]


@kernel
def scaled(outer, k):
    """What a step finds in a tuple within a tuple."""
    return outer.factor * third(outer.inner, k) + outer.inner.b


def test_kernels_read_tuples_in_tuples_and_python_calls_their_steps() -> None:
    """Both read the same."""
    inner = Inner(1.0, 2.0, 3.0, 4.0, 5.0, 6.0, np.arange(8.0))
    assert scaled(Outer(inner, 10.0), 3) == 32.0 and third(inner, 3) == 3.0


MISSING = """
import numba.core.caching, numba.core.codegen, numba.core.options
load = numba.core.caching.FunctionCache.load_overload
numba.core.caching.FunctionCache.load_overload = lambda *given: load(*given)
del numba.core.codegen.JITCodeLibrary, numba.core.options.DefaultOptions
"""
TUPLES = f"""
import sys
sys.path.insert(0, {str(Path(__file__).parents[1])!r})
from tests.test_compiled import Inner, Outer, np, scaled

def told():
    inner = Inner(1.0, 2.0, 3.0, 4.0, 5.0, 6.0, np.arange(8.0))
    found = {{scaled(Outer(inner, 10.0), 3) for _ in range(1000)}}
    return *found, inner.g.sum(), sum(scaled.stats.cache_hits.values())
"""


def test_without_what_numba_does_not_publish_it_compiles_longer_and_works(tmp_path: Path) -> None:
    """As with a Numba to come that has other names: the same result, kept on file all the same."""
    place = Place(tmp_path, TUPLES)
    assert place.run(before=MISSING) == "32.0 28.0 0" and place.run(before=MISSING) == "32.0 28.0 1"


@helper
def twice(x):
    """For Python and for kernels."""
    return 2.0 * x


@kernel
def calls(x):
    """Of a number, and of numbers written down."""
    return twice(x) + twice(1) + twice(2)


def test_a_helper_is_called_by_both() -> None:
    """With the same result."""
    assert calls(3.0) == 12.0 and twice(3.0) == 6.0


def _named(x):
    return other(x) + 1.0  # noqa: F821


def test_a_function_is_told_later_what_a_name_stands_for() -> None:
    """Two copies of one function call two functions, and both are kept."""
    found = [compiled(naming(_named, other=one), home=one.py_func)(2.0) for one in (twice, calls)]
    assert found == [5.0, 11.0]


def test_a_number_outside_a_users_function_is_compiled_in(tmp_path: Path) -> None:
    """A program that changes it gets the function with the new one, not what is on file for its text."""
    file = tmp_path / "user.py"
    file.write_text("GAIN = 0.0\n\n\ndef scaled(x):\n    return GAIN * x\n")
    user = run_file(file, UsageError)
    for user.GAIN in (2.0, 3.0, 2.0):
        assert compiled(user.scaled)(1.0) == user.GAIN


def test_a_number_outside_a_function_that_a_users_function_calls_is_compiled_in(tmp_path: Path) -> None:
    """It too may change while the text stays; here in a file of its own."""
    file = tmp_path / "user.py"
    file.write_text(
        "import numba\n\nGAIN = 0.0\n\n\n@numba.njit\ndef inner(x):\n    return GAIN * x\n\n\n"
        "def outer(x):\n    return inner(x) + 1.0\n"
    )
    user = run_file(file, UsageError)
    for user.GAIN in (2.0, 3.0, 2.0):
        user.inner = numba.njit(user.inner.py_func)
        assert compiled(user.outer)(1.0) == user.GAIN + 1.0


@pytest.mark.parametrize(("words", "call"), [("import helpers", "helpers."), ("from helpers import *", "")])
def test_what_a_users_function_takes_from_another_file_is_compiled_in(
    tmp_path: Path, words: str, call: str
) -> None:
    """A number there, or a compiled function, may change while the function's own file does not."""
    place = Place(
        tmp_path,
        f"from realitygap.compiled import compiled\n{words}\n\n\n"
        f"def score(x):\n    return {call}GAIN * {call}inner(x)\n\n\n"
        "def told():\n    return (compiled(score)(1.0),)\n",
    )
    for gain, factor in ((2.0, 3.0), (5.0, 3.0), (5.0, 7.0), (2.0, 3.0)):
        (tmp_path / "helpers.py").write_text(
            f"import numba\n\nGAIN = {gain}\n\n\n@numba.njit\ndef inner(x):\n    return {factor} * x\n"
        )
        assert place.run() == str(gain * factor)


def test_a_command_survives_damaged_entries_of_its_own(tmp_path: Path) -> None:
    """`simulate` with its score's compiled code cut short says what it says without."""
    simulated(None)
    cache = tmp_path / "cache"

    def copy(source: str, target: str) -> None:
        with suppress(FileNotFoundError):  # another test's process has replaced it meanwhile
            shutil.copy2(source, target)

    shutil.copytree(module.folder(), cache / "realitygap", copy_function=copy)
    files = [file for file in cache.rglob("*.nbc") if "paper." in file.name]
    assert files
    for file in files:
        damage(file, "cut", file)
    assert simulated(cache) == simulated(None)
