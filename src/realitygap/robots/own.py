"""A body of the user's own, opened by its name, and held to what it declares."""

import inspect
from operator import methodcaller
from pathlib import Path
from typing import Any, Self, cast

import numpy as np

from realitygap.errors import UsageError
from realitygap.robots.body import KINDS, Body, Channel, Odometry
from realitygap.user_code import blamed_on, named_object
from realitygap.values import Pose, Readings

__all__ = ["OwnBody", "opened"]

MEMBERS = ("channels", "period_s", "counts_turns", "reset", "sense", "act", "stop", "close")
MORE = ("attend", "clock", "enter", "inspect", "odometry", "pose", "speeds")
"""What a body may have besides."""
PAIR = "(left, right) or None"
FORMS = {"odometry": "an Odometry(counters=(left, right))", "pose": "a Pose", "speeds": PAIR}
FACTS = {"base", "pulses_per_mm", "robot", "units"}
CURE = "The text of realitygap.robots.body says what a robot of your own needs."


class Blamed:
    """Passes everything on to a user's object; an error in it is told by its line, in `place`."""

    def __init__(self, own: Any, place: str) -> None:
        self._own, self._place, self._name = own, place, type(own).__name__

    def __getattr__(self, name: str) -> Any:
        inspect.getattr_static(self._own, name)  # what is not there is asked for, too
        with self._blamed(name):
            found = getattr(self._own, name)
        if not callable(found):
            return found

        def called(*words: Any, **named: Any) -> Any:
            with self._blamed(name):
                return found(*words, **named)

        return called

    def _blamed(self, name: str) -> Any:
        return blamed_on(self._place, UsageError, f"{self._name}.{name} stops")


class OwnBody(Blamed):
    """A user's body, whose readings are what its channels say.

    Raises:
        UsageError: something is missing, or is not what a body declares.
    """

    def __new__(cls, own: Any, place: str) -> Self:
        """Of a class that has what `own` has besides: from Python 3.12 on isinstance looks there alone."""
        besides = {name: property(methodcaller("_checked", name)) for name in MORE if name in dir(own)}
        return super().__new__(type(cls.__name__, (cls,), besides))

    def __init__(self, own: Any, place: str) -> None:
        super().__init__(own, place)
        missing = [member for member in MEMBERS if not hasattr(own, member)]
        if missing:
            raise self._wrong(f"expected {', '.join(missing)}, which it lacks")
        self.channels = self._channels()
        period = own.period_s
        if isinstance(period, bool) or not isinstance(period, int | float) or not 0.02 <= period <= 0.2:
            raise self._wrong(f"period_s: expected 0.02 to 0.2 (s), got {period!r}")
        if own.counts_turns and "odometry" not in dir(own):
            raise self._wrong("odometry: expected, since it counts turns")

    @property
    def facts(self) -> dict[str, Any]:
        """What recordings say of it: its name, and what it tells of itself (`robots/body.py`)."""
        told = self.__getattr__("facts") if hasattr(self._own, "facts") else {}
        if not isinstance(told, dict) or not set(told) <= FACTS:
            raise self._wrong(f"facts: expected a dict of {', '.join(sorted(FACTS))}, got {told!r}")
        pulses = {"pulses_per_mm": self._own.pulses_per_mm} if hasattr(self._own, "pulses_per_mm") else {}
        return {"robot": f"{Path(self._place).name}:{self._name}", **pulses, **told}

    def sense(self) -> Readings:
        """What it reads, checked.

        Raises:
            UsageError: no Readings, or others than its channels say.
        """
        with self._blamed("sense"):
            read = self._own.sense()
        if not isinstance(read, Readings):
            raise self._wrong(f"sense: expected Readings, got {read!r}")
        declared = {one.name: one for one in self.channels}
        checked = {}
        for kind in KINDS:
            one = declared.get(kind)
            with self._blamed("sense"):
                counts = np.asarray(getattr(read, kind), np.float64)
            if counts.shape != (one.sensors if one else 0,):
                wanted = f"{one.sensors} {kind} readings" if one else f"no {kind} readings"
                raise self._wrong(f"sense: expected {wanted}, as its channels say, got {counts.shape}")
            if one and not ((counts >= one.low) & (counts <= one.high)).all():
                raise self._wrong(f"sense: expected {kind} counts from {one.low} to {one.high}, got {counts}")
            checked[kind] = counts
        return Readings(**checked)

    def _checked(self, name: str) -> Any:
        """One of MORE."""
        found = self.__getattr__(name)
        try:
            if name not in FORMS or (name == "pose" and isinstance(found, Pose | None)):
                return Blamed(found, self._place) if name == "clock" else found
            if name == "speeds":
                return _pair(found)
            if name == "odometry" and isinstance(found, Odometry):
                return Odometry(*map(_pair, found))
        except (TypeError, ValueError):
            pass
        raise self._wrong(f"{name}: expected {FORMS[name]}, got {found!r}")

    def _channels(self) -> tuple[Channel, ...]:
        channels = self._own.channels
        if not isinstance(channels, tuple | list) or not all(isinstance(one, Channel) for one in channels):
            raise self._wrong(f"channels: expected a tuple of Channel, got {channels!r}")
        if not channels or len({one.name for one in channels}) < len(channels):
            raise self._wrong(f"channels: expected one for each kind of sensors, got {channels!r}")
        return tuple(channels)

    def _wrong(self, what: str) -> UsageError:
        return UsageError(f"{self._place}: {self._name}: {what}. {CURE}")


def _pair(told: Any) -> tuple[int, int] | None:
    """Left and right, of whatever holds two numbers."""
    if told is None:
        return None
    left, right = np.add(told, 0).tolist()
    return left, right


def opened(name: str, **_: Any) -> Body:
    """The body that `file.py:Class` or `module:Class` makes when it is called.

    Raises:
        UsageError: there is no such class, it stops with an error, or it is no body.
    """
    found, place = named_object(name, UsageError, "robot"), name.rpartition(":")[0]
    place = str(Path(place).expanduser().resolve()) if place.endswith(".py") else place
    if not callable(found):
        raise UsageError(f"robot: {name}: expected a class, or a function that makes a body, got {found!r}.")
    with blamed_on(place, UsageError, f"{name.rpartition(':')[2]}() stops"):
        own = found()
    return cast("Body", OwnBody(own, place))
