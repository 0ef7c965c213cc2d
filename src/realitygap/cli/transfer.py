"""`realitygap transfer`: let evolved individuals drive a robot, as they drove in simulation."""

from __future__ import annotations

import math
import shlex
import sys
from functools import partial
from typing import TYPE_CHECKING, Any

import click

from realitygap.cli import option
from realitygap.cli.failure import StoppedError
from realitygap.cli.kinds import Whole
from realitygap.cli.notes import ask_trust
from realitygap.cli.output import shown, table, tell
from realitygap.cli.studies import show_shard
from realitygap.errors import RobotStoppedError, StudyInterruptedError
from realitygap.work.progress import ProgressLine

if TYPE_CHECKING:
    from collections.abc import Iterator

    from realitygap.transfer.run import TransferredTrial
    from realitygap.transfer.spec import TrialSpec
    from realitygap.values import Pose
    from realitygap.work.pool import Workers
    from realitygap.work.shard import Shard

__all__ = ["told_transfers", "transfer"]

NEAR_CM, NEAR_DEG = 3.0, 20.0
"""If a robot is seen farther than this from its start, the person is asked."""


SIDES = (
    "to the right (+x)", "to the upper right", "up (+y)", "to the upper left",
    "to the left (−x)", "to the lower left", "down (−y)", "to the lower right",
)  # fmt: skip
"""Headings in words, from 0° on in steps of 45°, as the arena is drawn."""


@click.command()
@click.argument("study", type=click.Path())
@click.argument("runs", metavar="[RUN]...", nargs=-1)
@click.option(
    "--robot",
    "robots",
    multiple=True,
    required=True,
    help="twin:UNIT, stranger:UNIT, enki:MODEL:UNIT, khepera:PORT, serial:PORT, epuck:PORT, epuck2:HOST, "
    "thymio:PORT, or a body of your own, file.py:Class; may be repeated.",
)
@click.option(
    "--starts", type=Whole(1, 10**6), default=1, help="Trials of each run, each from its own start."
)
@click.option(
    "--individual",
    type=click.Choice(["champion", "fittest"]),
    default="champion",
    help="champion (retested), or fittest (as in the paper).",
)
@option.controller(required=False)
@click.option("--film/--no-film", default=False, help="Keep a film and track it.")
@click.option(
    "--view",
    type=click.Choice(["drawn", "mujoco"]),
    default="drawn",
    help="How a twin's film is made: drawn, or by MuJoCo's renderer, which takes longer and needs an EGL or "
    "OSMesa library. An existing film is kept.",
)
@click.option(
    "--watch/--no-watch",
    default=True,
    help="Take paths from the overhead camera; otherwise from the wheels, which miss slip.",
)
@click.option("--camera", metavar="FILE", help="Calibration of the live camera (camera.json).")
@click.option(
    "--eye", metavar="DEVICE", help="The live camera over a real robot: its number, a video file or a stream."
)
@option.marker
@click.option(
    "--disk",
    metavar="FILE",
    help="TOML file of the disk that a real robot wears [default: the shipped disk].",
)
@option.twin_noise()
@option.seed(None, " [default: the study's]")
@option.seconds
@option.baud()
@option.workers
@option.shard
@option.trust
@option.as_json
def transfer(
    study: str, workers: Workers, shard: Shard | None, trust: bool, json_output: bool, **words: Any
) -> None:
    """Drive a robot with evolved individuals of STUDY.

    Each RUN (a number or a name; omitted: all finished runs) drives each robot from --starts poses and
    is simulated from the same poses. Recordings, paths, films and tails go to STUDY/transfer; finished
    trials are kept. The twin is pseudo-reality: a
    physics model behind the robot's own serial protocol.

    With --controller a controller of your own drives in their place, at the task, the noise and the starts
    of each RUN (omitted: one of each task and noise); its trials go to STUDY/controllers, for
    `realitygap score`.

    \b
    Examples: on two units of the twin, filmed; on a robot that you carry to its starts, under a camera; a
    controller of your own
        realitygap transfer out/reproduce 9 24 --robot twin:1 --robot twin:2 --film
        realitygap transfer out/reproduce 9 --robot serial:/dev/ttyUSB0 --camera camera.json --eye 0
        realitygap transfer out/reproduce 9 --robot twin:1 --controller my.py:decide --starts 8
    """
    from realitygap.study.load import load_study
    from realitygap.transfer.options import Transfer
    from realitygap.transfer.run import Operator, place_of, run_transfer, shard_folder
    from realitygap.transfer.spec import FOLDER

    ask_trust(study, trust)
    loaded = load_study(study)
    options = Transfer(**words)
    option.check_baud(*options.bodies)
    carry = partial(_carry, seen=options.eye is not None)
    home = place_of(loaded.folder, options) if shard is None else shard_folder(loaded.folder, shard)
    operator = Operator(carry, _found, partial(click.echo, err=True))
    try:
        with ProgressLine(after_s=0) as line:  # a person may be asked things first
            made = run_transfer(
                loaded, options, workers=workers, operator=operator, shard=shard, on_progress=line.show
            )
    except (KeyboardInterrupt, StudyInterruptedError, click.Abort) as stop:
        raise StoppedError(_stopped(stop, str(home / FOLDER))) from None
    facts, lines = {"transfers": [one.to_dict() for one in made]}, told_transfers(made)
    if shard is not None:
        show_shard(home, facts, *lines, json_output=json_output)
        return
    where = (f"\ntransfers {one.folder.parents[2]}" for one in made[:1])
    tell(json_output, {"study": study, **facts}, *lines, *where)


def told_transfers(made: list[TransferredTrial]) -> Iterator[str]:
    """A table with a line per trial, then what went wrong."""
    rows = [
        [
            one.robot, one.name, one.start, shown(one.fitness_simulated), shown(one.fitness_situated),
            one.situated_from, one.late_steps,
        ]
        for one in made
    ]  # fmt: skip
    yield table(("robot", "run", "start", "simulated", "situated", "path from", "late steps"), rows)
    for one in made:
        if one.missed_steps:
            told = f"{one.missed_steps} steps had no answer in time; the last readings were used instead"
            yield f"{one.robot}, start {one.start}: {told}"
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
    enter = "Press Enter when it is in place and your hand is away" if seen else "Press Enter to start it"
    click.prompt(enter, default="", show_default=False, prompt_suffix=" ", err=True)


def _found(one: TrialSpec, requested: Pose, seen: Pose | None) -> bool:
    """Tell a person where the camera sees the robot; ask where it is not seen, or far from its start."""
    if seen is None:
        click.echo("The camera does not see the robot.", err=True)
        return _answered(
            "Type w to start it as if it were exactly at the requested pose; press Enter to look again"
        )
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
    return _answered("That is far off. Type w to start it anyway; press Enter to look again")


def _answered(question: str) -> bool:
    said = click.prompt(question, default="", show_default=False, prompt_suffix=" ", err=True)
    return bool(said.strip().lower() == "w")


def _stopped(stop: BaseException, kept: str) -> str:
    if isinstance(stop, RobotStoppedError):
        return str(stop)
    again = f"realitygap transfer {shlex.join(sys.argv[2:])}" if sys.argv[1:2] == ["transfer"] else ""
    cure = f"continue with `{again}`" if again else "the same command continues"
    return f"stopped; finished trials are kept in {kept}; {cure}"
