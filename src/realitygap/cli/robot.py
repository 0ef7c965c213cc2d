"""`realitygap robot check`, `robot serve` and `record`: a robot by its address, and the twin as one."""

from __future__ import annotations

import math
import sys
from contextlib import ExitStack, closing
from typing import TYPE_CHECKING, Any, TypedDict, Unpack

import click
from click.core import ParameterSource

from realitygap.cli import options
from realitygap.cli.console import StoppedError, as_json, table, tell
from realitygap.work.progress import ProgressLine

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from realitygap.calibration.plan import Plan
    from realitygap.calibration.record import Progress, Result
    from realitygap.robots.address import Address
    from realitygap.robots.body import Body, Channel
    from realitygap.robots.drive import Recording
    from realitygap.values import Pose, Readings
    from realitygap.world.arena import Arena

__all__ = ["record", "robot"]

BAR_CHARACTERS = 40
MOVE_CM_S, MOVE_S = 4.0, 0.5
"""A small movement: 4 cm/s for half a second and back, 2 cm."""

ROOM_CM = 60.0
"""Side of the empty room in which a robot that places itself is checked."""
BAUD = 38400
"""Rate of the twin's line."""

SAID = {"leds": "all LEDs, on and off", "faults": "answers that had to be requested again"}
"""What a robot finds out by itself, in words."""


@click.group()
def robot() -> None:
    """Check a robot, or serve a twin as one.

    \b
    Examples:
        realitygap robot check --robot khepera:/dev/ttyUSB0
        realitygap robot serve --arena avoidance
    """


@robot.command()
@click.option(
    "--robot",
    "where",
    type=options.ROBOT,
    required=True,
    help="khepera:PORT, epuck:PORT, epuck2:HOST, thymio:PORT, twin:UNIT, stranger:UNIT, enki:MODEL:UNIT, "
    "table:PROFILE (recorded readings, replayed), or a body of your own, file.py:Class.",
)
@options.baud
@options.profile(says=" Gives the speed of its commands, for the movement; omitted: the robot's own base.")
@click.option(
    "--seconds", type=click.FloatRange(0.1), default=3.0, help="Seconds for which to show the sensors."
)
@click.option("--yes", is_flag=True, help="Let it move 2 cm and back without asking.")
@options.as_json
def check(where: Address, baud: int | None, profile: str, seconds: float, yes: bool) -> None:
    """Check that a robot works.

    Shows its sensors, counters, the timing of its loop, and whatever else it has. It moves only with your
    consent.

    \b
    Examples: a robot with factory settings; one of your own
        realitygap robot check --robot serial:/dev/ttyUSB0 --baud 9600
        realitygap robot check --robot my_robot.py:MyRobot --profile my_robot.toml
    """
    from realitygap.robots.drive import StopOnSignal
    from realitygap.transfer.spec import check_fit
    from realitygap.values import Pose
    from realitygap.world.robot import load_profile

    named = click.get_current_context().get_parameter_source("profile") is not ParameterSource.DEFAULT
    load_profile(profile)  # refused before the robot is asked anything
    with StopOnSignal(), closing(where.open(baud=baud)) as body:
        known = load_profile(profile if named else body.description().get("base", profile))
        if named:  # another robot's commands could be ten times as fast
            seen = [one.name for one in body.channels if known.channel(one.name).sensors]
            check_fit(body, known, seen)
        units = round(MOVE_CM_S / known.wheels.speed_per_unit_cm_s[0])
        if body.places_itself:
            body.enter({"size_cm": [ROOM_CM] * 2}, 0, Pose(x=ROOM_CM / 2, y=ROOM_CM / 2, heading=0.0))
        facts = _about(where, body)
        if not as_json():
            about = [f"{name} {fact}" for name, fact in facts.items() if name not in ("robot", "port")]
            click.echo(": ".join([str(where), ", ".join(about)]) if about else str(where))
        facts |= _sensors(body, seconds, live=not as_json() and sys.stdout.isatty())
        facts |= {"counters": _counters(body)}
        if not as_json():
            _tell(facts, body.channels)
        facts["movement"] = _movement(body, units) if _agreed(yes) else None
        found = body.inspect()
    lines = [f"{SAID.get(name, name)}: {fact}" for name, fact in found.items()]
    if facts["movement"]:
        counted = "counters {left} and {right} pulses, then back".format(**facts["movement"])
        lines.insert(0, f"moved: {counted}" if facts["counters"] else "moved ahead and back")
    tell({**facts, **found}, *lines)


def _about(where: Address, body: Body) -> dict[str, Any]:
    known = {
        name: fact
        for name, fact in body.description().items()
        if name not in ("units", "robot", "base", "pulses_per_mm")
    }
    baud = getattr(body, "baud", None)
    return {"robot": str(where), **known, **({} if baud is None else {"baud": baud})}


def _sensors(body: Body, seconds: float, *, live: bool) -> dict[str, Any]:
    """Run a standing robot through the control loop, and show what it reads."""
    from realitygap.errors import BaudError

    note, kinds = None, [one.name for one in body.channels]
    try:
        body.attend(*kinds)
    except BaudError as error:
        note = str(error)
        body.attend(kinds[0])
    steps = max(1, round(seconds / body.period_s))
    recording = _drive(body, 0, steps * body.period_s, live)
    late, wire_ms = recording.late * 1000, getattr(body, "wire_ms", None)
    read = {kind: getattr(recording, kind)[-1] for kind in kinds if getattr(recording, kind).size}
    for kind in kinds:
        if kind not in read:  # a step has no room for it
            body.attend(kind, turns=False)
            read[kind] = getattr(body.sense(), kind)
    return {
        **{kind: read[kind] for kind in kinds},
        "loop": {
            "steps": len(late),
            "late_steps": recording.late_steps,
            "missed_steps": recording.missed_steps,
            "mean_lateness_ms": round(float(late.mean()), 3),
            "worst_lateness_ms": round(float(late.max()), 3),
            "wire_ms": None if wire_ms is None else round(wire_ms, 1),
            "note": note,
        },
        "period_s": body.period_s,
    }


def _drive(body: Body, units: int, seconds: float, live: bool = False) -> Recording:
    """Straight on; 0: stand."""
    from realitygap.robots.drive import ConstantController, drive
    from realitygap.values import Command

    steady = ConstantController(Command(left=units, right=units))

    def run(show: Callable[[Readings], object]) -> Recording:
        def look(readings: Readings) -> list[int]:
            show(readings)
            return []

        return drive(body, steady, seconds=seconds, inputs=look)

    if not live:
        return run(lambda readings: None)
    from rich.live import Live

    with Live(auto_refresh=False, transient=True) as screen:
        return run(lambda readings: screen.update(_bars(readings, body.channels), refresh=True))


def _bars(readings: Readings, channels: Sequence[Channel]) -> Any:
    """Readings as bars: long is many counts (for ambient light: dark)."""
    from rich.progress_bar import ProgressBar
    from rich.table import Table

    table = Table(box=None)
    for column in ("sensor", *(word for one in channels for word in (one.name, ""))):
        table.add_column(column)
    for i in range(max(one.sensors for one in channels)):
        cells: list[Any] = [str(i)]
        for one in channels:
            counts = getattr(readings, one.name)
            value = float(counts[i]) if i < len(counts) else None
            cells.append(ProgressBar(total=one.high, completed=value or 0.0, width=BAR_CHARACTERS))
            cells.append("–" if value is None else f"{value:4.0f}")
        table.add_row(*cells)
    return table


def _counters(body: Body) -> tuple[int, int] | None:
    body.attend()
    body.sense()
    return body.odometry.counters


def _tell(facts: dict[str, Any], channels: Sequence[Channel]) -> None:
    most = max(one.sensors for one in channels)
    rows = [[one.name, *map(int, facts[one.name]), *[""] * (most - one.sensors)] for one in channels]
    click.echo(table(["counts", *(f"s{i}" for i in range(most))], rows))
    if facts["counters"] is not None:
        click.echo("counters: {} and {} pulses".format(*facts["counters"]))
    loop = facts["loop"]
    missed = f", {loop['missed_steps']} without an answer in time" if loop["missed_steps"] else ""
    on_wire = "" if loop["wire_ms"] is None else f"; up to {loop['wire_ms']} ms of a step on the wire"
    click.echo(
        f"loop of {1000 * facts['period_s']:g} ms: {loop['steps']} steps, {loop['late_steps']} late (over "
        f"10 ms){missed}; lateness {loop['mean_lateness_ms']} ms on average, "
        f"{loop['worst_lateness_ms']} ms at worst{on_wire}"
    )
    if loop["note"]:
        click.echo(f"note: {loop['note']}")


def _agreed(yes: bool) -> bool:
    """Whether the person lets the robot move; without anyone to ask it stands."""
    if yes or as_json() or not sys.stdin.isatty():
        return yes
    return click.confirm("Let it move 2 cm forward and back? Its wheels must be free", default=False)


def _movement(body: Body, units: int) -> dict[str, int | None]:
    """Ahead, look at the counters, back, stand."""
    body.attend(body.channels[0].name)
    body.reset()
    steps = max(1, round(MOVE_S / body.period_s))
    _drive(body, units, steps * body.period_s)
    left, right = _counters(body) or (None, None)
    body.attend(body.channels[0].name)
    _drive(body, -units, steps * body.period_s)
    return {"left": left, "right": right}


@robot.command()
@click.option(
    "--arena", "arena_name", required=True, metavar="TASK", help="A task, or an arena's name or TOML file."
)
@click.option("--unit", type=options.Whole(0), default=1, metavar="N", help="Which robot.")
@options.twin_noise
@options.pose()
@options.as_json
def serve(arena_name: str, unit: int, twin_noise: float | None, pose: options.Numbers | None) -> None:
    """Serve a twin of the Khepera until Ctrl-C.

    The twin, a physics model, answers on a pseudo-terminal in the robot's own serial protocol.

    \b
    Example: a robot that any Khepera program can talk to
        realitygap robot serve --arena avoidance
    """
    import signal

    from realitygap.twin.body import TwinBody
    from realitygap.twin.firmware import Firmware
    from realitygap.twin.serve import Server
    from realitygap.world.robot import load_profile

    arena, start = _arena(arena_name)
    if pose is not None:
        start = options.checked_pose(pose, arena, load_profile("paper"))
    noise = 1.0 if twin_noise is None else twin_noise
    body = TwinBody(arena.plain(), unit=unit, noise=noise)
    if start is not None:
        body.place(start.x, start.y, start.heading)
    for number in (signal.SIGTERM, signal.SIGHUP):  # its folder is removed however it is ended
        signal.signal(number, signal.default_int_handler)
    with Server(Firmware(body, baud=BAUD, name=f"twin unit {unit}")) as server:
        facts = {
            "device": server.device,
            "channel": server.channel,
            "unit": unit,
            "noise": noise,
            "baud": BAUD,
            "arena": arena.plain(),
            "pose": None if start is None else (start.x, start.y, start.heading),
        }
        lines = (f"device: {server.device}", f"second channel: {server.channel}")
        tell(facts, *lines, f"{BAUD} baud, unit {unit}; Ctrl-C ends it")
        try:
            server.serve()
        except KeyboardInterrupt:
            click.echo("stopped", err=True)


def _arena(name: str) -> tuple[Arena, Pose | None]:
    """A task's arena and the middle of its start, or an arena alone."""
    from realitygap.errors import TaskError
    from realitygap.tasks import load_task
    from realitygap.values import Pose
    from realitygap.world.arena import load_arena

    if name.endswith(".toml"):
        return load_arena(name), None
    try:
        task = load_task(name)
    except TaskError:
        if name.endswith(".py"):
            raise
        return load_arena(name), None
    return task.arena, Pose.from_degrees(task.start.x_cm, task.start.y_cm, sum(task.start.heading_deg) / 2)


class PlanSettings(TypedDict):
    """Options that `Plan` takes by the same names."""

    kind: str
    object: str | None
    reflectance: float
    repeats: int
    bearings: int | None
    distances_cm: tuple[float, ...] | None
    seed: int
    marker: str | None


class Reflectance(click.FloatRange):
    """How much light a surface throws back; "unknown" is NaN."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        return math.nan if value == "unknown" else super().convert(value, param, ctx)


@click.command()
@click.option(
    "--robot",
    type=options.ROBOT,
    required=True,
    help="twin:UNIT, stranger:UNIT, enki:MODEL:UNIT or table:PROFILE (placed by the program), serial:PORT, "
    "epuck:PORT, epuck2:HOST or thymio:PORT (placed by you), or a body of your own, file.py:Class.",
)
@click.option(
    "--plan",
    "kind",
    type=click.Choice(["infrared", "ambient", "wheels", "all"]),
    required=True,
    help="What to record.",
)
@click.option("--out", required=True, metavar="DIR", help="Folder to write; it can hold several recordings.")
@click.option(
    "--object",
    metavar="O",
    help="The object for infrared: wall or cylinder:RADIUS_CM [default: a wall, then a cylinder of 4 cm].",
)
@click.option(
    "--reflectance",
    type=Reflectance(0.01, 10.0),
    default=1.0,
    metavar="R",
    help="Reflectance of the object's surface, relative to the surfaces that the profile assumes; "
    "unknown: calibrate fits it.",
)
@click.option(
    "--repeats", type=options.Whole(1), default=10, help="Readings at each place, which measure the noise."
)
@click.option(
    "--bearings",
    type=options.Whole(1, 720),
    help="Bearings of the infrared's places, evenly all round [default: 24; of Enki's robots 180].",
)
@click.option(
    "--distances",
    "distances_cm",
    type=options.Parsed("CM,CM,…", "realitygap.calibration.plan:distances_of", "distances: "),
    help="Distances of the infrared's places, rising [default: 0.5,1,1.5,2,3,4,5.5,8; of Enki's robots "
    "10,12.5,15 too].",
)
@options.seed(says=" It does not change a twin's constants: those depend on its unit alone.")
@options.twin_noise
@options.baud
@options.base
@options.marker
@click.option("--resume", is_flag=True, help="Continue interrupted recordings.")
@options.as_json
def record(
    robot: Address,
    out: str,
    twin_noise: float | None,
    baud: int | None,
    base: str | None,
    resume: bool,
    **places: Unpack[PlanSettings],
) -> None:
    """Record a robot at known places, for a calibration.

    Infrared: a wall and a cylinder at all bearings, 0.5 to 8 cm away (Enki's robots: to 15 cm). Ambient:
    poses all over the arena of light seeking. Wheels: speed steps, standing starts, straight lines and
    turns. Each finished place is saved at once; --resume continues after an interruption.

    Examples: all that a calibration of a twin needs; a robot at a wall, and how to continue after "q";
    a robot of your own

    \b
        realitygap record --robot twin:7 --plan all --out unit-7
        realitygap record --robot serial:/dev/ttyUSB0 --plan infrared --object wall --out wall
        realitygap record --robot serial:/dev/ttyUSB0 --plan infrared --object wall --out wall --resume
        realitygap record --robot my_robot.py:MyRobot --base my_robot.toml --plan all --out mine
    """
    from realitygap.calibration.plan import Plan
    from realitygap.world.robot import load_profile

    if robot.kind == "own" and base is None:
        raise click.UsageError(
            f"--base: expected the rough profile of {robot}: its radius, heights, top command and speed."
        )
    wanted = Plan(base=load_profile(base) if base is not None else None, **places)
    made, facts = _recorded(robot, baud, 1.0 if twin_noise is None else twin_noise, wanted, out, resume)
    finished, fields = all(one.finished for one in made), ("kind", "places", "done", "finished", "seconds")
    recordings = [{"folder": str(one.folder), **{key: getattr(one, key) for key in fields}} for one in made]
    seconds = sum(one.seconds for one in made)
    found = {"out": out, "plan": wanted.kind, **facts, "finished": finished, "seconds": seconds}
    lines = [
        f"{one.folder}: {one.kind}, {one.done} of {one.places} places, {one.seconds:.1f} s" for one in made
    ]
    lines += [] if finished else ["not finished: the same command with --resume continues"]
    tell({**found, "recordings": recordings}, *lines)


def _recorded(
    robot: Address, baud: int | None, noise: float, wanted: Plan, out: str, resume: bool
) -> tuple[list[Result], dict[str, Any]]:
    """What was recorded, and the facts of the robot."""
    from realitygap.calibration.record import record as make
    from realitygap.errors import RobotStoppedError
    from realitygap.robots.drive import StopOnSignal

    with ExitStack() as stack:
        if robot.unit is None:
            stack.enter_context(StopOnSignal())
        body = stack.enter_context(closing(robot.open(baud=baud, noise=noise)))
        facts = {name: fact for name, fact in body.description().items() if name != "units"}
        report: Progress = stack.enter_context(ProgressLine()).places if body.places_itself else _written
        try:
            return make(wanted, out, body, ask=_ask, resume=resume, on_progress=report), facts
        except (RobotStoppedError, KeyboardInterrupt) as stopped:
            why = f": {stopped}" if str(stopped) else ""
            raise StoppedError(f"stopped{why}; finished places are kept, --resume continues") from None


def _ask(says: str) -> str:
    """Say something on stderr and take the answer; the end of the input stops, as "q" does."""
    click.echo(f"{says} ", nl=False, err=True)
    return sys.stdin.readline() or "q"


def _written(name: str, done: int, total: int) -> None:
    click.echo(f"{name}: {done} of {total} written", err=True)
