"""`realitygap simulate`, `probe`, `profile`, `arena`: a robot in an arena, and what there is."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from realitygap.cli import options
from realitygap.cli.console import link, note, shown, table, tell
from realitygap.cli.fitness import after

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

    from realitygap.simulation.simulation import Simulation
    from realitygap.tasks.task import Task
    from realitygap.track import Trajectory
    from realitygap.values import Pose
    from realitygap.world.arena import Arena
    from realitygap.world.robot import Profile
    from realitygap.world.toml import Value

__all__ = [
    "arena", "note_dark", "path_lines", "probe", "profile", "save_path", "simulate", "simulation_facts",
]  # fmt: skip

EVERY = 10
"""Steps of a trajectory from one row that is shown to the next."""


@click.command()
@click.argument("task")
@options.controller()
@options.pose()
@options.profile()
@options.arena
@options.noise()
@options.noise_between
@options.seed()
@options.seconds
@options.picture
@options.verbose
@options.as_json
def simulate(
    task: str,
    controller: str,
    pose: options.Numbers | None,
    profile: str,
    arena: str | None,
    noise: float,
    noise_between: bool,
    seed: int,
    seconds: float | None,
    picture: Path | None,
    verbose: bool,
) -> None:
    """Simulate one trial of TASK.

    TASK is obstacle-avoidance, light-seeking or a Python file of your own. Without --pose the robot starts
    as the task says, drawn with --seed. --verbose prints every tenth step; with --json there is an
    entry for each step (0.1 s, or the profile's): the robot's readings, decision and pose then, what its
    wheels achieved in the following step, and whether it touched something.

    \b
    Example:
        realitygap simulate avoidance --controller constant:5,-3 --pose 25,25,90 --json
    """
    from realitygap.control.controllers import named_controller
    from realitygap.simulation.body import drive_simulated

    simulation, place = _placed(task, profile, noise, noise_between, pose, arena, seed)
    played = simulation.task
    driver = named_controller(controller, played.feeds, len(played.sensors), played.name)
    trajectory, score = drive_simulated(simulation, driver, stream=seed, pose=place, seconds=seconds)
    if picture is not None:
        save_path(picture, played, simulation.profile, trajectory)
    found = {**simulation_facts(simulation, seed), **trajectory.to_dict(), "score": score}
    tell(found, *path_lines(played.to_dict(), trajectory, score, picture, verbose=verbose))


@click.command()
@click.argument("task")
@options.pose()
@options.profile()
@options.arena
@options.noise()
@options.noise_between
@options.seed()
@click.option("--repeat", type=options.Whole(1, 10**6), default=1, metavar="N", help="Read N times.")
@options.as_json
def probe(
    task: str,
    pose: options.Numbers | None,
    profile: str,
    arena: str | None,
    noise: float,
    noise_between: bool,
    seed: int,
    repeat: int,
) -> None:
    """Read a robot's sensors at a place in TASK's arena.

    Readings are whole counts, as the robot's converter gives them; at noise zero they are shown
    before rounding. Without --pose the robot stands at a start of the task's, drawn with --seed.

    \b
    Example: what the paper's model reads facing a cylinder, without noise
        realitygap probe avoidance --pose 25,15,180 --noise zero
    """
    simulation, place = _placed(task, profile, noise, noise_between, pose, arena, seed)
    proximity, ambient = simulation.probe(place, stream=seed, repeat=repeat)
    found, lines = {"proximity": proximity, "ambient": ambient}, []
    for title, readings in found.items():
        if readings.shape[1]:
            rows = [[k, *(f"{round(one, 2):.15g}" for one in row)] for k, row in enumerate(readings.tolist())]
            head = ["reading", *(f"s{i}" for i in range(readings.shape[1]))]
            lines += [f"{title}, counts", table(head, rows)]
    tell({**simulation_facts(simulation, seed), **found}, *lines)


def _placed(
    task: str,
    profile: str,
    noise: float,
    between: bool,
    pose: options.Numbers | None,
    arena: str | None,
    seed: int,
) -> tuple[Simulation, Pose]:
    """The simulation that a person names, and the robot's pose there, by default a start of the task's; task,
    profile and an arena instead of the task's own by name or file.

    Raises:
        BadParameter: the robot cannot stand at the pose.
    """
    from realitygap.simulation.simulation import Simulation
    from realitygap.tasks import Start, load_task
    from realitygap.world.arena import load_arena
    from realitygap.world.robot import load_profile

    loaded, robot = load_task(task), load_profile(profile)
    robot = robot.with_between() if between else robot
    place_in = loaded.arena if arena is None else load_arena(arena)
    note_dark(loaded, place_in)
    if pose is None:
        simulation = Simulation(loaded, robot, noise, place_in)
        return simulation, simulation.start(seed)
    place = options.checked_pose(pose, place_in, robot)
    faces = (place.heading_deg, place.heading_deg)
    start = Start(x_cm=place.x, y_cm=place.y, heading_deg=faces)  # the task's own need not be free here
    return Simulation(replace(loaded, arena=place_in, start=start), robot, noise), place


def simulation_facts(simulation: Simulation, seed: int) -> dict[str, Any]:
    """What a person needs to reproduce the figures."""
    task, profile = simulation.task, simulation.profile
    names = {"task": task.name, "arena": task.arena.name, "profile": profile.name}
    between = {"noise_between": True} if profile.noise.between else {}
    return {**names, "noise": simulation.noise, **between, "seed": seed}


def note_dark(task: Task, arena: Arena) -> None:
    """Note it if a task that feeds ambient light runs where there is no lamp."""
    if "ambient" in task.kinds and not arena.lamps:
        note(f"arena {arena.name!r} has no lamp: the light sensors that task {task.name!r} feeds read dark")


def path_lines(
    task: Mapping[str, Any],
    trajectory: Trajectory,
    score: float,
    picture: Path | None,
    *,
    verbose: bool,
    whose: str = "",
) -> Iterator[str]:
    """A trial's score in its task's unit (a task as by `to_dict`), where it began and ended; `verbose`: every
    tenth step too."""
    turned = 180.0 - (180.0 - trajectory.heading_deg) % 360.0
    yield f"{whose}score {score / task['fitness_scale']:.3g}{after(task['fitness_unit'])}"
    end = trajectory.end
    poses = {"from": (trajectory.x[0], trajectory.y[0], turned[0]), "to": (end.x, end.y, end.heading_deg)}
    for word, (x, y, heading) in poses.items():
        yield f"{word} ({x:.1f}, {y:.1f}) cm, heading {heading:.0f}°"
    if picture is not None:
        yield f"picture {link(picture)}"
    rows: list[list[object]] = []
    places = (trajectory.t, trajectory.x, trajectory.y, turned)
    for k in range(0, len(trajectory.t) if verbose else 0, EVERY):
        place, wheels = (
            [shown(value, ".1f") for value in row] for row in ([p[k] for p in places], trajectory.wheels[k])
        )
        touched = "yes" if trajectory.contact[k : k + EVERY].any() else ""
        rows.append([*place, *map(int, trajectory.commands[k]), *wheels, touched])
    head = ("t s", "x cm", "y cm", "heading°", "left", "right", "wheel l", "wheel r", "contact")
    if verbose:
        yield f"\n{table(head, rows)}"


def save_path(file: Path, task: Task, profile: Profile, trajectory: Trajectory) -> None:
    """A picture of a trial's path; as .gif or .mp4 it moves."""
    from realitygap.report import save_animation, save_picture

    save = save_animation if file.suffix.lower() in (".gif", ".mp4") else save_picture
    save(file, task, profile, trajectory, task.title)


drawn = click.option(
    "--picture", type=options.OutFile(".png", ".svg", ".pdf"), help="Draw it to FILE (.png, .svg or .pdf)."
)


@click.command()
@click.argument("name", required=False)
@drawn
def arena(name: str | None, picture: Path | None) -> None:
    """Print an arena's walls, cylinders and lamps.

    NAME is a shipped arena or a TOML file; without it, the names of the shipped ones are listed. Save what is
    printed, change it, and give the file to --arena.

    \b
    Example: an arena of your own
        realitygap arena obstacle-avoidance > arena.toml
    """
    from realitygap.world.arena import load_arena

    _show("arenas", name, load_arena, picture)


@click.command()
@click.argument("name", required=False)
@drawn
def profile(name: str | None, picture: Path | None) -> None:
    """Print all constants of a robot.

    NAME is a shipped profile or a TOML file; without it, the names of the shipped ones are listed. Save what
    is printed, change it, and give the file to --profile.

    \b
    Example: a robot of your own
        realitygap profile paper > mine.toml
    """
    from realitygap.world.robot import load_profile

    _show("profiles", name, load_profile, picture)


def _show(folder: str, name: str | None, load: Callable[[str], Value], picture: Path | None) -> None:
    """A shipped file as it is, with its comments, or a user's as it was read, or its picture; or the shipped
    ones' names."""
    from realitygap.world.toml import shipped, shipped_text

    if name is None and picture is not None:
        raise click.BadParameter(f"draws one of the {folder}: give its NAME.", param_hint="'--picture'")
    if name is None:
        click.echo("\n".join(shipped(folder)))
    elif picture is not None:
        from realitygap.report.drawing import robot_figure, room_figure
        from realitygap.report.style import write_figure

        draw: Callable[[Any], Any] = room_figure if folder == "arenas" else robot_figure
        write_figure(partial(draw, load(name)), picture)
        click.echo(f"picture {link(picture)}")
    else:
        loaded = load(name)
        click.echo((shipped_text(folder, name) or loaded.to_toml()).rstrip())
