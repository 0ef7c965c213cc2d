"""Where a recording is made: with a robot that places itself, or one placed by a person."""

from __future__ import annotations

import contextlib
import hashlib
import math
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, ExitStack, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any

from realitygap import temporary
from realitygap.calibration.recorder.plans import Place
from realitygap.calibration.recorder.wheel_plans import Trial
from realitygap.errors import UsageError
from realitygap.robots.body import Body
from realitygap.values import Closing, Pose

if TYPE_CHECKING:
    from realitygap.film.marker import Marker

__all__ = ["Ask", "EnoughError", "OwnSite", "PersonSite", "Site", "site_of"]

Ask = Callable[[str], str]
"""Says something to a person and returns the answer."""


class EnoughError(Exception):
    """The person stops for today."""


class OwnSite(Closing):
    """A robot that places itself.

    Args:
        body, room, marker: as of `site_of`.
        seed: of its noise, together with the place: no place or trial affects the next.
        camera: whether to use the camera over the floor, if the robot has one.
    """

    def __init__(
        self,
        body: Body,
        room: Mapping[str, Any],
        *,
        seed: int,
        camera: bool = False,
        marker: Marker | None = None,
    ) -> None:
        self._body, self._room, self._seed = body, room, seed
        self._camera = None
        self._stack = ExitStack()
        if camera and body.is_filmed:
            from realitygap.calibration.recorder.camera import FloorCamera

            with ExitStack() as stack:
                self._camera = stack.enter_context(
                    FloorCamera(
                        room,
                        unit=body.facts["unit"],
                        noise=body.facts["twin_noise"],
                        seed=seed,
                        marker=marker,
                    )
                )
                self._film = Path(stack.enter_context(temporary.Folder("record"))) / "film.csv"
                self._stack = stack.pop_all()

    def prepare(self, says: str) -> bool:
        """Does nothing: its room is built already."""
        return True

    def stand(self, place: Place) -> bool:
        self._put("/".join(place.key), place.pose)
        return True

    def begin(self, trial: Trial) -> bool:
        """Place the robot, and film it from now on."""
        self._put(str(trial.number), trial.pose)
        if self._camera is not None and trial.filmed and self._body.is_filmed:
            self._body.film(self._film)
        return True

    def end(self, trial: Trial) -> Mapping[int, Pose]:
        """The poses that the camera saw, by step."""
        if self._camera is None or not trial.filmed or not self._body.is_filmed:
            return {}
        self._body.film(None)
        return self._camera.poses(self._film, trial.seen(), trial.number)

    def close(self) -> None:
        self._stack.close()

    def _put(self, where: str, pose: Pose) -> None:
        """Place the robot with noise seeded by the place's name, independent of what happened before."""
        digest = hashlib.sha256(f"{self._seed}/{where}".encode()).digest()
        self._body.enter(self._room, int.from_bytes(digest[:7]), pose)


class PersonSite:
    """A person who places the robot as asked: an empty answer continues, "s" skips, "q" stops."""

    def __init__(self, ask: Ask) -> None:
        self._ask = ask

    def prepare(self, says: str) -> bool:
        """Say what a plan needs, and ask whether it is ready."""
        while True:
            answer = self._ask(f"{says} [Enter: ready, s: leave out, q: stop here]").strip().lower()
            if answer in ("", "s"):
                return not answer
            if answer == "q":
                raise EnoughError

    def stand(self, place: Place) -> bool:
        """Say where to place the robot."""
        return self.prepare(f"Place: {place.says}.")

    def begin(self, trial: Trial) -> bool:
        """Say how much room a trial needs, and ask where it starts."""
        self._start: Pose | None = None
        name = f"Trial {trial.number} ({trial.kind})"
        if not self.prepare(f"{name}: the robot will move; it needs {trial.says}."):
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

    def _measured(self, says: str) -> Pose | None:
        """A pose that the person measured or read off the camera's track."""
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


Site = OwnSite | PersonSite
"""Brings a robot to a place: `prepare`, `stand` and `begin` return False if it is skipped; `end` returns the
poses that were seen, by the trial's steps."""


def site_of(
    body: Body, ask: Ask | None, room: Mapping[str, Any], *, part: str, seed: int, marker: str | None
) -> AbstractContextManager[Site]:
    """The site for a part of a plan.

    Args:
        body: the robot.
        ask: asks the person who places it; not needed if it places itself.
        room: in plain numbers (cm).
        part: its name, which noise depends on.
        seed: of the noise of a robot that places itself.
        marker: what it wears under a camera over the wheels' floor, as `load_marker` reads it.

    Raises:
        UsageError: nobody can place the robot, or a marker is given for a robot without a camera.
    """
    if body.places_itself:
        from realitygap.film.marker import load_marker

        own = int.from_bytes(hashlib.sha256(f"{seed}/{part}".encode()).digest()[:7])
        worn = None if marker is None else load_marker(marker)
        return OwnSite(body, room, seed=own, camera=part == "wheels", marker=worn)
    if marker is not None:
        raise UsageError(
            "marker: expected a robot with a camera of its own over it, as a twin's; this one is filmed by "
            "whoever places it: `realitygap track FILM --marker …`."
        )
    if ask is None:
        raise UsageError("ask: expected a function that asks a person to place the robot, got none.")
    return nullcontext(PersonSite(ask))
