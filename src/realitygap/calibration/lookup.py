"""The form "lookup": a table of mean readings with linear interpolation between places, without a model.

The approach of the paper's reference [15]: readings recorded round a wall and round a cylinder, replayed.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from realitygap.calibration.fit import Fit, Outcome, Use
from realitygap.calibration.model import checked, unchecked, with_columns
from realitygap.calibration.readings import LIT_SHARE, Readings, dead_zone
from realitygap.errors import CalibrationError
from realitygap.values import Floats
from realitygap.world.robot import Profile
from realitygap.world.sensors import LookUp

FEWEST_BEARINGS, FEWEST_DISTANCES = 8, 2
EVEN_DEG = 0.01
BEHIND_DEG = 120.0
"""A sensor facing this far away from the object sees nothing of it."""
WALL, CYLINDER = "wall", "cylinder"


@dataclass(frozen=True, kw_only=True, eq=False)
class Ring:
    """The places round one kind of object: D distances (cm), at each B bearings at equal steps.

    `rows` [m] are the recordings' rows read there, `node` [m] the place of each.
    """

    at: Floats
    bearings: int
    rows: NDArray[np.int64]
    node: NDArray[np.int64]

    def table(self, counts: Floats, use: Use) -> Floats:
        """[D · B, S] mean readings [n, S] of each place; places without rows in `use` [n] are interpolated
        linearly, or take the nearest value at an end."""
        from scipy.interpolate import griddata

        there = use[self.rows]
        node, read = self.node[there], counts[self.rows[there]]
        size = len(self.at) * self.bearings
        many = np.bincount(node, minlength=size)
        sums = np.stack([np.bincount(node, column, minlength=size) for column in read.T], 1)
        mean, known = sums / np.maximum(many, 1)[:, None], many > 0
        if known.all():
            return np.asarray(mean)
        # Bearings go round: the ring lies three times side by side; a step of either counts the same.
        step = float(np.median(np.diff(self.at)))
        away, turn = (
            part.ravel() for part in np.meshgrid(self.at / step, np.arange(self.bearings), indexing="ij")
        )
        known_at = np.concatenate(
            [np.column_stack([away, turn + by])[known] for by in (-self.bearings, 0, self.bearings)]
        )
        values, left = np.tile(mean[known], (3, 1)), np.column_stack([away, turn])[~known]
        found = griddata(known_at, values, left, "nearest")
        if len(np.unique(away[known])) > 1:
            linear = griddata(known_at, values, left, "linear")
            found = np.where(np.isfinite(linear), linear, found)
        mean[~known] = found
        return np.asarray(mean)


def rings(data: Readings) -> dict[str, Ring]:
    """The places of all recordings, by kind of object."""
    radii = {r.object: r.source for r in data.recordings if r.radius_cm is not None}
    if len(radii) > 1:
        (one, here), (two, there) = list(radii.items())[:2]
        raise CalibrationError(
            f"form lookup: expected cylinders of one radius, got {one} in {here} and {two} in {there}: a "
            "table has one for all. Leave one out."
        )
    kind = np.concatenate([np.full(len(r.counts), r.object.partition(":")[0]) for r in data.recordings])
    return {name: _ring(data, np.flatnonzero(kind == name)) for name in np.unique(kind).tolist()}


def _ring(data: Readings, there: NDArray[np.int64]) -> Ring:
    at, i = np.unique(np.round(data.distance[there], 6), return_inverse=True)
    turned, j = np.unique(np.round(data.bearing[there] % 360.0, 6) % 360.0, return_inverse=True)
    many = len(turned)
    node = i * many + j
    even = bool(np.abs(turned - np.arange(many) * 360.0 / many).max() < EVEN_DEG)
    full = 2 * len(np.unique(node)) >= len(at) * many
    if not (even and full and many >= FEWEST_BEARINGS and len(at) >= FEWEST_DISTANCES):
        where = ", ".join(r.source for r in data.recordings)
        raise CalibrationError(
            f"{where}: form lookup: expected at least {FEWEST_DISTANCES} distances with the same "
            f"{FEWEST_BEARINGS} or more bearings each, at equal steps all round from straight ahead on, got "
            f"{len(np.unique(node))} places at {len(at)} distances and {many} bearings. Record them "
            "(realitygap record --plan infrared), or take another form."
        )
    return Ring(at=at, bearings=many, rows=there, node=node)


def replayed(data: Readings, use: Use) -> Floats:
    """[n, S] readings at every row's place by tables of the rows in `use` [n]."""
    read = np.zeros(data.counts.shape)
    for ring in rings(data).values():
        read[ring.rows] = ring.table(data.counts, use)[ring.node]
    return read


def fit_lookup(data: Readings, base: Profile, *, intervals: bool = True) -> Outcome:
    """A table of the rows in use."""
    for recording in data.recordings:
        if recording.pose is not None or recording.body_outline_cm:
            why = "poses in a room" if recording.pose is not None else "a body with an outline"
            raise CalibrationError(
                f"{recording.source}: form lookup: expected distances and bearings from a round body, got "
                f"{why}. Take another form."
            )
        unread = np.flatnonzero(~np.isfinite(recording.counts).all(axis=0)).tolist()
        if unread:
            raise CalibrationError(
                f"{recording.source}: form lookup: expected readings of every sensor at every place, got "
                f"some without sensors {unread}: no table can replay them. Take another form."
            )
    use = data.use.any(axis=1)
    fit = Fit(values={}, model=replayed(data, use))
    return Outcome(profile=_profile(data, base, use) if intervals else base, fit=fit)


def _profile(data: Readings, base: Profile, use: Use) -> Profile:
    """The base with the table in place of equation and curves; a kind that was not recorded uses the other's
    table."""
    law, places = base.infrared, rings(data)
    away = (data.bearing[:, None] - [s.direction_deg for s in law.sensors] + 180.0) % 360.0 - 180.0
    behind = np.abs(away) > BEHIND_DEG
    nothing = np.where(behind, data.counts, 0.0).sum(axis=0) / behind.sum(axis=0)
    both: dict[str, Any] = {}
    for name, other in ((WALL, CYLINDER), (CYLINDER, WALL)):
        ring = places.get(name) or places[other]
        table = ring.table(data.counts, use)
        both |= {f"{name}_cm": ring.at.tolist(), name: table.T.round(2).tolist()}
    looked_up = LookUp(nothing=nothing.round(2).tolist(), **both)
    sensors = with_columns(law.sensors, {"curve": [()] * len(law.sensors), "noise": [()] * len(law.sensors)})
    law = unchecked(law, sensors=sensors, table=looked_up, dead=dead_zone(data))
    return replace(base, infrared=checked(law))


def beyond(data: Readings, profile: Profile) -> list[str]:
    """Warnings about situations that the profile's table does not cover."""
    table, top, said, places = profile.infrared.table, profile.infrared.top, [], rings(data)
    for name, other in ((WALL, CYLINDER), (CYLINDER, WALL)):
        if name not in places:
            said.append(f"infrared: no {name} was recorded: it is taken to read like a {other}")
    for name, ring in places.items():
        counts = np.array(getattr(table, name)).reshape(-1, len(ring.at), ring.bearings)
        left = float((counts[:, -1] - np.array(table.nothing)[:, None]).max())
        if left > LIT_SHARE * top:
            said.append(
                f"infrared: {ring.at[-1]:g} cm before a {name}, the farthest recorded, sensors read up to "
                f"{left:.0f} counts more than of nothing: beyond, the table reads nothing. Record farther off"
            )
        if ring.at[0] > 0:
            said.append(
                f"infrared: nearer to a {name} than {ring.at[0]:g} cm, the nearest recorded, the table reads "
                "what was read there"
            )
    return said
