"""The options of a transfer as one value: who drives which robots, and how they are seen."""

import hashlib
import re
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from realitygap.errors import UsageError
from realitygap.film.camera import CameraModel
from realitygap.film.disk import Disk
from realitygap.film.tag import Marker, load_marker
from realitygap.plugins import place_of
from realitygap.robots.address import Address, as_scale
from realitygap.study.config import LARGEST, whole

__all__ = ["Named", "Transfer"]


@dataclass(frozen=True)
class Named:
    """A controller that was not evolved, named by a person (`named_controller`)."""

    text: str

    @cached_property
    def _file(self) -> tuple[Path, str]:
        """Its file, and the name in `file.py:name`; no file for one that comes with the package."""
        return place_of(self.text) or (Path(self.text).expanduser(), "")

    @property
    def spec(self) -> str:
        """The same with an absolute path."""
        file, name = self._file
        return f"{file.resolve()}{':' if name else ''}{name}" if file.is_file() else self.text

    @property
    def name(self) -> str:
        """For folders: my-decide of my.py:decide."""
        file, name = self._file
        words = f"{file.stem} {name}" if file.is_file() else self.text
        return re.sub(r"\W+", "-", words).strip("-")

    def __str__(self) -> str:
        file, name = self._file
        if not file.is_file():
            return self.text
        digest = hashlib.sha256(file.read_bytes()).hexdigest()[:16]
        return f"{file.name}{':' if name else ''}{name}, sha256 {digest}"


@dataclass(frozen=True, kw_only=True)
class Transfer:
    """Everything that the trials of a transfer depend on, besides the study.

    Attributes:
        runs: ids or names; all finished ones if empty.
        robots: addresses, as in `robots/address.py`: "twin:UNIT", "khepera:PORT", "file.py:Class".
        starts: trials of each individual on each robot.
        individual: "champion" or "fittest".
        controller: the driver in place of an individual, at the runs' tasks and noise: a network's file,
            "constant:5,5", "braitenberg", or "file.py:name" of your own.
        film: film all trials, none, or those of the runs with these ids; (id, start) names a single one.
        view: renderer of a twin's film: "drawn", or MuJoCo's, "mujoco".
        path_from: of the other trials: the "camera" (no film is kept; without one the robot's own poses), or
            its "wheels", which miss slip.
        twin_noise: the twin's noise scale, 1 if None.
        seed: of starts and noise; the study's own if None.
        seconds: length of a trial; the task's own if None.
        baud: rate of the robots' lines; None tries them all on a port.
        camera: the calibration of the live camera over a real robot, or its file.
        camera_device: that camera: its number, a video file, a stream.
        disk: a real robot's disk, or its file; the shipped one if None.
        marker: what the robots wear instead: a tag, or its text for `Tag.parse`.

    Raises:
        UsageError: invalid values, or invalid combinations.
    """

    runs: Sequence[int | str] = ()
    robots: Sequence[str | Address] = ("twin",)
    starts: int = 1
    individual: str = "champion"
    controller: str | None = None
    film: bool | Collection[int | tuple[int, int]] = False
    view: str = "drawn"
    path_from: str = "camera"
    twin_noise: float | None = None
    seed: int | None = None
    seconds: float | None = None
    baud: int | None = 38400
    camera: CameraModel | str | Path | None = None
    camera_device: str | int | None = None
    disk: Disk | str | Path | None = None
    marker: Marker | str | None = None

    def __post_init__(self) -> None:
        for name, given in {"runs": self.runs, "robots": self.robots}.items():
            if isinstance(given, str) or not isinstance(given, Iterable):
                raise UsageError(f"{name}: expected a list, got {given!r}. Write [{given!r}].")
            object.__setattr__(self, name, tuple(given))
        whole("starts", self.starts, 1, 10**6)
        if self.seed is not None:
            whole("seed", self.seed, 0, LARGEST)
        if self.twin_noise is not None:
            as_scale(self.twin_noise, "twin_noise")
        if self.marker is not None:
            self.worn  # noqa: B018 - one that is none is refused now
        for name, known in {"view": ("drawn", "mujoco"), "path_from": ("camera", "wheels")}.items():
            if getattr(self, name) not in known:
                raise UsageError(f"{name}: expected {' or '.join(known)}, got {getattr(self, name)!r}.")
        if self.controller is not None and self.individual != "champion":
            raise UsageError("individual: expected none with a controller of your own. Leave it out.")
        real = any(robot.unit is None for robot in self.bodies)
        twins = any(robot.unit is not None for robot in self.bodies)
        if self.twin_noise is not None and not twins:
            raise UsageError("twin_noise: expected a twin; a robot has its own noise. Leave it out.")
        if self.view == "mujoco" and (self.marker is not None or not (twins and self.film)):
            raise UsageError("view: expected a filmed twin with mujoco, which wears the disk (--film).")
        above = [name for name in ("camera", "camera_device", "disk") if getattr(self, name) is not None]
        above = ["disk (--marker FILE.toml)" if name == "disk" else name for name in above]
        if above and not real:
            raise UsageError(f"{above[0]}: expected a real robot; a twin has a camera and a disk of its own.")
        above += [name for name in ("film",) if real and self.film]
        above += [name for name in ("marker",) if not twins and self.marker is not None]
        if above and (self.camera is None or self.camera_device is None):
            raise UsageError(
                f"{above[0]}: expected the camera above the robot, and its calibration (--camera-device "
                "DEVICE, --camera FILE). `realitygap camera calibrate` makes that; `realitygap camera track "
                "FILM` tracks a film of your own."
            )

    @cached_property
    def bodies(self) -> tuple[Address, ...]:
        """The robots, each once."""
        parsed = (one if isinstance(one, Address) else Address.parse(str(one)) for one in self.robots)
        bodies = tuple(dict.fromkeys(parsed))
        if not bodies:
            raise UsageError('robots: expected one robot at least, got none. Leave it out for ["twin"].')
        return bodies

    @cached_property
    def worn(self) -> Marker:
        """What the robots wear: the shipped disk for a twin, or the tag."""
        if isinstance(self.disk, Disk) and self.marker is None:
            return self.disk
        if isinstance(self.marker, Marker):
            return self.marker
        return load_marker(self.marker, str(self.disk) if isinstance(self.disk, Disk) else self.disk)

    @property
    def named(self) -> Named | None:
        """The controller that drives in place of an individual, if any."""
        return None if self.controller is None else Named(str(self.controller))

    @property
    def noise(self) -> float:
        """The twin's noise scale."""
        return 1.0 if self.twin_noise is None else self.twin_noise

    def films(self, run: int, start: int) -> bool:
        """Whether the trial of the run with this id from this start is filmed."""
        return self.film if isinstance(self.film, bool) else run in self.film or (run, start) in self.film
