"""Enki in a process of its own: a line of text in, a line of numbers out, a limit to every wait.

Its program in C++ is compiled at first use, and kept.
"""

import hashlib
import os
import shutil
import subprocess
import sysconfig
import weakref
from collections.abc import Iterable, Mapping
from importlib import resources
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from realitygap.enki.unit import draw_unit
from realitygap.errors import RobotError, UsageError
from realitygap.files import atomic_path
from realitygap.work import child

__all__ = ["STEP_S", "EnkiProcess", "Moment", "program"]

SOURCE = "enki.cpp"
COMPILER = ("g++", "-std=c++14", "-O2")
LIBRARY = "libenki.so"
CURE = "Install them with: apt install libenki-dev g++"
LONGEST_S = 300.0
"""Compiling takes 3 s."""


def program(text: bytes | None = None) -> Path:
    """The path of the program that `text` in C++ compiles to, by default of the one that is talked to.

    It is named after its text, the compiler's options and the library.

    Raises:
        UsageError: without the library or the compiler, or where nothing can be kept.
    """
    if text is None:
        text = resources.files(__package__).joinpath(SOURCE).read_bytes()
    library = _library()
    digest = hashlib.sha256(repr(COMPILER).encode() + text + library.read_bytes()).hexdigest()[:16]
    home = os.environ.get("XDG_CACHE_HOME") or os.path.join(os.path.expanduser("~"), ".cache")
    path = Path(home) / "realitygap" / f"enki-{digest}"
    try:
        path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        facts = path.parent.stat()
        if facts.st_uid != os.getuid() or facts.st_mode & 0o022:
            raise PermissionError(13, "others can write into it")
        if not path.is_file():
            _compile(text, library, path)
    except OSError as error:
        raise UsageError(
            f"enki: its compiled program cannot be kept in {path.parent}: {error.strerror or error}. "
            "Set XDG_CACHE_HOME to another folder."
        ) from None
    return path


def _library() -> Path:
    """Enki's shared library."""
    multiarch = sysconfig.get_config_var("MULTIARCH")
    for folder in ("/usr/lib", f"/usr/lib/{multiarch}", "/usr/local/lib", "/usr/lib64"):
        if (Path(folder) / LIBRARY).exists():
            return Path(folder) / LIBRARY
    raise UsageError(f"enki: expected EPFL's simulator Enki ({LIBRARY}) and its headers. {CURE}")


def _compile(text: bytes, library: Path, path: Path) -> None:
    """Compile to `path`, whole: of two processes that do so at once the later one's program stays."""
    compiler = shutil.which(COMPILER[0])
    if compiler is None:
        raise UsageError(f"enki: expected a compiler, {COMPILER[0]}, to use the simulator Enki. {CURE}")
    with atomic_path(path) as spare:
        order = [compiler, *COMPILER[1:], "-x", "c++", "-", "-x", "none", str(library), "-o", str(spare)]
        try:
            made = subprocess.run(order, input=text, capture_output=True, timeout=LONGEST_S)
        except subprocess.TimeoutExpired:
            raise UsageError(f"enki: {COMPILER[0]} did not compile it within {LONGEST_S:g} s.") from None
        if made.returncode:
            raise UsageError(f"enki: {COMPILER[0]} cannot compile it: {_said(made.stderr)}. {CURE}")


def _said(words: bytes) -> str:
    """The first line that tells what is wrong."""
    lines = words.decode("utf-8", "replace").splitlines()
    return next(
        (line.strip() for line in lines if "error" in line), lines[-1] if lines else "no reason given"
    )


STEP_S = 0.02
"""Enki's step, s, as in `enki.cpp`: a part of the model, since wheel noise is drawn each step."""
PATIENCE_S = 10.0
"""Longest wait for an answer, which takes microseconds."""
LEAVE_S = 2.0
WHO = "Enki's process"
GONE = f"{WHO} is gone; start again"


class Moment(NamedTuple):
    """The results of some steps.

    Attributes:
        poses: [steps, 3] x, y (cm) and heading (rad) after each step.
        ways: of the left wheel and the right one since the robot was set down, cm.
        speeds: of both, cm/s.
        values: [n] what the sensors read.
    """

    poses: NDArray[np.float64]
    ways: NDArray[np.float64]
    speeds: NDArray[np.float64]
    values: NDArray[np.float64]


class EnkiProcess:
    """One robot in one room after another. It ends when closed, or with this process.

    Raises:
        UsageError: Enki is not installed, or cannot be compiled.
    """

    def __init__(self) -> None:
        pipes: dict[str, Any] = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "bufsize": 0}
        path = program()
        try:
            self._process = subprocess.Popen([path], start_new_session=True, **pipes)
        except OSError as error:
            raise UsageError(
                f"enki: its program {path} cannot be started: {error.strerror}. Remove it, or name another "
                "folder by XDG_CACHE_HOME."
            ) from None
        self._finalizer = weakref.finalize(self, child.end, self._process, LEAVE_S)

    def enter(
        self, room: Mapping[str, Any], *, model: str, unit: int, noise: float, seed: int
    ) -> NDArray[np.float64]:
        """Be a unit in a new room.

        Args:
            room: plain numbers, cm: size_cm, cylinders, walls; Enki's robots see no lamps.
            model: "khepera", "epuck" or "thymio2".
            unit: its number; 0 is the published model.
            noise: the scale of Enki's noise.
            seed: of that noise.

        Returns:
            What is published: axle, top speed, wheels' noise, radius (cm, cm/s, share, cm), and of each
            sensor x, y, direction (rad), its most and its noise (counts).

        Raises:
            RobotError: the process is gone.
        """
        who = draw_unit(model, unit)
        things = (room.get("cylinders", ()), room.get("walls", ()))
        numbers = (
            seed, noise, who.track, *who.wheels, len(who.gains), *who.gains, *who.turns, *room["size_cm"],
            *(number for rows in things for number in (len(rows), *(v for row in rows for v in row))),
        )  # fmt: skip
        return self._ask(f"enter {model}", numbers)

    def place(self, x_cm: float, y_cm: float, heading: float) -> Moment:
        """Set the robot down; it stands for a step."""
        return self._moment(1, self._ask("place", (x_cm, y_cm, heading)))

    def run(self, steps: int, left_cm_s: float, right_cm_s: float) -> Moment:
        """Run some steps with these speeds of the wheels."""
        return self._moment(steps, self._ask("run", (steps, left_cm_s, right_cm_s)))

    def close(self) -> None:
        self._finalizer()

    def _moment(self, steps: int, told: NDArray[np.float64]) -> Moment:
        poses, rest = told[: 3 * steps].reshape(steps, 3), told[3 * steps :]
        return Moment(poses, rest[:2], rest[2:4], rest[4:])

    def _ask(self, word: str, numbers: Iterable[float]) -> NDArray[np.float64]:
        if not self._finalizer.alive:
            raise RobotError(GONE)
        try:
            line = " ".join([word, *map(str, map(_plain, numbers))]).encode() + b"\n"
            answer = child.ask(self._process, line, within_s=PATIENCE_S, who=WHO)
            if not answer.endswith(b"\n"):
                raise RobotError(GONE)
        except OSError as error:
            self.close()
            raise RobotError(f"{GONE}: {error.strerror}") from None
        except BaseException:
            self.close()  # its next answer would be to this question
            raise
        if answer.startswith(b"error"):
            said = answer[:-1].decode("utf-8", "replace")
            raise RobotError(f"Enki does not understand {word!r}: {said[:200]}")
        return np.array(answer.split(), np.float64)


def _plain(number: float) -> float | int:
    """A number as Python writes it exactly, NumPy's too."""
    return number if isinstance(number, int) else float(number)
