"""Robots: what a body is, its address, control loop, recordings, safe stop; a file for each."""

from realitygap.lazy import names_of

__all__, __getattr__ = names_of(__name__, {
    "address": "Address",
    "body": "Body Channel Clock Odometry RealClock SteppedClock",
    "drive": "Controller Recorder Recording",
})  # fmt: skip
