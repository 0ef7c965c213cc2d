"""What recordings of one set have in common: another unit's gain, and the distance that it starts from.

A set is what was made of one robot without moving the rig: the recordings of one folder, or of one argument.
Its constants are free only where that pays, by the error on places left out.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from realitygap.calibration import model
from realitygap.calibration.fit import Observed, Outcome, Parameter, Use, Values, fit, value_of
from realitygap.calibration.readings import LIT_SHARE, Readings
from realitygap.calibration.recordings import sets_of
from realitygap.values import Floats

PAYS, BOTH_PAY = 1.5, 1.1
"""Factors by which the error on places left out must fall for a set to have a constant of its own, and for a
second one."""
ENOUGH, FOLDS = 30, 4
"""Lit readings from which on a set is asked for constants of its own, and the folds of its places."""
NAMED, MOVED_CM = 1.25, 0.2
"""A gain beyond this factor is another unit's, a start beyond this another start: less is a day's."""
FREE = (
    Parameter(key="gain", start=np.zeros(1), low=-3.0, high=3.0, prior=1.0, step=2e-3),
    Parameter(key="start", start=np.zeros(1), low=-1.0, high=1.0, prior=0.5, step=2e-3),
)
"""A gain's logarithm, and a start, cm."""
TRIED = (("gain",), ("start",), ("gain", "start"))

Read = Callable[[float, float], Floats]
"""Noise-free readings [n, S] under a gain, the object so much (cm) further away."""


def own_constants(read: Read, data: Observed) -> tuple[float, float]:
    """Gain and start (cm) of a set relative to a profile; (1, 0) where they do not pay. `data.clusters` are
    its places."""
    number = np.unique(data.clusters, return_inverse=True)[1]
    fold = np.random.default_rng(0).permutation(int(number.max()) + 1)[number] % FOLDS
    top = data.counts[data.use].max(initial=1.0)
    lit = data.use & (data.counts > LIT_SHARE * top) & (data.counts < (1.0 - LIT_SHARE) * top)
    if lit.sum() < ENOUGH:
        return 1.0, 0.0

    def readings(values: Values) -> Floats:
        return read(float(np.exp(value_of(values, "gain"))), value_of(values, "start"))

    def found(keys: Sequence[str], use: Use) -> Values:
        free = [one for one in FREE if one.key in keys]
        some = replace(data, use=data.use & use[:, None])
        return fit(free, readings, some, intervals=False).values if free else {}

    def held_out(keys: Sequence[str]) -> float:
        off = np.zeros(data.counts.shape)
        for k in range(FOLDS):
            out = fold == k
            off[out] = (readings(found(keys, ~out)) - data.counts)[out]
        return float(np.sqrt((off[lit] ** 2).mean()))

    best: Sequence[str] = ()
    least = held_out(best)
    for keys in TRIED:
        error = held_out(keys)
        if error * (BOTH_PAY if best else PAYS) < least:
            best, least = keys, error
    values = found(best, fold >= 0)
    gain, start = float(np.exp(value_of(values, "gain"))), value_of(values, "start")
    other = max(gain, 1.0 / gain) > NAMED or abs(start) > MOVED_CM
    return (gain, start) if other else (1.0, 0.0)


def own_sets(data: Readings, made: Outcome) -> Readings | None:
    """The readings with constants of their own for all sets after the first for which that pays, given a fit
    without; None: there is none. A surface of unknown reflectance hides a gain."""
    sets = sets_of(data.recordings)
    free = set[int]()
    scenes, rows = model.scenes_of(data.recordings), data.split(np.arange(len(data.counts)))
    for first in sorted({*sets} - {0}):
        some = [i for i, one in enumerate(sets) if one == first]
        if any(scenes[i][1].paint or np.isnan(data.recordings[i].gain) for i in some):
            continue
        here = [scenes[i][1].tried(made.fit.values) for i in some]

        def read(gain: float, start: float, here: Sequence[model.Scene] = here) -> Floats:
            return np.concatenate(
                [model.proximity(made.profile, one.brighter(gain), away_cm=start) for one in here]
            )

        at = np.concatenate([rows[i] for i in some])
        own = Observed(
            counts=data.counts[at], noise=data.noise, use=data.use[at], clusters=data.place[at]
        )  # fmt: skip
        free |= set(some) if own_constants(read, own) != (1.0, 0.0) else set()
    if not free:
        return None
    return data.of(
        [replace(r, gain=np.nan, start_cm=np.nan) if i in free else r for i, r in enumerate(data.recordings)]
    )


def in_words(gain: float, start_cm: float, than: str = "") -> str:
    """A set's gain and start."""
    times = f"{gain:.2g} times as sensitive{than}"
    other = f"another unit, or another surface, {times}"
    said = [other if max(gain, 1.0 / gain) > NAMED else times] if gain != 1.0 else []
    where = "further away" if start_cm > 0 else "nearer"
    said += [f"{abs(10 * start_cm):.1f} mm {where} than its table says"] if round(start_cm, 2) else []
    return ", ".join(said)


def units_in_words(data: Readings, values: Values) -> list[str]:
    """Which sets of recordings have a gain or a start of their own among a fit's values, in words."""
    out = []
    for i, one in enumerate(data.recordings):
        gain, start = value_of(values, f"{model.GAIN}{i}") or 1.0, value_of(values, f"{model.START}{i}_cm")
        if words := in_words(gain, start, " as the first"):
            out.append(f"{data.kind}: {one.group or one.source}: {words}")
    return out
