"""A body of the user's own, opened by its name, and checked against what it declares."""

import inspect
from collections.abc import Callable, Mapping
from operator import methodcaller
from pathlib import Path
from typing import Any, Self, cast

import numpy as np

from realitygap.errors import UsageError
from realitygap.plugins import blamed_on, named_object
from realitygap.robots.body import KINDS, Body, Channel, Odometry
from realitygap.values import Pose, Readings

__all__ = ["OwnBody", "opened"]

MEMBERS = ("channels", "period_s", "counts_turns", "reset", "sense", "act", "stop", "close")
FACTS = {"base", "pulses_per_mm", "robot", "units"}
CURE = "The text of realitygap.robots.body says what a robot of your own needs."


def _pair(told: Any) -> tuple[int, int] | None:
    """Left and right, of whatever holds two numbers."""
    if told is None:
        return None
    pair = np.add(told, 0)
    if pair.shape != (2,) or not np.isfinite(pair).all():
        raise ValueError
    left, right = pair.tolist()
    return left, right


def _odometry(told: Any) -> Odometry:
    if not isinstance(told, Odometry):
        raise TypeError
    return Odometry(*map(_pair, told))


def _pose(told: Any) -> Pose | None:
    if told is not None and not (
        isinstance(told, Pose) and np.isfinite((told.x, told.y, told.heading)).all()
    ):
        raise TypeError
    return told


def _clock(told: Any) -> Any:
    if not all(hasattr(told, way) for way in ("waits", "now", "sleep_until")):
        raise TypeError
    return told


def _number(told: Any) -> float:
    if not np.isfinite(told):
        raise ValueError
    return float(told)


def _pulses(told: Any) -> float | None:
    if told is not None and (isinstance(told, bool) or not 0 < told < np.inf):
        raise ValueError
    return None if told is None else float(told)


def _grid(told: Any) -> tuple[int, tuple[float, ...]]:
    bearings, distances = told
    return int(bearings), tuple(map(float, distances))


FORMS: dict[str, tuple[str, Callable[[Any], Any]]] = {
    "clock": ("a clock, with waits, now and sleep_until", _clock),
    "infrared_grid": ("(bearings, distances in cm)", _grid),
    "odometry": ("an Odometry(counters=(left, right))", _odometry),
    "pose": ("a Pose of finite numbers", _pose),
    "pulses_per_mm": ("a number above 0, pulses of a counter in a millimetre", _pulses),
    "read_at": ("a time (s) by its clock", _number),
    "speeds": ("(left, right) or None", _pair),
}
MORE = (*FORMS, "attend", "enter", "inspect")
"""Optional members of a body; of some, their form."""


class Blamed:
    """Passes everything on to a user's object; an error in it names its line, in `place`."""

    def __init__(self, own: Any, place: str) -> None:
        self._own, self._place, self._name = own, place, type(own).__name__

    def __getattr__(self, name: str) -> Any:
        try:
            inspect.getattr_static(self._own, name)
        except AttributeError:  # what is not there is asked for, too
            if not self._has(name):
                raise
        found = self._told(name)
        if not callable(found):
            return found

        def called(*words: Any, **named: Any) -> Any:
            with self._blamed(name):
                return found(*words, **named)

        return called

    def _has(self, name: str) -> bool:
        with self._blamed(name):
            return hasattr(self._own, name)

    def _told(self, name: str) -> Any:
        with self._blamed(name):
            return getattr(self._own, name)

    def _blamed(self, name: str) -> Any:
        return blamed_on(self._place, UsageError, f"{self._name}.{name} fails")


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
        missing = [member for member in MEMBERS if not self._has(member)]
        if missing:
            raise self._wrong(f"expected {', '.join(missing)}, which it lacks")
        if mute := [way for way in MEMBERS[3:] if not callable(self._told(way))]:
            raise self._wrong(f"{', '.join(mute)}: expected a method, got {self._told(mute[0])!r}")
        self.channels = self._channels()
        period = self._told("period_s")
        if isinstance(period, bool) or not isinstance(period, int | float) or not 0.02 <= period <= 0.2:
            raise self._wrong(f"period_s: expected a float from 0.02 to 0.2 (s), got {period!r}")
        if self._told("counts_turns") and "odometry" not in dir(own):
            raise self._wrong("odometry: expected, since it counts turns")

    @property
    def facts(self) -> dict[str, Any]:
        """What recordings say of it: its name, and what it tells of itself (`robots/body.py`)."""
        told = self._told("facts") if self._has("facts") else {}
        if not isinstance(told, dict) or not set(told) <= FACTS:
            raise self._wrong(f"facts: expected a dict of {', '.join(sorted(FACTS))}, got {told!r}")
        pulses = {"pulses_per_mm": self.pulses_per_mm} if self._has("pulses_per_mm") else {}
        return {"robot": f"{Path(self._place).name}:{self._name}", **pulses, **told}

    def sense(self) -> Readings:
        """What it reads, checked.

        Raises:
            UsageError: no Readings, or not as its channels say.
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
        if name == "inspect":
            return self._inspected
        if name not in FORMS:
            return self.__getattr__(name)
        (words, form), told = FORMS[name], self._told(name)
        try:
            found = form(told)
        except (TypeError, ValueError):
            raise self._wrong(f"{name}: expected {words}, got {told!r}") from None
        return Blamed(found, self._place) if name == "clock" else found

    def _inspected(self) -> Mapping[str, Any]:
        found = self.__getattr__("inspect")()
        if not isinstance(found, Mapping):
            raise self._wrong(f"inspect: expected a dict, got {found!r}")
        return found

    def _channels(self) -> tuple[Channel, ...]:
        channels = self._told("channels")
        if not isinstance(channels, tuple | list) or not all(isinstance(one, Channel) for one in channels):
            raise self._wrong(f"channels: expected a tuple of Channel, got {channels!r}")
        if not channels or len({one.name for one in channels}) < len(channels):
            raise self._wrong(f"channels: expected one for each kind of sensors, got {channels!r}")
        return tuple(channels)

    def _wrong(self, what: str) -> UsageError:
        return UsageError(f"{self._place}: {self._name}: {what}. {CURE}")


def opened(name: str, **_: Any) -> Body:
    """The body that `file.py:Class` or `module:Class` makes when it is called.

    Raises:
        UsageError: there is no such class, it fails, or it is not a body.
    """
    found, place = named_object(name, UsageError, "robot"), name.rpartition(":")[0]
    place = str(Path(place).expanduser().resolve()) if place.endswith(".py") else place
    if not callable(found):
        raise UsageError(f"robot: {name}: expected a class, or a function that makes a body, got {found!r}.")
    with blamed_on(place, UsageError, f"{name.rpartition(':')[2]}() fails"):
        own = found()
    return cast("Body", OwnBody(own, place))
