"""The control loop: each period sense, decide, act, record; whatever happens, stop first.

Signals become an exception, held back while the robot is stopped. A recording has a row a step, written while
the robot drives, in a folder: `drive.toml` with the facts and, once the drive is over, how it ended;
`steps.csv`. Each row is handed to the system before the next step, so that a killed process loses none.
"""

from __future__ import annotations

import csv
import inspect
import math
import signal
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass, field
from numbers import Real
from pathlib import Path
from types import FrameType
from typing import IO, Any, NamedTuple, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from realitygap.errors import RobotStoppedError, UsageError
from realitygap.files import atomic_write, naming_errors, read_text, read_toml, to_toml
from realitygap.plugins import blamed_on
from realitygap.robots.body import Body, Clock, Odometry, checked_readings
from realitygap.values import Command, Readings, steps_in

__all__ = [ "LATE_S", "MOVING", "NUMBERS", "ConstantController", "Controller", "Recorder", "Recording",
    "Step",
    "StopOnSignal", "drive", "raise_pending",
]  # fmt: skip

KILLED = "killed"
"""How a recording ended if it does not say."""

LATE_S = 0.01
"""A step that begins later than this after its time is late."""

LONGEST_GAP_S, LATE_SHARE = 0.5, 0.2
"""A drive with a longer gap between two steps, or with a larger share of late ones, is no fair trial."""

FACTS, CALIBRATION = "drive.toml", "recording.toml"
"""The facts of a drive, and of a calibration's recording, which none is written beside."""
STEPS = "steps.csv"
STALLS = ("stalls", "stalled_s")
_GROUPS = ("proximity", "ambient", "input")
ALWAYS = [
    "t_s", "late_s", "command_left", "command_right", "counter_left", "counter_right", "speed_left",
    "speed_right",
]  # fmt: skip
"""The columns that every recording has."""


class Step(NamedTuple):
    """One step: when it began, how late, what was read, fed, decided; what the wheels said; when what
    was read arrived, of a body that tells it."""

    t_s: float
    late_s: float
    readings: Readings
    inputs: Sequence[int]
    command: Command
    odometry: Odometry
    read_s: float | None = None

    def row(self) -> list[float]:
        """As numbers, in the order of the file's columns."""
        nothing = (math.nan, math.nan)
        return [
            round(self.t_s, 6),
            round(self.late_s, 6),
            *self.readings.proximity.tolist(),
            *self.readings.ambient.tolist(),
            *self.inputs,
            self.command.left,
            self.command.right,
            *(self.odometry.counters or nothing),
            *(self.odometry.speeds or nothing),
            *([] if self.read_s is None else [round(self.read_s, 6)]),
        ]

    def columns(self) -> list[str]:
        """Names of the columns: units in the names, where there are any."""
        counts = (len(self.readings.proximity), len(self.readings.ambient), len(self.inputs))
        groups = [f"{name}_{i}" for name, n in zip(_GROUPS, counts, strict=True) for i in range(n)]
        return [*ALWAYS[:2], *groups, *ALWAYS[2:], *([] if self.read_s is None else ["read_s"])]


@dataclass(frozen=True, kw_only=True)
class Recording:
    """A recorded drive, [n] steps.

    t, late [n] s; proximity [n, P or 0], ambient [n, A or 0] counts; inputs [n, I]; commands [n, 2]
    and speeds [n, 2] in the robot's units; counters [n, 2] pulses. Counters and speeds are NaN where
    the robot has none, or its line had no room for them. `read` [n] s is when what was read arrived, NaN
    where the robot does not tell. `stalls` counts how often the line stalled so that the wheels were stopped,
    `stalled_s` says how long in all. `ended` is "finished", "killed", or what
    stopped the drive.
    """

    t: NDArray[np.float64]
    late: NDArray[np.float64]
    proximity: NDArray[np.float64]
    ambient: NDArray[np.float64]
    inputs: NDArray[np.int64]
    commands: NDArray[np.int64]
    counters: NDArray[np.float64]
    speeds: NDArray[np.float64]
    read: NDArray[np.float64]
    ended: str
    facts: Mapping[str, Any] = field(default_factory=dict)
    stalls: int = 0
    stalled_s: float = 0.0

    @property
    def late_steps(self) -> int:
        """How many steps began more than 10 ms after their time."""
        return int((self.late > LATE_S).sum())

    @property
    def timing(self) -> str | None:
        """Why its timing cannot be trusted: a gap, or too many late steps; None: it can."""
        gap = float(np.diff(self.t).max(initial=0.0))
        if gap > LONGEST_GAP_S:
            stalled = ", while the line stalled and the wheels stood" if self.stalls else ""
            return f"a gap of {gap:.1f} s between two steps{stalled}"
        if self.late_steps > LATE_SHARE * len(self.t):
            return f"{self.late_steps} of {len(self.t)} steps late"
        return None

    @property
    def missed_steps(self) -> int:
        """How many steps had no answer in time, so that older readings were used."""
        return int((self.read < self.t).sum())

    @classmethod
    def from_rows(cls, columns: Sequence[str], rows: Sequence[Sequence[float]], **known: Any) -> Self:
        """From the names of a file's columns and their rows [n, columns], and what else is known."""
        table = np.array(rows, np.float64).reshape(len(rows), len(columns))
        column = dict(zip(columns, np.ascontiguousarray(table.T), strict=True))

        def group(name: str) -> NDArray[np.float64]:
            count = sum(one.rsplit("_", 1)[0] == name for one in columns)
            return np.array([column[f"{name}_{i}"] for i in range(count)]).reshape(count, len(rows)).T.copy()

        def pair(name: str) -> NDArray[np.float64]:
            return np.stack([column[f"{name}_left"], column[f"{name}_right"]], axis=1)

        return cls(
            t=column["t_s"],
            late=column["late_s"],
            proximity=group("proximity"),
            ambient=group("ambient"),
            inputs=group("input").astype(np.int64),
            commands=pair("command").astype(np.int64),
            counters=pair("counter"),
            speeds=pair("speed"),
            read=column.get("read_s", np.full(len(rows), np.nan)),
            **known,
        )

    @classmethod
    def from_folder(cls, folder: str | Path) -> Self:
        """Read a recording; a last line that a kill cut short is left out.

        Raises:
            UsageError: no recording there, or an invalid row: names the line.
        """
        facts_file, steps_file = Path(folder) / FACTS, Path(folder) / STEPS
        if not facts_file.is_file():
            raise UsageError(f"{str(folder)!r} holds no recording: there is no {FACTS} in it")
        facts = read_toml(facts_file, UsageError, "It says what was recorded.")
        end = facts.pop("end", {})
        told = {"ended": KILLED, **{key: end[key] for key in ("ended", *STALLS) if key in end}}
        text = read_text(steps_file, UsageError, "It holds the steps.") if steps_file.is_file() else ""
        lines = text[: text.rfind("\n") + 1].splitlines()
        columns = next(csv.reader(lines[:1]), ALWAYS)
        if [columns.count(name) for name in ALWAYS] != [1] * len(ALWAYS):
            raise UsageError(f"{steps_file}, line 1: expected columns {', '.join(ALWAYS)} and others")
        rows = [_row(line, columns, f"{steps_file}, line {k}") for k, line in enumerate(lines[1:], 2)]
        return cls.from_rows(columns, rows, facts=facts, **told)


class Recorder:
    """Keeps the steps of a drive, and writes each into `folder` if there is one.

    Raises:
        UsageError: the folder already holds a recording.
    """

    def __init__(self, folder: str | Path | None = None, *, facts: Mapping[str, Any] | None = None) -> None:
        self.facts = dict(facts or {})
        self.folder = Path(folder) if folder is not None else None
        self.ended = KILLED
        self._stalls: dict[str, Any] = {}
        self._columns = ALWAYS
        self._rows: list[list[float]] = []
        self._file: IO[str] | None = None
        if self.folder is not None:
            self.folder.mkdir(parents=True, exist_ok=True)
            if any((self.folder / name).exists() for name in (FACTS, CALIBRATION)):
                raise UsageError(f"{str(self.folder)!r} already holds a recording; choose another folder")
            atomic_write(self.folder / FACTS, to_toml(self.facts))
            self._file = (self.folder / STEPS).open("w", encoding="utf-8")

    def __len__(self) -> int:
        return len(self._rows)

    def add(self, step: Step) -> None:
        row = step.row()
        if not self._rows:
            self._columns = step.columns()
            self._write(self._columns)
        self._rows.append(row)
        self._write(f"{value:.10g}" for value in row)

    def finish(self, ended: str, stalls: Sequence[float] = ()) -> None:
        """Say how the drive ended, and how long each stall of its line took (s), and close the files."""
        self.ended = ended
        if stalls:
            self._stalls = dict(zip(STALLS, (len(stalls), round(sum(stalls), 3)), strict=True))
        if self._file is None or self.folder is None:
            return
        self._file.close()
        self._file = None
        kept = self.recording()
        end = {"ended": ended, "steps": len(self._rows), "late_steps": kept.late_steps, **self._stalls}
        if "read_s" in self._columns:
            end["missed_steps"] = kept.missed_steps
        with (self.folder / FACTS).open("a", encoding="utf-8") as file:
            file.write("\n" + to_toml({"end": end}))

    def recording(self) -> Recording:
        """All that was kept so far."""
        told = {"ended": self.ended, "facts": self.facts, **self._stalls}
        return Recording.from_rows(self._columns, self._rows, **told)

    def _write(self, words: Iterable[str]) -> None:
        if self._file is not None:
            with naming_errors(self._file.name):
                self._file.write(",".join(words) + "\n")
                self._file.flush()


def _row(line: str, columns: Sequence[str], where: str) -> list[float]:
    words = line.split(",")
    try:
        row = [float(word) for word in words]
    except ValueError:
        row = []
    if len(row) != len(columns):
        raise UsageError(f"{where}: expected {len(columns)} numbers, got {line!r}")
    return row


NUMBERS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
MOVING = (*NUMBERS, signal.SIGTSTP)
"""While a robot moves whose time does not wait: it must stop before this process is suspended."""

PATIENCE_S = 5.0
"""A robot has this long to stop; then the next signal ends the wait."""


_active: list[StopOnSignal] = []


def raise_pending() -> None:
    """Raise a signal's exception again that was caught on its way: by `except Exception` in a user's robot.

    Raises:
        RobotStoppedError: as at first.
    """
    for one in _active:
        if one.first is not None:
            raise _stopped(one.first)


class StopOnSignal:
    """As a context, in the main thread: each of the signals raises RobotStoppedError, once.

    SIGTSTP (Ctrl-Z) suspends the process at the context's end, and the error goes on after `fg`. While the
    robot is stopped they wait, but not for ever: a user's driver may hang.
    """

    def __init__(self, numbers: Sequence[signal.Signals] = NUMBERS) -> None:
        self._numbers, self._before = numbers, dict[signal.Signals, Any]()
        self._held, self._since = False, 0.0
        self.first: int | None = None
        self._missed: int | None = None

    def __enter__(self) -> StopOnSignal:
        if threading.current_thread() is threading.main_thread():
            for number in self._numbers:
                if number == signal.SIGTSTP and signal.getsignal(number) == signal.SIG_IGN:
                    continue  # a shell without job control
                self._before[number] = signal.signal(number, self._arrived)
            _active.append(self)
        return self

    def __exit__(self, *error: object) -> None:
        if self in _active:
            _active.remove(self)
        for number, handler in self._before.items():
            signal.signal(number, handler)
        self._before.clear()
        if signal.SIGTSTP in (self.first, self._missed):
            signal.raise_signal(signal.SIGTSTP)

    @contextmanager
    def held(self) -> Iterator[None]:
        """Within it no signal interrupts; one that came is raised at its end, if nothing else is."""
        before, self._held = self._held, True
        yield
        self._held = before
        if self._missed is not None and not before:
            self._held = True
            raise _stopped(self._missed)

    def _arrived(self, number: int, frame: FrameType | None) -> None:
        if self._held:
            self._since = self._since or time.monotonic()
            self._missed = number
            if time.monotonic() - self._since >= PATIENCE_S:
                raise RobotStoppedError(f"{_name(number)} again: the robot has not confirmed that "
                                        "it stopped. Check it, or switch it off")  # fmt: skip
            return
        self._held, self.first = True, number  # it stops the robot; what follows must not disturb that
        self._since = time.monotonic()
        raise _stopped(number)


def _stopped(number: int) -> RobotStoppedError:
    if number == signal.SIGTSTP:
        return RobotStoppedError("suspended; the robot was told to stop first, and the drive is over")
    return RobotStoppedError(f"stopped by {_name(number)}; the robot was told to stop first")


def _name(number: int) -> str:
    return signal.Signals(number).name


class Controller(Protocol):
    """Integers −10..10 in, wheel commands out."""

    def reset(self) -> None:
        """Before a trial."""

    def decide(self, inputs: Sequence[int]) -> Command:
        """One step."""


class ConstantController:
    """A controller that gives the same command at each step."""

    def __init__(self, command: Command) -> None:
        self.command = command

    def reset(self) -> None:
        """No state to reset."""

    def decide(self, inputs: Sequence[int]) -> Command:
        """The command, whatever is read."""
        return self.command


def drive(
    body: Body,
    controller: Controller,
    *,
    seconds: float,
    inputs: Callable[[Readings], list[int]],
    clock: Clock | None = None,
    recorder: Recorder | None = None,
    at_end: Callable[[], None] = lambda: None,
) -> Recording:
    """Drive a body with a controller, one step each of its periods.

    The time-table moves on with a step that is late by more than a whole one, as after a stall of the line
    that stopped the wheels: the robot never has to catch up. Whatever ends the drive, an exception, Ctrl-C,
    Ctrl-Z, SIGTERM or a lost line, the wheels are stopped first; then the recording is closed. Its steps are
    the `recorder`'s, however it ends.

    Args:
        seconds: length of the trial, which ends at the nearest step.
        inputs: turns readings into the controller's inputs.
        clock: the body's own if None.
        recorder: keeps the steps, in a folder if it has one.
        at_end: called when the last step is over, before the robot is stopped.

    Raises:
        RobotStoppedError: Ctrl-C or SIGTERM; or Ctrl-Z, after the suspension.
        FrozenError: it was frozen, and the guard has stopped the robot.
        LineError: the line was lost, or the robot did not confirm that it stopped.
    """
    period, clock = body.period_s, body.clock if clock is None else clock
    given: object = seconds
    number = isinstance(given, Real) and math.isfinite(given)
    if not number or seconds < period / 2:
        raise UsageError(f"a trial must last at least one step of {period:g} s; got {seconds!r} s")
    recorder = Recorder() if recorder is None else recorder
    stopping = StopOnSignal(NUMBERS if clock.waits else MOVING)
    with stopping, _blamed(body), _closing(body, recorder, stopping):
        controller.reset()
        for step in _steps(body, controller, clock, inputs, steps_in(seconds, period)):
            recorder.add(step)
            raise_pending()
        at_end()
    return recorder.recording()


def _steps(
    body: Body, controller: Controller, clock: Clock, inputs: Callable[[Readings], list[int]], steps: int
) -> Iterator[Step]:
    period = body.period_s
    start = due = clock.now()
    for step in range(steps):
        clock.sleep_until(due)
        now = clock.now()
        readings = body.sense()
        if step == 0:
            checked_readings(body, readings)
        fed = inputs(readings)
        command = controller.decide(fed)
        body.act(command)
        read_s = None if body.read_at is None else body.read_at - start
        yield Step(now - start, max(0.0, now - due), readings, fed, command, body.odometry, read_s)
        due += period if now - due <= period else period + (now - due)
    clock.sleep_until(due)


def _blamed(body: Body) -> AbstractContextManager[None]:
    """Names the line of a user's file whose body fails."""
    kind = type(body)
    if kind.__module__.startswith("realitygap."):
        return nullcontext()
    return blamed_on(inspect.getfile(kind), UsageError, f"{kind.__name__} fails", own=True)


@contextmanager
def _closing(body: Body, recorder: Recorder, stopping: StopOnSignal) -> Iterator[None]:
    """At the end stop the body, undisturbed, and say in the recording what ended the drive."""
    ended, before = "finished", len(body.stalls)
    try:
        yield
    except BaseException as error:
        ended = f"{type(error).__name__}: {error}" if str(error) else type(error).__name__
        raise
    finally:
        with stopping.held():
            try:
                body.stop()
            except BaseException as error:
                ended = f"{ended}; {type(error).__name__}: {error}"
                raise
            finally:  # whether the robot confirmed or not
                recorder.finish(ended, body.stalls[before:])
