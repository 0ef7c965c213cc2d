"""Fits of a sensor channel in all its forms, side by side, each judged on places held out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from realitygap.calibration.checks import dead_sensors, refuse_nonsense, refuse_swapped, refuse_units
from realitygap.calibration.forward import scene_of
from realitygap.calibration.infrared import INFRARED_FORMS, infrared_frees, infrared_model, with_infrared
from realitygap.calibration.judge import LIMITS, Misfit, measure_noise, misfits
from realitygap.calibration.light import (
    LIGHT_FORMS,
    LightMemory,
    as_bright_as_the_paper,
    light_frees,
    light_model,
    with_light,
)
from realitygap.calibration.noise import NoiseEstimate
from realitygap.calibration.solve import Fit, Free, Model, Values, solve
from realitygap.errors import CalibrationError

if TYPE_CHECKING:
    from realitygap.calibration.recording import SensorRecording
    from realitygap.world.profile import Profile

__all__ = ["ChannelFit", "fit_infrared", "fit_light"]

Array = NDArray[np.float64]

NEUTRAL = {"offset_cm": np.zeros(1), "exponent": np.ones(1)}
SCANS_DEG, SCAN = (12.0, 3.0), 17
"""How far directions are looked for on either side, one search after another, and in how many steps."""
LIGHT_RAYS = 50.0
"""By so many rays reflected light comes in where a room is known: ten see a shadow's edge in steps of 18°."""
FOLDS = 4
OVERFITTED = 1.3
"""Held-out RMSE over the fitted one, from which on a form is said to fit more than the robot."""
PROXIMITY_COUNTS, AMBIENT_COUNTS = 21.0, 4.5
"""Noise that residuals are weighed by before it is measured."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ChannelFit:
    """One kind of sensor, fitted.

    Attributes:
        kind: "infrared" or "ambient".
        form: the form that was asked for.
        profile: the base with this form's constants in place.
        fit: constants, intervals, what cannot be told apart.
        by_form: RMSE of every form, counts; held_out: of those that were tried on places held out.
        noise: what could be measured of it.
        sensors: each sensor's misfit.
        dead: sensors that told nothing, and why.
        warnings: in words.
        distance_cm, bearing_deg: [n] of all rows; NaN where poses are all that is known.
        counts, model: [n, S].
        span: [S, 2] what each sensor's readings really span.
    """

    kind: str
    form: str
    profile: Profile
    fit: Fit
    by_form: dict[str, float]
    held_out: dict[str, float]
    noise: tuple[NoiseEstimate, ...]
    sensors: tuple[Misfit, ...]
    dead: dict[int, str]
    warnings: tuple[str, ...]
    source: str
    distance_cm: Array = field(repr=False)
    bearing_deg: Array = field(repr=False)
    counts: Array = field(repr=False)
    model: Array = field(repr=False)
    span: Array = field(repr=False)

    @property
    def rmse(self) -> float:
        """Of the form that was asked for, all sensors that live, counts."""
        return self.by_form[self.form]


@dataclass(frozen=True, kw_only=True, eq=False)
class _Problem:
    """One form's fit: what is free, the model, and how values become a profile."""

    frees: list[Free]
    model: Model
    base: Profile
    steep: bool = False


class _Rows:
    """The rows of several recordings of one kind, one after another."""

    def __init__(self, recordings: Sequence[SensorRecording], base: Profile) -> None:
        self.recordings = recordings
        self.dead: dict[int, str] = {}
        warned: list[str] = []
        for recording in recordings:
            refuse_units(recording)
            dead = dead_sensors(recording)
            warned += [f"{recording.source}: {reason}" for reason in dead.values()]
            warned += refuse_swapped(recording, base, dead)
            self.dead |= dead
        self.warnings = tuple(warned)
        self.counts = np.concatenate([r.counts for r in recordings])
        self.distance = np.concatenate([r.distance_cm for r in recordings])
        self.bearing = np.concatenate([r.bearing_deg for r in recordings])
        self.scenes = [(f"turn_{i}_deg", scene_of(r)) for i, r in enumerate(recordings)]
        places, first = [], 0
        for recording in recordings:
            places.append(recording.place() + first)
            first = int(places[-1].max()) + 1
        self.place = np.concatenate(places)
        self.use = np.ones(self.counts.shape, bool)
        self.use[:, list(self.dead)] = False
        self.block = self._blocks()

    def _blocks(self) -> NDArray[np.int64]:
        """[n] patches of neighbouring distances and bearings: what errs, and is held out, together."""
        known = np.isfinite(self.distance) & np.isfinite(self.bearing)
        if not known.all() or self.recordings[0].pose is not None:
            return self.place
        _, rank = np.unique(self.distance, return_inverse=True)
        thick = max(1, (int(rank.max()) + 1) // 6)
        patch = (rank // thick) * 18 + ((self.bearing + 180.0) // 20.0).astype(np.int64)
        of = np.concatenate([np.full(len(r.counts), i) for i, r in enumerate(self.recordings)])
        return np.asarray(of * 10_000 + patch, np.int64)

    def folds(self) -> NDArray[np.int64]:
        """[n] which fold a row is held out with."""
        numbers = np.unique(self.block, return_inverse=True)[1]
        order = np.random.default_rng(0).permutation(int(numbers.max()) + 1)
        return np.asarray(order[numbers] % FOLDS)

    def rmse(self, model: Array, rows: NDArray[np.bool_] | None = None) -> float:
        use = self.use if rows is None else self.use & rows[:, None]
        return float(np.sqrt(((model - self.counts)[use] ** 2).mean()))


def fit_infrared(recordings: Sequence[SensorRecording], base: Profile, form: str) -> ChannelFit:
    """Fit the proximity sensors to all recordings at once.

    Raises:
        CalibrationError: the recordings are no robot's.
    """
    rows = _Rows(recordings, base)
    rigs = [name for name, _ in rows.scenes]
    problems = {
        name: _Problem(
            frees=infrared_frees(name, base, rigs),
            model=lambda values: infrared_model(base, values, rows.scenes),
            base=base,
        )
        for name in INFRARED_FORMS
    }
    fits, held_out = _fit_all(rows, problems, form, PROXIMITY_COUNTS)
    values = _mend_dead(fits[form].values, problems[form].frees, rows.dead)
    return _channel("infrared", form, rows, fits, held_out, with_infrared(base, values))


def fit_light(recordings: Sequence[SensorRecording], base: Profile, form: str) -> ChannelFit:
    """Fit the ambient sensors to all recordings at once.

    Raises:
        CalibrationError: the recordings are no robot's, or of lamps both known and unknown.
    """
    rows = _Rows(recordings, base)
    rooms = {r.pose is not None and r.arena is not None for r in recordings}
    if len(rooms) > 1:
        raise CalibrationError(
            "ambient recordings: some are in an arena, some before a lamp of unknown "
            "brightness: calibrate from one kind."
        )
    room = rooms.pop()
    problems = {name: _light_problem(name, rows, base, room=room, falloff=2.0) for name in LIGHT_FORMS}
    if room:
        for name in ("linear", "extended"):
            problems[name] = _best_reflection(name, rows, base, problems[name])
    fits, held_out = _fit_all(rows, problems, form, AMBIENT_COUNTS)
    values = _mend_dead(fits[form].values, problems[form].frees, rows.dead)
    profile = with_light(problems[form].base, values, form)
    if not room:
        profile = as_bright_as_the_paper(profile)
    return _channel("ambient", form, rows, fits, held_out, profile)


def _light_problem(
    form: str, rows: _Rows, base: Profile, *, room: bool, falloff: float, narrow: float = 0.0
) -> _Problem:
    law = base.ambient
    reflectance = law.reflectance if falloff == law.falloff else law.reflectance / 30.0
    changes: dict[str, float] = {"falloff": falloff, "reflectance": reflectance}
    if form == "extended" and falloff == 1.0:
        changes |= {"matt": 1.0, "rays": LIGHT_RAYS, "lamp_narrow": narrow}
    start = replace(base, ambient=replace(law, **changes))  # type: ignore[arg-type]
    memory = LightMemory()
    return _Problem(
        frees=light_frees(form, start, rows.scenes, rows.counts, room=room),
        model=lambda values: light_model(start, values, rows.scenes, form, memory),
        base=start,
        steep=room and form == "extended",
    )


def _best_reflection(form: str, rows: _Rows, base: Profile, paper: _Problem) -> _Problem:
    """Reflected light as the paper has it or off walls of some height, and a lamp as wide as the arena
    has it or narrow: whichever leaves least over. (What a point of a lamp is hidden by changes in
    jumps, which no derivative sees: so its width is tried, not fitted.)"""
    others = [_light_problem(form, rows, base, room=True, falloff=1.0)]
    if form == "extended":
        others.append(_light_problem(form, rows, base, room=True, falloff=1.0, narrow=1.0))
    left = {}
    for problem in (paper, *others):
        fit = _solve(rows, problem, AMBIENT_COUNTS, intervals=False)
        left[rows.rmse(fit.model)] = problem
    return left[min(left)]


def _fit_all(
    rows: _Rows, problems: dict[str, _Problem], form: str, noise: float
) -> tuple[dict[str, Fit], dict[str, float]]:
    """Every form's fit, and the RMSE on places held out of the form that was asked for."""
    fits: dict[str, Fit] = {}
    for name, problem in problems.items():
        fits[name] = _solve(rows, problem, noise, intervals=name == form)
        simpler = list(fits.values())[:-1]
        if simpler and _lost(rows, fits[name], simpler[-1]):
            # A sensor fell silent on the way, where nothing leads back: begin where the simpler form ended.
            start = {f.key: NEUTRAL.get(f.key, f.start) for f in problem.frees} | simpler[-1].values
            again = _solve(rows, problem, noise, start=start, intervals=name == form)
            if rows.rmse(again.model) < rows.rmse(fits[name].model):
                fits[name] = again
    folds, off = rows.folds(), np.zeros(rows.counts.shape)
    for fold in range(FOLDS):
        out = folds == fold
        if not out.any() or out.all():
            continue
        some = _solve(rows, problems[form], noise, start=fits[form].values, without=out, intervals=False)
        off[out] = some.model[out] - rows.counts[out]
    return fits, {form: float(np.sqrt((off[rows.use] ** 2).mean()))}


def _lost(rows: _Rows, fit: Fit, simpler: Fit) -> bool:
    """Whether any sensor is fitted much worse than by the form before."""
    live = rows.use.any(axis=0)
    now, before = (np.sqrt(((one.model - rows.counts) ** 2).mean(axis=0))[live] for one in (fit, simpler))
    return bool((now > 1.3 * before).any())


def _solve(
    rows: _Rows,
    problem: _Problem,
    noise: float,
    *,
    start: Values | None = None,
    without: NDArray[np.bool_] | None = None,
    intervals: bool,
) -> Fit:
    use = rows.use if without is None else rows.use & ~without[:, None]

    def once(begin: Values | None, intervals: bool) -> Fit:
        return solve(
            problem.frees, problem.model, rows.counts, noise=noise, use=use, clusters=rows.block,
            start=begin, intervals=intervals,
        )  # fmt: skip

    if not problem.steep or without is not None:
        return once(start, intervals)
    values: Values = start or {f.key: f.start for f in problem.frees}
    for reach in SCANS_DEG:
        values = once(_scan(problem, values, rows.counts, use, noise, reach), False).values
    return once(values, intervals)


def _scan(
    problem: _Problem, values: Values, counts: Array, use: NDArray[np.bool_], noise: float, reach: float
) -> dict[str, Array]:
    """The values, with each sensor's direction where it leaves least over within `reach` degrees.

    Where direct light is bright a sensor's reading drops within a degree, and no derivative sees it come.
    """
    best, chosen = np.full(counts.shape[1], np.inf), values["direction_deg"].copy()
    for off in np.linspace(-reach, reach, SCAN):
        turned = {**values, "direction_deg": values["direction_deg"] + off}
        z = np.where(use, (problem.model(turned) - counts) / noise, 0.0)
        cost = np.sqrt(1.0 + (z / 5.0) ** 2).sum(axis=0)
        chosen = np.where(cost < best, turned["direction_deg"], chosen)
        best = np.minimum(cost, best)
    return {**values, "direction_deg": chosen}


def _mend_dead(values: dict[str, Array], frees: Sequence[Free], dead: dict[int, str]) -> dict[str, Array]:
    """A sensor that told nothing gets the others' median, and its own direction."""
    start = {f.key: f.start for f in frees}
    out = {}
    for key, value in values.items():
        out[key] = value.copy()
        for k in dead:
            if len(value) > 1:
                live = [i for i in range(len(value)) if i not in dead]
                out[key][k] = start[key][k] if key == "direction_deg" else np.median(value[live])
    return out


def _channel(
    kind: str, form: str, rows: _Rows, fits: dict[str, Fit], held_out: dict[str, float], profile: Profile
) -> ChannelFit:
    fit = fits[form]
    source = ", ".join(r.source for r in rows.recordings)
    refuse_nonsense(source, rows.counts, fit.model, rows.dead)
    ends = np.cumsum([len(r.counts) for r in rows.recordings])[:-1]
    live = np.where(rows.use, rows.counts, np.nan)
    noise = measure_noise(
        [replace(r, counts=part) for r, part in zip(rows.recordings, np.split(live, ends), strict=True)],
        np.split(fit.model, ends),
    )
    main = next((e.deviation for e in noise if e.channel in ("proximity", "ambient")), None)
    deviation = main or (PROXIMITY_COUNTS if kind == "infrared" else AMBIENT_COUNTS)
    sensors = tuple(
        m for m in misfits(rows.counts, fit.model, rows.place, kind, deviation) if m.sensor not in rows.dead
    )
    by_form = {name: rows.rmse(one.model) for name, one in fits.items()}
    span = np.stack([np.percentile(rows.counts, q, axis=0) for q in (0.5, 99.5)], 1)
    return ChannelFit(
        kind=kind, form=form, profile=profile, fit=fit, by_form=by_form, held_out=held_out,
        noise=tuple(noise), sensors=sensors, dead=rows.dead, source=source,
        warnings=(
            *rows.warnings,
            *_warnings(kind, by_form[form], held_out[form], sensors, fit, noise, deviation),
        ),
        distance_cm=rows.distance, bearing_deg=rows.bearing, counts=rows.counts, model=fit.model, span=span,
    )  # fmt: skip


def _warnings(
    kind: str,
    rmse: float,
    held_out: float,
    sensors: Sequence[Misfit],
    fit: Fit,
    noise: Sequence[NoiseEstimate],
    deviation: float,
) -> list[str]:
    limit, out = LIMITS[kind], []
    over = [m for m in sensors if m.ratio > limit]
    if over:
        which = ", ".join(f"{m.sensor} ({m.ratio:.1f})" for m in over)
        out.append(
            f"{kind}: model error is more than {limit:g} noise deviations ({deviation:.3g} "
            f"counts) for sensors "
            f"{which}: there the level of noise can explain nothing"
        )
    if held_out > OVERFITTED * rmse:
        out.append(
            f"{kind}: RMSE {held_out:.3g} on places held out, {rmse:.3g} on those fitted: the form overfits"
        )
    vague = [c.key for c in fit.constants if not c.told]
    if vague:
        out.append(f"{kind}: the data do not decide {', '.join(vague)}: bounds or a mild prior do")
    if not noise:
        out.append(f"{kind}: too little to measure noise by; the base profile's is kept")
    return out
