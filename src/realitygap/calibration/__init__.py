"""Calibration (§3.2.1): recordings of a robot, curves fitted to them, a profile, and its judgement.

The main function is `realitygap.calibrate`.
"""

from realitygap.lazy import names_of

__all__, __getattr__ = names_of(__name__, {
    "calibrate": "Calibration",
    "judge": "Judgement",
    "load": "load_recording",
    "recordings": "Recording SensorRecording WheelRecording",
    "unit": "calibrated_robot calibrated_unit",
})  # fmt: skip
