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
        watch: take the other paths from the camera too, without keeping a film; else, and without a camera,
            they are reported by the robot, or computed from its wheels' counters.
        twin_noise: the twin's noise scale, 1 if None.
        seed: of starts and noise; the study's own if None.
        seconds: length of a trial; the task's own if None.
        baud: rate of the robots' lines; None tries them all on a port.
        camera: the calibration of the live camera over a real robot, or its file.
        eye: the live camera over a real robot: a camera's number, a video file, a stream.
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
    watch: bool = True
    twin_noise: float | None = None
    seed: int | None = None
    seconds: float | None = None
    baud: int | None = 38400
    camera: CameraModel | str | Path | None = None
    eye: str | int | None = None
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
        real = any(robot.unit is None for robot in self.bodies)
        twins = any(robot.unit is not None for robot in self.bodies)
        disk, eye, marker, camera = (
            given is not None for given in (self.disk, self.eye, self.marker, self.camera)
        )
        above = "the camera above the robot, and its calibration (--camera-device DEVICE, --camera FILE)"
        wrong = {
            "individual: expected none with a controller of your own. Leave it out.": (
                self.controller is not None and self.individual != "champion"
            ),
            "--twin-noise scales a twin's noise, or Enki's; a robot has its own noise. Leave it out.": (
                self.twin_noise is not None and not twins
            ),
            "disk: expected a robot that wears it; a twin has a disk of its own.": disk and not real,
            "eye: expected camera too: its camera.json, as `realitygap camera calibrate` makes it (--camera "
            "FILE).": eye and not camera,
            f"camera: expected eye too: {above}.": camera and not eye,
            f"disk: expected eye too: {above}.": disk and not eye,
            "eye: expected a robot under it; a twin has a camera of its own.": eye and not real,
            f"marker: expected eye too: {above}.": marker and not twins and not eye,
            f"film: expected {above}. A film of your own: `realitygap camera track FILM`.": (
                real and bool(self.film) and not eye
            ),
            f"view: expected drawn or mujoco, got {self.view!r}.": self.view not in ("drawn", "mujoco"),
            "view: expected a filmed twin with mujoco (--robot twin:1 --film).": (
                self.view == "mujoco" and not (twins and self.film)
            ),
            "view: expected drawn with a marker; MuJoCo's renderer shows a twin's disk.": (
                self.view == "mujoco" and marker
            ),
        }
        for says, found in wrong.items():
            if found:
                raise UsageError(says)

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
