"""The wheels' fit (§3.2.2): gains and speed per unit from the counters, lengths from a camera.

Counters show how a wheel follows its command, in pulses; pulses per millimetre, the track and slip can only
be seen from outside.
"""

from dataclasses import dataclass, field, replace
from operator import attrgetter

import numpy as np
from numpy.typing import NDArray

from realitygap.calibration.fit import Tick
from realitygap.calibration.model import wheel_speeds
from realitygap.calibration.recordings import PULSES_PER_MM, WheelRecording
from realitygap.calibration.wheels.checks import refuse_few_steps, refuse_odd, refuse_wheels
from realitygap.calibration.wheels.friction import Friction, measure_friction
from realitygap.calibration.wheels.intervals import at_bound, intervals, with_lengths
from realitygap.calibration.wheels.odometry import Odometry, measure_odometry, measured_speeds
from realitygap.errors import CalibrationError
from realitygap.values import Floats
from realitygap.world.robot import Constant, Profile, largest_pole

__all__ = ["WHEEL_FORMS", "WheelFit", "doubts", "fit_wheels"]

WHEEL_FORMS = ("printed", "refitted")
""""printed": the paper's gains; "refitted": free gains, a lag, and play on reversal. Both fit the speed per
unit."""
SPEED_KEYS, SPEED_BOUNDS = ("speed_left", "speed_right"), (0.0625, 25.0)
"""Speeds per unit, and their bounds relative to the base's."""
GAINS = ("kp", "ki", "kd", "lag")
PRINTED = {"kp": 3800.0, "ki": 800.0, "kd": 100.0, "divisor": 50000.0, "lag": 0.0, "play_cm": 0.0}
"""§3.2.2, whatever the base has; lag and play are not in the paper."""
FIRST_GAINS: dict[str, tuple[tuple[float, ...], ...]] = {
    "printed": ((),),
    "refitted": ((3800.0, 100.0, 100.0, 0.1, 0.01), (4800.0, 1.0, 1.0, 0.4, 0.08)),
}
"""Starting values of a form: gains, lag and play."""
ROBUST_AT, SETTLING = 0.5, 0.999
"""Residuals beyond this many cm/s count less than their square; the largest pole that is tried."""
ROUGH = 1.15
"""Factor between fitted and base speeds beyond which the unit of commands is doubted."""
FIRST_STEPS = 2
"""Number of steps affected by a wheel's first start in a trial, since its previous direction is unknown."""


@dataclass(frozen=True, kw_only=True, eq=False)
class WheelFit:
    """The fit of the wheels.

    Attributes:
        profile: the base with the wheels' constants in place.
        form: one of WHEEL_FORMS.
        constants: with their intervals.
        alike: pairs that the counters cannot separate, with their correlation.
        rmse: of each form's speeds against the counters', cm/s.
        friction: from the standing starts.
        odometry: from the camera; None without one, or if it saw too little.
        camera: whether there are any pictures.
        pulses_per_mm: of both counters, measured or known in advance; empty without counters.
        measured, model: [n, 2] speeds in the step after each row, cm/s.
    """

    profile: Profile
    form: str
    constants: tuple[Constant, ...]
    alike: tuple[tuple[str, str, float], ...]
    rmse: dict[str, float]
    friction: Friction | None
    odometry: Odometry | None
    camera: bool
    pulses_per_mm: tuple[float, ...]
    measured: Floats = field(repr=False)
    model: Floats = field(repr=False)


def fit_wheels(recording: WheelRecording, base: Profile, form: str, *, tick: Tick = lambda: None) -> WheelFit:
    """Fit a profile's wheels to a recording.

    Args:
        recording: of a drive.
        base: the profile whose values stay where the recording says nothing.
        form: which constants are free.
        tick: called after each fit.

    Raises:
        CalibrationError: the recording is too short, or impossible for such a robot.
    """
    assumed = recording.counted and not (recording.pulses_said or base.provenance.pulses_per_mm)
    recording = recording.of_robot(base)
    odometry = measure_odometry(recording, base.wheels.track_cm)
    refuse_odd(recording, odometry, base)
    per_pulse = odometry.cm_per_pulse if odometry else (0.1 / recording.pulses_per_mm,) * 2
    measured = measured_speeds(recording, odometry, per_pulse)
    refuse_few_steps(recording, measured)
    # With a camera alone it is unknown in which step a wheel began to turn.
    friction = measure_friction(recording, measured) if recording.counted else None
    track = odometry.track_cm if odometry else base.wheels.track_cm
    threshold = friction.value if friction else base.wheels.friction_cm_s2
    start = replace(base, wheels=replace(base.wheels, track_cm=track, friction_cm_s2=threshold))
    fits = {name: _fit(name, start, recording, measured) for name in WHEEL_FORMS}
    profile, constants, alike = fits[form]
    constants = _with_others(constants, odometry, friction)
    if assumed and odometry is None:
        _refuse_assumed(recording, profile, base)
    if odometry is not None:
        profile = replace(profile, noise=replace(profile.noise, wheel=odometry.slip))
    model = wheel_speeds(profile, recording)
    left = {name: wheel_speeds(made, recording) - measured for name, (made, *_) in fits.items()}
    speeds = [c for c in constants if c.key in SPEED_KEYS and at_bound(c.value, *_speed_bounds(base))]
    refuse_wheels(recording, measured, model, {c.key: c.value for c in speeds})
    tick()
    return WheelFit(
        profile=profile, form=form, constants=constants, alike=alike,
        rmse={name: float(np.sqrt(np.nanmean(off**2))) for name, off in left.items()},
        friction=friction, odometry=odometry,
        camera=recording.pose is not None and bool(np.isfinite(recording.pose).any()),
        pulses_per_mm=tuple(0.1 / length for length in per_pulse if recording.counted),
        measured=measured, model=model,
    )  # fmt: skip


def doubts(wheels: WheelFit, base: Profile) -> list[str]:
    """Warnings about fitted wheels."""
    out = []
    if wheels.odometry is None:
        seen = "a camera saw too little" if wheels.camera else "no camera saw the robot"
        out.append(
            f"wheels: {seen}: {wheels.pulses_per_mm[0]:g} pulses per mm are assumed (what recording.toml "
            f"says of pulses_per_mm, else the base profile, else a Khepera's {PULSES_PER_MM:g}), track and "
            "noise of the wheels are the base profile's"
        )
    known, found = base.wheels.speed_per_unit_cm_s, wheels.profile.wheels.speed_per_unit_cm_s
    if _apart(wheels.profile, base) > ROUGH:
        out.append(
            f"wheels: {found[0]:.3g} and {found[1]:.3g} cm/s a unit, where profile {base.name!r} has "
            f"{known[0]:.3g} and {known[1]:.3g}: were commands written in another unit, as cm/s or mm/s? "
            "Write them as the robot is given them"
            + ("" if wheels.odometry else "; or is it pulses_per_mm? State the robot's in recording.toml")
        )
    better = wheels.rmse["printed"] / max(wheels.rmse["refitted"], 1e-9)
    if wheels.form == "printed" and better > 1.5:
        out.append(
            f"wheels: the printed gains leave {wheels.rmse['printed']:.2f} cm/s, refitted ones "
            f"{wheels.rmse['refitted']:.2f}: this misfit is no noise"
        )
    return out


def _refuse_assumed(recording: WheelRecording, profile: Profile, base: Profile) -> None:
    """Refuse another robot's counters read as a Khepera's, with which its speeds disagree with the base's."""
    if _apart(profile, base) <= ROUGH:
        return
    found, known = ("{:.3g} and {:.3g}".format(*p.wheels.speed_per_unit_cm_s) for p in (profile, base))
    raise CalibrationError(
        f"{recording.source}: pulses_per_mm: expected in recording.toml, since no camera measured them and "
        f"profile {base.name!r} has none; by a Khepera's {PULSES_PER_MM:g} the wheels made {found} cm/s a "
        f"unit, where that profile has {known}. State the robot's, or write commands as it is given them."
    )


def _apart(profile: Profile, base: Profile) -> float:
    """Largest factor between speeds per unit of two profiles."""
    pairs = zip(profile.wheels.speed_per_unit_cm_s, base.wheels.speed_per_unit_cm_s, strict=True)
    return max(max(a / b, b / a) for a, b in pairs)


def _with_others(
    constants: tuple[Constant, ...], odometry: Odometry | None, friction: Friction | None
) -> tuple[Constant, ...]:
    """A form's constants, and those from the camera and the standing starts."""
    constants = with_lengths(constants, odometry)
    if odometry is not None:
        constants += odometry.constants
    if friction is None:
        return constants
    value, low, high = friction.value, friction.low, friction.high
    return (*constants, Constant(key="friction_cm_s2", value=value, low=low, high=high, told=low > 0))


def _fit(
    form: str, base: Profile, recording: WheelRecording, measured: Floats
) -> tuple[Profile, tuple[Constant, ...], tuple[tuple[str, str, float], ...]]:
    """One form's profile, its constants, and pairs that the counters cannot separate.

    Free are the speed per unit of each wheel, and in the form "refitted" the gains, the lag and the play too.
    """
    from scipy.optimize import least_squares

    keys = [*SPEED_KEYS] + ([*GAINS, "play_cm"] if form == "refitted" else [])
    slowest, fastest = _speed_bounds(base)
    low = np.array([slowest, slowest, 100.0, 0.0, 0.0, 0.0, 0.0][: len(keys)])
    high = np.array([fastest, fastest, 9500.0, 4000.0, 40000.0, 1.0, 0.5][: len(keys)])
    if form == "printed":
        base = replace(base, wheels=replace(base.wheels, **PRINTED))  # type: ignore[arg-type]
    use = _told(recording, measured)
    speeds = _steady(recording, measured)

    def residuals(theta: Floats) -> Floats:
        law = dict(zip(keys, theta.tolist(), strict=True))
        if not _stable(base, law):
            return np.full(int(use.sum()), 1e3)
        off = (wheel_speeds(_with(base, law), recording) - measured)[use]
        return np.asarray(np.clip(off, -1e3, 1e3))

    step = np.array([1e-4, 1e-4, 1e-3, 1e-3, 1e-3, 1e-3, 1e-3][: len(keys)])
    begun = [np.array([*speeds, *gains][: len(keys)]) for gains in FIRST_GAINS[form]]
    tried = [
        least_squares(
            residuals, np.clip(begin, low, high), bounds=(low, high), x_scale=np.maximum(begin, 10.0 * step),
            diff_step=step, loss="soft_l1", f_scale=ROBUST_AT,
        )
        for begin in begun
    ]  # fmt: skip
    found = min(tried, key=attrgetter("cost"))
    trial = np.broadcast_to(recording.trial[:, None], use.shape)[use]
    told = intervals(keys, found.x, (low, high), residuals, trial, robust_at=ROBUST_AT)
    return _with(base, dict(zip(keys, found.x.tolist(), strict=True))), *told


def _speed_bounds(base: Profile) -> tuple[float, float]:
    """Bounds of a wheel's speed per unit, cm/s."""
    usual = sum(base.wheels.speed_per_unit_cm_s) / 2
    return SPEED_BOUNDS[0] * usual, SPEED_BOUNDS[1] * usual


def _told(recording: WheelRecording, measured: Floats) -> NDArray[np.bool_]:
    """[n, 2] speeds that are known and determined by the trial's commands alone.

    A wheel's first start in a trial is excluded: its previous direction is unknown.
    """
    use = np.isfinite(measured)
    for rows in recording.trials():
        for w in range(2):
            moves = np.flatnonzero(recording.commands[rows, w])
            if len(moves):
                use[rows[: moves[0] + FIRST_STEPS], w] = False
    return np.asarray(use)


def _stable(base: Profile, law: dict[str, float]) -> bool:
    """Whether a wheel with these gains settles, and goes no further than a radius in a step at command 1;
    otherwise no profile could hold it."""
    if max(law[key] for key in SPEED_KEYS) * base.period_s > base.body.radius_cm:
        return False
    kp, ki, kd = (law.get(key, getattr(base.wheels, key)) for key in ("kp", "ki", "kd"))
    return largest_pole(kp, ki, kd, base.wheels.divisor) < SETTLING


def _with(base: Profile, values: dict[str, float]) -> Profile:
    wheels = base.wheels
    gains = {key: values[key] for key in (*GAINS, "play_cm") if key in values}
    speeds = (values["speed_left"], values["speed_right"])
    # A little below the loader's bound, because of rounding.
    top = min(wheels.top_command, base.body.radius_cm / base.period_s / max(speeds) * (1 - 1e-9))
    return replace(base, wheels=replace(wheels, speed_per_unit_cm_s=speeds, top_command=top, **gains))


def _steady(recording: WheelRecording, measured: Floats) -> list[float]:
    """Speed per unit of each wheel where its command was constant for half a second, cm/s."""
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
