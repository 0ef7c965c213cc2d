"""Every kind of file that a command reads, and the command; small, so that thousands can be tried."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from realitygap.world.arena import load_arena
from realitygap.world.robot import load_profile

__all__ = ["KINDS", "Kind"]

Work = Callable[[], object]


@dataclass(frozen=True)
class Kind:
    """A kind of file: its name, its sound bytes, other files that it needs, and what reads it.

    `command` are the words of a command; `call` makes a call of the library where no command is quick.
    """

    file: str
    data: bytes
    command: tuple[str, ...] = ()
    beside: dict[str, bytes] | None = None
    call: Callable[[Path], object] | None = None

    def write(self, folder: Path, data: bytes) -> None:
        """Put the file, and those beside it, into a folder."""
        for name, content in {**(self.beside or {}), self.file: data}.items():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).write_bytes(content)


def _readings() -> bytes:
    draw = np.random.default_rng(0)
    lines = ["distance_cm,bearing_deg,repeat," + ",".join(f"s{i}" for i in range(8))]
    looks = np.array([90, 45, 0, 0, -45, -90, 180, 180.0])
    for distance in (0.5, 1, 2, 4):
        for bearing in range(-165, 181, 15):
            lit = np.cos(np.radians(np.clip(np.abs((looks - bearing + 180) % 360 - 180), 0, 90)))
            counts = np.clip(lit * 900 / distance + draw.normal(0, 5, 8), 0, 1023).round()
            lines.append(f"{distance},{bearing},0," + ",".join(f"{c:g}" for c in counts))
    return ("\n".join(lines) + "\n").encode()


def _steps() -> bytes:
    lines = [
        "t_s,command_left,command_right,counter_left,counter_right,speed_left,speed_right,trial,kind,"
        "x_cm,y_cm,heading_deg"
    ]
    for trial in range(4):
        pulses = np.zeros(2)
        for k in range(25):
            command = np.array([trial + 2, trial + 1 if trial % 2 else trial + 2]) * (k < 20)
            lines.append(
                f"{k / 10},{command[0]},{command[1]},{pulses[0]:g},{pulses[1]:g},0,0,{trial},step,"
                f"{pulses.mean() / 120},0,{np.degrees(np.diff(pulses)[0] / 120 / 5.3):.3f}"
            )
            pulses += (command * 9.6).round()
    return ("\n".join(lines) + "\n").encode()


def _sam() -> bytes:
    draw = np.random.default_rng(1)
    rows = ["8 36 4 5 5"]
    for d in range(4):
        rows.append(f"TURN {d}")
        for b in range(36):
            lit = np.clip(np.cos(np.radians(np.array([90, 45, 0, 0, -45, -90, 180, 180]) + 10 * b)), 0, 1)
            rows.append(
                " ".join(f"{v:.0f}" for v in np.clip(lit * 1000 / (d + 1) + draw.integers(0, 9, 8), 0, 1023))
            )
    return ("\n".join([*rows, "END"]) + "\n").encode()


def _track() -> bytes:
    t = np.arange(100) / 10
    rows = [f"{a:g},{25 + 3 * np.cos(a):.4f},{25 + 3 * np.sin(a):.4f},{np.degrees(a) + 90:.3f}" for a in t]
    return ("\n".join(["t_s,x_cm,y_cm,heading_deg", *rows]) + "\n").encode()


def _simulated() -> bytes:
    rows = [line.split(",") for line in _track().decode().splitlines()[1:]]
    columns = {
        name: [float(row[i]) for row in rows] for i, name in enumerate(("t_s", "x_cm", "y_cm", "heading_deg"))
    }
    return json.dumps(columns).encode()


@cache
def _film() -> bytes:
    """Two small frames with the disk in them."""
    import tempfile

    from realitygap.film.video import FilmWriter

    with tempfile.TemporaryDirectory() as folder:
        with FilmWriter(Path(folder) / "f.mp4", rate=5.0, made_by="a test") as film:
            for x in (60, 64):
                film.add(_disk(x))
        return (Path(folder) / "f.mp4").read_bytes()


def _disk(x: int) -> Any:
    import cv2

    frame = np.full((120, 160), 160, np.uint8)
    for away, radius, grey in ((0, 22, 30), (0, 6, 220), (16, 4, 220)):
        cv2.circle(frame, (x + away, 60), radius, grey, -1, cv2.LINE_AA)
    return frame


def _picture() -> bytes:
    import cv2

    return bytes(cv2.imencode(".png", _disk(60))[1])


def _camera() -> bytes:
    homography = [[8.0, 0.0, 0.0], [0.0, -8.0, 119.0], [0.0, 0.0, 1.0]]
    return json.dumps(
        {
            "format": "realitygap camera 1",
            "width_px": 160,
            "height_px": 120,
            "homography": homography,
            "radial": [0.0, 0.0],
            "plane_cm": 3.0,
            "lens_cm": [10, 8, 90],
        }
    ).encode()


def _genotype() -> bytes:
    from realitygap.control.genotype import Genotype

    return str(Genotype.braitenberg("proximity")).encode()


def _npz() -> bytes:
    import io

    out = io.BytesIO()
    np.savez(out, poses=np.zeros((1, 2, 21, 3)), streams=np.zeros(2, np.uint64))
    return out.getvalue()


def _study_config(folder: Path) -> object:
    from realitygap.study.config import StudyConfig

    return StudyConfig.from_toml(folder / "study.toml", task="obstacle-avoidance").to_toml()


def _noise_config(folder: Path) -> object:
    from realitygap.experiments.noise import NoiseConfig

    return NoiseConfig.from_folder(folder).to_toml()


def _reproduction(folder: Path) -> object:
    from realitygap.experiments.reproduction import Reproduction

    return Reproduction.from_toml(folder / "reproduce.toml")


def _transfers(folder: Path) -> object:
    from realitygap.transfer.record import load_transfers

    return [(one.to_dict(), one.simulated, one.situated) for one in load_transfers(folder)]


def _drive(folder: Path) -> object:
    from realitygap.robots.recording import Recording

    return Recording.from_folder(folder).late_steps


def _situated(folder: Path) -> object:
    from types import SimpleNamespace

    from realitygap.experiments.noise import NoiseExperiment

    design = SimpleNamespace(
        config=SimpleNamespace(starts=2),
        driven=lambda one: (1,),
        driven_file=lambda one: folder / "one.npz",
        task=lambda name: SimpleNamespace(steps_of=lambda profile: 20),
        profile=lambda unit: SimpleNamespace(period_s=0.1),
    )
    one = SimpleNamespace(task="t", name="one", home=1)
    return NoiseExperiment.read_driven(design, one)  # type: ignore[arg-type]


_FACTS = (
    b'kind = "infrared"\n'
    b'object = "wall"\nsensors = 8\nbody_radius_cm = 2.75\nnotes = ""\nseed = 3\nplaces = 96\n'
)
_LIT = b'kind = "ambient"\nobject = "lamp"\nsensors = 8\narena = "arena.toml"\n'
_WHEELS = b'kind = "wheels"\nplaces = 4\n'
_AROUND = (
    _readings().replace(b"distance_cm,bearing_deg", b"x_cm,y_cm,heading_deg").replace(b"\n", b"\n5,", 96)[:-2]
)
_TRIAL = b"""run = 1
name = "obstacle-avoidance/zero/1"
task = "obstacle-avoidance"
noise = 0.0
individual = "champion"
evaluation = 3
robot = "twin:1"
unit = 1
twin_noise = 1.0
seed = 7
start = 1
seconds = 9.9
film = false
situated_from = "camera"
late_steps = 0
lost_steps = 0
[pose]
x_cm = 35.0
y_cm = 25.0
heading_deg = 90.0
[fitness]
simulated = 0.5
situated = 0.4
"""
_DRIVE = (
    b"t_s,late_s,command_left,command_right,counter_left,counter_right,speed_left,speed_right\n"
    b"0,0,3,4,0,0,0,0\n0.1,0,3,4,0,0,0,0\n"
)
_POSES = b"frame,x_cm,y_cm,heading_deg\nf0.png,10,7.5,0\nf1.png,11,7.5,0\n"
_KEY = json.dumps([{"pair": k, "score": 10.0 - k, "name": f"p{k}"} for k in range(1, 5)]).encode()
_MARKS = ("pair,judge,mark\n" + "".join(f"{k},anna,{9 - 2 * k}\n" for k in range(1, 5))).encode()
_SIMULATE = (
    "simulate",
    "avoidance",
    "--controller",
    "constant:1,2",
    "--pose",
    "25",
    "25",
    "0",
    "--seconds",
    "0.5",
    "--json",
)


def _kinds() -> dict[str, Kind]:
    profile, room = load_profile("paper").to_toml().encode(), load_arena("light-seeking").to_toml().encode()
    plain = load_arena("obstacle-avoidance").to_toml().encode()
    wall, drive = {"recording.toml": _FACTS}, {"drive.toml": b'robot = "twin"\n'}
    study = b'seed = 3\nruns = 2\nevaluations = 10\n[[conditions]]\ntask = "light"\nnoise = "double"\n'
    noise = b"levels = [0.0, 1.0]\nruns = 2\nunits = 1\nstarts = 2\nevaluations = 10\n"
    film, here = {"film.mp4": _film(), "camera.json": _camera()}, "transfer/twin-1/one/start-1/"
    trial = {
        here + name: data
        for name, data in (("transfer.toml", _TRIAL), ("simulated.csv", _track()), ("situated.csv", _track()))
    }
    track = ("track", "{}/film.mp4", "--camera", "{}/camera.json", "--out", "{}/out.csv", "--json")
    check, marks = (
        ("calibrate", "--check", "{}", "paper", "--json"),
        ("judge", "marks", "{}/m.csv", "--key", "{}/k.json"),
    )
    return {
        "profile": Kind("mine.toml", profile, (*_SIMULATE, "--profile", "{}/mine.toml")),
        "profile-light": Kind(
            "mine.toml",
            profile,
            ("probe", "light", "--pose", "60", "35", "0", "--profile", "{}/mine.toml", "--json"),
        ),
        "arena": Kind("mine.toml", plain, (*_SIMULATE, "--arena", "{}/mine.toml")),
        "arena-light": Kind(
            "mine.toml",
            room,
            ("probe", "light", "--pose", "60", "35", "0", "--arena", "{}/mine.toml", "--json"),
        ),
        "recording": Kind("recording.toml", _FACTS, check, {"readings.csv": _readings()}),
        "readings": Kind("readings.csv", _readings(), check, wall),
        "poses-of-light": Kind("readings.csv", _AROUND, check, {"recording.toml": _LIT, "arena.toml": room}),
        "arena-of-light": Kind("arena.toml", room, check, {"recording.toml": _LIT, "readings.csv": _AROUND}),
        "steps": Kind("steps.csv", _steps(), check, {"recording.toml": _WHEELS}),
        "wheels": Kind("recording.toml", _WHEELS, check, {"steps.csv": _steps()}),
        "base": Kind(
            "mine.toml",
            profile,
            ("calibrate", "--check", "{}/r", "{}/mine.toml", "--json"),
            {"r/recording.toml": _FACTS, "r/readings.csv": _readings()},
        ),
        "base-of-wheels": Kind(
            "mine.toml",
            profile,
            ("calibrate", "--check", "{}/r", "{}/mine.toml", "--json"),
            {"r/recording.toml": _WHEELS, "r/steps.csv": _steps()},
        ),
        "sam": Kind("t.sam", _sam(), ("calibrate", "--check", "{}/t.sam", "paper", "--object", "wall")),
        "camera": Kind("camera.json", _camera(), track, film),
        "disk": Kind(
            "disk.toml",
            b"radius_cm = 2.75\ncentre_radius_cm = 0.7\nheight_cm = 3.0\n",
            (*track, "--disk", "{}/disk.toml"),
            film,
        ),
        "film": Kind("film.mp4", _film(), track, film),
        "poses": Kind(
            "poses.csv",
            _POSES,
            ("camera", "calibrate", "--frames", "{}", "--poses", "{}/poses.csv", "--out", "{}/c.json"),
            {"f0.png": _picture(), "f1.png": _picture()},
        ),
        "track": Kind(
            "a.csv",
            _track(),
            ("score", "{}/a.csv", "{}/b.csv", "--task", "avoidance", "--json"),
            {"b.csv": _track()},
        ),
        "track-json": Kind("a.json", _simulated(), ("classify", "{}/a.json", "--json")),
        "key": Kind("k.json", _KEY, marks, {"m.csv": _MARKS}),
        "marks": Kind("m.csv", _MARKS, marks, {"k.json": _KEY}),
        "controller": Kind("c.txt", _genotype(), (*_SIMULATE[:3], "{}/c.txt", *_SIMULATE[4:])),
        "study": Kind("study.toml", study, call=_study_config),
        "noise-study": Kind("noise-study.toml", noise, call=_noise_config),
        "reproduce": Kind(
            "reproduce.toml", b"runs = 2\nevaluations = 10\nseed = 5\nstarts = 3\n", call=_reproduction
        ),
        "transfer": Kind(here + "transfer.toml", _TRIAL, call=_transfers, beside=trial),
        "path": Kind(here + "situated.csv", _track(), call=_transfers, beside=trial),
        "drive": Kind("steps.csv", _DRIVE, call=_drive, beside=drive),
        "drive-facts": Kind("drive.toml", drive["drive.toml"], call=_drive, beside={"steps.csv": _DRIVE}),
        "paths": Kind("one.npz", _npz(), call=_situated),
    }


KINDS = _kinds()
