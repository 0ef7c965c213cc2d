"""The Khepera's dialect. Sources: Player's khepera driver, KiKS, pykhepera, Webots."""

from types import MappingProxyType

from realitygap.robots.address import BAUD, BAUD_RATES
from realitygap.robots.line.protocol import Dialect, Form, Span

__all__ = ["FULL", "KHEPERA", "PULSES_PER_MM", "SENSORS"]

PULSES_PER_MM = 12.0
"""Most sources; 0.08 mm a pulse (12.5) by others: a calibration measures it."""

SENSORS, FULL = 8, 1023
"""Sensors of each kind, and the highest count of their converter of 10 bits."""

COUNTER_CHARACTERS = 7
"""Of a position counter, for times on the wire: a robot drives 83 m before there are more."""

_GAIN = Span(0, 32767)
_PULSES = Span(-(2**31), 2**31 - 1, COUNTER_CHARACTERS)
_SPEED = Span(-127, 127)
_MEASURED = Span(-1023, 1023, 4)
_LIGHT = (Span(0, FULL),) * SENSORS
_FLAG = Span(0, 1)
_VERSION = Span(0, 0, 5)

COMMANDS = {
    "A": Form(meaning="set the speed controller's Kp, Ki, Kd", takes=(_GAIN,) * 3),
    "B": Form(
        meaning="read the versions of bios and protocol",
        gives=(_VERSION,) * 2,
        text=r"[0-9]{1,3}(\.[0-9]{1,4})?",
    ),
    "C": Form(meaning="go to a position, pulses", takes=(_PULSES,) * 2),
    "D": Form(meaning="set the speed, pulses per 10 ms", takes=(_SPEED,) * 2),
    "E": Form(meaning="read the measured speed, pulses per 10 ms", gives=(_MEASURED,) * 2),
    "F": Form(meaning="set the position controller's Kp, Ki, Kd", takes=(_GAIN,) * 3),
    "G": Form(meaning="set the position counters, pulses", takes=(_PULSES,) * 2),
    "H": Form(meaning="read the position counters, pulses", gives=(_PULSES,) * 2),
    "I": Form(meaning="read an analogue input, 10 bits", takes=(Span(0, 5),), gives=(Span(0, FULL),)),
    "J": Form(
        meaning="set the speed profile: top speed and acceleration, left and right",
        takes=(Span(0, 127), Span(0, 255)) * 2,
    ),
    "K": Form(
        meaning="read the motion's status: on target, mode, error, left and right",
        gives=(_FLAG, _FLAG, _PULSES) * 2,
    ),
    "L": Form(meaning="switch an LED: 0 off, 1 on, 2 change", takes=(_FLAG, Span(0, 2)), repeatable=False),
    "N": Form(meaning="read the proximity sensors", gives=_LIGHT),
    "O": Form(meaning="read the ambient light sensors", gives=_LIGHT),
    "P": Form(meaning="set the motors' pulse width", takes=(Span(-255, 255),) * 2),
    "T": Form(
        meaning="pass on to a turret",
        takes=(Span(0, 255),),
        gives=(Span(0, 255),),
        repeatable=False,
        open_ended=True,
    ),
}

KHEPERA = Dialect(
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
    leds=2,
)
