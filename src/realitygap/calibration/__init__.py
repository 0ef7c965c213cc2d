"""§3.2.1 of the paper: recordings of a robot, curves through them, a profile, and its judge.

Its main verb is `realitygap.calibrate`.
"""

from realitygap.lazy import names_of

__all__, __getattr__ = names_of(__name__, {
    "calibrate": "Calibration",
    "judge": "Judgement",
    "recordings.files": "load_recording",
    "recordings.recording": "Recording SensorRecording WheelRecording",
    "unit": "calibrated_robot calibrated_unit",
})  # fmt: skip
