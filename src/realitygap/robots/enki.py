"""A unit of Enki's Khepera, e-puck or Thymio II as a body: in any room, in Enki's own time."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from realitygap.enki.process import STEP_S, EnkiProcess
from realitygap.enki.unit import MODELS
from realitygap.errors import ConfigError
from realitygap.robots.body import Channel, Odometry
from realitygap.robots.clock import SteppedClock
from realitygap.robots.signals import undisturbed
from realitygap.track import Track
from realitygap.values import Command, Pose, Readings

__all__ = ["EnkiBody", "opened"]

MM_PER_CM = 10.0
ROOM: dict[str, Any] = {"size_cm": [60.0, 60.0]}
"""Where it stands until it enters another."""
GRID = (180, (0.5, 1.0, 1.5, 2.0, 3.0, 4.0, 5.5, 8.0, 10.0, 12.5, 15.0))
"""Bearings and distances (cm) at which its infrared is recorded: 2 degrees apart, and on to where none of its
robots sees anything. Where a ray just meets a thing, or just not, tells where a sensor looks only as nearly
as places are apart."""


class EnkiBody:
    """One process serves it in all its rooms. It sees walls and cylinders, no light.

    Args:
        model: "khepera", "epuck" or "thymio2".
        unit: which robot of the population; 0 is Enki's published model.
        noise: the scale of Enki's noise.
    """

    period_s, infrared_grid = 0.1, GRID
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
    def pose(self) -> Pose:
        """Where it is."""
        self._catch_up()
        x, y, heading = self._now.poses[-1].tolist()
        return Pose(x=x, y=y, heading=heading)

    @property
    def odometry(self) -> Odometry:
        """Both wheels' counters and speeds now."""
        self._catch_up()
        ways, speeds = self._now.ways - self._zero, self._now.speeds / self._is.unit_cm_s
        counts = ways * MM_PER_CM * (self.pulses_per_mm or 0.0)
        left, right = np.rint([counts, speeds]).astype(int).T.tolist()
        return Odometry((left[0], right[0]), (left[1], right[1]))

    def enter(self, room: Mapping[str, Any], seed: int, pose: Pose | None) -> None:
        """Be as new, in another room: no trial affects the next."""
        self._due, self._given, self._film = 0, Command(left=0, right=0), None
        width, depth = room["size_cm"]
        if "reflectance" in room:
            raise ConfigError(
                "arena: reflectance: expected none for a robot of Enki's: in Enki all surfaces "
                "reflect alike. Use the twin, or leave it out."
            )
        with undisturbed():
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
        """Stop, from Enki's next step on."""
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
        with undisturbed():
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
            with undisturbed():
                self._now = self._enki.run(steps, left, right)
            if self._film is not None:
                self._seen.append(self._now.poses)


def opened(name: str, *, noise: float = 1.0, **_: Any) -> EnkiBody:
    """A unit by its model and its number, as in "epuck:3"."""
    model, _colon, unit = name.partition(":")
    return EnkiBody(model, int(unit), noise=noise)
