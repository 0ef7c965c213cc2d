"""The wheels' fit (§3.2.2): gains and speed per unit from the counters, lengths from a camera.

Counters and a camera know different things. Counters show how a wheel follows its command, in
pulses; only what is seen from outside tells pulses per millimetre, the track, and slip.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from realitygap.calibration.forward import wheel_speeds
from realitygap.calibration.odometry import Odometry, measure_odometry
from realitygap.calibration.solve import SIGMAS, Constant
from realitygap.errors import CalibrationError
from realitygap.kernels.params import STEP_S

if TYPE_CHECKING:
    from realitygap.calibration.recording import WheelRecording
    from realitygap.world.profile import Profile

__all__ = ["PULSES_PER_CM", "WHEEL_FORMS", "WheelFit", "fit_wheels", "measured_speeds"]

Array = NDArray[np.float64]

PULSES_PER_CM = 120.0
"""12 pulses per mm by most sources (0.08 mm per pulse by others): what is taken where nothing measured it."""
WHEEL_FORMS = ("printed", "refitted")
"""The paper's gains; gains of one's own, a lag, and play at turning round. Both fit the speed per unit."""
GAINS = ("kp", "ki", "kd", "lag")
DIVISOR = 50000.0
FIRST_STEPS = 2
"""A wheel's first start in a trial, from the rest before which nothing is known, shows for so many steps."""
MOVING_SHARE = 0.1
"""A wheel has started when it goes faster than this share of the speed asked for."""


class Friction(NamedTuple):
    """|I| that frees a resting wheel (cm/s²): between `low` and `high` by the standing starts."""

    value: float
    low: float
    high: float
    starts: int


@dataclass(frozen=True, kw_only=True, eq=False)
class WheelFit:
    """Wheels as they were fitted.

    Attributes:
        profile: the base with the wheels' constants in place.
        form: one of WHEEL_FORMS.
        constants: with their intervals.
        rmse: of each form's speeds against the counters', cm/s.
        friction: from the standing starts.
        odometry: what the camera told; None without one.
        measured, model: [n, 2] speeds of the wheels in the step after each row, cm/s.
    """

    profile: Profile
    form: str
    constants: tuple[Constant, ...]
    rmse: dict[str, float]
    friction: Friction | None
    odometry: Odometry | None
    measured: Array = field(repr=False)
    model: Array = field(repr=False)


def measured_speeds(recording: WheelRecording, cm_per_pulse: tuple[float, float]) -> Array:
    """[n, 2] mean speed in the step that follows each row, by the counters (cm/s); NaN in last rows."""
    step, way = np.diff(recording.t_s), np.diff(recording.counters, axis=0)
    out = np.full(recording.commands.shape, np.nan)
    good = (np.diff(recording.trial) == 0) & (np.abs(step - STEP_S) < 0.2 * STEP_S)
    out[:-1][good] = way[good] / step[good, None] * np.array(cm_per_pulse)
    return out


def fit_wheels(recording: WheelRecording, base: Profile, form: str = "refitted") -> WheelFit:
    """Fit a profile's wheels to a recording.

    Raises:
        CalibrationError: the wheels never moved, or too little was recorded.
    """
    _refuse_still(recording)
    odometry = measure_odometry(recording, PULSES_PER_CM, base.wheels.track_cm)
    per_pulse = odometry.cm_per_pulse if odometry else (1.0 / PULSES_PER_CM,) * 2
    measured = measured_speeds(recording, per_pulse)
    if np.isfinite(measured).sum() < 60:
        raise CalibrationError(f"{recording.source}: expected 30 steps of 0.1 s or more, in a trial each.")
    friction = _friction(recording, measured)
    track = odometry.track_cm if odometry else base.wheels.track_cm
    threshold = friction.value if friction else base.wheels.friction_cm_s2
    start = replace(base, wheels=replace(base.wheels, track_cm=track, friction_cm_s2=threshold))
    fits = {name: _fit(name, start, recording, measured) for name in WHEEL_FORMS}
    profile, constants = fits[form]
    if odometry is not None:
        profile = replace(profile, noise=replace(profile.noise, wheel=odometry.slip))
        constants += odometry.constants
    if friction is not None:
        where = Constant(
            key="friction_cm_s2",
            value=friction.value,
            low=friction.low,
            high=friction.high,
            told=friction.low > 0,
        )
        constants += (where,)
    return WheelFit(
        profile=profile,
        form=form,
        constants=constants,
        rmse={name: _rmse(wheel_speeds(made, recording) - measured) for name, (made, _) in fits.items()},
        friction=friction,
        odometry=odometry,
        measured=measured,
        model=wheel_speeds(profile, recording),
    )


def _fit(
    form: str, base: Profile, recording: WheelRecording, measured: Array
) -> tuple[Profile, tuple[Constant, ...]]:
    """Speed per unit of each wheel, and in the form "refitted" the gains and the lag too."""
    from scipy.optimize import least_squares

    keys = ["speed_left", "speed_right"] + ([*GAINS, "play_cm"] if form == "refitted" else [])
    low = np.array([0.05, 0.05, 100.0, 0.0, 0.0, 0.0, 0.0][: len(keys)])
    high = np.array([20.0, 20.0, 9500.0, 4000.0, 40000.0, 1.0, 0.5][: len(keys)])
    use = _told(recording, measured)
    speeds = _steady(recording, measured)

    def made(theta: Array) -> Profile:
        return _with(base, dict(zip(keys, theta.tolist(), strict=True)))

    def residuals(theta: Array) -> Array:
        if not made_stable(theta, keys, base):
            return np.full(int(use.sum()), 1e3)
        off = (wheel_speeds(made(theta), recording) - measured)[use]
        return np.asarray(np.clip(off, -1e3, 1e3))

    found = None
    for gains in ((3800.0, 100.0, 100.0, 0.1, 0.01), (4800.0, 1.0, 1.0, 0.4, 0.08)):
        begin = np.array([*speeds, *gains][: len(keys)])
        step = np.array([1e-4, 1e-4, 1e-3, 1e-3, 1e-3, 1e-3, 1e-3][: len(keys)])
        one = least_squares(
            residuals, np.clip(begin, low, high), bounds=(low, high), x_scale=np.maximum(begin, 10.0 * step),
            diff_step=step, loss="soft_l1", f_scale=0.5,
        )  # fmt: skip
        found = one if found is None or one.cost < found.cost else found
        if form == "printed":
            break
    assert found is not None
    jacobian = np.asarray(found.jac)
    freedom = max(int(use.sum()) - len(keys), 1)
    variance = float((found.fun**2).sum()) / freedom
    deviation = np.sqrt(np.maximum(np.diag(np.linalg.pinv(jacobian.T @ jacobian)) * variance, 0.0))
    constants = tuple(
        Constant(key=key, value=float(v), low=float(v - SIGMAS * d), high=float(v + SIGMAS * d))
        for key, v, d in zip(keys, found.x, deviation, strict=True)
    )
    return made(found.x), constants


def _told(recording: WheelRecording, measured: Array) -> NDArray[np.bool_]:
    """[n, 2] speeds that are known and follow from the trial's commands alone.

    Not a wheel's first start in a trial: which way it turned before, nobody wrote down.
    """
    use = np.isfinite(measured)
    for rows in recording.trials():
        for w in range(2):
            moves = np.flatnonzero(recording.commands[rows, w])
            if len(moves):
                use[rows[: moves[0] + FIRST_STEPS], w] = False
    return np.asarray(use)


def made_stable(theta: Array, keys: list[str], base: Profile) -> bool:
    """Whether a wheel with these gains settles at all."""
    law = dict(zip(keys, theta.tolist(), strict=True))
    gains = [law.get(key, getattr(base.wheels, key)) / DIVISOR for key in ("kp", "ki", "kd")]
    p, i, d = gains[0] / STEP_S, gains[1] / STEP_S, gains[2]
    return float(np.abs(np.roots([1.0, p + i - 1 - d, i + d, i, i, i])).max()) < 0.999


def _with(base: Profile, values: dict[str, float]) -> Profile:
    wheels = base.wheels
    gains = {key: values[key] for key in (*GAINS, "play_cm") if key in values}
    speeds = (values["speed_left"], values["speed_right"])
    top = min(wheels.top_command, base.body.radius_cm / STEP_S / max(speeds))
    return replace(base, wheels=replace(wheels, speed_per_unit_cm_s=speeds, top_command=top, **gains))


def _steady(recording: WheelRecording, measured: Array) -> list[float]:
    """Speed per unit of each wheel where its command has stood for half a second, cm/s."""
    out = []
    for w in range(2):
        command = recording.commands[:, w]
        changed = np.concatenate([[True], (np.diff(command) != 0) | (np.diff(recording.trial) != 0)])
        since = np.arange(len(command)) - np.maximum.accumulate(np.where(changed, np.arange(len(command)), 0))
        use = (since >= 5) & (command != 0) & np.isfinite(measured[:, w])
        if use.sum() < 5:
            use = (command != 0) & np.isfinite(measured[:, w])
        out.append(float((measured[use, w] * command[use]).sum() / (command[use] ** 2).sum()))
    return out


def _friction(recording: WheelRecording, measured: Array) -> Friction | None:
    """Between which thresholds the wheels' delays at standing starts lie.

    A wheel that rests under a command of speed v adds v/0.1 s to I each step: if it starts in its
    n-th step, the threshold lies between n − 1 and n times that.
    """
    lows, highs = [], []
    for rows in recording.trials():
        for w in range(2):
            command, speed = recording.commands[rows, w], measured[rows, w]
            for k in np.flatnonzero((command != 0) & (np.concatenate([[0.0], command[:-1]]) == 0)):
                rested = k == 0 or (k >= 5 and np.all(command[k - 5 : k] == 0) and abs(speed[k - 1]) < 0.05)
                going = speed[k : k + 5]
                if not rested or len(going) < 5 or not np.all(command[k : k + 5] == command[k]):
                    continue
                final = abs(going[-1])
                moved = np.flatnonzero(np.abs(going) > MOVING_SHARE * max(final, 0.2))
                if final > 0.2 and len(moved):
                    lows.append(moved[0] * final / STEP_S)
                    highs.append((moved[0] + 1) * final / STEP_S)
    if not lows:
        return None
    low, high = float(np.quantile(lows, 0.75)), float(np.quantile(highs, 0.25))
    value = 0.0 if low == 0 else (low + high) / 2
    return Friction(value, min(low, high), max(low, high), len(lows))


def _refuse_still(recording: WheelRecording) -> None:
    for w, side in enumerate(("left", "right")):
        if not (recording.commands[:, w] != 0).any():
            raise CalibrationError(f"{recording.source}: the {side} wheel was never told to move.")
        if np.ptp(recording.counters[:, w]) == 0:
            raise CalibrationError(f"{recording.source}: counter_{side} never changes: it looks dead.")


def _rmse(off: Array) -> float:
    return float(np.sqrt(np.nanmean(off**2)))
