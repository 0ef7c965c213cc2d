"""The control loop: each period sense, decide, act, record; whatever happens, stop first."""

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from numbers import Real
from typing import Protocol

from realitygap.errors import UsageError
from realitygap.robots.body import Body, clock_of, odometry_of
from realitygap.robots.clock import Clock
from realitygap.robots.recording import Recorder, Recording, Step
from realitygap.robots.signals import MOVING, NUMBERS, Stopping, heed
from realitygap.values import Command, Readings

__all__ = ["Controller", "Steady", "drive"]


class Controller(Protocol):
    """Integers −10..10 in, wheel commands out."""

    def reset(self) -> None:
        """Before a trial."""

    def decide(self, inputs: Sequence[int]) -> Command:
        """One step."""


class Steady:
    """A controller that gives the same command at each step."""

    def __init__(self, command: Command) -> None:
        self.command = command

    def reset(self) -> None:
        """Nothing to forget."""

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

    The time-table moves on with a step that is late by more than a whole one: the robot never has to
    catch up. Whatever ends the drive, an exception, Ctrl-C, Ctrl-Z, SIGTERM or a lost line, the wheels
    are stopped first; then the recording is closed. Its steps are the `recorder`'s, however it ends.

    Args:
        seconds: length of the trial: whole steps, at least one.
        inputs: turns readings into the controller's inputs.
        clock: the body's own if None.
        recorder: keeps the steps, in a folder if it has one.
        at_end: called when the last step is over, before the robot is stopped.

    Raises:
        RobotStoppedError: Ctrl-C or SIGTERM; or Ctrl-Z, after the suspension.
        FrozenError: it was frozen, and the guard has stopped the robot.
        LineError: the line was lost, or the robot did not confirm that it stopped.
    """
    period, clock = body.period_s, clock_of(body) if clock is None else clock
    given: object = seconds
    number = isinstance(given, Real) and math.isfinite(given)
    steps = round(seconds / period) if number else 0
    if steps < 1 or abs(steps * period - seconds) > 1e-6:
        raise UsageError(f"a trial must last whole steps of {period:g} s, one at least; got {seconds!r} s")
    recorder = Recorder() if recorder is None else recorder
    with Stopping(NUMBERS if clock.waits else MOVING) as stopping, _closing(body, recorder, stopping):
        controller.reset()
        for step in _steps(body, controller, clock, inputs, steps):
            recorder.add(step)
            heed()
        at_end()
    return recorder.recording()


def _steps(
    body: Body, controller: Controller, clock: Clock, inputs: Callable[[Readings], list[int]], steps: int
) -> Iterator[Step]:
    period = body.period_s
    start = due = clock.now()
    for _ in range(steps):
        clock.sleep_until(due)
        now = clock.now()
        readings = body.sense()
        fed = inputs(readings)
        command = controller.decide(fed)
        body.act(command)
        read_at = getattr(body, "read_at", None)
        read_s = None if read_at is None else read_at - start
        yield Step(now - start, max(0.0, now - due), readings, fed, command, odometry_of(body), read_s)
        due += period if now - due <= period else period + (now - due)
    clock.sleep_until(due)


@contextmanager
def _closing(body: Body, recorder: Recorder, stopping: Stopping) -> Iterator[None]:
    """At the end stop the body, undisturbed, and say in the recording what ended the drive."""
    ended = "finished"
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
                recorder.finish(ended)
