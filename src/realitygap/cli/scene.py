"""What `simulate`, `probe` and `replay` have in common: a simulation, and what is said of it."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

from realitygap.cli.notes import note
from realitygap.cli.option import checked_pose
from realitygap.cli.output import Figure, table

if TYPE_CHECKING:
    from realitygap.cli.option import Numbers
    from realitygap.simulation.simulation import Simulation
    from realitygap.tasks.task import Task
    from realitygap.track import Trajectory
    from realitygap.values import Pose
    from realitygap.world.arena import Arena

__all__ = ["facts", "note_dark", "path_table", "placed"]

EVERY = 10
"""Steps of a trajectory from one row that is shown to the next."""


def placed(
    *, task: str, profile: str, noise: float, pose: Numbers, arena: str | None = None
) -> tuple[Simulation, Pose]:
    """The simulation that a person names, and the robot's pose there; task, profile and an arena instead of
    the task's own by name or file.

    Raises:
        BadParameter: the robot cannot stand at the pose.
    """
    from realitygap.simulation.simulation import Simulation
    from realitygap.tasks import Start, load_task
    from realitygap.world.arena import load_arena
    from realitygap.world.robot import load_profile

    loaded, robot = load_task(task), load_profile(profile)
    room = loaded.arena if arena is None else load_arena(arena)
    place = checked_pose(pose, room, robot)
    note_dark(loaded, room)
    faces = (place.heading_deg, place.heading_deg)
    start = Start(x_cm=place.x, y_cm=place.y, heading_deg=faces)  # the task's own need not be free here
    return Simulation(replace(loaded, arena=room, start=start), robot, noise), place


def facts(simulation: Simulation, seed: int) -> dict[str, Any]:
    """What a person needs to reproduce the figures."""
    task, profile = simulation.task, simulation.profile
    names = {"task": task.name, "arena": task.arena.name, "profile": profile.name}
    return {**names, "noise": simulation.noise, "seed": seed}


def note_dark(task: Task, arena: Arena) -> None:
    """Note it if a task that feeds ambient light runs where there is no lamp."""
    if "ambient" in task.kinds and not arena.lamps:
        note(f"arena {arena.name!r} has no lamp: the light sensors that task {task.name!r} feeds read dark")


def path_table(trajectory: Trajectory) -> str:
    """Every tenth step of a trajectory."""
    rows: list[list[object]] = []
    places = (trajectory.t, trajectory.x, trajectory.y, trajectory.heading_deg)
    for k in range(0, len(trajectory.t), EVERY):
        place, wheels = (
            [Figure(v, ".1f") for v in row] for row in ([p[k] for p in places], trajectory.wheels[k])
        )
        touched = "yes" if trajectory.contact[k : k + EVERY].any() else ""
        rows.append([*place, *map(int, trajectory.commands[k]), *wheels, touched])
    head = ("t s", "x cm", "y cm", "heading°", "left", "right", "wheel l", "wheel r", "contact")
    return table(head, rows)
