"""What places between those of a grid tell, where readings jump: where rays look, and where they end.

A grid tells it to about the spacing of its places over the number of edges in a recording; and a model whose
rays are off by that still errs by a whole reading where a ray should just have met something.
"""

from dataclasses import replace
from operator import itemgetter
from typing import NamedTuple

import numpy as np

from realitygap.calibration.descent import LIKE, Descent
from realitygap.calibration.forward import scene_of
from realitygap.calibration.optics import Optics
from realitygap.calibration.rows import REFLECTANCE, Rows, means
from realitygap.calibration.solve import ROBUST_AT, Values
from realitygap.values import Floats

__all__ = ["Edges"]

REACHES, TRIED = (0.3, 0.08, 0.02, 0.005, 0.005), 9
"""Ranges to either side of successive searches for directions (degrees), and values tried in each."""
COMMON = {"range_cm": 0.3, "aperture_deg": 1.0}
"""What all sensors share, and its range to either side as a multiple of the directions'."""


class Edges:
    """The places between those of the recordings.

    Args:
        grid: the optics with the places of the grids.
        rows: with the recordings and their edges.
        step: holds the directions' mean where rigs may stand turned.
        noise: of a reading, counts.
    """

    def __init__(self, grid: Optics, rows: Rows, step: Descent, noise: float) -> None:
        self._step, self._noise = step, noise
        scenes, counts = [], []
        for i, ((name, scene), edges) in enumerate(zip(rows.scenes, rows.edges, strict=True)):
            there = replace(scene, poses=scene.poses[:0])
            if edges is not None:
                there = scene_of(edges, f"{REFLECTANCE}{i}")
                counts.append(means(edges.counts, edges.place(), grid.seen.most))
            scenes.append((name, there))
        self._found = bool(counts)
        if counts:
            read = np.concatenate(counts)
            seen = replace(grid.seen, counts=np.nan_to_num(read), use=np.isfinite(read))
            self._between = replace(grid, scenes=scenes, seen=seen, place=np.arange(len(read)))

    def matched(self, optics: Optics, values: Values) -> dict[str, Floats]:
        """Nearly right values with directions, the beams' angle and where rays end as the edges have them, if
        they suit these better; `optics` are of the grids' places."""
        if not self._found:
            return dict(values)
        there = replace(self._between, base=optics.base, lobe=optics.lobe)
        fit, found = _Fit(optics, there, self._noise), dict(values)
        for reach in REACHES:
            for key, far in COMMON.items():
                if found[key] > 0:
                    found = fit.nearer(found, key, far * reach, reach)
        found = self._step.level(found)
        before, now = (fit.cost(v, fit.curves(v)).sum() for v in (values, found))
        return found if now < before else dict(values)


class _Fit(NamedTuple):
    """The optics of the grids' places and of those between, and the noise of a reading, counts."""

    grid: Optics
    between: Optics
    noise: float

    def nearer(self, values: dict[str, Floats], key: str, far: float, reach: float) -> dict[str, Floats]:
        """The values with one that all sensors share, and each sensor's direction for it, where they cost
        least: in the middle of directions that suit equally well."""
        found, offs = [], np.linspace(-reach, reach, TRIED)
        for more in np.linspace(-far, far, TRIED):
            at = {**values, key: values[key] + more}
            curves = self.curves(at)
            costs = np.array([self.cost(_turned(at, off), curves) for off in offs])
            least = costs <= costs.min(axis=0) * LIKE
            at = _turned(at, offs @ least / least.sum(axis=0))
            found.append((float(self.cost(at, curves).sum()), at))
        return min(found, key=itemgetter(0))[1]

    def curves(self, values: Values) -> Floats:
        """The curves by the grids' places alone: few of these depend on where rays look."""
        return self.grid.curves(values, self.grid.seen.use, beyond=True)[0]

    def cost(self, values: Values, curves: Floats) -> Floats:
        """[S] misfit of each sensor at the edges, as least squares have it."""
        seen = self.between.seen
        model = self.between.read(curves, self.between.share(self.between.profile(values), values))
        off = np.where(seen.use, model - seen.counts, 0.0) / self.noise
        return np.asarray(np.sqrt(1.0 + (off / ROBUST_AT) ** 2).sum(axis=0))


def _turned(values: dict[str, Floats], by: Floats | float) -> dict[str, Floats]:
    return {**values, "direction_deg": values["direction_deg"] + by}
