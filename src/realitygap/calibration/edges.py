"""What places between those of a grid tell, where readings jump: where rays look, and where they end.

A grid tells it to about the spacing of its places over the number of edges in a recording; and a ray that is
off by that still errs by its whole reading where it should just have met something.
"""

from dataclasses import replace
from operator import itemgetter

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
"""What all sensors share, and its range as a multiple of these."""


class Edges:
    """Places of recordings and those between them.

    Args:
        grid: the optics with the places of the grids.
        rows: with the recordings and their edges.
        step: holds what recordings do not determine.
        noise: of a reading, counts.
    """

    def __init__(self, grid: Optics, rows: Rows, step: Descent, noise: float) -> None:
        self._step, self._noise = step, noise
        self._all: Optics | None = None
        if all(edges is None for edges in rows.edges):
            return
        ends = np.cumsum([len(scene.poses) for _, scene in rows.scenes])[:-1]
        of_grid = np.split(np.where(grid.seen.use, grid.seen.counts, np.nan), ends)
        most, sensors = grid.seen.most, grid.seen.counts.shape[1]
        scenes, counts, by = [], [], []
        for i, ((name, scene), edges, here) in enumerate(zip(rows.scenes, rows.edges, of_grid, strict=True)):
            there, poses = np.empty((0, sensors)), scene.poses
            if edges is not None:
                there = means(edges.counts, edges.place(), most)
                poses = np.concatenate([poses, scene_of(edges, f"{REFLECTANCE}{i}").poses])
            scenes.append((name, replace(scene, poses=poses, row=np.arange(len(poses)))))
            counts += [here, there]
            by += [np.ones(len(here), bool), np.zeros(len(there), bool)]
        read = np.concatenate(counts)
        seen = replace(grid.seen, counts=np.nan_to_num(read), use=np.isfinite(read))
        self._all = replace(grid, scenes=scenes, seen=seen, place=np.arange(len(read)), by=np.concatenate(by))

    def matched(self, optics: Optics, values: Values) -> dict[str, Floats]:
        """The values with directions, the beams' angle and where rays end as the edges have them, if that
        leaves a smaller residual.

        Args:
            optics: of the grids' places.
            values: nearly right.
        """
        if self._all is None:
            return dict(values)
        seen = replace(optics.seen, counts=self._all.seen.counts, use=self._all.seen.use)
        both = replace(self._all, base=optics.base, lobe=optics.lobe, seen=seen)
        begin, found = self._cost(both, values).sum(), dict(values)
        for reach in REACHES:
            for key, far in COMMON.items():
                if found[key] > 0:
                    found = self._nearer(both, found, key, far * reach, reach)
        found = self._step.level(found)
        return found if self._cost(both, found).sum() < begin else dict(values)

    def _nearer(
        self, optics: Optics, values: dict[str, Floats], key: str, far: float, reach: float
    ) -> dict[str, Floats]:
        """The values with one that all sensors share, and each sensor's direction for it, where they cost
        least: in the middle of directions that suit equally well."""
        found = []
        for more in np.linspace(-far, far, TRIED):
            at, offs = {**values, key: values[key] + more}, np.linspace(-reach, reach, TRIED)
            costs = np.array([self._cost(optics, _turned(at, off)) for off in offs])
            least = costs <= costs.min(axis=0) * LIKE
            at = _turned(at, offs @ least / least.sum(axis=0))
            found.append((float(self._cost(optics, at).sum()), at))
        return min(found, key=itemgetter(0))[1]

    def _cost(self, optics: Optics, values: Values) -> Floats:
        """[S] misfit of each sensor, as least squares have it."""
        use = optics.seen.use
        off = np.where(use, optics.readings(values, use) - optics.seen.counts, 0.0) / self._noise
        return np.asarray(np.sqrt(1.0 + (off / ROBUST_AT) ** 2).sum(axis=0))


def _turned(values: dict[str, Floats], by: Floats | float) -> dict[str, Floats]:
    return {**values, "direction_deg": values["direction_deg"] + by}
