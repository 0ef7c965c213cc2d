"""A look-up table of proximity readings: what a robot's sensors read round each kind of object."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from realitygap.kernels.params import Seen, Table
from realitygap.world.files import Value, require

__all__ = ["LookUp"]

FEWEST = 2
"""Distances, and bearings, between which there is a line."""


@dataclass(frozen=True, kw_only=True)
class LookUp(Value):
    """What proximity sensors read round objects, in the place of a law (the paper's reference [15]).

    `nothing` holds each sensor's counts where nothing is near; without any there is no table. `wall_cm` are
    distances from the body's edge, rising; `wall` a row a sensor, of counts: all bearings, at equal steps
    counter-clockwise from the robot's front, at the first distance, then at the next. So for cylinders, from
    edge to edge, whatever their radius. How readings follow: `kernels/replay.py`.
    """

    nothing: tuple[float, ...] = ()
    wall_cm: tuple[float, ...] = ()
    wall: tuple[tuple[float, ...], ...] = ()
    cylinder_cm: tuple[float, ...] = ()
    cylinder: tuple[tuple[float, ...], ...] = ()

    def __bool__(self) -> bool:
        return bool(self.nothing)

    def check(self, sensors: int, top: float) -> None:
        """Refuse a table that is not for these sensors and this full scale.

        Raises:
            ConfigError: names the key.
        """
        if not self and self == LookUp():
            return
        require(len(self.nothing) == sensors, "nothing", f"one of each sensor ({sensors})", self.nothing)
        require(all(0 <= v <= top for v in self.nothing), "nothing", f"0 to top ({top:g})", self.nothing)
        for key in ("wall", "cylinder"):
            at, rows = getattr(self, f"{key}_cm"), getattr(self, key)
            rising = len(at) >= FEWEST and at[0] >= 0 and all(one < two for one, two in pairwise(at))
            require(rising, f"{key}_cm", "two distances or more, rising from 0 or more", at)
            require(len(rows) == sensors, key, f"a row for each sensor ({sensors})", len(rows))
            lengths = {len(row) for row in rows}
            many = f"rows of one length, {FEWEST} bearings or more at each of {len(at)} distances"
            fits = len(lengths) == 1 and min(lengths) % len(at) == 0 and min(lengths) >= FEWEST * len(at)
            require(fits, key, many, sorted(lengths))
            ends = min(map(min, rows)), max(map(max, rows))
            require(ends[0] >= 0 and ends[1] <= top, key, f"counts from 0 to top ({top:g})", ends)

    def to_kernel(self) -> Table | tuple[()]:
        """The table as the kernels take it; (): none."""
        if not self:
            return ()
        nothing = np.array(self.nothing)

        def seen(at: tuple[float, ...], rows: tuple[tuple[float, ...], ...]) -> Seen:
            counts = np.array(rows).T.reshape(len(at), -1, len(rows))
            return Seen(at=np.array(at), added=np.ascontiguousarray(counts - nothing))

        return Table(nothing, seen(self.wall_cm, self.wall), seen(self.cylinder_cm, self.cylinder))
