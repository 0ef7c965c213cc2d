"""`realitygap record`: what a robot reads at known places, for a calibration."""

from __future__ import annotations

import math
import sys
from contextlib import ExitStack, closing
from typing import TYPE_CHECKING, Any

import click

from realitygap.cli import options
from realitygap.cli.console import StoppedError, print_json
from realitygap.work.progress import ProgressLine

if TYPE_CHECKING:
    from realitygap.calibration.plan import Plan
    from realitygap.calibration.record import Progress, Result
    from realitygap.robots.address import Address

__all__ = ["record"]

DISTANCES = options.Parsed("CM,CM,…", "realitygap.calibration.plan:distances_of", "distances: ")
PLANS = ("infrared", "ambient", "wheels", "all")


class Reflectance(click.FloatRange):
    """How much light a surface throws back; "unknown" is NaN."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        return math.nan if value == "unknown" else super().convert(value, param, ctx)


@click.command()
@click.option(
    "--robot",
    type=options.ROBOT,
    required=True,
    help="twin:UNIT, stranger:UNIT or enki:MODEL:UNIT (placed by the program), serial:PORT, epuck:PORT, "
    "epuck2:HOST or thymio:PORT (placed by you), or a body of your own, file.py:Class.",
)
@click.option("--plan", type=click.Choice(PLANS), required=True, help="What to record.")
@click.option("--out", required=True, metavar="DIR", help="Folder to write; it can hold several recordings.")
@click.option(
    "--object", metavar="O",
    help="The object for infrared: wall or cylinder:RADIUS_CM [default: a wall, then a cylinder of 4 cm].",
)  # fmt: skip
@click.option(
    "--reflectance", type=Reflectance(0.01, 10.0), default=1.0, metavar="R",
    help="Reflectance of the object's surface, relative to the surfaces that the profile assumes; "
    "unknown: calibrate fits it.",
)  # fmt: skip
@click.option(
    "--repeats", type=click.IntRange(1), default=10, help="Readings at each place, which measure the noise."
)
@click.option(
    "--bearings", type=click.IntRange(1, 720),
    help="Bearings of the infrared's places, evenly all round [default: 24; of Enki's robots 180].",
)  # fmt: skip
@click.option(
    "--distances", "distances_cm", type=DISTANCES,
    help="Distances of the infrared's places, rising [default: 0.5,1,1.5,2,3,4,5.5,8; of Enki's robots "
    "10,12.5,15 too].",
)  # fmt: skip
@options.seed(says=" It does not change a twin's constants: those depend on its unit alone.")
@options.twin_noise()
@options.baud()
@options.base
@options.marker
@click.option(
    "--notes",
    default="",
    show_default=False,
    metavar="TEXT",
    help="Notes kept with the recording: which robot, where, by whom.",
)
@click.option("--resume", is_flag=True, help="Continue interrupted recordings.")
@options.as_json
def record(
    robot: Address, out: str, twin_noise: float | None, baud: int | None, resume: bool, json_output: bool,
    **words: Any,
) -> None:  # fmt: skip
    """Record a robot at known places, for a calibration.

    Infrared: a wall and a cylinder at all bearings, 0.5 to 8 cm away (Enki's robots: to 15 cm). Ambient:
    poses all over the arena of light seeking. Wheels: speed steps, standing starts, straight lines and
    turns. Each finished place is saved at once; --resume continues after an interruption.

    \b
    Examples: all that a calibration of a twin needs; a robot at a wall, and how to continue after "q";
    a robot of your own
        realitygap record --robot twin:7 --plan all --out unit-7
        realitygap record --robot serial:/dev/ttyUSB0 --plan infrared --object wall --out wall
        realitygap record --robot serial:/dev/ttyUSB0 --plan infrared --object wall --out wall --resume
        realitygap record --robot my_robot.py:MyRobot --base my_robot.toml --plan all --out mine
    """
    from realitygap.calibration.plan import Plan
    from realitygap.world.robot import load_profile

    plan, base = words.pop("plan"), words.pop("base")
    for key in ("object", "bearings", "distances_cm"):
        if words[key] is not None and plan not in ("infrared", "all"):
            named = f"--{key.removesuffix('_cm')}"
            raise click.UsageError(f"{named} belongs to the infrared's plan, not to {plan!r}; leave it out.")
    if words["reflectance"] != 1.0 and words["object"] is None:
        raise click.UsageError("--reflectance: expected --object beside it, whose surface it describes.")
    if math.isnan(words["reflectance"]) and robot.unit is not None:
        raise click.UsageError(
            f"--reflectance: expected a number: {robot} is simulated with the surface that you give."
        )
    if words["marker"] is not None and plan not in ("wheels", "all"):
        raise click.UsageError(f"--marker belongs to the wheels' plan, not to {plan!r}; leave it out.")
    if robot.unit is None and twin_noise is not None:
        raise click.UsageError(
            "--twin-noise: expected a twin, or a robot of Enki's; this one has its own noise. Leave it out."
        )
    if robot.kind == "own" and base is None:
        raise click.UsageError(
            f"--base: expected the rough profile of {robot}: its radius, heights, top command and speed."
        )
    wanted = Plan(kind=plan, base=load_profile(base) if base is not None else None, **words)
    settings = {"baud": baud, "noise": 1.0 if twin_noise is None else twin_noise}
    made, facts = _recorded(robot, settings, wanted, out, resume)
    if json_output:
        print_json(_facts(made, plan, out, facts))
        return
    for one in made:
        click.echo(f"{one.folder}: {one.kind}, {one.done} of {one.places} places, {one.seconds:.1f} s")
    if not all(one.finished for one in made):
        click.echo("not finished: the same command with --resume continues")


def _recorded(
    robot: Address, settings: dict[str, Any], wanted: Plan, out: str, resume: bool
) -> tuple[list[Result], dict[str, Any]]:
    """What was recorded, and the facts of the robot."""
    from realitygap.calibration.record import record as make
    from realitygap.errors import RobotStoppedError
    from realitygap.robots.drive import StopOnSignal

    with ExitStack() as stack:
        if robot.unit is None:
            stack.enter_context(StopOnSignal())
        body = stack.enter_context(closing(robot.open(**settings)))
        facts = {name: fact for name, fact in body.description().items() if name != "units"}
        report: Progress = stack.enter_context(ProgressLine()).places if body.places_itself else _written
        if robot.unit is not None:
            report = _stoppable(stack, report)
        try:
            return make(wanted, out, body, ask=_ask, resume=resume, on_progress=report), facts
        except (RobotStoppedError, KeyboardInterrupt) as stopped:
            said = f": {stopped}" if str(stopped) else ""
            raise StoppedError(f"stopped{said}; finished places are kept, --resume continues") from None


def _stoppable(stack: ExitStack, report: Progress) -> Progress:
    """Let Ctrl-C and SIGTERM wait for the end of a twin's place (a moment); the second does not wait."""
    import signal

    asked: list[int] = []

    def arrived(number: int, frame: object) -> None:
        if asked:
            raise KeyboardInterrupt
        asked.append(number)

    for number in (signal.SIGINT, signal.SIGTERM):
        stack.callback(signal.signal, number, signal.signal(number, arrived))

    def places(name: str, done: int, total: int) -> None:
        report(name, done, total)
        if asked:
            raise KeyboardInterrupt

    return places


def _ask(says: str) -> str:
    """Say something on stderr and take the answer; the end of the input stops, as "q" does."""
    click.echo(f"{says} ", nl=False, err=True)
    answer = sys.stdin.readline()
    return answer if answer else "q"


def _written(name: str, done: int, total: int) -> None:
    click.echo(f"{name}: {done} of {total} written", err=True)


def _facts(made: list[Result], plan: str, out: str, facts: dict[str, Any]) -> dict[str, Any]:
    recordings = [
        {
            "folder": str(one.folder), "kind": one.kind, "places": one.places, "done": one.done,
            "finished": one.finished, "seconds": round(one.seconds, 3),
        }
        for one in made
    ]  # fmt: skip
    return {
        "out": out, "plan": plan, **facts,
        "finished": all(one.finished for one in made),
        "seconds": round(sum(one.seconds for one in made), 3),
        "recordings": recordings,
    }  # fmt: skip
