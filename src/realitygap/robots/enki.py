"""Enki as a reality: units of EPFL's simulator's Khepera, e-puck and Thymio II, in any room, in Enki's own
time.

Only the units are ours: gains, directions and wheels, drawn from a unit's number on top of its published
models. Its noise is its own, with a scale; its step is 20 ms. The library is under the GNU General Public
License, version 2 or later. So it stays behind a pipe: a small program in C++, compiled at first use with the
system's compiler and kept, is talked to with a line of text in, a line of numbers out, a limit to every wait.
"""

import hashlib
import os
import shutil
import subprocess
import sysconfig
import weakref
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from realitygap.errors import ConfigError, RobotError, UsageError
from realitygap.files import atomic_path
from realitygap.robots.body import Body, Channel, Odometry, SteppedClock
from realitygap.track import Track
from realitygap.values import Command, Pose, Readings
from realitygap.work import child

__all__ = [
    "MODELS",
    "EnkiBody",
    "EnkiProcess",
    "Model",
    "Unit",
    "draw_unit",
    "opened",
    "program",
]

GAIN_SHARE, TURN_RAD = 0.2, 0.0873
"""Deviations between the eight sensors of one real Khepera: its wall table shows 20 to 25 % and 3° to 11°."""
WHEEL_SHARE, TRACK_SHARE = 0.004, 0.006
MOST = 3.0
"""Deviations, at most: no maker delivers worse."""


@dataclass(frozen=True, kw_only=True)
class Model:
    """What a driver needs to know of one of Enki's robots.

    Attributes:
        words: its name for a person.
        profile: the shipped profile of what is known of it beforehand.
        sensors: how many proximity sensors; full_scale: their highest count.
        unit_cm_s: speed of a wheel at command 1; top: the largest command.
        pulses_per_mm: of its wheels' counters; None: it has none.
        commands: what its commands and speeds are in.
    """

    words: str
    profile: str
    sensors: int
    full_scale: int
    unit_cm_s: float
    top: int
    pulses_per_mm: float | None
    commands: str


MODELS = {
    "khepera": Model(
        words="Enki's Khepera", profile="enki-khepera", sensors=8, full_scale=1023, unit_cm_s=0.8,
        top=127, pulses_per_mm=12.0, commands="Khepera units",
    ),
    "epuck": Model(
        words="Enki's e-puck", profile="enki-epuck", sensors=8, full_scale=4095, unit_cm_s=0.0128,
        top=1000, pulses_per_mm=1000 / 128.0, commands="e-puck units (steps/s)",
    ),
    "thymio2": Model(
        words="Enki's Thymio II", profile="enki-thymio2", sensors=7, full_scale=4505, unit_cm_s=16.6 / 500,
        top=500, pulses_per_mm=None, commands="Thymio units",
    ),
}  # fmt: skip
"""Full scales: the converters' 10 and 12 bits; of the Thymio the most that Enki's model gives. A Khepera's
unit is a pulse each 10 ms (8 mm/s); an e-puck makes 1000 steps a turn of 128 mm; 500 Thymio units are Enki's
top speed of 16.6 cm/s."""


@dataclass(frozen=True, kw_only=True)
class Unit:
    """A unit's shares of what is published, and by how much its sensors are turned (rad)."""

    track: float
    wheels: tuple[float, float]
    gains: tuple[float, ...]
    turns: tuple[float, ...]


def draw_unit(model: str, number: int) -> Unit:
    """The unit with this number of a model, always the same one; 0 is what is published."""
    draws = np.random.default_rng([number, list(MODELS).index(model), 19])
    around = np.clip(draws.standard_normal(3 + 2 * MODELS[model].sensors), -MOST, MOST)
    around *= number > 0
    wheels, sensors = 1.0 + WHEEL_SHARE * around[1:3], around[3:].reshape(2, -1)
    return Unit(
        track=float(1.0 + TRACK_SHARE * around[0]),
        wheels=(float(wheels[0]), float(wheels[1])),
        gains=tuple((1.0 + GAIN_SHARE * sensors[0]).tolist()),
        turns=tuple((TURN_RAD * sensors[1]).tolist()),
    )


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


class StepResult(NamedTuple):
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
        """Be a unit of a model in a new room, with Enki's noise at a scale.

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

    def place(self, x_cm: float, y_cm: float, heading: float) -> StepResult:
        """Set the robot down; it stands for a step."""
        return self._result(1, self._ask("place", (x_cm, y_cm, heading)))

    def run(self, steps: int, left_cm_s: float, right_cm_s: float) -> StepResult:
        """Run some steps with these speeds of the wheels."""
        return self._result(steps, self._ask("run", (steps, left_cm_s, right_cm_s)))

    @property
    def alive(self) -> bool:
        """Whether it was not closed."""
        return self._finalizer.alive

    def close(self) -> None:
        self._finalizer()

    def _result(self, steps: int, answer: NDArray[np.float64]) -> StepResult:
        poses, rest = answer[: 3 * steps].reshape(steps, 3), answer[3 * steps :]
        return StepResult(poses, rest[:2], rest[2:4], rest[4:])

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


MM_PER_CM = 10.0
ROOM: dict[str, Any] = {"size_cm": [60.0, 60.0]}
"""Where it stands until it enters another."""
GRID = (180, (0.5, 1.0, 1.5, 2.0, 3.0, 4.0, 5.5, 8.0, 10.0, 12.5, 15.0))
"""Bearings and distances (cm) at which its infrared is recorded: 2 degrees apart, and on to where none of its
robots sees anything. Where a ray just meets a thing, or just not, tells where a sensor looks only as nearly
as places are apart."""


class EnkiBody(Body):
    """One process serves it in all its rooms. It sees walls and cylinders, no light.

    Args:
        model: "khepera", "epuck" or "thymio2".
        unit: which robot of the population; 0 is Enki's published model.
        noise: the scale of Enki's noise.
    """

    period_s, infrared_grid = 0.1, GRID
    clock: SteppedClock
    _film: Path | None
    _seen: list[NDArray[np.float64]]

    def __init__(self, model: str, unit: int, *, noise: float = 1.0) -> None:
        self.model, self.unit, self.noise = model, unit, noise
        self._is = MODELS[model]
        self.channels = (Channel(name="proximity", sensors=self._is.sensors, high=self._is.full_scale),)
        self.counts_turns = self._is.pulses_per_mm is not None
        self.pulses_per_mm = self._is.pulses_per_mm
        self.clock = SteppedClock(self._step, STEP_S)
        self._enki = EnkiProcess()
        self.enter(ROOM, 0, None)

    @property
    def facts(self) -> dict[str, Any]:
        """What a recording says of it."""
        pulses = {"pulses_per_mm": self.pulses_per_mm} if self.counts_turns else {}
        return {
            "units": self._is.commands, "robot": self._is.words, "unit": self.unit, "twin_noise": self.noise,
            "base": self._is.profile, **pulses,
        }  # fmt: skip

    @property
    def pose(self) -> Pose:  # type: ignore[override]
        """Where it is."""
        self._catch_up()
        x, y, heading = self._now.poses[-1].tolist()
        return Pose.reached(x, y, heading)

    @property
    def odometry(self) -> Odometry:
        """Both wheels' counters and speeds now, of a robot that counts them."""
        if not self.counts_turns:
            return Odometry()
        self._catch_up()
        ways, speeds = self._now.ways - self._zero, self._now.speeds / self._is.unit_cm_s
        counts = ways * MM_PER_CM * (self.pulses_per_mm or 0.0)
        left, right = np.rint([counts, speeds]).astype(int).T.tolist()
        return Odometry((left[0], right[0]), (left[1], right[1]))

    def pace(self, period_s: float) -> None:
        """Take steps of this length; each begins with the step of Enki's that is over by then."""
        self.period_s = period_s

    def enter(self, room: Mapping[str, Any], seed: int, pose: Pose | None) -> None:
        """Be as new, in another room: no trial affects the next."""
        self._due, self._given, self._film = 0, Command(left=0, right=0), None
        width, depth = room["size_cm"]
        if "reflectance" in room:
            raise ConfigError(
                "arena: reflectance: expected none for a robot of Enki's: in Enki all surfaces "
                "reflect alike. Use the twin, or leave it out."
            )
        self._enki.enter(room, model=self.model, unit=self.unit, noise=self.noise, seed=seed)
        self._put(pose or Pose(x=width / 2, y=depth / 2, heading=0.0))

    def reset(self, pose: Pose | None = None) -> None:
        """Stand still at `pose`, counters at zero."""
        self.stop()
        self._catch_up()
        if pose is not None:
            self._put(pose)
        self._zero = self._now.ways

    def sense(self) -> Readings:
        """What its sensors read at Enki's last step."""
        self._catch_up()
        counts = np.clip(np.rint(self._now.values), 0.0, self._is.full_scale)
        return Readings(proximity=counts, ambient=np.empty(0))

    def act(self, command: Command) -> None:
        """Wheel speeds from now on, in the robot's own units, held to its largest ones."""
        self._catch_up()
        self._given = command

    def stop(self) -> None:
        """Stop, from Enki's next step on; one whose process is gone stands."""
        if self._enki.alive:
            self.act(Command(left=0, right=0))

    def film(self, states: Path | None) -> None:
        """Write where it is, each of Enki's steps, into a sealed file for the camera; None ends it."""
        self._catch_up()
        if self._film is not None:
            x, y, heading = np.concatenate(self._seen).T
            t, sure = np.arange(len(x), dtype=np.float64) * STEP_S, np.ones(len(x))
            Track(t=t, x=x, y=y, heading=heading, quality=sure, seen_by="truth").write_csv(self._film)
        self._film, self._seen = states, [self._now.poses[-1:]]

    def close(self) -> None:
        """Release it and end its process."""
        self._enki.close()

    abandon = close

    def _put(self, pose: Pose) -> None:
        self._now = self._enki.place(pose.x, pose.y, pose.heading)
        self._zero = self._now.ways * 0.0
        self.clock.begin_step()

    def _step(self) -> None:
        """A step of Enki's is due; it is made when somebody looks, or gives another command."""
        self._due += 1

    def _catch_up(self) -> None:
        if self._due:
            steps, self._due = self._due, 0
            unit, top, given = self._is.unit_cm_s, self._is.top, self._given
            left, right = (unit * max(-top, min(top, wheel)) for wheel in (given.left, given.right))
            self._now = self._enki.run(steps, left, right)
            if self._film is not None:
                self._seen.append(self._now.poses)


def opened(name: str, *, noise: float = 1.0, **_: Any) -> EnkiBody:
    """A unit by its model and its number, as in "epuck:3"."""
    model, _colon, unit = name.partition(":")
    return EnkiBody(model, int(unit), noise=noise)
