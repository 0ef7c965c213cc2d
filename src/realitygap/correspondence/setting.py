"""Where trials took place: the arena that they are described in, and the exemplars that serve."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from os import PathLike

from realitygap.correspondence.surroundings import fits
from realitygap.correspondence.trials import Trial, require_trials
from realitygap.errors import TrackError
from realitygap.tasks.load import TASKS, load_task
from realitygap.tasks.task import Task
from realitygap.world.arena import Arena

__all__ = ["Setting", "setting_of"]


@dataclass(frozen=True, kw_only=True)
class Setting:
    """An arena and the paper's task that is most like what happens in it.

    Attributes:
        name: for people.
        arena: None: nobody knows; then only the tracks' own motion is compared.
        exemplars: a paper's task: obstacle avoidance where no lamp is, else light seeking; None: both.
    """

    name: str
    arena: Arena | None
    exemplars: str | None


def setting_of(trials: Sequence[Trial], task: Task | str | PathLike[str] | None = None) -> Setting:
    """Where trials took place: in a task's arena, or in the paper's arena that they fit in.

    Raises:
        TrackError: a track that leaves the task's arena.
    """
    require_trials(trials)
    if task is not None:
        task = load_task(task)
        _require_inside(trials, task)
        return _setting(task, task.name)
    for name in TASKS:
        guess = load_task(name)
        if all(fits(guess.arena, t.x, t.y, t.radius_cm) for t in trials):
            return _setting(guess, f"{name} (guessed from where the tracks are)")
    return Setting(name="unknown arena: compared by motion alone", arena=None, exemplars=None)


def _setting(task: Task, name: str) -> Setting:
    if task.feeds == "ambient" and task.arena.lamps:
        return Setting(name=name, arena=task.arena, exemplars="light-seeking")
    return Setting(name=name, arena=replace(task.arena, lamps=()), exemplars="obstacle-avoidance")


def _require_inside(trials: Sequence[Trial], task: Task) -> None:
    for t in trials:
        if not fits(task.arena, t.x, t.y, t.radius_cm):
            width, depth = task.arena.size_cm
            raise TrackError(
                f"{t.source}, start {t.start}: expected a track in the arena of task {task.name!r} "
                f"({width:g} by {depth:g} cm, clear of its walls and cylinders), got x from {t.x.min():.1f} "
                f"to {t.x.max():.1f} and y from {t.y.min():.1f} to {t.y.max():.1f} cm. Name another --task, "
                "or leave it out."
            )
