"""The wheels' fit (§3.2.2): gains and speed per unit from the counters, lengths from a camera.

Counters show how a wheel follows its command, in pulses; pulses per millimetre, the track and slip can only
be seen from outside (odometry.py).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from operator import attrgetter
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from realitygap.calibration.fit import SIGMAS, Tick, blind_pairs, bounded, filling
from realitygap.calibration.model import wheel_speeds
from realitygap.calibration.odometry import Odometry, enough_pictures, measure_odometry, measured_speeds
from realitygap.calibration.recordings import PULSES_PER_MM, WheelRecording
from realitygap.errors import CalibrationError
from realitygap.kernels.types import STEP_S
from realitygap.values import Floats
from realitygap.world.robot import Constant, Profile, largest_pole

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
ROUGH, OTHER_UNIT = 1.15, 4.0
"""Factor between fitted and base speeds beyond which the unit of commands is doubted."""
FIRST_STEPS = 2
"""Number of steps affected by a wheel's first start in a trial, since its previous direction is unknown."""


class Friction(NamedTuple):
    """`|I|` that frees a resting wheel (cm/s²): between `low` and `high` by the standing starts."""

    value: float
    low: float
    high: float
    starts: int


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
    """Fit a profile's wheels to a recording; constants that it says nothing of stay the base's."""
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
    _refuse_unit(recording, profile, base)
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


def _refuse_unit(recording: WheelRecording, profile: Profile, base: Profile) -> None:
    """Refuse commands in a smaller unit, such as mm/s: evolution's top command would be a crawl, and the
    robot many times as fast as simulated. An e-puck's, above its top_command, are followed as the base says.
    """
    most, top = float(np.abs(recording.commands).max(initial=0.0)), base.wheels.top_command
    if most > top and _apart(profile, base) > OTHER_UNIT:
        unit = 5.0 * sum(base.wheels.speed_per_unit_cm_s)
        raise CalibrationError(
            f"{recording.source}: commands up to {most:g}, expected at most {top:g}, the top_command of "
            f"profile {base.name!r}, in units of {unit:.3g} mm/s. Are these mm/s? Divide them by "
            f"{unit:.3g}; or give the robot's own unit, wheels.speed_per_unit_cm_s, in --base."
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
    told = intervals(keys, found.x, (low, high), residuals, trial)
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


# Static friction, from the delay at standing starts

MOVING_SHARE = 0.1
"""A wheel has started when it exceeds this share of the commanded speed."""


def measure_friction(recording: WheelRecording, measured: Floats) -> Friction | None:
    """The range of thresholds that explains the wheels' delays at standing starts, from speeds [n, 2], cm/s.

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


# Intervals, and which constants the counters cannot separate

ASSUMED = 0.02
"""Relative uncertainty of pulses per mm where they were not measured: sources say 12 or 12.5."""
LENGTHS = {"speed_left": (0,), "speed_right": (1,), "play_cm": (0, 1)}
"""Constants in cm, and the wheels whose cm per pulse they depend on."""
STEP = 1e-4
"""Step of the derivatives: this share of a value, or of a hundredth of its range."""
FEWEST_TRIALS, ROWS = 10, 20
"""With fewer trials the rows are grouped by this many (2 s)."""


def intervals(
    names: Sequence[str],
    theta: Floats,
    bounds: tuple[Floats, Floats],
    residuals: Callable[[Floats], Floats],
    trial: NDArray[np.int64],
) -> tuple[tuple[Constant, ...], tuple[tuple[str, str, float], ...]]:
    """Constants with 95 % intervals, and pairs that the residuals cannot separate.

    Steps of one trial [n] have correlated errors: the covariance is the sandwich clustered by trials (Liang
    and Zeger 1986), at least that of independent steps. A constant without effect gets its whole range; one
    whose interval ends at a bound is not identifiable (not `told`).
    """
    low, high = bounds
    off = residuals(theta)
    z = (off / ROBUST_AT) ** 2
    columns = _columns(theta, bounds, residuals, off) * (high - low)
    curvature = columns.T @ (columns * (1.0 + z)[:, None] ** -1.5)  # soft L1's second derivative
    variance = max(float((off**2 / np.sqrt(1.0 + z)).sum()) / max(len(off) - len(theta), 1), 1e-300)
    # Without information all values within the bounds are equally likely: no division by zero.
    bread = np.linalg.inv(curvature / variance + np.eye(len(theta)))
    scores = columns * (off / np.sqrt(1.0 + z) / variance)[:, None]
    inner = filling(scores, _groups(trial)) + np.eye(len(theta))
    spread = np.maximum(np.diag(bread @ inner @ bread), np.diag(bread))
    deviation = np.sqrt(spread) * (high - low)
    told = (low < theta - SIGMAS * deviation) & (theta + SIGMAS * deviation < high)
    return bounded(names, theta, deviation, low, high, told), blind_pairs(names, curvature)


def with_lengths(constants: Sequence[Constant], odometry: Odometry | None) -> tuple[Constant, ...]:
    """Constants in cm with the uncertainty of the pulses' length added; not identifiable where that length is
    assumed."""
    shares = (ASSUMED, ASSUMED)
    if odometry is not None:
        lengths = {c.key: (c.high - c.low) / 2 / SIGMAS / c.value for c in odometry.constants}
        shares = (lengths.get("cm_per_pulse_left", 0.0), lengths.get("cm_per_pulse_right", 0.0))
    out = []
    for c in constants:
        share = max((shares[w] for w in LENGTHS.get(c.key, ())), default=0.0)
        below, above = (np.hypot(end - c.value, SIGMAS * share * c.value) for end in (c.low, c.high))
        wide = replace(
            c, low=max(float(c.value - below), 0.0), high=float(c.value + above),
            told=c.told and (odometry is not None or c.key not in LENGTHS),
        )  # fmt: skip
        out.append(wide)
    return tuple(out)


def at_bound(value: float, low: float, high: float) -> bool:
    """Whether a fitted value is at one of its bounds."""
    span = 1e-4 * (high - low)
    return not low + span < value < high - span


def _groups(trial: NDArray[np.int64]) -> NDArray[np.int64]:
    """[n] numbers of rows with correlated errors: a trial's, or a piece's where trials are few."""
    numbers = np.unique(trial, return_inverse=True)[1]
    if int(numbers.max(initial=0)) + 1 < FEWEST_TRIALS:
        numbers = np.unique(numbers * len(trial) + np.arange(len(trial)) // ROWS, return_inverse=True)[1]
    return np.asarray(numbers)


def _columns(
    theta: Floats, bounds: tuple[Floats, Floats], residuals: Callable[[Floats], Floats], off: Floats
) -> Floats:
    """[n, p] derivatives within the bounds; of both directions the smaller one, since unstable gains may be
    near."""
    low, high = bounds
    out = np.empty((len(off), len(theta)))
    for i, value in enumerate(theta):
        step = STEP * max(abs(value), 0.01 * (high[i] - low[i]))
        ways = []
        for to in (value + step, value - step):
            if low[i] <= to <= high[i]:
                moved = theta.copy()
                moved[i] = to
                ways.append((residuals(moved) - off) / (to - value))
        out[:, i] = min(ways, key=np.linalg.norm)
    return out


# What no such wheels can have made

SIDES = ("left", "right")
FEWEST_STEPS = 30
AGAINST, OTHERS = -0.3, 0.2
"""Cosine of pulses and commands below which a counter runs against its command; and the advantage of the
other wheel's command from which on columns count as swapped."""
PULSES_SHARE = (0.5, 25.0 / 12.0)
"""Range of pulses per mm by camera, as a share of the value known in advance."""
TRACK_SHARE = 0.3
EXPLAINED = 0.5


def refuse_odd(recording: WheelRecording, odometry: Odometry | None, base: Profile) -> None:
    """Refuse a recording that no robot like the base can have made, using the camera's data."""
    for w, side in enumerate(SIDES):
        if not (recording.commands[:, w] != 0).any():
            raise CalibrationError(f"{recording.source}: the {side} wheel was never told to move.")
        if np.ptp(recording.counters[:, w]) == 0:
            raise CalibrationError(f"{recording.source}: counter_{side} never changes: it looks dead.")
    if recording.counted:
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
    if odometry is not None:
        _refuse_lengths(recording, odometry, base)
    elif enough_pictures(recording, base.wheels.track_cm):
        raise CalibrationError(
            f"{recording.source}: the camera's poses fit no wheels with these counters or commands. Are x_cm "
            "and y_cm in cm, heading_deg in degrees, and commands in units of --base? Without these three "
            "columns counters alone are used."
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
    """Refuse a fit that explains less than half of the variation of the speeds [n, 2], or whose speeds per
    unit ended at their bounds (`bounded`, cm/s)."""
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
