"""A transferred trial of both robots, step by step: what a log of it shows."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from realitygap.controller.layout import Genes
from realitygap.errors import StudyError
from realitygap.report.arenas import rays_of
from realitygap.report.network import network_drawing
from realitygap.report.player_tracks import activity, decided
from realitygap.report.robots import front
from realitygap.robots.recording import Recording
from realitygap.study.load import Run
from realitygap.tasks.task import Task
from realitygap.text import must_be
from realitygap.track import Track, Trajectory, read_track
from realitygap.transfer.load import Transferred, load_transfers, read_trial
from realitygap.transfer.packed import placed
from realitygap.transfer.replay import Replays
from realitygap.transfer.trial import SIMULATED, SITUATED, TRIAL
from realitygap.values import Floats
from realitygap.world.profile import Profile

__all__ = ["Lived", "Side", "lived"]


class Side(NamedTuple):
    """One of the two robots.

    Attributes:
        name: "simulated" or "situated".
        track: [n + 1] poses; NaN where it was lost.
        inside: what is known of each step, [n, k] by name: proximity, ambient (counts), inputs, commands
            (−10 to 10), and outputs of the network's neurons, in the order of the drawing's.
        rays: [n + 1, rays, 2 ends, 2] cm; NaN where it was lost.
    """

    name: str
    track: Track
    inside: Mapping[str, NDArray[Any]]
    rays: Floats


class Lived(NamedTuple):
    """A trial: where, who, both robots, and the film of the situated one (None: none was kept).

    Attributes:
        trial: what its file says.
        task: with the arena.
        outlines: [2] lines [points, 2] in cm in the robot's own frame: its body, and a line ahead.
        network: the drawing that the page's player has, None where it is not known who drove.
        sides: simulated, situated.
        film: its file; lead_s: how long before the trial it begins.
    """

    trial: Transferred
    task: Task
    outlines: tuple[Floats, Floats]
    network: Mapping[str, Any] | None
    sides: tuple[Side, Side]
    film: Path | None
    lead_s: float

    @property
    def name(self) -> str:
        """For its file and for people."""
        return f"{self.trial.name.replace('/', '-')}-{self.trial.robot}-start-{self.trial.start}"


def lived(
    run: Run, individual: str = "champion", robot: str | None = None, start: int | None = None
) -> Lived:
    """A trial of a run on a robot, simulated again beside it; the first that fits.

    What is not known is left out: see `transfer/replay.py`.

    Args:
        run: whose.
        individual: "champion" or "fittest".
        robot: the trial's folder, such as "twin-1"; any if None.
        start: its number; any if None.

    Raises:
        StudyError: there is no such trial; names those that there are.
    """
    must_be(run, Run, "run", "study.run(1) is one.")
    there = [one for one in load_transfers(run.study.folder) if one.run == run.id]
    wanted = {"individual": individual, "robot": robot, "start": start}
    asked = {key: value for key, value in wanted.items() if value is not None}
    fits = [one for one in there if all(getattr(one, key) == value for key, value in asked.items())]
    if not fits:
        known = (
            ", ".join(f"{one.individual} on {one.robot} from start {one.start}" for one in there) or "none"
        )
        raise StudyError(
            f"{run.study.folder}: expected a trial of run {run.id} on a robot, got "
            f"{', '.join(f'{key} {value}' for key, value in asked.items())}; there are: {known}. "
            "Make one with `realitygap transfer`."
        )
    trial, task, profile = fits[0], run.study.task(run.task), run.study.profile
    replay = Replays(run.study).of(trial.folder)
    drawing, slots = (None, []) if replay.genes is None else network_drawing(replay.genes, task, profile)
    with placed(trial.folder) as here:
        paths = [read_track(here / name) for name in (SIMULATED, SITUATED)]
    if replay.simulated is not None:
        paths[0] = replay.simulated.track
    sides = [
        _side(name, path, kept, (replay.genes, slots), (task, profile))
        for name, path, kept in zip(("simulated", "situated"), paths, replay[1:], strict=True)
    ]
    return Lived(
        trial=trial, task=task, outlines=_outlines(profile), network=drawing, sides=(sides[0], sides[1]),
        film=trial.folder / "film.mp4" if trial.filmed else None,
        lead_s=float(read_trial(trial.folder / TRIAL).get("film_lead_s", 0.0)),
    )  # fmt: skip


def _side(
    name: str,
    track: Track,
    kept: Trajectory | Recording | None,
    drove: tuple[Genes | None, list[int]],
    where: tuple[Task, Profile],
) -> Side:
    """One robot on its path, with what was `kept` of it; `drove` is the genotype and its neurons' slots."""
    task, profile = where
    robot, arena, steps = profile.to_kernel(), task.arena.to_kernel(), len(track) - 1
    rays = np.stack([
        rays_of(robot, arena, task.feeds, pose) for pose in zip(track.x, track.y, track.heading, strict=True)
    ])  # fmt: skip
    rays[~track.found] = np.nan
    inside: dict[str, NDArray[Any]] = {}
    if kept is not None:
        inside = {key: getattr(kept, key) for key in ("proximity", "ambient", "inputs")}
        inside["commands"] = decided(kept, profile)
        outputs = None if drove[0] is None else activity(drove[0], kept.inputs, inside["commands"], drove[1])
        inside |= {} if outputs is None else {"outputs": outputs}
    return Side(name, track, {k: v for k, v in inside.items() if v.shape[0] == steps and v.shape[1]}, rays)


def _outlines(profile: Profile) -> tuple[Floats, Floats]:
    robot = profile.to_kernel()
    turn = np.linspace(0.0, 2.0 * np.pi, 33)
    circle = robot.radius * np.stack([np.cos(turn), np.sin(turn)], 1)
    corners = robot.outline[:, :2]
    body = np.concatenate([corners, corners[:1]]) if len(corners) else circle
    return body, np.array([[0.0, 0.0], [front(robot), 0.0]])
