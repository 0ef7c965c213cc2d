"""Made-up data that the report's tests draw, and transfers: no simulation is needed to look at a figure."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from realitygap.control.genotype import Genotype
from realitygap.files import to_toml
from realitygap.film.camera import CameraModel
from realitygap.film.video import FilmWriter
from realitygap.kernels.types import MAX_DELAY
from realitygap.report.evolution import NoiseClass, Row, TaskPart, mean_of
from realitygap.report.page import Picture
from realitygap.study.config import StudyConfig
from realitygap.study.load import Run, Study
from realitygap.track import Track, Trajectory
from realitygap.values import Pose
from tests.conftest import FIGURE

LEVELS = {0.0: "zero", 1.0: "observed", 2.0: "double"}
EQUAL = {0.0: [0.5, 0.6, 0.55], 1.0: [0.56, 0.52, 0.58], 2.0: [0.54, 0.6, 0.5]}
APART = {0.0: [0.5, 0.51, 0.52], 1.0: [0.9, 0.91, 0.92], 2.0: [0.2, 0.21, 0.22]}
"""Means of runs by noise level: alike, and clearly apart."""


def circle(steps: int = 50, *, radius: float = 8.0, centre: tuple[float, float] = (25.0, 25.0)) -> Trajectory:
    """A robot that drives along a circle, counter-clockwise, with rising readings."""
    turn = np.linspace(0, 1.5 * np.pi, steps + 1)
    x, y = centre[0] + radius * np.cos(turn), centre[1] + radius * np.sin(turn)
    heading = turn + np.pi / 2
    rising = np.repeat(np.linspace(0, 480, steps)[:, None], 8, axis=1)
    return Trajectory(
        t=0.1 * np.arange(steps), x=x[:-1], y=y[:-1], heading=heading[:-1], proximity=2 * rising,
        ambient=rising, inputs=np.zeros((steps, 8), np.int64), commands=np.tile([3, 7], (steps, 1)),
        wheels=np.tile([3.0, 7.0], (steps, 1)), contact=np.zeros(steps, bool),
        end=Pose(x=float(x[-1]), y=float(y[-1]), heading=float(heading[-1])),
    )  # fmt: skip


def random_genotype(
    seed: int, *, hidden: float = 0.1, slots: int = 30, links: int = 8, inputs: int = 8
) -> Genotype:
    """A random genotype, every field filled whether expressed or not."""
    random = np.random.default_rng(seed)
    genes = np.zeros((slots, 2 + 4 * links), np.int8)
    genes[:, 0] = random.random(slots) < hidden
    genes[: inputs + 2, 0] = 1
    genes[:, 1] = random.integers(-10, 11, slots)
    genes[:, 2::4] = random.random((slots, links)) < 0.5
    genes[:, 3::4] = random.integers(0, slots, (slots, links))
    genes[:, 4::4] = random.integers(-4, 5, (slots, links))
    genes[:, 5::4] = random.integers(0, MAX_DELAY + 1, (slots, links))
    return Genotype(genes, inputs)


def table(
    fittest: dict[float, list[float]],
    champion: dict[float, list[float]],
    stored: float = 0.7,
    scale: float = 1.0,
) -> TaskPart:
    """A table whose individuals score the same at every noise level: given means by noise class."""
    classes = []
    for level, means in fittest.items():
        facts = [
            {"index": k, "id": k, "name": f"made-up/{level}/{k}", "evaluations": 1000, "finished": True,
             "best_fitness": stored * scale}
            for k in range(1, len(means) + 1)
        ]  # fmt: skip
        rows = tuple(
            Row(
                run=SimpleNamespace(**one),
                means={(who, at): mean_of([0.99 * value * scale, 1.01 * value * scale])
                       for who, value in (("fittest", best), ("champion", last)) for at in LEVELS},
            )
            for one, best, last in zip(facts, means, champion[level], strict=True)
        )  # fmt: skip
        classes.append(NoiseClass(level=level, name=LEVELS[level], rows=rows))
    return TaskPart(task=made_up(scale), conditions=tuple(classes), levels=LEVELS)


def made_up(scale: float = 1.0) -> SimpleNamespace:
    """What a table needs to know of its task."""
    return SimpleNamespace(name="made-up", fitness_unit="", fitness_scale=scale)


def draw_only(patch: pytest.MonkeyPatch, wanted: Callable[[str], bool]) -> None:
    """Pages have an empty figure, as files too, in the place of each whose name is not wanted."""
    save = Picture.save

    def some(picture: Picture, folder: Path, **settings: int) -> str:
        if wanted(picture.name):
            return save(picture, folder, **settings)
        for kind in ("png", "svg"):
            (folder / f"{picture.name}.{kind}").write_text(FIGURE, "utf-8")
        return FIGURE

    patch.setattr(Picture, "save", some)


def few(config: StudyConfig) -> StudyConfig:
    """The same with short trials and few tests."""
    return config.with_settings(["task.seconds=0.5", "retest_trials=2", "fresh_trials=3"])


STEPS = 40
TIMES, EDGE_PX = 10, 4.0
"""Frames a second of a made-up film; its pixels for each cm of the 50 by 50 cm that it shows."""


def write_film(folder: Path, shade: int = 60) -> None:
    """A film of an empty floor of one shade, its camera, and a track along a straight line."""
    CameraModel(
        width_px=200, height_px=200, homography=np.array([(EDGE_PX, 0, 0), (0, -EDGE_PX, 200), (0, 0, 1.0)])
    ).save(folder / "camera.json")
    count = STEPS // 4
    with FilmWriter(folder / "film.mp4", rate=TIMES, made_by="a test") as film:
        for _ in range(count):
            film.add(np.full((200, 200), shade, np.uint8))
    x = np.linspace(10.0, 30.0, count)
    track = Track.from_degrees(np.arange(count) / TIMES, x, np.full(count, 10.0), np.zeros(count))
    track.write_csv(folder / "track.csv")


def write_transfer(
    study: Study, run: Run, *, robot: str = "twin-1", start: int = 1,
    fitness: tuple[float, float] = (0.6, 0.4), film: bool = False, individual: str = "champion",
) -> Path:  # fmt: skip
    """A transfer of the layout that `realitygap transfer` writes: the robot drives a narrower circle."""
    from PIL import Image

    folder = study.folder / "transfer" / robot / run.name.replace("/", "-") / f"start-{start}"
    folder.mkdir(parents=True)
    for name, radius in (("simulated.csv", 3.0), ("situated.csv", 2.0)):
        turn = np.arange(STEPS + 1) / STEPS * 4.0
        x, y = 22.0 - radius + radius * np.cos(turn), 25.0 + radius * np.sin(turn)
        Track.from_degrees(np.arange(STEPS + 1) / 10, x, y, 90.0 + np.degrees(turn)).write_csv(folder / name)
    if film:
        shade = np.linspace(0, 255, 1600 * 1200).reshape(1200, 1600).astype(np.uint8)
        Image.fromarray(shade).save(folder / "tails.png")  # larger than a page has room for
        write_film(folder)
    facts: dict[str, Any] = {
        "run": run.id, "name": run.name, "task": run.task, "noise": run.noise, "individual": individual,
        "robot": robot, "start": start, "pose": {"x_cm": 22.0, "y_cm": 25.0, "heading_deg": 90.0},
        "seconds": STEPS / 10, "film": film, "situated_from": "film" if film else "camera", "late_steps": 0,
        "fitness": {"simulated": fitness[0], "situated": fitness[1]},
    }  # fmt: skip
    if robot.startswith("twin"):
        facts |= {"unit": int(robot.split("-")[1]), "twin_noise": 1.0}
    (folder / "transfer.toml").write_text(to_toml(facts), encoding="utf-8")
    return folder
