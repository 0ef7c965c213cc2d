"""What places between those of a grid tell, where readings jump: where rays look, and where they end.

A grid tells it to about the spacing of its places over the number of edges in a recording; and a ray that is
off by that still errs by its whole reading where it should just have met something.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from realitygap.calibration.descent import LIKE, Descent
from realitygap.calibration.forward import scene_of
from realitygap.calibration.optics import Optics
from realitygap.calibration.rows import REFLECTANCE, Rows, means
from realitygap.calibration.solve import ROBUST_AT, Values
from realitygap.values import Floats

__all__ = ["Edges"]

REACHES_DEG, TRIED = (0.3, 0.08, 0.02, 0.005), 13
"""Ranges to either side of successive searches for directions and the beams' angle; values tried in each."""


class Edges:
    """Places of recordings and those between them.

    Args:
        grid: the optics with the places of the grids.
        rows: with the recordings and their edges.
        step: measures residuals, and finds where rays end.
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
        found = dict(values)
        for reach in REACHES_DEG:
            found = self._step.ended(both, self._turned(both, found, np.linspace(-reach, reach, TRIED)))
        found = self._step.level(found)
        return found if self._step.left(both, found) < self._step.left(both, values) else dict(values)

    def _turned(self, optics: Optics, values: Values, offs: Floats) -> dict[str, Floats]:
        """The values with the beams' angle and each sensor's direction where they cost least, in the middle
        of directions that suit equally well."""

        def cost(tried: Mapping[str, Floats]) -> Floats:
            off = (optics.readings(tried, optics.seen.use) - optics.seen.counts) / self._noise
            off = np.where(optics.seen.use, off, 0.0) / ROBUST_AT
            return np.asarray(np.sqrt(1.0 + off**2).sum(axis=0))

        found: list[tuple[float, dict[str, Floats]]] = []
        for wider in offs:
            at = {**values, "aperture_deg": values["aperture_deg"] + wider}
            costs = np.array([cost({**at, "direction_deg": at["direction_deg"] + off}) for off in offs])
            least = costs <= costs.min(axis=0) * LIKE
            turned = {**at, "direction_deg": at["direction_deg"] + offs @ least / least.sum(axis=0)}
            found.append((float(cost(turned).sum()), turned))
        return min(found, key=lambda one: one[0])[1]
