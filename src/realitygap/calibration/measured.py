"""Measured proximity sensors: optics by rays, electronics by a curve for each sensor.

Only the optics is searched (directions, offset, width, aperture, lobe): for each of its values the best
curves follow by linear least squares (variable projection: Golub and Pereyra 1973).
"""

from collections.abc import Sequence
from dataclasses import replace
from itertools import product
from operator import itemgetter

import numpy as np
from numpy.typing import NDArray

from realitygap.calibration.constants import SIGMAS, moved
from realitygap.calibration.curves import ALIKE, ALIKES, SMOOTH, STEPS, Curves, Seen, smoothness
from realitygap.calibration.descent import BY_HAND, ENDS_CM, PLAIN, Descent
from realitygap.calibration.edges import Edges
from realitygap.calibration.forms import with_columns
from realitygap.calibration.optics import SHARES, Optics
from realitygap.calibration.rows import Rows, dead_zone, means, repeated_noise, saturation
from realitygap.calibration.solve import Fit, Values
from realitygap.values import Floats
from realitygap.world.robot import Constant, Profile

__all__ = ["Measured", "read_unseen"]

Use = NDArray[np.bool_]
Begun = tuple[float, int, Optics, dict[str, Floats]]
"""A start: its residual, its number, and its current state."""

ONE_BEAM = {"aperture_deg": 60.0, "share_1": 0.28, "share_2": 0.22, "share_3": 0.14, "share_4": 0.06}
TWO_BEAMS = {"share_4": 0.67}
"""Starting values, and the free parts of the lobe: one beam; or two beside the middle ray, minus their
response to a flat surface in front, as in simulators that subtract."""
TWO_BEAMS_DEG = (10.0, 15.0, 22.0)
LOBES = (ONE_BEAM, *({**TWO_BEAMS, "aperture_deg": wide} for wide in TWO_BEAMS_DEG))
WIDTHS_CM = (0.5, 3.0, 9.0)
PROMISING, HEARD, GIVEN_UP = 2, 3, 2.0
"""How many starts of each kind of lobe are followed. For held-out fits: how many are scanned for where rays
end, and the factor over the best residual at which a start is given up. In tests one of the first two of a
kind by directions alone always won, and none from so far behind."""
COARSE = {0.05: 10.0, 0.03: 4.0, 0.02: 2.0, 0.01: 1.0, 0.003: 0.4}
"""Assumed accuracies of readings in early stages, as shares of the full scale, since details mislead far from
the truth; and the range of the search for directions then, degrees."""
FIRST = max(COARSE)
DRAWS, DRAWS_HELD_OUT = 600, 300
"""Evaluations of all places in one search; and in held-out fits, of which there are four: a poorer search
errs on the safe side."""
FINEST = 0.004
"""No model is expected to be more accurate than this share of the full scale."""
POINTS = (STEPS // 4, STEPS // 2, 3 * STEPS // 4)
"""Points of a curve whose intervals are reported."""


class Measured:
    """The form "measured" of the proximity sensors.

    Args:
        rows: readings to fit.
        base: the profile to start from.
        noise: of a reading, counts; None: as the readings have it.
        judging: only predicts held-out readings, by a shorter search.
    """

    def __init__(
        self, rows: Rows, base: Profile, noise: float | None = None, *, judging: bool = False
    ) -> None:
        if noise is None:
            noise = max(repeated_noise(rows), (BY_HAND if rows.straight else FINEST) * rows.top)
        self._rows, self._noise, self._judging = rows, noise, judging
        draws, law = DRAWS_HELD_OUT if judging else DRAWS, base.infrared
        self._step = Descent(rows, law.sensors, noise, draws=draws)
        flat = tuple(np.linspace(0.0, law.top, 2))
        sensors = tuple(replace(s, a=1.0, b=0.0, curve=flat, noise=()) for s in law.sensors)
        law = replace(
            law, sensors=sensors, lobe=(1.0, 0.0, 0.0, 0.0, 0.0), aperture_deg=45.0, curve_cm=3.0,
            dead=dead_zone(rows), exponent=1.0,
        )  # fmt: skip
        self._all = Seen(
            counts=rows.counts, use=rows.use, top=rows.top, most=saturation(rows), noise=noise, dead=law.dead
        )
        self._first_of = np.unique(rows.place, return_index=True)[1]
        mean = means(rows.live(), rows.place, self._all.most)
        counts, use = np.nan_to_num(mean), np.isfinite(mean)
        seen = replace(self._all, counts=counts, use=use, noise=FIRST * rows.top)
        self._first = Optics(
            base=replace(base, infrared=law), scenes=rows.scenes, seen=seen, place=np.arange(len(seen.counts))
        )
        self._few = self._first.at(rows.sparse()[self._first_of])
        self._edges = Edges(self._first, rows, self._step, noise)

    def fit(self) -> tuple[Profile, Fit]:
        """The profile and its constants, from the most promising start."""
        places, values = self._promising()
        fit = self._step.solved(places, values, self._noise, intervals=True)
        values = self._edges.matched(places, self._step.mended(places, values, fit.values))
        use = self._rows.use
        constants = [moved(c, values) for c in fit.constants]
        fit = replace(fit, values=values, constants=(*constants, *self._points(values, use)))
        return self.profile(values, use), replace(fit, model=self.optics.shown(values, use))

    def read(self) -> Floats:
        """[n, S] readings at all places, also those not used by the fit, by the search alone."""
        _, values = self._promising()
        return self.optics.shown(values, self._rows.use)

    def _promising(self) -> tuple[Optics, dict[str, Floats]]:
        """Where the start ends that promises most; `optics` has it with curves fitted to all readings."""
        begun = [
            (replace(self._first, base=optics.base, lobe=optics.lobe), v) for *_, optics, v in self._begun()
        ]
        found = [self._start_at(i, *self._nearer(*one)) for i, one in enumerate(begun)]
        places, values = self._nearer(*min(found, key=itemgetter(0, 1))[2:])
        values = self._edges.matched(places, self._step.lit(places, values))
        chosen = places.seen
        seen = replace(self._all, smooth=chosen.smooth, linear=chosen.linear, alike=chosen.alike)
        self.optics = replace(places, seen=seen, place=self._rows.place)
        return places, values

    def _points(self, values: Values, use: Use) -> list[Constant]:
        """Three points of each sensor's curve with their intervals, for fixed optics."""
        curves, u = self.optics.curves(values, use)
        size = SIGMAS * Curves(replace(self.optics.seen, use=use), u).deviations(curves)
        return [
            Constant(
                key=f"curve_{j}[{k}]", value=value, low=max(0.0, value - size[k, j]),
                high=min(self._rows.top, value + size[k, j]), told=bool(np.isfinite(size[k, j])),
            )
            for j in POINTS for k, value in enumerate(curves[:, j].tolist()) if k not in self._rows.dead
        ]  # fmt: skip

    def _nearer(self, optics: Optics, values: Values) -> tuple[Optics, dict[str, Floats]]:
        """Choose the curves' smoothness, which only shows near the right optics; then refine the optics.

        Curves that may bend can compensate for wrong optics, so the optics that suit straight curves are
        tried too.
        """
        folds, seen = self._rows.folds()[self._first_of], replace(optics.seen, noise=self._noise)
        alikes = ALIKES if self._step.straight else (ALIKE,)
        plain = replace(optics, seen=replace(seen, smooth=SMOOTH[-1], linear=True))
        tried = [values]
        if not self._step.straight:
            solved = self._step.solved(plain, values, self._noise).values
            tried += [self._step.mended(plain, values, solved)]
        found = [
            (*smoothness(seen, optics.share(optics.profile(one), one), folds, alikes), one) for one in tried
        ]
        _, seen, values = min(found, key=itemgetter(0))
        optics = replace(optics, seen=seen)
        return optics, self._step.searched(optics, values)

    def _begun(self) -> list[Begun]:
        """Good starts: the most promising are followed for one stage, then the best with one beam and with
        two."""
        begun: list[Begun] = []
        straight = self._step.straight
        lobes = LOBES[: 1 if straight else None]
        for lobe, width, matt in product(lobes, WIDTHS_CM, (1.0,) if straight else (1.0, 0.0)):
            values = self._start(lobe, width)
            law = replace(self._first.base.infrared, matt=matt)
            optics = replace(self._few, base=replace(self._few.base, infrared=law), lobe=tuple(lobe))
            optics = optics.centred(values)
            values = self._step.turned(optics, values, FIRST * self._rows.top, COARSE[FIRST])
            begun.append(self._start_at(len(begun), optics, values))
        heard = self._followed(begun, HEARD) if self._judging else begun
        begun = [self._start_at(k, optics, self._step.ended(optics, v, ENDS_CM)) for _, k, optics, v in heard]
        many = PROMISING
        for share, reach in COARSE.items():
            staged = []
            for _, number, optics, values in self._followed(begun, many):
                nearer = self._step.stage(optics, values, share * self._rows.top, reach)
                staged.append(self._start_at(number, *nearer))
            begun, many = staged, 1
        return self._followed(begun, many)

    def _followed(self, begun: Sequence[Begun], many: int) -> list[Begun]:
        """The best `many` starts with one beam and with two, the best first."""
        ranked = sorted(begun, key=itemgetter(0, 1))
        kinds = [[one for one in ranked if one[2].lobe == tuple(lobe)] for lobe in (ONE_BEAM, LOBES[-1])]
        most = GIVEN_UP * ranked[0][0] if self._judging else np.inf
        best = (one for kind in kinds for one in kind[:many] if one[0] <= most)
        return sorted(best, key=itemgetter(0, 1))

    def _start_at(self, number: int, optics: Optics, values: dict[str, Floats]) -> Begun:
        plain = 1.0 if optics.lobe == tuple(ONE_BEAM) else PLAIN
        return self._step.left(optics, values) * plain, number, optics, values

    def profile(self, values: Values, use: Use) -> Profile:
        """The profile of fitted optics with the best curves for it."""
        made = self.optics.profile(values)
        curves = self.optics.in_room(values, self.optics.curves(values, use)[0], use)
        law = made.infrared
        sensors = with_columns(law.sensors, {"curve": [tuple(row) for row in curves.round(3).tolist()]})
        return replace(made, infrared=replace(law, sensors=sensors))

    def _start(self, lobe: dict[str, float], width: float) -> dict[str, Floats]:
        start = {free.key: free.start for free in self._step.frees(())}
        start["direction_deg"] = np.array([s.direction_deg for s in self._first.base.infrared.sensors])
        none = dict.fromkeys((*SHARES, "range_cm"), 0.0)
        return start | {key: np.array([value]) for key, value in (none | lobe | {"width_cm": width}).items()}


def read_unseen(rows: Rows, base: Profile, out: Use) -> Floats:
    """[m, S] readings at m of the rows, `out` [n], by a search that saw none of them."""
    return Measured(rows.without(out), base, judging=True).read()[out]
