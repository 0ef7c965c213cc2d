"""Fits the set-up of a series of one sensor facing a wall: its extra distance and background light."""

import numpy as np

from realitygap.calibration.descent import BY_HAND, LIGHT, SHIFT
from realitygap.calibration.forward import Scene, lit_readings, proximity
from realitygap.calibration.recordings.recording import SensorRecording
from realitygap.calibration.solve import Free, Measured, Values, solve
from realitygap.values import Floats
from realitygap.world.profile import Profile

__all__ = ["set_up"]


def set_up(recording: SensorRecording, profile: Profile, scene: Scene) -> tuple[float, float, Floats]:
    """Most likely extra distance (cm) and background light beyond the profile's (1/cm²), with a calibration's
    priors; and the profile's readings [n, S] there."""
    law, use = profile.infrared, np.isfinite(recording.counts)
    if not law.measured:
        return 0.0, 0.0, proximity(profile, scene)
    silent = (recording.counts <= 0) & (law.dead > 0)

    def readings(values: Values) -> Floats:
        away, more = float(values["shift"][0]), float(values["light"][0])
        return lit_readings(profile, scene, more, away_cm=away)

    def told(values: Values) -> Floats:
        return np.where(silent, np.maximum(readings(values) - law.dead, 0.0), readings(values))

    # Like a calibration, it uses the places' means.
    noise = BY_HAND * law.top * np.sqrt(np.median(np.bincount(recording.place())))
    measured = Measured(
        counts=np.nan_to_num(recording.counts), noise=float(noise), use=use, clusters=recording.place()
    )
    lit = {**LIGHT, "low": -LIGHT["high"]}
    frees = [Free(key="shift", start=np.zeros(1), **SHIFT), Free(key="light", start=np.zeros(1), **lit)]
    found = solve(frees, told, measured, intervals=False).values
    model = readings(found)
    return float(found["shift"][0]), float(found["light"][0]), np.where(model < law.dead, 0.0, model)
