"""Robots: what a body is, its address, control loop, clocks, recordings, safe stop; a folder for each."""

from realitygap.lazy import names_of

__all__, __getattr__ = names_of(__name__, {
    "address": "Address",
    "body": "Body Channel Odometry",
    "clock": "Clock RealClock SteppedClock",
    "loop": "Controller drive",
    "recording": "Recorder Recording",
})  # fmt: skip
