"""A Khepera, or a twin of one, as a body on its serial line.

Sources of its protocol: Player's khepera driver, KiKS, pykhepera, Webots.
"""

from types import MappingProxyType
from typing import Any

from realitygap.robots.address import BAUD, BAUD_RATES
from realitygap.robots.body import KINDS, Channel
from realitygap.robots.line import CommandSpec, IntRange, LineBody, Protocol

__all__ = ["FULL", "KHEPERA", "PULSES_PER_MM", "SENSORS", "KheperaBody", "opened"]

PULSES_PER_MM = 12.0
"""Most sources; 0.08 mm a pulse (12.5) by others: a calibration measures it."""

SENSORS, FULL = 8, 1023
"""Sensors of each kind, and the highest count of their converter of 10 bits."""

COUNTER_CHARACTERS = 7
"""Of a position counter, for times on the wire: a robot drives 83 m before there are more."""

_GAIN = IntRange(0, 32767)
_PULSES = IntRange(-(2**31), 2**31 - 1, COUNTER_CHARACTERS)
_SPEED = IntRange(-127, 127)
_MEASURED = IntRange(-1023, 1023, 4)
_LIGHT = (IntRange(0, FULL),) * SENSORS
_FLAG = IntRange(0, 1)
_VERSION = IntRange(0, 0, 5)

COMMANDS = {
    "A": CommandSpec(meaning="set the speed controller's Kp, Ki, Kd", takes=(_GAIN,) * 3),
    "B": CommandSpec(
        meaning="read the versions of bios and protocol",
        gives=(_VERSION,) * 2,
        text=r"[0-9]{1,3}(\.[0-9]{1,4})?",
    ),
    "C": CommandSpec(meaning="go to a position, pulses", takes=(_PULSES,) * 2),
    "D": CommandSpec(meaning="set the speed, pulses per 10 ms", takes=(_SPEED,) * 2),
    "E": CommandSpec(meaning="read the measured speed, pulses per 10 ms", gives=(_MEASURED,) * 2),
    "F": CommandSpec(meaning="set the position controller's Kp, Ki, Kd", takes=(_GAIN,) * 3),
    "G": CommandSpec(meaning="set the position counters, pulses", takes=(_PULSES,) * 2),
    "H": CommandSpec(meaning="read the position counters, pulses", gives=(_PULSES,) * 2),
    "I": CommandSpec(
        meaning="read an analogue input, 10 bits", takes=(IntRange(0, 5),), gives=(IntRange(0, FULL),)
    ),
    "J": CommandSpec(
        meaning="set the speed profile: top speed and acceleration, left and right",
        takes=(IntRange(0, 127), IntRange(0, 255)) * 2,
    ),
    "K": CommandSpec(
        meaning="read the motion's status: on target, mode, error, left and right",
        gives=(_FLAG, _FLAG, _PULSES) * 2,
    ),
    "L": CommandSpec(
        meaning="switch an LED: 0 off, 1 on, 2 change", takes=(_FLAG, IntRange(0, 2)), repeatable=False
    ),
    "N": CommandSpec(meaning="read the proximity sensors", gives=_LIGHT),
    "O": CommandSpec(meaning="read the ambient light sensors", gives=_LIGHT),
    "P": CommandSpec(meaning="set the motors' pulse width", takes=(IntRange(-255, 255),) * 2),
}

KHEPERA = Protocol(
    robot="Khepera",
    check="check that it is switched on, its cable, and its jumper "
    f"({', '.join(map(str, BAUD_RATES))} baud; 9600 from the factory)",
    commands=MappingProxyType(COMMANDS),
    not_found="Command not found",  # one source
    protocol_error="z,Protocol error",  # one source
    wake=b"\n",
    barrier="B",
    version="B",
    facts=("bios", "protocol"),
    counters="H",
    set_counters="G",
    measured="E",
    rates=BAUD_RATES,
    usual=BAUD,
    stop_bits=2,
    patience_s=0.1,  # USB converters hold bytes back for up to 16 ms
    top=10,
)

STANDS = 2
"""Measured speeds up to this, pulses per 10 ms, count as standing still."""


class KheperaBody(LineBody):
    """Its commands and speeds are pulses per 10 ms."""

    protocol = KHEPERA
    units = "Khepera units"
    pulses_per_mm = PULSES_PER_MM
    channels = tuple(Channel(name=kind, sensors=SENSORS, high=FULL) for kind in KINDS)
    leds = 2

    def _is_still(self) -> bool:
        """By its measured speeds."""
        return max(map(abs, self.read("E"))) <= STANDS


def opened(
    port: str, *, baud: int | None = KHEPERA.usual, kinds: tuple[str, ...] = ("proximity",), **_: Any
) -> KheperaBody:
    """The Khepera on a serial port, told to stop: arguments and errors as of `LineBody.connect`."""
    return KheperaBody.connect(port, baud=baud, kinds=kinds)
