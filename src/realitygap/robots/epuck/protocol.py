"""The e-puck's dialect, that of the firmware "advanced sercom" which the e-puck2 speaks too.

Sources: Asercom.c of GCtronic, EPFL and the York Robotics Laboratory, Asercom2.c of the e-puck2.
"""

from types import MappingProxyType

from realitygap.robots.line.protocol import Dialect, Form, Span

__all__ = ["EPUCK", "FULL", "PULSES_PER_MM", "SENSORS"]

PULSES_PER_MM = 1000 / 128.0
"""1000 steps a turn of 128 mm (Enki); 125.7 by GCtronic's ROS driver, 129 by others: to be measured."""

SENSORS, FULL = 8, 4095
"""Sensors of each kind, clockwise from the front's right, and the highest count of 12 bits."""

_LIGHT = (Span(0, FULL),) * SENSORS
_STEPS = (Span(-(2**31), 2**31 - 1, 6),) * 2

COMMANDS = {
    "C": Form(meaning="read the selector", gives=(Span(0, 15),)),
    "D": Form(meaning="set the speed, steps per second", takes=(Span(-1000, 1000),) * 2),
    "E": Form(meaning="read the speed that was set", gives=(Span(-1000, 1000),) * 2),
    "L": Form(
        meaning="switch an LED: 0 off, 1 on, 2 change", takes=(Span(0, 7), Span(0, 2)), repeatable=False
    ),
    "N": Form(meaning="read the proximity sensors", gives=_LIGHT),
    "O": Form(meaning="read the ambient light sensors", gives=_LIGHT),
    "P": Form(meaning="set the step counters", takes=_STEPS),
    "Q": Form(meaning="read the step counters", gives=_STEPS),
    "V": Form(meaning="read the firmware's version", gives=(Span(0, 0, 60),), text=r"Version[ -~]*"),
}

EPUCK = Dialect(
    robot="e-puck",
    check="check that it is switched on, that its Bluetooth is bound to this port (rfcomm) or its cable, "
    "and its selector (3 for Bluetooth; 8 for an e-puck2's USB)",
    commands=MappingProxyType(COMMANDS),
    not_found="z,Command not found",
    protocol_error="",  # it has none: what is wrong in a command it reads as something else
    wake=b"\0\n",  # the NUL ends its binary mode, which a garbled byte may have begun
    barrier="C",
    version="V",
    facts=("firmware",),
    counters="Q",
    set_counters="P",
    measured="",  # E only tells what it was told
    rates=(115200,),
    usual=115200,
    stop_bits=1,
    patience_s=0.3,  # Bluetooth
    top=1000,
    leds=8,
)
