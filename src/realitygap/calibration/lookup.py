"""The form "lookup": a table of mean readings with linear interpolation between places, without a model.

The approach of the paper's reference [15]: readings recorded round a wall and round a cylinder, replayed.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from realitygap.calibration.forms import with_columns
from realitygap.calibration.rows import LIT_SHARE, Rows, dead_zone
from realitygap.calibration.solve import Fit
from realitygap.errors import CalibrationError
from realitygap.values import Floats
from realitygap.world.robot import Profile
from realitygap.world.sensors import LookUp

__all__ = ["Ring", "fit_lookup", "rings", "without"]

FEWEST_BEARINGS, FEWEST_DISTANCES = 8, 2
EVEN_DEG = 0.01
BEHIND_DEG = 120.0
"""A sensor facing this far away from the object sees nothing of it."""
NEAREST = 1e-9
"""Weight of a place known on one side only: it matters only where nothing else is known."""
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

    def table(self, counts: Floats, use: NDArray[np.bool_]) -> Floats:
        """[D · B, S] mean readings [n, S] of each place; places without rows in `use` [n] are interpolated
        linearly, or take the nearest value at an end."""
        there = use[self.rows]
        node, read = self.node[there], counts[self.rows[there]]
        size = len(self.at) * self.bearings
        many = np.bincount(node, minlength=size)
        sums = np.stack([np.bincount(node, column, minlength=size) for column in read.T], 1)
        mean = (sums / np.maximum(many, 1)[:, None]).reshape(len(self.at), self.bearings, -1)
        return np.asarray(self._filled(mean, (many > 0).reshape(mean.shape[:2])).reshape(size, -1))

    def _filled(self, mean: Floats, known: NDArray[np.bool_]) -> Floats:
        """[D, B, S] with unknown places [D, B] interpolated along distances and along bearings, the shorter
        line with more weight."""
        if known.all():
            return mean
        said, weights = np.zeros(mean.shape), np.zeros((*known.shape, 1))
        turns = np.arange(3.0 * self.bearings)
        for j in range(self.bearings):
            value, weight = _line(self.at, mean[:, j], known[:, j])
            said[:, j] += weight * value
            weights[:, j] += weight
        for i in range(len(self.at)):
            round_again = (np.concatenate([part[i]] * 3) for part in (mean, known))
            value, weight = (part[self.bearings : -self.bearings] for part in _line(turns, *round_again))
            said[i] += weight * value
            weights[i] += weight
        return np.where(known[..., None], mean, said / weights)


def _line(at: Floats, values: Floats, known: NDArray[np.bool_]) -> tuple[Floats, Floats]:
    """[n, S] values interpolated between the known ones of [n, S] at places [n], constant beyond the last;
    and the weights [n, 1]: one over the line's length, almost 0 beyond the last."""
    there = np.flatnonzero(known)
    if not len(there):
        return values, np.zeros((len(at), 1))
    after = np.searchsorted(there, np.arange(len(at)))
    left, right = there[np.maximum(after - 1, 0)], there[np.minimum(after, len(there) - 1)]
    inside = (right > left)[:, None]
    share = ((at - at[left]) / np.where(right > left, at[right] - at[left], 1.0))[:, None]
    value = np.where(inside, values[left] + share * (values[right] - values[left]), values[left])
    return value, np.where(inside, 1.0 / np.maximum(right - left, 1)[:, None], NEAREST)


def rings(rows: Rows) -> dict[str, Ring]:
    """The places of all recordings, by kind of object.

    Raises:
        CalibrationError: bearings are not at equal steps all round, or there are several radii.
    """
    radii = {r.object: r.source for r in rows.recordings if r.radius_cm is not None}
    if len(radii) > 1:
        (one, here), (two, there) = list(radii.items())[:2]
        raise CalibrationError(
            f"form lookup: expected cylinders of one radius, got {one} in {here} and {two} in {there}: a "
            "table has one for all. Leave one out."
        )
    kind = np.concatenate([np.full(len(r.counts), r.object.partition(":")[0]) for r in rows.recordings])
    return {name: _ring(rows, np.flatnonzero(kind == name)) for name in np.unique(kind).tolist()}


def _ring(rows: Rows, there: NDArray[np.int64]) -> Ring:
    at, i = np.unique(np.round(rows.distance[there], 6), return_inverse=True)
    turned, j = np.unique(np.round(rows.bearing[there] % 360.0, 6) % 360.0, return_inverse=True)
    many = len(turned)
    node = i * many + j
    even = bool(np.abs(turned - np.arange(many) * 360.0 / many).max() < EVEN_DEG)
    full = 2 * len(np.unique(node)) >= len(at) * many
    if not (even and full and many >= FEWEST_BEARINGS and len(at) >= FEWEST_DISTANCES):
        where = ", ".join(r.source for r in rows.recordings)
        raise CalibrationError(
            f"{where}: form lookup: expected at least {FEWEST_DISTANCES} distances with the same "
            f"{FEWEST_BEARINGS} or more bearings each, at equal steps all round from straight ahead on, got "
            f"{len(np.unique(node))} places at {len(at)} distances and {many} bearings. Record them "
            "(realitygap record --plan infrared), or take another form."
        )
    return Ring(at=at, bearings=many, rows=there, node=node)


def without(rows: Rows, round_object: Mapping[str, Ring], out: NDArray[np.bool_]) -> Floats:
    """[n, S] readings at every row's place by tables of all rows but `out` [n]."""
    read = np.zeros(rows.counts.shape)
    for ring in round_object.values():
        read[ring.rows] = ring.table(rows.counts, ~out)[ring.node]
    return read


def fit_lookup(rows: Rows, base: Profile) -> tuple[Profile, Fit, Floats, list[str]]:
    """The profile, its readings [n, S], those on held-out places [n, S], and warnings about what the table
    lacks.

    Raises:
        CalibrationError: the recordings cannot be made into a table.
    """
    for recording in rows.recordings:
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
    places, nobody = rings(rows), np.zeros(len(rows.counts), bool)
    read, held_out = without(rows, places, nobody), np.zeros(rows.counts.shape)
    for out in rows.held_out(lambda: None):
        held_out[out] = without(rows, places, out)[out]
    fit = Fit(values={}, constants=(), alike=(), model=read)
    profile = _profile(rows, base, places)
    return profile, fit, held_out, _beyond(places, profile)


def _profile(rows: Rows, base: Profile, places: Mapping[str, Ring]) -> Profile:
    """The base with the table in place of equation and curves; a kind that was not recorded uses the other's
    table."""
    law = base.infrared
    away = (rows.bearing[:, None] - [s.direction_deg for s in law.sensors] + 180.0) % 360.0 - 180.0
    behind = np.abs(away) > BEHIND_DEG
    nothing = np.where(behind, rows.counts, 0.0).sum(axis=0) / behind.sum(axis=0)
    both: dict[str, Any] = {}
    for name, other in ((WALL, CYLINDER), (CYLINDER, WALL)):
        ring = places.get(name) or places[other]
        table = ring.table(rows.counts, np.ones(len(rows.counts), bool))
        both |= {f"{name}_cm": ring.at.tolist(), name: table.T.round(2).tolist()}
    looked_up = LookUp(nothing=nothing.round(2).tolist(), **both)
    sensors = with_columns(law.sensors, {"curve": [()] * len(law.sensors), "noise": [()] * len(law.sensors)})
    return replace(base, infrared=replace(law, sensors=sensors, table=looked_up, dead=dead_zone(rows)))


def _beyond(places: Mapping[str, Ring], profile: Profile) -> list[str]:
    """Warnings about situations that the table does not cover."""
    table, top, said = profile.infrared.table, profile.infrared.top, []
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
