"""The wheels' fit (§3.2.2): gains and speed per unit from the counters, lengths from a camera.

Counters show how a wheel follows its command, in pulses; pulses per millimetre, the track and slip can only
be seen from outside (odometry.py).
"""

from collections.abc import Collection
from dataclasses import dataclass, field, replace
from operator import attrgetter
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from realitygap.calibration.fit import SIGMAS, Fit, Observed, Outcome, Parameter, Tick, Values, fit, value_of
from realitygap.calibration.law import Law, fit_law, groups
from realitygap.calibration.model import wheel_speeds
from realitygap.calibration.odometry import FEWEST, Odometry, measure_odometry, measured_speeds
from realitygap.calibration.recordings import PULSES_PER_MM, WheelRecording
from realitygap.errors import CalibrationError
from realitygap.kernels.types import STEP_S
from realitygap.values import Floats
from realitygap.world.robot import Constant, Profile, largest_pole

WHEEL_FORMS = ("printed", "refitted")
""""printed": the paper's gains; "refitted": free gains, a lag, and play on reversal. Both fit the speed per
unit."""
ODOMETRY = "odometry"
"""The form of drives without commands: lengths only, the base's law."""
SPEED_KEYS, SPEED_BOUNDS = ("speed_left", "speed_right"), (0.0625, 25.0)
"""Speeds per unit, and their bounds relative to the base's."""
GAINS = {
    "kp": (100.0, 9500.0, 4.0), "ki": (0.0, 4000.0, 1.0), "kd": (0.0, 40000.0, 1.0), "lag": (0.0, 1.0, 1e-3),
    "play_cm": (0.0, 0.5, 1e-3),
}  # fmt: skip
"""Bounds of what is free in the form "refitted", and steps of the derivatives."""
PRINTED = {"kp": 3800.0, "ki": 800.0, "kd": 100.0, "divisor": 50000.0, "lag": 0.0, "play_cm": 0.0}
"""§3.2.2, whatever the base has; lag and play are not in the paper."""
FIRST_GAINS: dict[str, tuple[tuple[float, ...], ...]] = {
    "printed": ((),),
    "refitted": (
        (3800.0, 100.0, 100.0, 0.1, 0.01), (4800.0, 1.0, 1.0, 0.4, 0.08), (6000.0, 1.0, 1.0, 0.25, 0.0),
    ),
}  # fmt: skip
"""Starting values of a form: gains, lag and play."""
NOISE_CM_S, SETTLING = 0.1, 0.999
"""Deviation by which residuals are weighed; the largest pole that is tried."""
SETTLED, BENT, AT_BOUND = 5, 0.1, 0.98
"""Steps after which a wheel has its speed; share of the top speed by which a settled one may be off the
fitted law before it is called not proportional; share of a bound from which on a constant is at it."""
LATEST = 10
"""Steps by which commands are tried to act late."""
ROUNDS = 3
"""Of odometry by commands and of curves by that odometry, where wheels have no counters."""
FEW = 0.01
"""Share of steps that may go unused in silence."""
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
        form: one of WHEEL_FORMS, or ODOMETRY.
        constants: with their intervals.
        alike: pairs that the counters cannot separate, with their correlation.
        rmse: of each form's speeds against the counters', cm/s; empty without commands.
        friction: from the standing starts.
        odometry: from the camera; None without one, or if it saw too little.
        law: of command to settled speed; None without commands.
        camera: whether there are any pictures.
        pulses_per_mm: of both counters, measured or known in advance; empty without counters.
        late_s: how late, in whole steps, the wheels follow their commands best.
        bent: wheel, command, and the share of the fitted speed at which it settles, where that is not
            proportional to the command though one constant was kept.
        unused: steps that last no whole number of periods: no form is fitted to them.
        measured, model: [n, 2] speeds in the step after each row, cm/s.
    """

    profile: Profile
    form: str
    constants: tuple[Constant, ...]
    alike: tuple[tuple[str, str, float], ...]
    rmse: dict[str, float]
    friction: Friction | None
    odometry: Odometry | None
    law: Law | None
    camera: bool
    pulses_per_mm: tuple[float, ...]
    late_s: float
    bent: tuple[str, float, float] | None
    unused: int
    measured: Floats = field(repr=False)
    model: Floats = field(repr=False)


def fit_wheels(recording: WheelRecording, base: Profile, form: str, *, tick: Tick = lambda: None) -> WheelFit:
    """Fit a profile's wheels to a recording; constants that it says nothing of stay the base's."""
    assumed = recording.counted and not (recording.pulses_said or base.provenance.pulses_per_mm)
    if not recording.commanded:
        tick()
        return _odometry_only(recording.of_robot(base), base)
    base = replace(base, wheels=replace(base.wheels, curve_left=(), curve_right=()))
    given = recording = recording.of_robot(base)
    refuse_odd(given)
    straightened = None
    for _ in range(ROUNDS):
        odometry = measure_odometry(recording, base, straightened)
        if odometry is not None:
            refuse_lengths(recording, odometry, base)
        per_pulse = odometry.cm_per_pulse if odometry else (0.1 / recording.pulses_per_mm,) * 2
        measured = measured_speeds(recording, odometry, per_pulse)
        refuse_few_steps(recording, measured)
        straightened = Straightened(given, base, measured)
        law, was, recording = straightened.law, recording, straightened()
        if recording is was or not given.from_commands:
            break
    # With a camera alone it is unknown in which step a wheel began to turn.
    friction = measure_friction(recording, measured) if recording.counted else None
    track = odometry.track_cm if odometry else base.wheels.track_cm
    threshold = friction.value if friction else base.wheels.friction_cm_s2
    start = replace(base, wheels=replace(base.wheels, track_cm=track, friction_cm_s2=threshold))
    fits = {name: _fit(name, start, recording, measured) for name in WHEEL_FORMS}
    profile, found = fits[form].profile, fits[form].fit
    constants = _with_others(found.constants, odometry, friction)
    if assumed and odometry is None:
        _refuse_assumed(recording, profile, base)
    _refuse_unit(given, profile, base)
    profile = _curved(profile, law, base.wheels.top_command)
    if odometry is not None:
        profile = replace(profile, noise=replace(profile.noise, wheel=odometry.slip))
    model = wheel_speeds(profile, given)
    refuse_wheels(recording, measured, model, found)
    tick()
    return WheelFit(
        profile=profile, form=form, constants=constants, alike=found.alike,
        rmse={name: float(np.sqrt(np.nanmean((one.fit.model - measured) ** 2)))
              for name, one in fits.items()},
        friction=friction, odometry=odometry, law=law,
        camera=recording.pose is not None and bool(np.isfinite(recording.pose).any()),
        pulses_per_mm=_pulses(recording, per_pulse), unused=_unused(recording, measured),
        late_s=_late(recording, profile, measured), measured=measured, model=model,
        bent=None if law.curves else _bent(recording, profile, measured),
    )  # fmt: skip


def _odometry_only(recording: WheelRecording, base: Profile) -> WheelFit:
    """The fit of drives of which no commands are known: track, pulses and slip, and the base's law."""
    odometry = measure_odometry(recording, base)
    if odometry is None:
        raise CalibrationError(
            f"{recording.source}: expected commands, or poses at {FEWEST} places of the counters or more: "
            "counters alone tell nothing of the wheels. Add either."
        )
    refuse_lengths(recording, odometry, base)
    measured = measured_speeds(recording, odometry, odometry.cm_per_pulse)
    profile = replace(
        base, wheels=replace(base.wheels, track_cm=odometry.track_cm),
        noise=replace(base.noise, wheel=odometry.slip),
    )  # fmt: skip
    if recording.in_units:
        profile = _with(profile, dict(zip(SPEED_KEYS, odometry.cm_per_pulse, strict=True)))
    return WheelFit(
        profile=profile,
        form=ODOMETRY, constants=odometry.constants, alike=(), rmse={}, friction=None, odometry=odometry,
        law=None, camera=True, pulses_per_mm=_pulses(recording, odometry.cm_per_pulse), late_s=0.0, bent=None,
        unused=0, measured=measured, model=np.full_like(measured, np.nan),
    )  # fmt: skip


def _pulses(recording: WheelRecording, cm_per_pulse: tuple[float, float]) -> tuple[float, ...]:
    """Of real counters, pulses per mm."""
    real = recording.counted and not recording.from_speeds
    return tuple(0.1 / length for length in cm_per_pulse if real)


def _unused(recording: WheelRecording, measured: Floats) -> int:
    """Steps within trials whose speeds [n, 2] nobody knows."""
    return int((np.isnan(measured[:-1]).any(axis=1) & (np.diff(recording.trial) == 0)).sum())


class Straightened:
    """A recording with the commands of wheels without curves that settle at the same speeds [n, 2], cm/s."""

    def __init__(self, recording: WheelRecording, base: Profile, measured: Floats) -> None:
        self._given, self._base, self._measured = recording, base, measured
        self.law = fit_law(recording, measured, base.wheels.top_command)

    def __call__(self, without: Collection[int] = ()) -> WheelRecording:
        """By a law that is chosen and fitted without some trials; as it was where that is one constant."""
        given, top, law = self._given, self._base.wheels.top_command, self.law
        if len(without):
            out = np.isin(given.trial, list(without))[:, None]
            law = fit_law(given, np.where(out, np.nan, self._measured), top)
        if not law.curves:
            return given
        return replace(given, commands=law.straight(given.commands, top)).of_robot(self._base)


def doubts(wheels: WheelFit, base: Profile) -> list[str]:
    """Warnings about fitted wheels."""
    out = []
    if wheels.form == ODOMETRY:
        out.append(
            f"wheels: no commands recorded: lengths alone are fitted; the wheels' law stays as profile "
            f"{base.name!r} has it"
        )
    if wheels.unused > FEW * len(wheels.measured) and wheels.rmse:
        out.append(
            f"wheels: speeds and gains are fitted to {len(wheels.measured) - wheels.unused} of "
            f"{len(wheels.measured)} steps: the others last no whole number of periods of {base.period_s:g} s"
        )
    if wheels.odometry is None:
        seen = "a camera saw too little" if wheels.camera else "no camera saw the robot"
        out.append(
            f"wheels: {seen}: {wheels.pulses_per_mm[0]:g} pulses per mm are assumed (what recording.toml "
            f"says of pulses_per_mm, else the base profile, else a Khepera's {PULSES_PER_MM:g}), track and "
            "noise of the wheels are the base profile's"
            if wheels.pulses_per_mm
            else f"wheels: {seen}: track and noise of the wheels are the base profile's"
        )
    known, found = base.wheels.speed_per_unit_cm_s, wheels.profile.wheels.speed_per_unit_cm_s
    if wheels.law is not None and not wheels.law.curves and _apart(wheels.profile, base) > ROUGH:
        out.append(
            f"wheels: {found[0]:.3g} and {found[1]:.3g} cm/s a unit, where profile {base.name!r} has "
            f"{known[0]:.3g} and {known[1]:.3g}: were commands written in another unit, as cm/s or mm/s? "
            "Write them as the robot is given them"
            + ("" if wheels.odometry else "; or is it pulses_per_mm? State the robot's in recording.toml")
        )
    better = wheels.rmse["printed"] / max(wheels.rmse["refitted"], 1e-9) if wheels.rmse else 1.0
    if wheels.form == "printed" and better > 1.5:
        out.append(
            f"wheels: the printed gains leave {wheels.rmse['printed']:.2f} cm/s, refitted ones "
            f"{wheels.rmse['refitted']:.2f}: this misfit is no noise"
        )
    for key, value in ((c.key, c.value) for c in wheels.constants if c.key in GAINS):
        low, high, _ = GAINS[key]
        if value > AT_BOUND * high or value < low / AT_BOUND:  # 0 is none of it
            bound, why = f"{high if value > AT_BOUND * high else low:g}", "these wheels follow another law"
            if key == "lag":
                more = wheels.late_s > wheels.profile.period_s
                bound, why = "one step", "commands act a whole step late"
                why = f"commands act later than a step, about {wheels.late_s:.2g} s late" if more else why
            out.append(f"wheels: {key}: at its bound of {bound}: {why}")
    if wheels.bent is not None:
        side, command, share = wheels.bent
        out.append(
            f"wheels: the speed is not proportional to the command: at {command:g} the {side} wheel settles "
            f"at {abs(share):.0%} of the fitted speed"
        )
    if (by := wheels.odometry) is None:
        return out
    if any(c.key == "track_cm" and not c.told for c in by.constants):
        out.append(
            "wheels: no turns: the track stays near the base profile's"
            if all(c.told for c in by.lengths)
            else "wheels: nothing but turns on the spot tells only how fast a wheel is over the track: both "
            "stay near the base profile's"
        )
    if by.halves is not None:
        out.append(
            "wheels: trials disagree: the first half of them gives a track of {:.3g} cm, the second {:.3g} "
            "cm: two floors?".format(*by.halves)
        )
    return out


def _bent(recording: WheelRecording, profile: Profile, measured: Floats) -> tuple[str, float, float] | None:
    """The wheel and command whose settled speed is farthest from proportional, and its share of the fitted
    speed; None if all are within BENT of the top speed."""
    found: list[tuple[float, str, float, float]] = []
    for w, side in enumerate(SIDES):
        per_unit, command = profile.wheels.speed_per_unit_cm_s[w], recording.commands[:, w]
        use = (recording.since_change()[:, w] >= SETTLED) & (command != 0) & np.isfinite(measured[:, w])
        for value in np.unique(command[use]).tolist():
            speeds = measured[use & (command == value), w]
            off = abs(float(np.median(speeds)) - value * per_unit)
            if len(speeds) >= SETTLED:
                found.append((off, side, value, float(np.median(speeds)) / (value * per_unit)))
    top = max((abs(value) for *_, value, _ in found), default=0.0) * max(profile.wheels.speed_per_unit_cm_s)
    worst = max(found, default=None)
    return worst[1:] if worst is not None and worst[0] > BENT * top else None


def _late(recording: WheelRecording, profile: Profile, measured: Floats) -> float:
    """By how many seconds the speeds [n, 2] follow best what was asked, from 0 to LATEST steps."""
    asked = recording.commands * np.array(profile.wheels.speed_per_unit_cm_s)
    rows = np.concatenate([rows[LATEST:] for rows in recording.trials()])
    off = [np.nansum((measured[rows] - asked[rows - late]) ** 2) for late in range(LATEST + 1)]
    return float(np.argmin(off)) * profile.period_s


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


def _fit(form: str, base: Profile, recording: WheelRecording, measured: Floats) -> Outcome:
    """One form's profile and fit.

    Free are the speed per unit of each wheel, and in the form "refitted" the gains, the lag and the play too;
    one whose interval reaches a bound is not identifiable.
    """
    if form == "printed":
        base = replace(base, wheels=replace(base.wheels, **PRINTED))  # type: ignore[arg-type]
    usual = sum(base.wheels.speed_per_unit_cm_s) / 2
    slow, fast = (share * usual for share in SPEED_BOUNDS)
    free = dict.fromkeys(SPEED_KEYS, (slow, fast, 1e-4 * usual)) | (GAINS if form == "refitted" else {})
    data = Observed(
        counts=measured, noise=NOISE_CM_S, use=_told(recording, measured), clusters=groups(recording.trial)
    )

    def model(values: Values) -> Floats:
        law = {key: value_of(values, key) for key in values}
        return (
            wheel_speeds(_with(base, law), recording)
            if _stable(base, law)
            else np.full_like(measured, np.inf)
        )

    tried = []
    for gains in FIRST_GAINS[form]:
        begun = zip(free.items(), (*_steady(recording, measured), *gains), strict=True)
        parameters = [
            Parameter(key=key, start=np.clip([value], low, high), low=low, high=high, step=step)
            for (key, (low, high, step)), value in begun
        ]
        tried.append(fit(parameters, model, data))
    found = min(tried, key=attrgetter("cost"))
    constants = tuple(
        replace(c, told=c.told and free[c.key][0] < c.low and c.high < free[c.key][1])
        for c in found.constants
    )
    law = {key: value_of(found.values, key) for key in free}
    return Outcome(profile=_with(base, law), fit=replace(found, constants=constants))


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
    gains = {key: values[key] for key in GAINS if key in values}
    speeds = (values["speed_left"], values["speed_right"])
    # A little below the loader's bound, because of rounding.
    top = min(wheels.top_command, base.body.radius_cm / base.period_s / max(speeds) * (1 - 1e-9))
    wheels = replace(wheels, speed_per_unit_cm_s=speeds, top_command=top, **gains)  # type: ignore[arg-type]
    return replace(base, wheels=wheels)


def _curved(profile: Profile, law: Law, top: float) -> Profile:
    """With the law's curves, as far as a speed per unit fitted to straightened commands says; and a top
    command at which the robot goes no further than a radius in a step."""
    if not law.curves:
        return profile
    wheels, most = profile.wheels, profile.body.radius_cm / profile.period_s
    shares = np.array(wheels.speed_per_unit_cm_s) / law.unit(top)
    curves = [
        np.column_stack([curve[:, 0], share * curve[:, 1]]).round(6).tolist()
        for curve, share in zip(law.curves, shares, strict=True)
    ]
    wheels = replace(wheels, curve_left=curves[0], curve_right=curves[1], top_command=top)
    while wheels.top_speed_cm_s > most:
        wheels = replace(wheels, top_command=0.99 * wheels.top_command)
    return replace(profile, wheels=wheels)


def _steady(recording: WheelRecording, measured: Floats) -> list[float]:
    """Speed per unit of each wheel where its command was constant for half a second, cm/s."""
    out = []
    for w in range(2):
        command = recording.commands[:, w]
        use = (recording.since_change()[:, w] >= SETTLED) & (command != 0) & np.isfinite(measured[:, w])
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


# Intervals

ASSUMED = 0.02
"""Relative uncertainty of pulses per mm where they were not measured: sources say 12 or 12.5."""
LENGTHS = {"speed_left": (0,), "speed_right": (1,), "play_cm": (0, 1)}
"""Constants in cm, and the wheels whose cm per pulse they depend on."""


def _with_others(
    constants: tuple[Constant, ...], odometry: Odometry | None, friction: Friction | None
) -> tuple[Constant, ...]:
    """A form's constants, those in cm with the uncertainty of the pulses' length added, not identifiable
    where that is assumed; and those from the camera and the standing starts."""
    shares, known = [SIGMAS * ASSUMED] * 2, [False] * 2
    if odometry is not None:
        known = [c.told for c in odometry.lengths]
        # Speeds that the camera itself measured err with lengths only where these are unknown.
        pulses = any(c.key.startswith("cm_per_pulse") for c in odometry.constants)
        shares = [(c.high - c.low) / 2 / c.value if pulses or not c.told else 0.0 for c in odometry.lengths]
    out = []
    for c in constants:
        size = max((shares[w] for w in LENGTHS.get(c.key, ())), default=0.0) * c.value
        low, high = c.value - np.hypot(c.low - c.value, size), c.value + np.hypot(c.high - c.value, size)
        told = c.told and all(known[w] for w in LENGTHS.get(c.key, ()))
        out.append(replace(c, low=max(float(low), 0.0), high=float(high), told=told))
    out += odometry.constants if odometry else ()
    if friction is not None:
        value, least, most, _ = friction
        out.append(Constant(key="friction_cm_s2", value=value, low=least, high=most, told=least > 0))
    return tuple(out)


# What no such wheels can have made

SIDES = ("left", "right")
FEWEST_STEPS = 30
AGAINST, OTHERS = -0.3, 0.2
"""Cosine of pulses and commands below which a counter runs against its command; and the advantage of the
other wheel's command from which on columns count as swapped."""
PULSES_SHARE = (0.5, 25.0 / 12.0)
"""Range of pulses per mm by camera, as a share of the value known in advance."""
TRACK_FACTOR, MOST_SLIP = 2.0, 0.5
EXPLAINED = 0.5


def refuse_odd(recording: WheelRecording) -> None:
    """Refuse commands and counters that do not belong together."""
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


def refuse_few_steps(recording: WheelRecording, measured: Floats) -> None:
    """Refuse a recording with too few speeds [n, 2]."""
    known = int(np.isfinite(measured).sum()) // 2
    if known < FEWEST_STEPS:
        apart = np.diff(recording.t_s)[np.diff(recording.trial) == 0]
        rows = f"rows are {np.median(apart):.3g} s apart" if len(apart) else "its trials have one row each"
        raise CalibrationError(
            f"{recording.source}: expected {FEWEST_STEPS} steps or more of {recording.period_s:g} s, or of "
            f"twice that and so on, got {known}: {rows}. Record more, or give the robot's period_s in --base."
        )


def refuse_lengths(recording: WheelRecording, odometry: Odometry, base: Profile) -> None:
    """Refuse impossible pulses per mm (without counters: speeds per unit), tracks and slip."""
    cure = "Are x_cm and y_cm in cm, heading_deg in degrees, and counters in pulses?"
    low, high = (share * recording.pulses_per_mm for share in PULSES_SHARE)
    for side, length in zip(SIDES, odometry.cm_per_pulse, strict=True):
        pulses = 0.1 / length if length else np.inf
        if low <= pulses <= high:
            continue
        expected, got = f"{low:g} to {high:g} pulses per mm", pulses
        if recording.in_units:
            expected, got = f"{0.1 / high:.3g} to {0.1 / low:.3g} cm/s a unit", length
            cure = f"Are commands in units of profile {base.name!r}, x_cm and y_cm in cm?"
        elif recording.from_speeds:
            expected, got = f"{0.1 / high:.3g} to {0.1 / low:.3g} cm/s for each cm/s", length
            cure = "Are the units of places and speeds right?"
        elif not recording.pulses_said:
            cure = f"State the robot's pulses_per_mm in recording.toml. {cure}"
        raise CalibrationError(
            f"{recording.source}: {side} wheel: expected {expected} by the camera, got {got:.3g}. {cure}"
        )
    least, most = base.wheels.track_cm / TRACK_FACTOR, base.wheels.track_cm * TRACK_FACTOR
    if not least <= odometry.track_cm <= most:
        raise CalibrationError(
            f"{recording.source}: track: expected {least:.1f} to {most:.1f} cm, as profile {base.name!r} has "
            f"{base.wheels.track_cm:g} cm, got {odometry.track_cm:.3g} cm by the camera. {cure}"
        )
    if odometry.slip > MOST_SLIP:
        raise CalibrationError(
            f"{recording.source}: the camera's poses fit no wheels with these counters or commands. {cure}"
        )


def refuse_wheels(recording: WheelRecording, measured: Floats, model: Floats, found: Fit) -> None:
    """Refuse a fit that explains less than half of the variation of the speeds [n, 2], or whose speeds per
    unit ended at their bounds."""
    for w, side in enumerate(SIDES):
        known = np.isfinite(measured[:, w])
        off = ((model - measured)[known, w] ** 2).sum()
        share = 1.0 - off / max(float((measured[known, w] ** 2).sum()), 1e-12)
        if share < EXPLAINED:
            raise CalibrationError(
                f"{recording.source}: the fitted law explains only {max(0.0, share):.0%} of how the {side} "
                "wheel turned: these counters or poses do not belong to these commands."
            )
    for key in SPEED_KEYS:
        if key in found.at_bounds:
            raise CalibrationError(
                f"{recording.source}: {key}: {value_of(found.values, key):g} cm/s per unit, the utmost that "
                "is tried: no wheel of this robot. Are commands in its units, as --base has them, and "
                "counters in pulses?"
            )
