"""`realitygap transfer` and `drive`: a robot is driven, as in the simulation from the same starts."""

from __future__ import annotations

import math
import shlex
import sys
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, TypedDict, Unpack

import click

from realitygap.cli import options
from realitygap.cli.console import StoppedError, load_trusted, shown, table, tell
from realitygap.cli.fitness import Fitness, after
from realitygap.cli.study import show_shard
from realitygap.errors import RobotStoppedError, StudyInterruptedError
from realitygap.work.progress import ProgressLine

if TYPE_CHECKING:
    from collections.abc import Iterator

    from realitygap.robots.address import Address
    from realitygap.transfer.run import TransferredTrial
    from realitygap.transfer.spec import TrialSpec
    from realitygap.values import Pose
    from realitygap.work.pool import Workers
    from realitygap.work.shard import Shard

__all__ = ["drive", "transfer", "transfer_lines"]

NEAR_CM, NEAR_DEG = 3.0, 20.0
"""If a robot is seen farther than this from its start, the person is asked."""

SIDES = (
    "to the right (+x)", "to the upper right", "up (+y)", "to the upper left",
    "to the left (−x)", "to the lower left", "down (−y)", "to the lower right",
)  # fmt: skip
"""Headings in words, from 0° on in steps of 45°, as the arena is drawn."""


class TransferSettings(TypedDict):
    """Options that `Transfer` takes by the same names."""

    runs: tuple[str, ...]
    robots: tuple[str, ...]
    starts: int
    individual: str
    controller: str | None
    film: bool
    view: str
    camera: str | None
    camera_device: str | None
    twin_noise: float | None
    seconds: float | None
    baud: int | None


@click.command()
@options.study
@click.argument("runs", metavar="[RUN]...", nargs=-1)
@click.option(
    "--robot",
    "robots",
    multiple=True,
    required=True,
    metavar="R",
    help="twin:UNIT, stranger:UNIT, enki:MODEL:UNIT, khepera:PORT, serial:PORT, epuck:PORT, epuck2:HOST, "
    "thymio:PORT, table:PROFILE (recorded readings, replayed), or a body of your own, file.py:Class; may be "
    "repeated.",
)
@options.starts(type=options.Whole(1), default=1, help="Trials of each run, each from its own start.")
@click.option(
    "--individual",
    type=click.Choice(["champion", "fittest"]),
    default="champion",
    help="champion (retested), or fittest (as in the paper).",
)
@options.controller(required=False)
@click.option("--film/--no-film", default=False, help="Keep a film and track it.")
@click.option(
    "--view",
    type=click.Choice(["drawn", "mujoco"]),
    default="drawn",
    help="How a twin's film is made: drawn, or by MuJoCo's renderer, which takes longer and needs an EGL or "
    "OSMesa library. An existing film is kept.",
)
@click.option(
    "--path-from",
    type=click.Choice(["camera", "wheels"]),
    default="camera",
    help="Where unfilmed paths come from: the overhead camera, or the wheels, which miss slip.",
)
@click.option("--camera", metavar="FILE", help="Calibration of the live camera (camera.json).")
@click.option(
    "--camera-device",
    metavar="DEVICE",
    help="The live camera over a real robot: its number, a video file or a stream.",
)
@options.marker
@options.twin_noise
@options.seconds
@options.baud
@options.workers
@options.shard
@options.verbose
@options.as_json
def transfer(
    study: Path,
    path_from: str,
    marker: str | None,
    workers: Workers,
    shard: Shard | None,
    verbose: bool,
    **settings: Unpack[TransferSettings],
) -> None:
    """Drive a robot with evolved individuals of STUDY.

    Each RUN (a number, a name or best; omitted: all finished runs) drives each robot from --starts poses and
    is simulated from the same poses. Recordings, paths, films and tails go to STUDY/transfer; finished
    trials are kept. The twin is a physics model of the robot behind its own serial protocol.

    With --controller a controller of your own drives in their place, at the task, the noise and the starts
    of each RUN (omitted: one of each task and noise); its trials go to STUDY/controllers, for
    `realitygap score`.

    Examples: on two units of the twin, filmed; on a robot that you carry to its starts, under a camera; a
    controller of your own

    \b
        realitygap transfer out/reproduce 9 24 --robot twin:1 --robot twin:2 --film
        realitygap transfer out/reproduce 9 --robot serial:/dev/ttyUSB0 --camera camera.json --camera-device 0
        realitygap transfer out/reproduce 9 --robot twin:1 --controller my.py:decide --starts 8
    """
    from realitygap.transfer.options import Transfer
    from realitygap.transfer.run import Operator, place_of, run_transfer, shard_folder
    from realitygap.transfer.spec import FOLDER

    loaded = load_trusted(study)
    disk, tag = (
        (marker, None) if (marker or "").endswith(".toml") else (None, None if marker == "disk" else marker)
    )
    asked = Transfer(path_from=path_from, disk=disk, marker=tag, **settings)
    carry = partial(_carry, seen=asked.camera_device is not None)
    home = place_of(loaded.folder, asked) if shard is None else shard_folder(loaded.folder, shard)
    operator = Operator(carry, _found, partial(click.echo, err=True))
    try:
        with ProgressLine() as line:
            made = run_transfer(
                loaded, asked, workers=workers, operator=operator, shard=shard, on_progress=line.show
            )
    except (KeyboardInterrupt, StudyInterruptedError, click.Abort) as stop:
        raise StoppedError(_stopped(stop, home / FOLDER)) from None
    facts, lines = {"transfers": [one.to_dict() for one in made]}, transfer_lines(study, made, verbose)
    if shard is not None:
        show_shard(home, facts, *lines)
        return
    where = (f"\ntransfers {one.folder.parents[2]}" for one in made[:1])
    tell({"study": str(study), **facts}, *lines, *where)


def transfer_lines(study: Path, made: list[TransferredTrial], verbose: bool = False) -> Iterator[str]:
    """A table with a line per trial of a study, then what went wrong."""
    from realitygap.study.load import load_study

    rows, fitness, stalled = [], Fitness(load_study(study)), any(one.stalls for one in made)
    for one in made:
        scores = (fitness.text(one.task, value) for value in (one.fitness_simulated, one.fitness_situated))
        stalls = f"{one.stalls} × ({one.stalled_s:.1f} s)" if one.stalls else "–"
        more = [*[stalls] * stalled, *[one.situated_from, one.late_steps] * verbose]
        rows.append([one.robot, one.name, one.start, *scores, *more])
    head = ["robot", "run", "start", "simulated", "on the robot", *["stalled"] * stalled]
    yield table([*head, *["path from", "late steps"] * verbose], rows)
    yield from fitness.units(one.task for one in made)
    if again := sum(one.repeated for one in made):
        left = sum(one.stalls > 0 for one in made)
        yield f"{again} of {len(made)} trials were repeated since the line stalled; {left} stalled again"
    for one in made:
        if one.missed_steps:
            missed = f"{one.missed_steps} steps had no answer in time; the last readings were used instead"
            yield f"{one.robot}, start {one.start}: {missed}"
        if one.timing:
            yield f"{one.robot}, {one.name}, start {one.start}: {one.timing}; it is left out of scores"
        if one.trouble:
            yield f"{one.robot}, {one.name}, start {one.start}: {one.trouble}"


def _carry(one: TrialSpec, pose: Pose, *, seen: bool) -> None:
    """Ask a person to put the robot at its start."""
    side = SIDES[round(pose.heading_deg / 45.0) % len(SIDES)]
    click.echo(
        f"\n{one.name}, {one.individual}, start {one.start}, {one.seconds:g} s on {one.robot}\n"
        f"Put the robot at x = {pose.x:.1f} cm, y = {pose.y:.1f} cm from the arena's lower left corner, "
        f"facing {side}: {pose.heading_deg:.0f}°, counter-clockwise from +x.",
        err=True,
    )
    _answer("Press Enter when it is in place and your hand is away" if seen else "Press Enter to start it")


def _found(one: TrialSpec, requested: Pose, seen: Pose | None) -> bool:
    """Tell a person where the camera sees the robot; ask where it is not seen, or far from its start."""
    if seen is None:
        click.echo("The camera does not see the robot.", err=True)
        start = "Type w to start it as if it were exactly at the requested pose; press Enter to look again"
        return _answer(start) == "w"
    from realitygap.values import Pose

    off = math.hypot(seen.x - requested.x, seen.y - requested.y)
    turned = Pose(x=0.0, y=0.0, heading=seen.heading - requested.heading).heading_deg
    click.echo(
        f"Seen at x = {seen.x:.1f} cm, y = {seen.y:.1f} cm, {seen.heading_deg:.0f}°: {off:.1f} cm and "
        f"{abs(turned):.0f}° from the requested pose. The simulated robot starts where this one is seen.",
        err=True,
    )
    if off <= NEAR_CM and abs(turned) <= NEAR_DEG:
        return True
    return _answer("That is far off. Type w to start it anyway; press Enter to look again") == "w"


def _answer(question: str) -> str:
    said = click.prompt(question, default="", show_default=False, prompt_suffix=" ", err=True)
    return str(said).strip().lower()


def _stopped(stop: BaseException, kept: Path) -> str:
    if isinstance(stop, RobotStoppedError):
        return str(stop)
    again = f"realitygap transfer {shlex.join(sys.argv[2:])}" if sys.argv[1:2] == ["transfer"] else ""
    cure = f"continue with `{again}`" if again else "the same command continues"
    return f"stopped; finished trials are kept in {kept}; {cure}"


@click.command()
@click.argument("task")
@options.controller()
@click.option(
    "--robot",
    type=options.ROBOT,
    default="twin:1",
    help="It must place itself: twin:UNIT, stranger:UNIT, enki:khepera (epuck, thymio2), table:PROFILE or "
    "FILE.py:CLASS.",
)
@options.pose()
@options.starts(type=options.Whole(1), default=1, help="Trials, each from a start that the task draws.")
@options.profile()
@options.arena
@options.noise()
@options.twin_noise
@options.seed()
@options.seconds
@options.out(help="Keep the tracks there, for `realitygap score DIR`.")
@options.as_json
def drive(
    task: str,
    controller: str,
    robot: Address,
    pose: options.Numbers | None,
    starts: int,
    profile: str,
    arena: str | None,
    noise: float,
    twin_noise: float | None,
    seed: int,
    seconds: float | None,
    out: Path | None,
) -> None:
    """Drive a robot with a controller of your own.

    It is simulated from the same starts. You need no study: the controller is a file of yours. TASK is
    obstacle-avoidance, light-seeking or a Python file of your own. The robot must have the sensors of
    --profile.

    \b
    Example:
        realitygap drive avoidance --controller my.py:decide --robot twin:1 --starts 3 --out out/mine
        realitygap score out/mine
    """
    from realitygap.control.controllers import named_controller
    from realitygap.simulation.simulation import Simulation
    from realitygap.transfer.drive import pairs

    simulation = Simulation(task, profile, noise, arena)
    place = None if pose is None else options.checked_pose(pose, simulation.task.arena, simulation.profile)
    at, scale = simulation.task, simulation.task.fitness_scale
    driver = named_controller(controller, at.feeds, len(at.sensors), at.name)
    made = list(
        pairs(
            simulation,
            driver,
            robot,
            starts=starts,
            pose=place,
            seed=seed,
            seconds=seconds,
            twin_noise=twin_noise,
            folder=out,
        )
    )
    facts = {"task": simulation.task.name, "robot": str(robot), "trials": [one.to_dict() for one in made]}
    rows = [
        (one.start, shown(one.score_simulated / scale), shown(one.score_situated / scale), one.track.lost)
        for one in made
    ]
    lines = [table(("start", "simulated", "on the robot", "steps lost"), rows)]
    lines += [f"scores in{after(at.fitness_unit)}"] if at.fitness_unit else []
    lines += [] if out is None else [f"\ntracks {out}"]
    tell(facts, *lines)
