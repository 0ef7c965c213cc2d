"""`realitygap record`: what a robot reads at known places, for a calibration."""

from __future__ import annotations

import sys
from contextlib import ExitStack
from typing import TYPE_CHECKING, Any, NamedTuple

import click

from realitygap.cli.failure import StoppedError
from realitygap.cli.kinds import SEED, Whole
from realitygap.cli.options import as_json, baud_option, seed_option, twin_noise_option
from realitygap.cli.output import print_json
from realitygap.cli.progress import ProgressLine

if TYPE_CHECKING:
    from realitygap.calibration.recorder.record import Made, OpenSite, Progress

__all__ = ["Robot", "RobotKind", "record"]

PLANS = ("infrared", "ambient", "wheels", "all")


class Robot(NamedTuple):
    """A robot as it is named: a twin's unit, or a real one's port."""

    unit: int | None
    port: str | None


class RobotKind(click.ParamType):
    """`twin`, `twin:UNIT` or `serial:PORT`."""

    name = "twin[:N]|serial:PORT"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Robot:
        word, _, rest = str(value).partition(":")
        if word == "serial" and rest:
            return Robot(None, rest)
        if word == "twin":
            return Robot(Whole(0, SEED.high).convert(rest if ":" in str(value) else "1", param, ctx), None)
        return self.fail(f"expected twin, twin:UNIT or serial:PORT, got {value!r}.", param, ctx)


@click.command()
@click.option(
    "--robot",
    type=RobotKind(),
    required=True,
    metavar="R",
    help="twin or twin:UNIT (a stand-in, placed by the program), or serial:PORT (placed by you).",
)
@click.option("--plan", type=click.Choice(PLANS), required=True, help="What to record.")
@click.option("--out", required=True, metavar="DIR", help="Folder to write; several recordings go into it.")
@click.option(
    "--object", "object_name", metavar="O",
    help="wall or cylinder:RADIUS_CM: the infrared's one object [default: a wall, then a cylinder of 4 cm].",
)  # fmt: skip
@click.option(
    "--repeats", type=Whole(1, 1000), default=10, show_default=True, metavar="N",
    help="Readings at each place: they measure the noise.",
)  # fmt: skip
@seed_option(says=" A twin's constants follow from its unit alone.")
@twin_noise_option()
@baud_option()
@click.option("--notes", default="", metavar="TEXT", help="Kept with it: which robot, where, by whom.")
@click.option("--resume", is_flag=True, help="Go on with recordings that were broken off.")
@as_json
def record(
    robot: Robot,
    plan: str,
    out: str,
    object_name: str | None,
    repeats: int,
    seed: int,
    twin_noise: float | None,
    baud: str,
    notes: str,
    resume: bool,
    json_output: bool,
) -> None:
    """Record a robot at known places: what a calibration is made from.

    Infrared: a wall and a cylinder at all bearings, 0.5 to 8 cm away. Ambient: poses all over the
    arena of light seeking. Wheels: speed steps, standing starts, straight lines and turns. Each
    finished place is written at once; --resume goes on after whatever broke it off.

    \b
    Examples: all that a calibration of a twin needs; a robot before a wall, and how to go on after "q"
        realitygap record --robot twin:7 --plan all --out unit-7
        realitygap record --robot serial:/dev/ttyUSB0 --plan infrared --object wall --out wall
        realitygap record --robot serial:/dev/ttyUSB0 --plan infrared --object wall --out wall --resume
    """
    from realitygap.calibration.recorder.record import record as make
    from realitygap.errors import RobotStoppedError

    if object_name is not None and plan not in ("infrared", "all"):
        raise click.UsageError(f"--object belongs to the infrared's plan, not to {plan!r}; leave it out.")
    if robot.port is not None and twin_noise is not None:
        raise click.UsageError(
            "--twin-noise scales the noise of a twin; a robot has its own noise. Leave it out."
        )
    with ExitStack() as stack:
        open_site, facts, report = _site(stack, robot, twin_noise, seed, baud)
        try:
            made = make(
                plan, out, open_site=open_site, facts={**facts, "notes": notes}, object=object_name,
                repeats=repeats, seed=seed, resume=resume, on_progress=report,
            )  # fmt: skip
        except (RobotStoppedError, KeyboardInterrupt) as stopped:
            said = f": {stopped}" if str(stopped) else ""
            raise StoppedError(f"stopped{said}; finished places are kept, --resume goes on") from None
    if json_output:
        print_json(_facts(made, plan, out, facts))
        return
    for one in made:
        click.echo(f"{one.folder}: {one.kind}, {one.done} of {one.places} places, {one.seconds:.1f} s")
    if not all(one.finished for one in made):
        click.echo("not finished: the same command with --resume goes on")


def _site(
    stack: ExitStack, robot: Robot, twin_noise: float | None, seed: int, baud: str
) -> tuple[OpenSite, dict[str, Any], Progress]:
    """How a robot's sites are opened, facts about it, and who shows the progress."""
    from contextlib import nullcontext

    from realitygap.calibration.recorder.record import twin_sites
    from realitygap.robots.signals import Stopping

    if robot.port is None:
        noise = 1.0 if twin_noise is None else twin_noise
        line = stack.enter_context(ProgressLine())
        assert robot.unit is not None
        facts = {"robot": "twin (pseudo-reality)", "unit": robot.unit, "twin_noise": noise}
        return twin_sites(unit=robot.unit, noise=noise, seed=seed), facts, _stoppable(stack, line.places)
    from realitygap.calibration.recorder.site import PersonSite
    from realitygap.robots.khepera.driver import Khepera

    stack.enter_context(Stopping())
    khepera = stack.enter_context(Khepera.connect(robot.port, baud=None if baud == "any" else int(baud)))
    facts = {"robot": "Khepera", "port": robot.port, **khepera.versions._asdict()}
    site = PersonSite(khepera, _ask)
    return (lambda name, room: nullcontext(site)), facts, _written


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


def _facts(made: list[Made], plan: str, out: str, facts: dict[str, Any]) -> dict[str, Any]:
    recordings = [
        {
            "folder": str(one.folder),
            "kind": one.kind,
            "places": one.places,
            "done": one.done,
            "finished": one.finished,
            "seconds": round(one.seconds, 3),
        }
        for one in made
    ]
    return {
        "out": out,
        "plan": plan,
        **facts,
        "finished": all(one.finished for one in made),
        "seconds": round(sum(one.seconds for one in made), 3),
        "recordings": recordings,
    }
