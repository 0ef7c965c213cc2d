"""`realitygap robot`: a Khepera on a serial line."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any

import click

from realitygap.cli.kinds import Finite
from realitygap.cli.options import as_json, baud_option
from realitygap.cli.output import print_json, print_table

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from realitygap.robots.khepera.body import KheperaBody
    from realitygap.robots.khepera.driver import Khepera
    from realitygap.robots.recording import Recording
    from realitygap.values import Readings

__all__ = ["robot"]

FULL_SCALE = 1023
BAR_CHARACTERS = 40
MOVE_UNITS, MOVE_S = 5, 0.5
"""A small movement: 4 cm/s for half a second and back, 2 cm."""

LED_S = 0.2


@click.group()
def robot() -> None:
    """Talk to a Khepera on a serial line.

    \b
    Example:
        realitygap robot check --port /dev/ttyUSB0
    """


@robot.command()
@click.option("--port", required=True, metavar="P", help="The robot's serial device.")
@baud_option()
@click.option(
    "--seconds",
    type=Finite(0.1, 3600),
    default=3.0,
    show_default=True,
    help="Seconds for which to show the sensors.",
)
@click.option("--clock-channel", metavar="FILE", help="Control channel of a twin that runs in virtual time.")
@click.option("--yes", is_flag=True, help="Let it move 2 cm and back without asking.")
@as_json
def check(
    port: str, baud: str, seconds: float, clock_channel: str | None, yes: bool, json_output: bool
) -> None:
    """Check that a robot works: versions, sensors, counters, LEDs, a 100 ms loop.

    It moves only with your consent.

    \b
    Example: a robot with factory settings
        realitygap robot check --port /dev/ttyUSB0 --baud 9600
    """
    from contextlib import closing

    from realitygap.robots.clock import RealClock, VirtualClock
    from realitygap.robots.khepera.driver import Khepera
    from realitygap.robots.signals import Stopping

    clock = VirtualClock(clock_channel) if clock_channel else RealClock()
    rate = None if baud == "any" else int(baud)
    with Stopping(), closing(clock), Khepera.connect(port, baud=rate, clock=clock) as khepera:
        facts: dict[str, Any] = {"port": port, "baud": khepera.baud, **khepera.versions._asdict()}
        if not json_output:
            click.echo(f"{port}: bios {khepera.versions.bios}, protocol {khepera.versions.protocol}")
        facts |= _sensors(khepera, round(seconds, 1), live=not json_output and sys.stdout.isatty())
        facts |= {"counters": khepera.counters(), "leds": _leds(khepera)}
        if not json_output:
            _tell(facts)
        facts["movement"] = _movement(khepera) if _agreed(yes, json_output) else None
        facts["faults"] = khepera.line.faults
    if json_output:
        print_json(facts)
        return
    if facts["movement"]:
        click.echo("moved: counters {left} and {right} pulses, then back".format(**facts["movement"]))
    click.echo(f"answers that had to be requested again: {facts['faults']}")


def _sensors(khepera: Khepera, seconds: float, *, live: bool) -> dict[str, Any]:
    """Run a standing robot through the control loop, and show what it reads."""
    from realitygap.errors import BaudError
    from realitygap.robots.khepera.body import KheperaBody

    note = None
    try:
        body = KheperaBody(khepera, kinds=("proximity", "ambient"))
    except BaudError as error:
        note, body = str(error), KheperaBody(khepera, kinds=("proximity",))
    recording = _drive(body, 0, seconds, live)
    late = recording.late * 1000
    return {
        "proximity": recording.proximity[-1],
        "ambient": recording.ambient[-1] if recording.ambient.size else khepera.ambient(),
        "loop": {
            "steps": len(late),
            "late_steps": recording.late_steps,
            "mean_lateness_ms": round(float(late.mean()), 3),
            "worst_lateness_ms": round(float(late.max()), 3),
            "wire_ms": round(body.budget.ms, 1),
            "note": note,
        },
    }


def _drive(body: KheperaBody, units: int, seconds: float, live: bool = False) -> Recording:
    """Straight on; 0: stand."""
    from realitygap.robots.loop import drive
    from realitygap.values import Command

    class Steady:
        def reset(self) -> None:
            """Nothing to forget."""

        def decide(self, inputs: Sequence[int]) -> Command:
            return Command(left=units, right=units)

    def run(show: Callable[[Readings], object]) -> Recording:
        def look(readings: Readings) -> list[int]:
            show(readings)
            return []

        return drive(body, Steady(), seconds=seconds, clock=body.khepera.clock, inputs=look)

    if not live:
        return run(lambda readings: None)
    from rich.live import Live

    with Live(auto_refresh=False, transient=True) as screen:
        return run(lambda readings: screen.update(_bars(readings), refresh=True))


def _bars(readings: Readings) -> Any:
    """Readings as bars: long is many counts (for ambient light: dark)."""
    from rich.progress_bar import ProgressBar
    from rich.table import Table

    table = Table(box=None)
    for column in ("sensor", "proximity", "", "ambient", ""):
        table.add_column(column)
    for i in range(8):
        cells: list[Any] = [str(i)]
        for counts in (readings.proximity, readings.ambient):
            value = float(counts[i]) if len(counts) else 0.0
            cells.append(ProgressBar(total=FULL_SCALE, completed=value, width=BAR_CHARACTERS))
            cells.append(f"{value:4.0f}" if len(counts) else "–")
        table.add_row(*cells)
    return table


def _leds(khepera: Khepera) -> str:
    """Switch both on and off."""
    for on in (True, False):
        for number in (0, 1):
            khepera.led(number, on)
        khepera.clock.sleep_until(khepera.clock.now() + LED_S)
    return "answered"


def _tell(facts: dict[str, Any]) -> None:
    rows = [[kind, *(int(value) for value in facts[kind])] for kind in ("proximity", "ambient")]
    print_table(["counts", *(f"s{i}" for i in range(8))], rows)
    click.echo("counters: {} and {} pulses; both LEDs were on and off".format(*facts["counters"]))
    loop = facts["loop"]
    click.echo(
        "loop of 100 ms: {steps} steps, {late_steps} late (over 10 ms); lateness {mean_lateness_ms} ms on "
        "average, {worst_lateness_ms} ms at worst; up to {wire_ms} ms of a step on the wire".format(**loop)
    )
    if loop["note"]:
        click.echo(f"note: {loop['note']}")


def _agreed(yes: bool, json_output: bool) -> bool:
    """Whether the person lets the robot move; without anyone to ask it stands."""
    if yes or json_output or not sys.stdin.isatty():
        return yes
    return click.confirm("Let it move 2 cm forward and back? Its wheels must be free", default=False)


def _movement(khepera: Khepera) -> dict[str, int]:
    """Ahead, look at the counters, back, stand."""
    from realitygap.robots.khepera.body import KheperaBody

    body = KheperaBody(khepera, kinds=("proximity",))
    body.reset()
    for units in (MOVE_UNITS, -MOVE_UNITS):
        _drive(body, units, MOVE_S)
        if units > 0:
            left, right = khepera.counters()
    return {"left": left, "right": right}
