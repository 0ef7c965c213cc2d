"""What `simulate`, `probe` and `replay` have in common: a task, a robot and a simulation of both."""

from __future__ import annotations

from dataclasses import dataclass
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

from realitygap.cli.output import print_table

if TYPE_CHECKING:
    from pathlib import Path

    import numpy as np

    from realitygap.controller.genotype import Layout
    from realitygap.tasks.simulation import Simulation
    from realitygap.tasks.task import Task
    from realitygap.values import Trajectory
    from realitygap.world.arena import Arena
    from realitygap.world.profile import Profile

__all__ = ["Scene", "print_path", "stream_of"]


@dataclass(frozen=True, kw_only=True)
class Scene:
    """A task and a robot in an arena (mostly the task's own) at one level of noise."""

    task: Task
    profile: Profile
    arena: Arena
    noise: float

    @classmethod
    def load(cls, *, task: str, profile: str, noise: float, arena: str | None = None) -> Scene:
        """The scene that a person names; `arena` takes the place of the task's own."""
        from realitygap.tasks import load_task
        from realitygap.world.arena import load_arena
        from realitygap.world.profile import load_profile

        loaded = load_task(task)
        room = loaded.arena if arena is None else load_arena(arena)
        return cls(task=loaded, profile=load_profile(profile), arena=room, noise=noise)

    @property
    def layout(self) -> Layout:
        """The genotypes that fit the task: one input for each sensor it feeds."""
        from realitygap.controller.genotype import Layout

        return Layout(inputs=len(self.task.sensors))

    def simulation(self) -> Simulation:
        """The simulation of this scene."""
        from realitygap.tasks.simulation import Simulation

        return Simulation(self.task, self.profile, self.noise, arena=self.arena)

    def save_picture(self, path: Path, trajectory: Trajectory) -> None:
        """Draw a trajectory with its tail."""
        from realitygap.report import save_picture

        save_picture(path, self._room(), self.profile, trajectory, self.task.title)

    def save_animation(self, path: Path, trajectory: Trajectory) -> None:
        """Film a trajectory."""
        from realitygap.report import save_animation

        save_animation(path, self._room(), self.profile, trajectory, self.task.title)

    def _room(self) -> SimpleNamespace:
        """What a picture shows of the task: this scene's arena may not hold the task's own starts."""
        return SimpleNamespace(arena=self.arena, feeds=self.task.feeds)

    def facts(self, seed: int) -> dict[str, Any]:
        """What a person needs to make the same figures again."""
        return {
            "task": self.task.name,
            "arena": self.arena.name,
            "profile": self.profile.name,
            "noise": self.noise,
            "seed": seed,
        }


def stream_of(seed: int) -> np.uint64:
    """The stream of random numbers that a person's `--seed` stands for."""
    import numpy as np

    return np.uint64(seed)


def print_path(trajectory: Trajectory, every: int = 10) -> None:
    """Every `every`th step of a trajectory and its end, as a table."""
    import numpy as np

    rows: list[list[object]] = []
    for k in range(0, len(trajectory.t), every):
        rows.append(
            [
                Fixed(trajectory.t[k]),
                Fixed(trajectory.x[k]),
                Fixed(trajectory.y[k]),
                Fixed(float(np.degrees(trajectory.heading[k]))),
                *(int(command) for command in trajectory.commands[k]),
                *(Fixed(wheel) for wheel in trajectory.wheels[k]),
                "yes" if trajectory.contact[k : k + every].any() else "",
            ]
        )
    head = ("t s", "x cm", "y cm", "heading°", "left", "right", "wheel l", "wheel r", "contact")
    print_table(head, rows)


class Fixed(float):
    """A number that shows one digit after the point."""

    def __str__(self) -> str:
        return f"{float(self):.1f}"
