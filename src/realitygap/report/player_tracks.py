"""One drive in the page's player: poses, readings, commands and a network's outputs, packed.

Numbers are packed as little-endian int16 or int8 in base64: a tenth of the size of JSON.
"""

import base64
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from realitygap.control.genotype import Genotype
from realitygap.robots.drive import Recording
from realitygap.track import Track, Trajectory
from realitygap.values import Floats
from realitygap.world.robot import TOP_INPUT, Profile

__all__ = ["LOST", "activity", "decided", "pack", "poses_of", "track"]

LOST = -32768
"""A missing number: the camera lost the robot."""
TURN = 100.0
"""Headings are packed in hundredths of a degree."""
DIGITS = 9
"""More digits than a file has, fewer than a heading loses in conversions from degrees and back."""


def pack(values: ArrayLike, kind: str) -> str:
    """Whole numbers as base64: `kind` is "<i2" or "i1"; NaN becomes LOST; larger values are clipped."""
    numbers = np.asarray(values, np.float64)
    limits = np.iinfo(np.dtype(kind))
    lowest = limits.min + 1 if kind == "<i2" else limits.min
    whole = np.clip(np.round(np.nan_to_num(numbers)), lowest, limits.max)
    whole = np.where(np.isnan(numbers), limits.min, whole)
    return base64.b64encode(np.ascontiguousarray(whole).astype(kind).tobytes()).decode("ascii")


def poses_of(track: Track) -> Floats:
    """Poses [n, 3] in cm, cm, degrees, with exactly a file's digits; NaN where the robot was lost."""
    return np.stack([track.x, track.y, track.heading_deg.round(DIGITS)], axis=1)


def decided(drive: Trajectory | Recording, profile: Profile) -> NDArray[np.int64]:
    """A drive's commands [n, 2] from −10 to 10: a recording has them in the robot's own units."""
    if isinstance(drive, Trajectory):
        return drive.commands
    outputs = np.rint(drive.commands * (TOP_INPUT / profile.wheels.top_command))
    return np.asarray(outputs, np.int64)


def activity(
    genotype: Genotype, inputs: NDArray[np.int64], commands: NDArray[np.int64], slots: Sequence[int]
) -> NDArray[np.int64] | None:
    """Outputs [n, slots] of a network's neurons at the end of each step, by replaying a drive.

    Args:
        genotype: whose network it is.
        inputs: its inputs [n, I].
        commands: the commands [n, 2]; if the network's differ, it is not the one that drove, and the result
            is None.
        slots: the neurons.
    """
    controller = genotype.controller()
    shown = np.zeros((len(inputs), len(slots)), np.int64)
    for k, (fed, command) in enumerate(zip(inputs.tolist(), commands.tolist(), strict=True)):
        decided = controller.decide(fed)
        if [decided.left, decided.right] != command:
            return None
        outputs = controller.outputs
        shown[k] = [outputs[slot] for slot in slots]
    return shown


def track(
    who: str,
    score: str,
    poses: Floats,
    unit_cm: float,
    *,
    readings: Floats | None = None,
    commands: NDArray[np.int64] | None = None,
    outputs: NDArray[np.int64] | None = None,
) -> dict[str, object]:
    """One drive for the page; rows of internal data belong to the first n poses.

    Args:
        who: the driver, in words.
        score: as in the tables.
        poses: [n + 1, 3] cm, cm, degrees.
        unit_cm: unit of packed positions.
        readings: [n, S] counts of the sensors that the task feeds, if known.
        commands: [n, 2], −10 to 10, if known.
        outputs: [n, N] of the network's neurons, if known.
    """
    steps = len(poses) - 1
    packed = {"poses": pack(poses * np.array([1 / unit_cm, 1 / unit_cm, TURN]), "<i2")}
    inside = {"readings": (readings, "<i2"), "commands": (commands, "i1"), "outputs": (outputs, "i1")}
    rows = {
        name: pack(values, kind) if values is not None and len(values) == steps > 0 else None
        for name, (values, kind) in inside.items()
    }
    return {"who": who, "score": score, "steps": steps, **packed, **rows}
