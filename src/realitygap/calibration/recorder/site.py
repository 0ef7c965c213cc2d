"""Where a recording is made: a twin that the program places, or a robot that a person places."""

from __future__ import annotations

import contextlib
import hashlib
import math
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, Protocol

from realitygap import temporary
from realitygap.calibration.recorder.plans import Place
from realitygap.calibration.recorder.wheel_plans import Trial
from realitygap.robots.clock import VirtualClock
from realitygap.robots.khepera.driver import Khepera
from realitygap.values import Pose

if TYPE_CHECKING:
    from realitygap.twin.process import TwinProcess

__all__ = ["Ask", "EnoughError", "PersonSite", "Site", "TwinSite"]

Ask = Callable[[str], str]
"""Says something to a person and returns the answer."""


class EnoughError(Exception):
    """The person stops for today."""


class Site(Protocol):
    """A robot, and somebody's hand that brings it to a place."""

    @property
    def khepera(self) -> Khepera:
        """The robot on its serial line."""

    def prepare(self, says: str) -> bool:
        """Make ready for a plan; False if it is left out."""

    def stand(self, place: Place) -> bool:
        """Bring the robot to a place; False if that place is left out."""

    def begin(self, trial: Trial) -> bool:
        """Bring the robot to the start of a trial; False if it is left out."""

    def end(self, trial: Trial) -> Mapping[int, Pose]:
        """Where the robot was seen, by the trial's steps."""


class TwinSite:
    """A twin in a process of its own, in virtual time, read through its serial line alone.

    Args:
        room: in plain numbers (cm).
        unit: which robot of the population.
        noise: the twin's noise scale.
        seed: of its noise, with the place: no place or trial leaves the next a trace.
        camera: whether a camera hangs over the floor.
    """

    def __init__(
        self, room: Mapping[str, Any], *, unit: int, noise: float, seed: int, camera: bool = False
    ) -> None:
        self._room, self._unit, self._noise, self._seed = room, unit, noise, seed
        self._twin: TwinProcess | None = None
        self._camera = None
        self._place_stack, self._stack = ExitStack(), ExitStack()
        with ExitStack() as stack:
            if camera:
                from realitygap.calibration.recorder.camera import FloorCamera

                self._camera = stack.enter_context(FloorCamera(room, unit=unit, noise=noise, seed=seed))
                folder = stack.enter_context(temporary.Folder("record"))
                self._film = Path(folder) / "film.csv"
            self._stack = stack.pop_all()

    @property
    def khepera(self) -> Khepera:
        """The driver."""
        return self._khepera

    def prepare(self, says: str) -> bool:
        """A twin's room is built already."""
        return True

    def stand(self, place: Place) -> bool:
        """Put the twin down."""
        self._put("/".join(f"{number:g}" for number in place.where), place.pose)
        return True

    def begin(self, trial: Trial) -> bool:
        """Put the twin down, and film it from now on."""
        twin = self._put(str(trial.number), trial.pose)
        if self._camera is not None and trial.filmed:
            twin.film(self._film)
        return True

    def end(self, trial: Trial) -> Mapping[int, Pose]:
        """What the camera saw."""
        if self._camera is None or self._twin is None or not trial.filmed:
            return {}
        self._khepera.clock.settle()
        self._twin.film(None)
        return self._camera.poses(self._film, trial.seen(), trial.number)

    def __enter__(self) -> TwinSite:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._place_stack.close()
        self._stack.close()

    def _put(self, where: str, pose: Pose) -> TwinProcess:
        """Switch the twin off and on again, its noise named by the place: the same whatever was before."""
        from realitygap.twin.process import start_twin

        digest = hashlib.sha256(f"{self._seed}/{where}".encode()).digest()
        own = int.from_bytes(digest[:7])
        self._place_stack.close()
        if self._twin is None:
            started = start_twin(self._room, unit=self._unit, noise=self._noise, seed=own)
            self._twin = self._stack.enter_context(started)
        else:
            self._twin.renew(own)
        clock = VirtualClock(self._twin.channel)
        self._place_stack.callback(clock.close)
        self._khepera = self._place_stack.enter_context(Khepera.connect(self._twin.device, clock=clock))
        clock.settle()
        self._twin.place(pose)
        return self._twin


class PersonSite:
    """A robot on a serial line, and a person who is told what to do.

    Args:
        khepera: the driver; whoever opened it closes it.
        ask: says something to the person: an empty answer goes on, "s" skips, "q" stops.
    """

    def __init__(self, khepera: Khepera, ask: Ask) -> None:
        self._khepera = khepera
        self._ask = ask

    @property
    def khepera(self) -> Khepera:
        """The driver."""
        return self._khepera

    def prepare(self, says: str) -> bool:
        """Tell what a plan needs."""
        return self._go_on(says)

    def stand(self, place: Place) -> bool:
        """Tell where the robot has to stand."""
        return self._go_on(f"Place: {place.says}.")

    def begin(self, trial: Trial) -> bool:
        """Tell how much room a trial needs, and ask where it starts."""
        self._start: Pose | None = None
        name = f"Trial {trial.number} ({trial.kind})"
        if not self._go_on(f"{name}: the robot will move; it needs {trial.says}."):
            return False
        if trial.filmed:
            self._start = self._measured("Where does it stand?")
        return True

    def end(self, trial: Trial) -> Mapping[int, Pose]:
        """Ask where a trial ended."""
        if not trial.filmed or self._start is None:
            return {}
        end = self._measured("Where does it stand now?")
        return {0: self._start} if end is None else {0: self._start, len(trial.commands) - 1: end}

    def _go_on(self, says: str) -> bool:
        while True:
            answer = self._ask(f"{says} [Enter: ready, s: leave out, q: stop here]").strip().lower()
            if answer in ("", "s"):
                return not answer
            if answer == "q":
                raise EnoughError

    def _measured(self, says: str) -> Pose | None:
        """A pose as a person measures it or reads it off the camera's track."""
        while True:
            answer = self._ask(f"{says} [x_cm y_cm heading_deg; Enter: not measured]")
            words = answer.replace(",", " ").split()
            if words == ["q"]:
                raise EnoughError
            if not words:
                return None
            with contextlib.suppress(ValueError):
                x, y, heading = map(float, words)
                if all(map(math.isfinite, (x, y, heading))):
                    return Pose.from_degrees(x, y, heading)
