"""Checks of wheel recordings: swapped counters, wrong units, impossible movements."""

import numpy as np

from realitygap.calibration.recordings import WheelRecording
from realitygap.calibration.wheels.odometry import Odometry, enough_pictures, measured_speeds
from realitygap.errors import CalibrationError
from realitygap.values import Floats
from realitygap.world.robot import Profile

__all__ = ["refuse_few_steps", "refuse_odd", "refuse_wheels"]

SIDES = ("left", "right")
FEWEST_STEPS = 30
AGAINST, OTHERS = -0.3, 0.2
"""Cosine of pulses and commands below which a counter runs against its command; and the advantage of the
other wheel's command from which on columns count as swapped."""
PULSES_SHARE = (0.5, 25.0 / 12.0)
"""Range of pulses per mm by camera, as a share of the value known in advance."""
TRACK_SHARE = 0.3
TURNED = 0.5
"""Commands above the base's top_command are the robot's own unit where its wheels turned by at least this
share of what a unit is in the base."""
EXPLAINED = 0.5


def refuse_odd(recording: WheelRecording, odometry: Odometry | None, base: Profile) -> None:
    """Refuse a recording that no robot like the base can have made, using the camera's data.

    Raises:
        CalibrationError: a wheel or counter that stands, commands or lengths in other units, swapped columns.
    """
    _refuse_still(recording)
    _refuse_counters(recording)
    _refuse_fast(recording, odometry, base)
    if odometry is not None:
        _refuse_lengths(recording, odometry, base)
    elif enough_pictures(recording, base.wheels.track_cm):
        raise CalibrationError(
            f"{recording.source}: the camera's poses fit no wheels with these counters or commands. Are x_cm "
            "and y_cm in cm, heading_deg in degrees, and commands in units of --base? Without these three "
            "columns counters alone are used."
        )


def _refuse_still(recording: WheelRecording) -> None:
    for w, side in enumerate(SIDES):
        if not (recording.commands[:, w] != 0).any():
            raise CalibrationError(f"{recording.source}: the {side} wheel was never told to move.")
        if np.ptp(recording.counters[:, w]) == 0:
            raise CalibrationError(f"{recording.source}: counter_{side} never changes: it looks dead.")


def _refuse_fast(recording: WheelRecording, odometry: Odometry | None, base: Profile) -> None:
    """Refuse commands in a smaller unit. The base's top_command is evolution's, and less than a robot takes
    (an e-puck 1000 of which evolution uses 625): larger ones that the wheels followed are good."""
    most, top = float(np.abs(recording.commands).max(initial=0.0)), base.wheels.top_command
    if most <= top:
        return
    speeds = measured_speeds(recording, odometry, (0.1 / recording.pulses_per_mm,) * 2)
    told = np.where(np.isfinite(speeds), recording.commands, 0.0)
    followed = (np.nan_to_num(speeds) * told).sum(axis=0) / np.maximum((told**2).sum(axis=0), 1e-12)
    if not (followed >= TURNED * np.array(base.wheels.speed_per_unit_cm_s)).all():
        left, right = base.wheels.speed_per_unit_cm_s
        unit = 5.0 * (left + right)
        raise CalibrationError(
            f"{recording.source}: commands up to {most:g}, expected at most {top:g}, the top_command of "
            f"profile {base.name!r}, in units of {unit:.3g} mm/s. Are these mm/s? Divide them by "
            f"{unit:.3g}; or raise wheels.top_command in --base."
        )


def refuse_few_steps(recording: WheelRecording, measured: Floats) -> None:
    """Refuse a recording with too few speeds [n, 2]."""
    known = int(np.isfinite(measured).sum()) // 2
    if known < FEWEST_STEPS:
        apart = np.diff(recording.t_s)[np.diff(recording.trial) == 0]
        rows = f"rows are {np.median(apart):.3g} s apart" if len(apart) else "its trials have one row each"
        raise CalibrationError(
            f"{recording.source}: expected {FEWEST_STEPS} steps of {recording.period_s:g} s or more, in a "
            f"trial each, got {known}: {rows}. Record more, or give the robot's period_s in --base."
        )


def _refuse_counters(recording: WheelRecording) -> None:
    if not recording.counted:
        return
    within = np.diff(recording.trial) == 0
    told, pulses = recording.commands[:-1][within], np.diff(recording.counters, axis=0)[within]
    size = np.linalg.norm(told, axis=0)[:, None] * np.linalg.norm(pulses, axis=0)
    alike = told.T @ pulses / np.maximum(size, 1e-12)
    if alike[0, 1] > alike[1, 1] + OTHERS and alike[1, 0] > alike[0, 0] + OTHERS:
        raise CalibrationError(
            f"{recording.source}: counter_left follows command_right and counter_right command_left. "
            "Are columns swapped?"
        )
    for w, side in enumerate(SIDES):
        if alike[w, w] < AGAINST:
            raise CalibrationError(
                f"{recording.source}: counter_{side} runs against command_{side}. Turn its sign round."
            )


def _refuse_lengths(recording: WheelRecording, odometry: Odometry, base: Profile) -> None:
    """Refuse impossible pulses per mm (without counters: speeds per unit) and tracks."""
    cure = "Are x_cm and y_cm in cm, heading_deg in degrees, and counters in pulses?"
    low, high = (share * recording.pulses_per_mm for share in PULSES_SHARE)
    for side, length in zip(SIDES, odometry.cm_per_pulse, strict=True):
        pulses = 0.1 / length if length else np.inf
        if low <= pulses <= high:
            continue
        expected, got = f"{low:g} to {high:g} pulses per mm", pulses
        if recording.from_commands:
            expected, got = f"{0.1 / high:.3g} to {0.1 / low:.3g} cm/s a unit", length
            cure = f"Are commands in units of profile {base.name!r}, x_cm and y_cm in cm?"
        raise CalibrationError(
            f"{recording.source}: {side} wheel: expected {expected} by the camera, got {got:.3g}. {cure}"
        )
    least, most = ((1 + sign * TRACK_SHARE) * base.wheels.track_cm for sign in (-1, 1))
    if not least <= odometry.track_cm <= most:
        raise CalibrationError(
            f"{recording.source}: track: expected {least:.1f} to {most:.1f} cm, as profile {base.name!r} has "
            f"{base.wheels.track_cm:g} cm, got {odometry.track_cm:.3g} cm by the camera. {cure}"
        )


def refuse_wheels(
    recording: WheelRecording, measured: Floats, model: Floats, bounded: dict[str, float]
) -> None:
    """Refuse a fit that explains less than half of the speeds' variation, or that ended at a bound.

    Args:
        recording: of the wheels.
        measured, model: [n, 2] speeds, cm/s; NaN where unknown.
        bounded: speeds per unit that ended at their bounds, cm/s.

    Raises:
        CalibrationError: names the wheel.
    """
    for w, side in enumerate(SIDES):
        known = np.isfinite(measured[:, w])
        off = ((model - measured)[known, w] ** 2).sum()
        share = 1.0 - off / max(float((measured[known, w] ** 2).sum()), 1e-12)
        if share < EXPLAINED:
            raise CalibrationError(
                f"{recording.source}: the fitted law explains only {max(0.0, share):.0%} of how the {side} "
                "wheel turned: these counters or poses do not belong to these commands."
            )
    for key, value in bounded.items():
        raise CalibrationError(
            f"{recording.source}: {key}: {value:g} cm/s per unit, the utmost that is tried: no wheel of this "
            "robot. Are commands in its units, as --base has them, and counters in pulses?"
        )
