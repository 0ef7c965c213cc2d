"""The numbers that describe a trial, each with its just-noticeable difference.

These differences are physical and fixed: what a person can just notice when watching two films side by side.
They were chosen from the size and speed of a Khepera (5.8 cm, up to 8 cm/s); changes after a look at
exemplars are listed with the validation of the score (studies/correspondence). They never depend on the
compared sets.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from realitygap.values import Floats
from realitygap.world.arena import Arena

__all__ = ["DESCRIPTORS", "FOR_LARGE", "FOR_NAMES", "Descriptor", "chosen", "mirrored"]


class Descriptor(NamedTuple):
    """A number that describes a trial."""

    name: str
    unit: str
    noticeable: float
    """The just-noticeable difference, in that unit."""
    needs: str = "motion"
    """motion: the track alone; walls: an arena; light: a lamp in it."""
    handed: bool = False
    """Changes sign in a mirror."""


DESCRIPTORS = (
    Descriptor("speed", "cm/s", 0.5),
    Descriptor("speed spread", "cm/s", 0.5),
    Descriptor("backward", "share of time", 0.1),
    Descriptor("reversals", "in 10 s", 1.0),
    Descriptor("still", "share of time", 0.1),
    Descriptor("turn rate", "deg/s", 8.0),
    Descriptor("net turn", "deg/s", 8.0, handed=True),
    Descriptor("usual turn", "deg/s", 5.0),
    Descriptor("straight", "share of time", 0.1),
    Descriptor("turns", "in 10 s", 1.0),
    Descriptor("turn size", "deg", 20.0),
    Descriptor("side of turns", "share of turning", 0.4, handed=True),
    Descriptor("one-sidedness", "share of turning", 0.15),
    Descriptor("looping", "share of time", 0.15),
    Descriptor("jitter", "deg/s", 4.0),
    Descriptor("spread", "cm", 3.0),
    Descriptor("ground", "places", 3.0),
    Descriptor("clearance", "cm", 1.0, "walls"),
    Descriptor("near", "share of time", 0.1, "walls"),
    Descriptor("touching", "share of time", 0.1, "walls"),
    Descriptor("along", "share of time", 0.1, "walls"),
    Descriptor("turning clearance", "cm", 0.5, "walls"),
    Descriptor("light distance", "cm", 5.0, "light"),
    Descriptor("light reached", "cm", 5.0, "light"),
    Descriptor("light bearing", "deg", 10.0, "light"),
    Descriptor("light response", "deg/s", 5.0, "light"),
)

FOR_NAMES = (
    Descriptor("free bend", "deg/cm", 2.0, "walls", handed=True),
    Descriptor("free straight", "share of time", 0.1, "walls"),
    Descriptor("turning away", "share of turning", 0.15, "walls"),
    Descriptor("side near", "share of turning", 0.15, "walls", handed=True),
    Descriptor("wall side", "share of time", 0.15, "walls", handed=True),
)
"""Descriptors that distinguish kinds of behaviour and are not part of a score: movement far from everything;
whether it turns away from what is ahead, and always to one side; on which side it has walls."""
FOR_LARGE = (
    Descriptor("bend to wall", "deg/cm", 1.0, "walls"),
    Descriptor("wall distance spread", "cm", 1.0, "walls"),
    Descriptor("turning in touch", "share of turning", 0.15, "walls"),
)
"""Descriptors for robots that see little to their sides: whether it bends back to a wall beside it, how
evenly it keeps its distance, and how much of its turning is due to a wall."""


def chosen(arena: Arena | None) -> tuple[Descriptor, ...]:
    """The descriptors that are defined in an arena; without one those of motion alone."""
    told = {"motion"} | ({"walls"} if arena else set()) | ({"light"} if arena and arena.lamps else set())
    return tuple(d for d in DESCRIPTORS if d.needs in told)


def mirrored(descriptors: Sequence[Descriptor]) -> Floats:
    """Signs [d] that turn a row of descriptors into that of its mirror image."""
    return np.array([-1.0 if d.handed else 1.0 for d in descriptors])
