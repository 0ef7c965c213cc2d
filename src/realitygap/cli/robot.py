"""`realitygap robot`: a robot by its address, checked."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any

import click
from click.core import ParameterSource

from realitygap.cli import option
from realitygap.cli.kinds import ROBOT, Finite
from realitygap.cli.output import print_json, table

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from realitygap.robots.address import Address
    from realitygap.robots.body import Body, Channel
    from realitygap.robots.recording import Recording
    from realitygap.values import Readings

__all__ = ["robot"]

BAR_CHARACTERS = 40
MOVE_CM_S, MOVE_S = 4.0, 0.5
"""A small movement: 4 cm/s for half a second and back, 2 cm."""

ROOM_CM = 60.0
"""Side of the empty room in which a robot that places itself is checked."""

SAID = {"leds": "all LEDs, on and off", "faults": "answers that had to be requested again"}
"""What a robot finds out by itself, in words."""


@click.group()
def robot() -> None:
    """Talk to a robot.

    \b
    Example:
        realitygap robot check --robot khepera:/dev/ttyUSB0
    """


@robot.command()
@click.option(
    "--robot",
    "where",
    type=ROBOT,
    required=True,
    help="khepera:PORT, epuck:PORT, epuck2:HOST, thymio:PORT, twin:UNIT, stranger:UNIT, enki:MODEL:UNIT, "
    "or a body of your own, file.py:Class.",
)
@option.baud()
@option.profile(says=" Gives the speed of its commands, for the movement; omitted: the robot's own base.")
@click.option("--seconds", type=Finite(0.1, 3600), default=3.0, help="Seconds for which to show the sensors.")
@click.option("--yes", is_flag=True, help="Let it move 2 cm and back without asking.")
@option.as_json
def check(
    where: Address,
    baud: int | None,
    profile: str,
    seconds: float,
    yes: bool,
    json_output: bool,
) -> None:
    """Check that a robot works: sensors, counters, the timing of its loop, and whatever else it has.

    It moves only with your consent.

    \b
    Examples: a robot with factory settings; one of your own
        realitygap robot check --robot serial:/dev/ttyUSB0 --baud 9600
        realitygap robot check --robot my_robot.py:MyRobot --profile my_robot.toml
    """
    from contextlib import closing

    from realitygap.robots.body import Inspected, Placing, facts_of
    from realitygap.robots.signals import Stopping
    from realitygap.transfer.spec import check_fit
    from realitygap.values import Pose
    from realitygap.world.robot import load_profile

    option.check_baud(where)
    named = click.get_current_context().get_parameter_source("profile") is not ParameterSource.DEFAULT
    load_profile(profile)  # refused before the robot is asked anything
    with Stopping(), closing(where.open(baud=baud)) as body:
        known = load_profile(profile if named else facts_of(body).get("base", profile))
        if named:  # another robot's commands could be ten times as fast
            seen = [one.name for one in body.channels if known.channel(one.name).sensors]
            check_fit(body, known, seen)
        units = round(MOVE_CM_S / known.wheels.speed_per_unit_cm_s[0])
        if isinstance(body, Placing):
            body.enter({"size_cm": [ROOM_CM] * 2}, 0, Pose(x=ROOM_CM / 2, y=ROOM_CM / 2, heading=0.0))
        facts = _about(where, body)
        if not json_output:
            about = [f"{name} {fact}" for name, fact in facts.items() if name not in ("robot", "port")]
            click.echo(": ".join([str(where), ", ".join(about)]) if about else str(where))
        facts |= _sensors(body, seconds, live=not json_output and sys.stdout.isatty())
        facts |= {"counters": _counters(body)}
        if not json_output:
            _tell(facts, body.channels)
        facts["movement"] = _movement(body, units) if _agreed(yes, json_output) else None
        found = body.inspect() if isinstance(body, Inspected) else {}
    if json_output:
        print_json({**facts, **found})
        return
    if facts["movement"]:
        counted = "counters {left} and {right} pulses, then back".format(**facts["movement"])
        click.echo(f"moved: {counted}" if facts["counters"] else "moved ahead and back")
    for name, fact in found.items():
        click.echo(f"{SAID.get(name, name)}: {fact}")


def _about(where: Address, body: Body) -> dict[str, Any]:
    from realitygap.robots.body import facts_of

    known = {
        name: fact
        for name, fact in facts_of(body).items()
        if name not in ("units", "robot", "base", "pulses_per_mm")
    }
    baud = getattr(body, "baud", None)
    return {"robot": str(where), **known, **({} if baud is None else {"baud": baud})}


def _sensors(body: Body, seconds: float, *, live: bool) -> dict[str, Any]:
    """Run a standing robot through the control loop, and show what it reads."""
    from realitygap.errors import BaudError
    from realitygap.robots.body import attend

    note, kinds = None, [one.name for one in body.channels]
    try:
        attend(body, *kinds)
    except BaudError as error:
        note = str(error)
        attend(body, kinds[0])
    steps = max(1, round(seconds / body.period_s))
    recording = _drive(body, 0, steps * body.period_s, live)
    late, wire_ms = recording.late * 1000, getattr(body, "wire_ms", None)
    read = {kind: getattr(recording, kind)[-1] for kind in kinds if getattr(recording, kind).size}
    for kind in kinds:
        if kind not in read:  # a step has no room for it
            attend(body, kind, turns=False)
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
    from realitygap.robots.loop import Steady, drive
    from realitygap.values import Command

    steady = Steady(Command(left=units, right=units))

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
    from realitygap.robots.body import attend, odometry_of

    attend(body)
    body.sense()
    return odometry_of(body).counters


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


def _agreed(yes: bool, json_output: bool) -> bool:
    """Whether the person lets the robot move; without anyone to ask it stands."""
    if yes or json_output or not sys.stdin.isatty():
        return yes
    return click.confirm("Let it move 2 cm forward and back? Its wheels must be free", default=False)


def _movement(body: Body, units: int) -> dict[str, int | None]:
    """Ahead, look at the counters, back, stand."""
    from realitygap.robots.body import attend

    attend(body, body.channels[0].name)
    body.reset()
    steps = max(1, round(MOVE_S / body.period_s))
    _drive(body, units, steps * body.period_s)
    left, right = _counters(body) or (None, None)
    attend(body, body.channels[0].name)
    _drive(body, -units, steps * body.period_s)
    return {"left": left, "right": right}
